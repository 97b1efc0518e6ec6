"""Angle-dependent stiffness of a gear: compliance varies with harmonics of the angle.

==========  ==========================================================================
Equation    θ = C τ + s u sum over up to three orders n of (a_n cos nq + b_n sin nq), u
            and s = du/dτ as in `hysteresis`, τ and 1 for a linear spring; K(q) = K (1 +
            r), r = ratio cos(nq + φ), K at no torque, with ρ = √(a² + b²) K/2, ratio =
            2ρ/(1 + ρ²), φ = atan2(b, -a), of the wave that is largest; of its gear's
            torque it carries -u (w - mean of w)/C, w the compliance of all waves
Source      Fourier series of 1/(1 + e cos x): Gradshteyn, Ryzhik, "Table of integrals,
            series and products", 3.613
Valid       orders n up to 6, q the reported angle, wind-ups small against a period
Ignores     the hundreds of orders of a gear's teeth; second and third harmonics of
            other forms of the law; products of two waves
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import (
    ORDERS_APART,
    Coeffs,
    Hypothesis,
    Shape,
    Shapes,
    apart,
    orders,
    sprung,
)
from stiffness.effects.jacobian import EffectJacobian, hstack, turn
from stiffness.experiment.static_state import StaticState

MOST_UNEVEN = 0.9
"""Largest share of a compliance that other laws are corrected for; chosen."""
TINY = 1e-300


@dataclass(frozen=True)
class AngleDependentStiffness(Hypothesis):
    """Compliance of an axis that varies with a few periods per turn.

    Its shape holds the order of each wave; the largest one is reported.
    """

    effect: ClassVar[str] = "angle_dependent_stiffness"
    sized_by: ClassVar[str] = "ratio"
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 0.0}
    shape_names: ClassVar[tuple[str, ...]] = ("order",)
    is_sum: ClassVar[bool] = True
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
    def further(
        self, found: Mapping[str, float], shape: Shape, coefficients: Coeffs
    ) -> list[dict[str, float]]:
        ratio = min(found["ratio"], 1.0)
        rho = ratio / (1.0 + np.sqrt(1.0 - ratio**2))
        largest = np.max(np.hypot(*coefficients.reshape(-1, 2).T))
        return _harmonics(shape, coefficients, largest / (2.0 * max(rho, 1e-12)))[1:]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        felt = situation.softness_of(k) * self._wound(situation, k)
        return turn(k, *_columns(situation, k, shape, felt))

    @override
    def parallel_torque(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, np.ndarray]:
        k = situation.axis(where)
        wound = self._wound(situation, k)
        softer = _softening(situation, k, shape, coefficients)
        uneven = softer - _mean(softer, wound)
        share = uneven / situation.unloaded_compliance(k)
        return {k: -np.clip(share, -MOST_UNEVEN, MOST_UNEVEN) * wound}

    @override
    def mean_softening(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, float]:
        k = situation.axis(where)
        softer = _softening(situation, k, shape, coefficients)
        return {k: _mean(softer, self._wound(situation, k))}

    def _wound(self, situation: StaticState, k: int) -> Float[np.ndarray, " rows"]:
        """Return torques of an axis that would wind up its spring alike, if linear."""
        own = (self.effect, situation.axes[k])
        return situation.wound(k, situation.spring_torque(k, own))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        multiples = (m * order for order in shape for m in (2.0, 3.0))
        found = apart(multiples, ORDERS_APART, shape)
        others = [self.jacobian(situation, where, np.array([n])) for n in found]
        k = situation.axis(where)
        if situation.is_curved(k):
            # all of the spring varies, not its slope at no torque
            wound = self._wound(situation, k)
            others.append(turn(k, *_columns(situation, k, shape, wound)))
        return hstack(others)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        mean = situation.unloaded_compliance(situation.axis(where))
        return _harmonics(shape, coefficients, mean)[0]


def _columns(
    situation: StaticState, k: int, shape: Shape, felt: Float[np.ndarray, " rows"]
) -> list[Float[np.ndarray, " rows"]]:
    """Return a turn that an axis feels times the waves of its angle."""
    phases = [n * situation.recording.posture[:, k] for n in shape]
    return [felt * f(phase) for phase in phases for f in (np.cos, np.sin)]


def _softening(
    situation: StaticState, k: int, shape: Shape, coefficients: Coeffs
) -> Float[np.ndarray, " rows"]:
    """Return the compliance that all waves add at an axis' angles, in rad/(N m)."""
    columns = _columns(situation, k, shape, np.ones(situation.rows))
    return np.stack(columns, axis=1) @ coefficients


def _mean(
    softer: Float[np.ndarray, " rows"], wound: Float[np.ndarray, " rows"]
) -> float:
    """Return the one compliance that turns an axis most like another in each row."""
    return float(softer @ wound**2 / max(float(wound @ wound), TINY))


def _harmonics(
    shape: Shape, coefficients: Coeffs, mean: float
) -> list[dict[str, float]]:
    """Return the parameters of each wave, the largest first."""
    found = []
    for n, (a, b) in zip(shape, coefficients.reshape(-1, 2), strict=True):
        rho = np.hypot(a, b) / (2.0 * mean)
        ratio, phase = 2.0 * rho / (1.0 + rho**2), np.arctan2(b, -a)
        found.append({"ratio": ratio, "order": n, "phase_rad": phase})
    return sorted(found, key=lambda wave: -wave["ratio"])
