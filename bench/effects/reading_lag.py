"""Reading lag: an axis is read before it rests, and goes on along its last move.

==========  ==========================================================================
Equation    q = q_reported + lag_rad s + share_lag_rad u, s = 1 or −1 the direction of
            the axis' last move, 0 before its first; u = Δq / max_j |Δq_j| its share of
            the arm's last move
Source      ISO 9283:1998, position stabilisation: a pose is attained once the motion
            has died out; what is read before lags behind it, or leads where it swings
            back. First-order settling has v T exp(−t / T) still to go, and the axes of
            a synchronised move arrive at speeds v in proportion to their ways
Valid       readings at rest, taken the same time after every arrival
Ignores     speed and length of the whole move, beyond an axis' share of it
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
        lag_rad: Angle at rest less the reported one, along the last move, whatever the
            move was; negative: the report leads.
        share_lag_rad: The same in proportion to the axis' share of the move.
    """

    name: ClassVar[str] = "reading_lag"
    lag_rad: float = 3e-4
    share_lag_rad: float = 0.0

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        reference = np.zeros_like(posture)
        if nominal.moves is not None:
            a = arm.axes.index(arm.axis(self.where))
            constant = self.lag_rad * nominal.moves.side[:, a]
            reference[:, a] = constant + self.share_lag_rad * nominal.moves.share[:, a]
        return Command(reference, np.zeros_like(posture))
