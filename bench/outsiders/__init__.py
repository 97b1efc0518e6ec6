"""Arms also do what no list foresees: mechanisms for trials that have no name in it.

What to use when: to see whether a diagnosis says that it does not know. None of them
can be asked for by name, and no hypothesis may describe one.
"""

from bench.effects.effect import Effect
from bench.outsiders.axis_crosstalk import AxisCrosstalk
from bench.outsiders.foot_lift_off import FootLiftOff
from bench.outsiders.loose_bearing import LooseBearing
from bench.outsiders.softening import Softening
from bench.outsiders.thrust_turn import ThrustTurn
from bench.outsiders.warming_gear import WarmingGear

__all__ = ["OUTSIDERS"]

OUTSIDERS: tuple[type[Effect], ...] = (
    Softening,
    ThrustTurn,
    LooseBearing,
    FootLiftOff,
    AxisCrosstalk,
    WarmingGear,
)
"""One mechanism each."""
