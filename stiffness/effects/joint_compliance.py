"""Compliance of a joint that the model calls rigid.

==========  ==========================================================================
Equation    θ = compliance τ
Source      Spong 1987, "Modeling and control of elastic joint robots", at rest
Valid       an axis whose joint in the model has no stiffness
Ignores     everything that is not proportional to torque
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class JointCompliance(Hypothesis):
    """Axis with a spring where the model has none."""

    effect: ClassVar[str] = "joint_compliance"
    linear: ClassVar[bool] = True
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "compliance_rad_per_nm": (0.0, 1e-2),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("compliance_rad_per_nm",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        felt = np.any(situation.torque != 0.0, axis=0)
        found = felt & (situation.arm.stiffness == 0.0)
        return tuple(a for a, f in zip(situation.axes, found, strict=True) if f)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        return turn(k, situation.torque[:, k])
