"""Asymmetric stiffness of a gear: different stiffness for each sign of the torque.

==========  ==========================================================================
Equation    τ = K⁺ θ for θ > 0, K⁻ θ for θ < 0, K⁺/K⁻ = ratio; the softer side has the
            axis' own K
Source      law: one-sided linear springs; size chosen, no source for a gear
Valid       static loads
Ignores     hardening of either side, hysteresis
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import ModelEffect, size
from bench.effects.springs import NEVER, add_parallel
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class AsymmetricStiffness(ModelEffect):
    """A spring in parallel with the axis' own that carries in one direction only.

    Attributes:
        ratio: Stiffness for positive wind-up over that for negative.
    """

    name: ClassVar[str] = "asymmetric_stiffness"
    ratio: float = size(1.3, 1e-2, 100.0, off=1.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = float(spec.joint(axis).stiffness[0])
        stiffer = max(self.ratio, 1.0 / self.ratio)
        slack = (-NEVER, 0.0) if self.ratio > 1.0 else (0.0, NEVER)
        add_parallel(
            spec, f"{axis}_asymmetric", axis, (stiffer - 1.0) * own, slack=slack
        )
