"""A force sensor sits on the flange a little turned.

==========  ==========================================================================
Equation    true force = reading + r x reading, torque alike, r the rotation vector from
            the stated axes to the sensor's own
Source      rotation vector to first order: Rodrigues 1840
Valid       some degrees; about the sensor's origin
Ignores     a sensor that sits beside its place; the second order of the turn
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.diagnosis.hypotheses.axes import sprung
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.hypotheses.response import (
    along_sensor,
    reading,
    torque_at_sensor,
    wind_up,
)
from stiffness.diagnosis.signature import NOTHING, Signature
from stiffness.diagnosis.situation import Situation

NAMES = ("rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class WrenchMisalignment(Hypothesis):
    """A sensor whose axes are not those that the manifest states."""

    effect: ClassVar[str] = "wrench_misalignment"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        name: (-0.3, 0.3) for name in NAMES
    }
    sizes: ClassVar[tuple[str, ...]] = NAMES

    @override
    def places(self, situation: Situation) -> tuple[str, ...]:
        measured = situation.recording.wrench is not None
        return ("wrench_sensor",) if measured and sprung(situation) else ()

    @override
    def shapes(
        self, situation: Situation, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        return np.zeros((1, 0))

    @override
    def signature(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        halves = reading(situation).reshape(-1, 2, 1, 3)
        turned = np.cross(np.eye(3), halves)  # (rows, halves, columns, 3)
        extra = turned.transpose(0, 1, 3, 2).reshape(-1, 6, 3)
        torque = torque_at_sensor(situation, along_sensor(situation, extra))
        return wind_up(situation, torque)

    @override
    def variants(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        return NOTHING

    @override
    def parameters(
        self,
        situation: Situation,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        return dict(zip(NAMES, coefficients, strict=True))
