"""Gravity compensator: a spring between a link and the part below.

==========  ==========================================================================
Equation    τ = torque sin(q - φ), so θ = s sin q + c cos q; torque = √(s² + c²)/C, φ =
            atan2(-c, s)
Source      spring without free length: Herder 2001, "Energy-free systems"; with it:
            Klimchik et al. 2013, arXiv 1311.6810
Valid       springs and cylinders whose force grows with their length; where the axis
            hardly turns it is a constant turn, sin(q - φ) = ±1, as an encoder's offset
Ignores     free length (see `stretched_spring`); how its pull tilts the bearing, which
            turns with the axis (its variants) beside a constant part; the spring's
            share of the axis' stiffness, about torque/K; the rotation of a sensor
            beyond, a thousandth of the deflection
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, absolute, orders, sprung
from stiffness.effects.jacobian import EffectJacobian, rotation_about, turn
from stiffness.effects.statics import encoder_offset_response
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class GravityCompensator(Hypothesis):
    """An axis with a torque of one period per turn.

    Large arms have one, on the lifting axis; most arms have none.
    """

    effect: ClassVar[str] = "gravity_compensator"
    log_prior: ClassVar[float] = -np.log(10.0)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "torque_nm": (0.0, 1e5),
        "phase_rad": (-np.pi, np.pi),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("torque_nm",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if not absolute(situation):
            return ()
        turning = ~situation.arm.slides
        return tuple(a for a in sprung(situation) if turning[situation.axis(a)])

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        angle = situation.recording.posture[:, k]
        if 1.0 not in orders(situation, k):
            return encoder_offset_response(situation, k)
        return turn(k, np.sin(angle), np.cos(angle))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return how the bearing tilts under the spring's pull, which turns with it."""
        k = situation.axis(where)
        angle = situation.recording.posture[:, k]
        across = situation.seat[:, k + 1, :, :2]
        waves = (np.sin(angle), np.cos(angle))
        tilt = np.concatenate([across * w[:, None, None] for w in waves], axis=2)
        return rotation_about(k + 1, tilt, situation.origin[:, k + 1])

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        k = situation.axis(where)
        if len(coefficients) != 2:
            return situation
        angle, (s, c) = situation.recording.posture[:, k], coefficients
        return helped(situation, k, s * np.sin(angle) + c * np.cos(angle))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        k = situation.axis(where)
        compliance = situation.compliance[k]
        if len(coefficients) == 1:
            (size,) = coefficients
            angle = float(np.mean(situation.recording.posture[:, k]))
            phase = angle - np.copysign(np.pi / 2, size)
            return {
                "torque_nm": np.abs(size) / compliance,
                "phase_rad": (phase + np.pi) % (2 * np.pi) - np.pi,
            }
        s, c = coefficients
        return {
            "torque_nm": np.hypot(s, c) / compliance,
            "phase_rad": np.arctan2(-c, s),
        }


def helped(
    situation: StaticState, axis: int, turned: Float[np.ndarray, " rows"]
) -> StaticState:
    """Return a state in which an axis has the torque that turns it so far, in rad.

    Unchanged where the axis has no spring.
    """
    if situation.compliance[axis] <= 0.0:
        return situation
    torque = situation.torque.copy()
    torque[:, axis] += turned / situation.compliance[axis]
    return replace(situation, torque=torque)
