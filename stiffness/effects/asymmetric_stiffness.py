"""Asymmetric stiffness of a gear: compliance depends on the sign of the torque.

==========  ==========================================================================
Equation    θ = C τ + a s |u|, u and s = du/dτ as in `hysteresis`, τ and 1 for a linear
            spring, |u| = √(u² + w²) - w; ratio = K+/K- = (C - a)/(C + a) far from no
            torque. Other laws of the gear act through u = τ on the softer side, whose
            slope is C + |a|, and u = τ (C - |a|)/(C + |a|) on the other
Source      even part of any law of two slopes; no source for a gear
Valid       torques of either sign; C the mean compliance of both ways
Ignores     hardening of either side; u tanh(u/w) for |u| (its variants)
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, reversing, sprung
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import CurvedSpring, StaticState

ROUND = (1e-3, 0.03, 0.1, 0.3)
"""w over the largest torque: how gradually the slope turns over. Chosen: a thousandth,
so that a torque of rounding has no side; beyond the last neither side has a slope."""


@dataclass(frozen=True)
class AsymmetricStiffness(Hypothesis):
    """Axis whose stiffness depends on the direction of the torque."""

    effect: ClassVar[str] = "asymmetric_stiffness"
    sized_by: ClassVar[str] = "ratio"
    shape_names: ClassVar[tuple[str, ...]] = ("rounding_nm",)
    logarithmic: ClassVar[tuple[str, ...]] = ("rounding_nm",)
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 1.0}
    size_of_variants: ClassVar[float | None] = 1.0
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "ratio": (0.05, 20.0),
    }

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        soft = sprung(situation)
        return tuple(a for a in reversing(situation) if a in soft)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        largest = np.max(np.abs(situation.torque[:, situation.axis(where)]))
        return largest * np.array(ROUND)[:, None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return self._turn(situation, where, partial(_even, width=shape[0]))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        widths = (x * float(shape[0]) for x in (0.5, 1.0, 2.0))
        smooth = (partial(_even_by_tanh, width=width) for width in widths)
        return self._turn(situation, where, *smooth)

    def _turn(
        self, situation: StaticState, where: str, *laws: Callable[..., np.ndarray]
    ) -> EffectJacobian:
        """Return how an axis turns by laws of u, as soft as its other laws leave it."""
        k = situation.axis(where)
        wound = situation.wound(k, situation.torque[:, k], self.effect)
        softness = situation.softness_of(k, self.effect)
        return turn(k, *(softness * law(wound) for law in laws))

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        k, half = situation.axis(where), float(coefficients[0])
        fitted = float(situation.compliance[k])
        softer = situation.unloaded_compliance(k, self.effect) + abs(half)
        if fitted <= 0.0 or 2.0 * abs(half) >= softer:
            return situation
        stiffer, side = 1.0 - 2.0 * abs(half) / softer, -np.sign(half)
        width = float(shape[0])

        def slope(torque: np.ndarray) -> np.ndarray:
            share = 0.5 * (1.0 + side * torque / np.hypot(torque, width))
            return 1.0 - (1.0 - stiffer) * share

        def wound(torque: np.ndarray) -> np.ndarray:
            on_side = 0.5 * (torque + side * _even(torque, width))
            return torque - (1.0 - stiffer) * on_side

        spring = CurvedSpring(1.0 + abs(half) / fitted, wound, slope)
        return situation.with_curve(k, self.effect, spring)

    @override
    def coefficient_of(self, size: float) -> float:
        return (size - 1.0) / (size + 1.0)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        mean = situation.unloaded_compliance(situation.axis(where), self.effect)
        half = coefficients[0]
        return {"ratio": (mean - half) / (mean + half)}


def _even(
    torque: Float[np.ndarray, "*rows"], width: float
) -> Float[np.ndarray, "*rows"]:
    """Return |u|, rounded over a width; both in N m."""
    return np.hypot(torque, width) - width


def _even_by_tanh(
    torque: Float[np.ndarray, "*rows"], width: float
) -> Float[np.ndarray, "*rows"]:
    """Return another law that is |u| far from no torque."""
    return torque * np.tanh(torque / width)
