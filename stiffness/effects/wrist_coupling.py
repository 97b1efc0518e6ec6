"""Wrist coupling: torque on one wrist axis turns another through shared gears.

==========  ==========================================================================
Equation    θ₁ = C₁ τ₁ + c τ₂, θ₂ = c τ₁ + C₂ τ₂; of gears that harden τ is what winds
            a linear spring up as far, less what friction carries beside it, and θ
            follows the spring's slope there; on gear 1 it carries -c τ₂/C₁
Source      compliance through a transmission that mixes axes, T diag(1/k) Tᵀ: Salisbury
            1980, "Active stiffness control of a manipulator in Cartesian coordinates"
Valid       pairs of the last three axes
Ignores     play and friction between the two trains
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, sprung
from stiffness.effects.jacobian import EffectJacobian, JointRotation
from stiffness.experiment.static_state import Law, StaticState

WRIST = 3
"""Number of axes, counted from the tip, that form a wrist."""


@dataclass(frozen=True)
class WristCoupling(Hypothesis):
    """Two axes whose torques turn each other.

    The shape is the number of the other axis, nearer to the base, counted from 1;
    values between two numbers are rounded.
    """

    effect: ClassVar[str] = "wrist_coupling"
    linear: ClassVar[bool] = True
    shape_names: ClassVar[tuple[str, ...]] = ("with",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "compliance_rad_per_nm": (-1e-3, 1e-3),
        "with": (1.0, np.inf),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("compliance_rad_per_nm",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return tuple(a for a in situation.axes if len(partners(situation, a)))

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return partners(situation, where)[:, None] + 1.0

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        far, near = situation.axis(where), round(shape[0]) - 1
        law = (self.effect, where)
        parts = (
            _turned(situation, far, near, law),
            _turned(situation, near, far, law),
        )
        return EffectJacobian(1, parts)

    @override
    def parallel_torque(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, np.ndarray]:
        far, near = situation.axis(where), round(shape[0]) - 1
        found = {}
        for one, other in ((far, near), (near, far)):
            compliance = situation.unloaded_compliance(one)
            if compliance > 0.0:
                torque = situation.spring_torque(other, (self.effect, where))
                wound = situation.wound(other, torque)
                found[one] = -coefficients[0] / compliance * wound
        return found

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        partner = float(round(shape[0]))
        return {"compliance_rad_per_nm": coefficients[0], "with": partner}


def _turned(situation: StaticState, one: int, other: int, law: Law) -> JointRotation:
    """Return how the torque of another axis turns one; both springs may be curved."""
    wound = situation.wound(other, situation.spring_torque(other, law))
    return JointRotation(one, (situation.softness_of(one) * wound)[:, None])


def partners(situation: StaticState, where: str) -> Float[np.ndarray, " partners"]:
    """Return the wrist axes nearer to the base that an axis can couple with, from 0."""
    soft = sprung(situation)
    wrist = [a for a in situation.axes[-WRIST:] if a in soft]
    nearer = wrist[: wrist.index(where)] if where in wrist else []
    return np.array([situation.axis(a) for a in nearer], dtype=float)
