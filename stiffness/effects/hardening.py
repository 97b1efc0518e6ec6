"""Hardening of a strain-wave gear: compliance falls with the torque.

==========  ==========================================================================
Equation    θ = τ/K3 + a f(τ), 1/K1 = 1/K3 + a; in pieces f = (1 - m) c(τ, T1)
            + m c(τ, r T1), c = τ up to the knee T, T beyond, rounded over T/10;
            smooth f = s T1 arctan(τ/(s T1))
Source      Harmonic Drive's three-piece table (CHA engineering data 1018854) as a
            function of torque; r = T2/T1: 3.1 to 3.7, m = (1/K2 - 1/K3)/(1/K1 - 1/K3):
            0.12 to 0.32 over its sizes 14 to 32; s = 1.2, whose slope falls as the
            table's
Valid       static torques of either sign, gravity's included, symmetric
Ignores     hysteresis; pieces without rounding, a tanh (its variants)
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import CurvedSpring, StaticState

MIDDLE, SECOND = 0.15, 3.5
"""m and r; chosen: between the table's sizes 25 and 32. Where no torque reaches T2, K3
is K2 by this share: right within an eighth of K3/K1 - 1 for them, low for size 14."""
MIDDLE_SIGMA, SECOND_SIGMA = 0.06, 0.17
"""Standard deviations of m and r over gears: of a uniform draw from the table's."""
ROUND = 0.1
"""Width over which a knee is rounded, over its torque; chosen: teeth engage one by
one."""
KNEES = (0.025, 0.045, 0.08, 0.12, 0.2, 0.32, 0.5, 0.75)
"""T1 over the axis' largest torque; chosen: gravity may wind a gear up by forty times
T1, and a knee below would be lost motion. The smooth law's stand twice as far apart."""
ARCTAN = 1.2
"""s of the smooth law: its torque scale over T1."""
LEAST = 1e-9
"""Least torque scale in N m, of an axis that is never loaded."""
PIECES, SMOOTH = 0, 1
"""Forms of the law; the readings choose."""


@dataclass(frozen=True)
class Hardening(Hypothesis):
    """Axis whose gear grows stiffer with the torque."""

    effect: ClassVar[str] = "hardening"
    sized_by: ClassVar[str] = "stiffness_ratio"
    neutral: ClassVar[Mapping[str, float]] = {"stiffness_ratio": 1.0}
    shape_names: ClassVar[tuple[str, ...]] = ("torque_nm", "law")
    size_of_variants: ClassVar[float | None] = 1.0
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "stiffness_ratio": (1.0, 10.0),
        "torque_nm": (0.0, np.inf),
    }

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        sprung = situation.compliance > 0.0
        return tuple(a for a, soft in zip(situation.axes, sprung, strict=True) if soft)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        largest = np.max(np.abs(situation.torque[:, situation.axis(where)]))
        return np.array(
            [
                (largest * knee, law)
                for law, knees in ((PIECES, KNEES), (SMOOTH, KNEES[1::2]))
                for knee in knees
            ]
        )

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        return turn(k, _bent(shape)(situation.torque[:, k]))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        torque, knee = situation.torque[:, k], shape[0]
        sharp = [np.clip(torque, -x, x) for x in (knee, SECOND * knee)]
        other = SMOOTH if round(shape[1]) == PIECES else PIECES
        slow = _bent(np.array([knee, other]))(torque)
        fast = [x * np.tanh(torque / x) for x in (0.7 * knee, knee, 1.5 * knee)]
        return turn(k, *sharp, slow, *fast)

    @override
    def assumed(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return what m and r would change; below T2 the ratio hangs on m alone."""
        k = situation.axis(where)
        torque, knee = situation.torque[:, k], shape[0]
        second = bent(torque, SECOND * knee)
        later = bent(torque, (SECOND + SECOND_SIGMA) * knee)
        middle = MIDDLE_SIGMA * (second - bent(torque, knee))
        return turn(k, middle, MIDDLE * (later - second))

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        k, a = situation.axis(where), float(coefficients[0])
        fitted = float(situation.compliance[k])
        stiff = situation.unloaded_compliance(k, self.effect)
        if fitted <= 0.0 or stiff + a <= 0.0:
            return situation
        share, law, falling = a / (stiff + a), _bent(shape), _slope(shape)
        spring = CurvedSpring(
            1.0 + a / fitted,
            lambda torque: (1.0 - share) * torque + share * law(torque),
            lambda torque: (1.0 - share) + share * falling(torque),
        )
        return situation.with_curve(k, self.effect, spring)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        stiff = situation.compliance[situation.axis(where)]
        ratio = (stiff + coefficients[0]) / stiff
        return {"stiffness_ratio": ratio, "torque_nm": shape[0]}


Curve = Callable[[np.ndarray], np.ndarray]
"""Of a torque in N m."""


def _bent(shape: Shape) -> Curve:
    """Return f, of slope 1 at no torque."""
    knee = float(shape[0])
    scale = max(ARCTAN * knee, LEAST)
    if round(shape[1]) == SMOOTH:
        return lambda torque: scale * np.arctan(torque / scale)
    return lambda torque: (
        (1.0 - MIDDLE) * bent(torque, knee) + MIDDLE * bent(torque, SECOND * knee)
    )


def _slope(shape: Shape) -> Curve:
    """Return the slope of f."""
    knee = float(shape[0])
    scale = max(ARCTAN * knee, LEAST)
    if round(shape[1]) == SMOOTH:
        return lambda torque: 1.0 / (1.0 + (torque / scale) ** 2)
    return lambda torque: (
        (1.0 - MIDDLE) * slope(torque, knee) + MIDDLE * slope(torque, SECOND * knee)
    )


def bent(torque: Float[np.ndarray, "*rows"], knee: float) -> Float[np.ndarray, "*rows"]:
    """Return a torque that saturates at a knee, both in N m."""
    width = ROUND * knee
    return 0.5 * (np.hypot(torque + knee, width) - np.hypot(torque - knee, width))


def slope(
    torque: Float[np.ndarray, "*rows"], knee: float
) -> Float[np.ndarray, "*rows"]:
    """Return the slope of `bent` at a torque; 1 far below the knee, 0 far beyond."""
    width = ROUND * knee
    above, below = torque + knee, torque - knee
    return 0.5 * (above / np.hypot(above, width) - below / np.hypot(below, width))
