"""Angle-dependent stiffness of a gear: compliance varies with harmonics of the angle.

==========  ==========================================================================
Equation    θ = τ (C + a cos nq + b sin nq); K(q) = K (1 + ratio cos(nq + φ)) with ρ =
            √(a² + b²)/2C, ratio = 2ρ/(1 + ρ²), φ = atan2(b, -a)
Source      Fourier series of 1/(1 + e cos x): Gradshteyn, Ryzhik, "Table of integrals,
            series and products", 3.613
Valid       orders n up to 6, q the reported angle, wind-ups small against a period
Ignores     the hundreds of orders of a gear's teeth; second and third harmonics of
            other forms of the law
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, orders, sprung
from stiffness.effects.jacobian import EffectJacobian, hstack, turn
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class AngleDependentStiffness(Hypothesis):
    """Compliance of an axis that varies with a few periods per turn."""

    effect: ClassVar[str] = "angle_dependent_stiffness"
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 0.0}
    shape_names: ClassVar[tuple[str, ...]] = ("order",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "ratio": (0.0, 1.0),
        "order": (0.0, 1e3),
        "phase_rad": (-np.pi, np.pi),
    }

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return tuple(
            a for a in sprung(situation) if len(orders(situation, situation.axis(a)))
        )

    @override
    def shapes(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        return orders(situation, situation.axis(where))[:, None]

    @override
    def jacobian(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        k = situation.axis(where)
        phase = shape[0] * situation.recording.posture[:, k]
        torque = situation.torque[:, k]
        return turn(k, torque * np.cos(phase), torque * np.sin(phase))

    @override
    def variants(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        others = (self.jacobian(situation, where, n * shape) for n in (2.0, 3.0))
        return hstack([*others])

    @override
    def parameters(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        a, b = coefficients
        rho = np.hypot(a, b) / (2.0 * situation.compliance[situation.axis(where)])
        return {
            "ratio": 2.0 * rho / (1.0 + rho**2),
            "order": shape[0],
            "phase_rad": np.arctan2(b, -a),
        }
