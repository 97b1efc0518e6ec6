"""Angle-dependent stiffness of a gear: compliance varies with harmonics of the angle.

==========  ==========================================================================
Equation    θ = C τ + s u (a cos nq + b sin nq), u and s = du/dτ as in `hysteresis`, τ
            and 1 for a linear spring; K(q) = K (1 + r), r = ratio cos(nq + φ), K at no
            torque, with ρ = √(a² + b²) K/2, ratio = 2ρ/(1 + ρ²), φ = atan2(b, -a);
            of its gear's torque it carries u r/(1 + r)
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
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, orders, sprung
from stiffness.effects.jacobian import EffectJacobian, hstack, turn
from stiffness.experiment.static_state import StaticState

MOST_UNEVEN = 0.9
"""Largest ratio that springs and other laws are corrected for; chosen."""


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
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return orders(situation, situation.axis(where))[:, None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        phase = shape[0] * situation.recording.posture[:, k]
        torque = situation.spring_torque(k, (self.effect, where))
        felt = situation.softness_of(k) * situation.wound(k, torque)
        return turn(k, felt * np.cos(phase), felt * np.sin(phase))

    @override
    def parallel_torque(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, np.ndarray]:
        k = situation.axis(where)
        own = self.parameters(situation, where, shape, coefficients)
        phase = shape[0] * situation.recording.posture[:, k] + own["phase_rad"]
        wave = min(own["ratio"], MOST_UNEVEN) * np.cos(phase)
        torque = situation.spring_torque(k, (self.effect, where))
        return {k: wave / (1.0 + wave) * situation.wound(k, torque)}

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        others = [self.jacobian(situation, where, n * shape) for n in (2.0, 3.0)]
        k = situation.axis(where)
        if situation.is_curved(
            k
        ):  # all of the spring varies, not its slope at no torque
            wound = situation.wound(k, situation.spring_torque(k, (self.effect, where)))
            phase = shape[0] * situation.recording.posture[:, k]
            others.append(turn(k, wound * np.cos(phase), wound * np.sin(phase)))
        return hstack(others)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        a, b = coefficients
        mean = situation.unloaded_compliance(situation.axis(where))
        rho = np.hypot(a, b) / (2.0 * mean)
        return {
            "ratio": 2.0 * rho / (1.0 + rho**2),
            "order": shape[0],
            "phase_rad": np.arctan2(b, -a),
        }
