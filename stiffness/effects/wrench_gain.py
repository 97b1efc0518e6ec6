"""Wrench gain: scale errors of the channels of the force sensor.

==========  ==========================================================================
Equation    true channel = reading/(1 + gain) = reading (1 - a), gain = a/(1 - a); the
            axes' springs respond to the true one
Source      Traversaro, Pucci, Nori 2015, "In situ calibration of six-axis force-torque
            sensors using accelerometer measurements"
Valid       gains that stay for the whole recording
Ignores     crosstalk (its variant); compliance besides the axes' own springs
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, sprung
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.statics import (
    felt,
    from_sensor_axes,
    misread,
    read_right,
    reading,
    torque_at_sensor,
    wind_up,
)
from stiffness.experiment.static_state import StaticState

SIGMA = 0.02
"""One sigma of a gain before any reading: the usual error of the catalogue. Gains
of all channels with softer springs are held by gravity alone."""
NAMES = ("fx", "fy", "fz", "tx", "ty", "tz")


@dataclass(frozen=True)
class WrenchGain(Hypothesis):
    """Scale errors of the sensor's channels to which the axes respond."""

    effect: ClassVar[str] = "wrench_gain"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        name: (-0.5, 0.5) for name in NAMES
    }
    magnitudes: ClassVar[tuple[str, ...]] = NAMES

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if situation.recording.wrench is None or not sprung(situation):
            return ()
        return ("wrench_sensor",) if felt(situation, torques(situation)) else ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        torque = torques(situation)
        return wind_up(situation, torque[:, :, felt(situation, torque)])

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        to, of = np.nonzero(~np.eye(6, dtype=bool))
        return misread(situation, to, -reading(situation)[:, of])

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        return np.full(len(felt(situation, torques(situation))), SIGMA)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        names = [NAMES[i] for i in felt(situation, torques(situation))]
        share = np.asarray(coefficients)
        return dict(zip(names, share / (1.0 - share), strict=True))

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        shown = felt(situation, torques(situation))
        return read_right(situation, missing(situation)[:, :, shown] @ coefficients)


def torques(situation: StaticState) -> Float[np.ndarray, "rows axes 6"]:
    """Return the change of the axes' torques per unit of gain of each channel."""
    return situation.once_standing(
        "torques of gains", lambda: torque_at_sensor(situation, missing(situation))
    )


def missing(situation: StaticState) -> Float[np.ndarray, "rows 6 6"]:
    """Return the change of the wrench, along the base's axes."""
    return situation.once_standing(
        "wrench of gains",
        lambda: from_sensor_axes(
            situation, -reading(situation)[:, :, None] * np.eye(6)
        ),
    )
