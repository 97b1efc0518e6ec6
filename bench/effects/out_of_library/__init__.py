"""Effects outside the library: mechanisms for blind trials without a hypothesis.

What to use when: to test whether a diagnosis reports an effect as unknown. None of them
can be asked for by name, and no hypothesis may describe one.
"""

from bench.effects.effect import Effect
from bench.effects.out_of_library.axis_crosstalk import AxisCrosstalk
from bench.effects.out_of_library.foot_lift_off import FootLiftOff
from bench.effects.out_of_library.loose_bearing import LooseBearing
from bench.effects.out_of_library.softening import Softening
from bench.effects.out_of_library.thrust_turn import ThrustTurn
from bench.effects.out_of_library.warming_gear import WarmingGear

__all__ = ["OUT_OF_LIBRARY_EFFECTS"]

OUT_OF_LIBRARY_EFFECTS: tuple[type[Effect], ...] = (
    Softening,
    ThrustTurn,
    LooseBearing,
    FootLiftOff,
    AxisCrosstalk,
    WarmingGear,
)
"""One mechanism each."""
