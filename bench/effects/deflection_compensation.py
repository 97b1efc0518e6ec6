"""Deflection compensation: the controller takes out a share of the arm's own sag.

==========  ==========================================================================
Equation    q = q_reported - ratio sag, sag = torque of the weights / stiffness, both
            of the data sheet and at the reported posture
Source      model-based compensation of elastic errors in controllers: Klimchik,
            Pashkevich, Chablat, Hovland 2013, "Compliance error compensation technique
            for parallel robots composed of non-perfect serial chains"; size: 1 takes
            out what the model says
Valid       at rest
Ignores     loads that a controller measures or is told; the sag of the compensated arm
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
class DeflectionCompensation(CommandEffect):
    """Controller that turns an axis back by what it takes for the sag.

    Attributes:
        ratio: Share of the data sheet's sag that it takes out.
    """

    name: ClassVar[str] = "deflection_compensation"
    ratio: float = 1.0

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        axis, reference = arm.axes.index(arm.axis(self.where)), np.zeros_like(posture)
        if nominal.sag is not None:
            reference[:, axis] = -self.ratio * nominal.sag()[:, axis]
        return Command(reference, np.zeros_like(posture))
