"""Warming gear: compliance that grows visit by visit.

==========  ==========================================================================
Equation    K(v) = K (1 - ratio (1 - exp(-v/visits))), v the number of the visit
Source      first-order warming of a lump of metal (Newton's law of cooling); sizes
            chosen: grease and flexspline lose a few percent
Valid       visits of equal length
Ignores     cooling while the arm rests
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import Command, CommandEffect, form, size
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class WarmingGear(CommandEffect):
    """The stiffness of one axis' own spring falls with the number of visits.

    Attributes:
        ratio: Share of the stiffness that is lost in the end.
        visits: After how many visits 63 % of it are lost.
    """

    name: ClassVar[str] = "warming_gear"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    ratio: float = size(0.05, 0.0)
    visits: float = form(50.0, 1.0)

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        a = arm.axes.index(arm.axis(self.where))
        warm = -np.expm1(-np.arange(len(posture)) / self.visits)
        stiffness = np.zeros_like(posture)
        stiffness[:, a] = -self.ratio * warm * nominal.stiffness[:, a]
        return Command(np.zeros_like(posture), stiffness)
