"""Wrench misalignment: rotation or offset of the force sensor on the flange.

==========  ==========================================================================
Equation    true force = reading + r x reading, torque alike, r the rotation vector from
            the stated axes to the sensor's own; or true torque = reading + d x force,
            d from the stated origin to the sensor's own
Source      rotation vector to first order: Rodrigues 1840; moments about two points:
            statics
Valid       turns of some degrees; any distance
Ignores     the second order of the turn; of both at once the weaker gets no value (it
            is a variant)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, sprung
from stiffness.effects.jacobian import NOTHING, EffectJacobian
from stiffness.effects.statics import (
    from_sensor_axes,
    read_right,
    reading,
    torque_at_sensor,
    wind_up,
)
from stiffness.experiment.static_state import StaticState

TURN = ("rx_rad", "ry_rad", "rz_rad")
SHIFT = ("x_m", "y_m", "z_m")
LEAST_TURN = 0.01
"""Minimum range of the force's direction relative to the sensor, in rad, for all
components to be identifiable: the least singular value over the largest; chosen."""


@dataclass(frozen=True)
class WrenchMisalignment(Hypothesis):
    """Sensor whose axes, or whose origin, differ from the manifest.

    It is turned, or it is displaced (`beside`: 0 or 1). The latter is tried only where
    the force varies in direction relative to the sensor, so that all three components
    are identifiable.
    """

    effect: ClassVar[str] = "wrench_misalignment"
    shape_names: ClassVar[tuple[str, ...]] = ("beside",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **dict.fromkeys(TURN, (-0.3, 0.3)),
        **dict.fromkeys(SHIFT, (-1.0, 1.0)),
    }
    magnitudes: ClassVar[tuple[str, ...]] = (*TURN, *SHIFT)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        measured = situation.recording.wrench is not None
        return ("wrench_sensor",) if measured and sprung(situation) else ()

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        carried = torques(situation, True)[:, situation.arm.compliance > 0.0]
        value = np.linalg.svd(carried.reshape(-1, 3), compute_uv=False)
        shown = len(value) == len(SHIFT) and value[-1] > LEAST_TURN * value[0]
        return np.array([[0.0], [1.0]] if shown else [[0.0]])

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return wind_up(situation, torques(situation, bool(shape[0])))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        forms = self.shapes(situation, where)
        other = [form for form in forms if form[0] != shape[0]]
        return self.jacobian(situation, where, other[0]) if other else NOTHING

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return dict(zip(SHIFT if shape[0] else TURN, coefficients, strict=True))

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        return read_right(situation, missing(situation, bool(shape[0])) @ coefficients)


def torques(situation: StaticState, beside: bool) -> Float[np.ndarray, "rows axes 3"]:
    """Return the change of the axes' torques, per radian or per metre displaced."""
    return situation.once_standing(
        ("torques of sensor's place", beside),
        lambda: torque_at_sensor(situation, missing(situation, beside)),
    )


def missing(situation: StaticState, beside: bool) -> Float[np.ndarray, "rows 6 3"]:
    """Return the change of the wrench, per radian or per metre displaced."""

    def changes() -> Float[np.ndarray, "rows 6 3"]:
        force, moment = np.split(reading(situation)[:, :, None], 2, axis=1)
        extra = [np.cross(np.eye(3)[None], part, axis=1) for part in (force, moment)]
        if beside:
            extra = [np.zeros_like(extra[0]), extra[0]]
        return from_sensor_axes(situation, np.concatenate(extra, axis=1))

    return situation.once_standing(("wrench of sensor's place", beside), changes)
