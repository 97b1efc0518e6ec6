"""Angle-dependent stiffness of a gear: stiffness varies periodically with the angle.

==========  ==========================================================================
Equation    K(q) = K (1 + ratio cos(order q + phase)), q the reported angle
Source      law: first term of a Fourier series; size chosen: 3 to 10 %
Valid       deflections that are small beside a period
Ignores     the energy that a turn of the axis under load would exchange
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
class AngleDependentStiffness(CommandEffect):
    """The stiffness of one axis' own spring changes with the axis' angle.

    Attributes:
        ratio: Largest change over the mean.
        order: Periods per turn of the axis.
        phase_rad: Phase at the axis' zero.
    """

    name: ClassVar[str] = "angle_dependent_stiffness"
    ratio: float = size(0.05, -0.9, 0.9)
    order: float = form(2.0)
    phase_rad: float = form(0.0)

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        a = arm.axes.index(arm.axis(self.where))
        wave = np.cos(self.order * posture[:, a] + self.phase_rad)
        stiffness = np.zeros_like(posture)
        stiffness[:, a] = nominal.stiffness[:, a] * self.ratio * wave
        return Command(np.zeros_like(posture), stiffness)
