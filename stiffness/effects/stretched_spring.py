"""Gravity compensator with free length: a spring or a cylinder on a crank.

==========  ==========================================================================
Equation    τ = torque_nm sin x (1 - f (1 - r)/w), w = √(1 + r² + 2 r cos x), x = q -
            phase_rad, r = arm_ratio, f = free_length_ratio; θ = a sin x - b (sin x)/w,
            so torque_nm = a/C, f = b/(a (1 - r))
Source      spring of length s = √(l² + c² + 2 l c cos x), free length s₀, stiffness k
            between two pins, l and c from the axis: τ = k l c sin x (1 - s₀/s),
            r = c/l, f = s₀/(l - c): Klimchik et al. 2013, arXiv 1311.6810
Valid       as `gravity_compensator`; springs that are never slack, f ≤ 1; a cylinder
            that pulls with F + k s has a free length of -F/k
Ignores     springs whose stiffness changes with their length (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Shape, Shapes, orders
from stiffness.effects.gravity_compensator import GravityCompensator, helped
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState

PHASES = np.linspace(-np.pi, np.pi, 9)
"""Of zero torque, in rad; chosen: a wave between two of them has a cosine of 0.92 with
both."""
RATIOS = (0.1, 0.4, 0.8)
"""Crank's length over the farther pin's distance; chosen: below the least the torque is
a wave and one at twice its angle, whatever the ratio; all phases are tried at the
middle."""


@dataclass(frozen=True)
class StretchedSpring(GravityCompensator):
    """An axis with the torque of a spring of some free length."""

    shape_names: ClassVar[tuple[str, ...]] = ("phase_rad", "arm_ratio")
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **GravityCompensator.limits,
        "free_length_ratio": (-1e2, 1.0),
        "arm_ratio": (0.0, 1.0),
    }
    neutral: ClassVar[Mapping[str, float]] = {"free_length_ratio": 0.0}

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        some = super().places(situation)
        return tuple(a for a in some if 1.0 in orders(situation, situation.axis(a)))

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        least, middle, most = RATIOS
        return np.array([*((x, middle) for x in PHASES), (0.0, least), (0.0, most)])

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        return turn(k, *_columns(situation.recording.posture[:, k], shape))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return waves that any spring between two pins can have."""
        k = situation.axis(where)
        angle = situation.recording.posture[:, k] - shape[0]
        return turn(k, *(np.sin(n * angle) for n in (2.0, 3.0, 4.0)))

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        k = situation.axis(where)
        columns = _columns(situation.recording.posture[:, k], shape)
        return helped(situation, k, coefficients @ np.array(columns))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        a, b = coefficients
        return {
            "torque_nm": a / situation.compliance[situation.axis(where)],
            "phase_rad": shape[0],
            "free_length_ratio": b / (a * (1.0 - shape[1])),
            "arm_ratio": shape[1],
        }


def _columns(
    angle: Float[np.ndarray, " rows"], shape: Shape
) -> tuple[Float[np.ndarray, " rows"], Float[np.ndarray, " rows"]]:
    """Return sin x and -(sin x)/w; the angle is in rad."""
    turned, ratio = angle - shape[0], shape[1]
    length = np.sqrt(1.0 + ratio**2 + 2.0 * ratio * np.cos(turned))
    wave = np.sin(turned)
    return wave, -wave / length
