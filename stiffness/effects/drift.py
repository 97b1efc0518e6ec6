"""Drift of tracker or base: a slow rigid motion in time.

==========  ==========================================================================
Equation    p + t (x, y, z) + t (rx, ry, rz) x p, t since the start; at `base` along the
            base's axes, at `tracker` along the tracker's and about it
Source      ISO 230-3, "Determination of thermal effects": linear in time to first order
Valid       drifts of less than a millimetre; at `tracker` along the base's axes where
            its orientation is unknown
Ignores     t² and temperature (its variants); the changed direction of gravity on a
            base that turned
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape
from stiffness.effects.jacobian import BodyTwist, EffectJacobian, rotate, translate
from stiffness.experiment.static_state import StaticState

HOUR = 3600.0
NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Drift(Hypothesis):
    """Rigid motion of all readings at constant speed.

    Drift of the base and drift of the tracker have the same columns.
    """

    effect: ClassVar[str] = "drift"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        f"{name}_per_h": (-0.1, 0.1) for name in NAMES
    }
    magnitudes: ClassVar[tuple[str, ...]] = tuple(f"{name}_per_h" for name in NAMES)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        recording = situation.recording
        if not recording.markers or np.ptp(recording.time) == 0.0:
            return ()
        return ("tracker", "base")

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        hours = situation.recording.time / HOUR
        return wander(situation, where, hours)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        recording = situation.recording
        hours, temperature = recording.time / HOUR, recording.temperature
        courses = [hours**2]
        if temperature is not None and np.ptp(temperature) > 0.0:
            courses.append(temperature - temperature[0])
        return wander(situation, where, *courses)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        names = (f"{name}_per_h" for name in NAMES)
        return dict(zip(names, coefficients, strict=True))


def wander(
    situation: StaticState, where: str, *courses: Float[np.ndarray, " rows"]
) -> EffectJacobian:
    """Return the displacement by six speeds for each course in time, row by row."""
    frame = situation.tracker
    if where == "base" or frame is None:
        frame = np.eye(4)
    centre = np.broadcast_to(frame[:3, 3], (situation.rows, 3))
    twists = []
    for course in courses:
        along = course[:, None, None] * frame[:3, :3]
        twists += [translate(0, along).twist, rotate(0, along, centre).twist]
    return EffectJacobian(
        6 * len(courses), (BodyTwist(0, np.concatenate(twists, axis=2)),)
    )
