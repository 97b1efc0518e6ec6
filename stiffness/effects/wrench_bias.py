"""Wrench bias: a constant reading of the force sensor.

==========  ==========================================================================
Equation    true wrench = reading - bias, along the sensor's axes; the axes' springs
            respond to the true one
Source      Traversaro, Pucci, Nori 2015, "In situ calibration of six-axis force-torque
            sensors using accelerometer measurements"
Valid       a bias that stays for the whole recording
Ignores     drift of the bias; compliance besides the axes' own springs
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, absolute, sprung
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.statics import (
    felt,
    from_sensor_axes,
    read_right,
    torque_at_sensor,
    wind_up,
)
from stiffness.experiment.static_state import StaticState

NAMES = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")


@dataclass(frozen=True)
class WrenchBias(Hypothesis):
    """Constant offset of the sensor's channels to which the axes respond."""

    effect: ClassVar[str] = "wrench_bias"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **dict.fromkeys(NAMES[:3], (-200.0, 200.0)),
        **dict.fromkeys(NAMES[3:], (-50.0, 50.0)),
    }
    magnitudes: ClassVar[tuple[str, ...]] = NAMES

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        measured = situation.recording.wrench is not None
        if measured and absolute(situation) and sprung(situation):
            return ("wrench_sensor",)
        return ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        torque = torques(situation)
        return wind_up(situation, torque[:, :, felt(situation, torque)])

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        names = [NAMES[i] for i in felt(situation, torques(situation))]
        return dict(zip(names, coefficients, strict=True))

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        shown = felt(situation, torques(situation))
        return read_right(situation, missing(situation)[:, :, shown] @ coefficients)


def torques(situation: StaticState) -> Float[np.ndarray, "rows axes 6"]:
    """Return the change of the axes' torques per N and N m of each channel."""
    return situation.once_standing(
        "torques of biases", lambda: torque_at_sensor(situation, missing(situation))
    )


def missing(situation: StaticState) -> Float[np.ndarray, "rows 6 6"]:
    """Return the change of the wrench, along the base's axes."""
    each = np.broadcast_to(-np.eye(6), (situation.rows, 6, 6))
    return situation.once_standing(
        "wrench of biases", lambda: from_sensor_axes(situation, each)
    )
