"""Reading lag: an axis is read before it rests, and goes on along its last move.

==========  ==========================================================================
Equation    q = q_reported + lag_rad s, s = 1 or −1 the direction of the axis' last
            move, 0 before its first
Source      ISO 9283:1998, position stabilisation: a pose is attained once the motion
            has died out; what is read before lags behind it, or leads where it swings
            back
Valid       readings at rest, taken the same time after every arrival
Ignores     speed and length of the move, on which the lag depends where it is the
            settling of a controller
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import Command, CommandEffect
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class ReadingLag(CommandEffect):
    """Reported angle that lags along the axis' last move.

    Attributes:
        lag_rad: Angle at rest less the reported one, along the last move; negative: the
            report leads.
    """

    name: ClassVar[str] = "reading_lag"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    lag_rad: float = 3e-4

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        reference = np.zeros_like(posture)
        if nominal.side is not None:
            a = arm.axes.index(arm.axis(self.where))
            reference[:, a] = self.lag_rad * nominal.side[:, a]
        return Command(reference, np.zeros_like(posture))
