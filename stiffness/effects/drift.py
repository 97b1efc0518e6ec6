"""Drift of tracker or base: a slow rigid motion in time.

==========  ==========================================================================
Equation    p + s (x, y, z) + s (rx, ry, rz) x p, s = T (1 - exp(-t/T)), t since the
            start, or a sum of some of these; at `base` along the base's axes, at
            `tracker` along the tracker's and about it
Source      ISO 230-3, "Determination of thermal effects"; a body that warms up by
            Newton's law of cooling; T far above the recording's length: linear in time
Valid       drifts of less than a millimetre; at `tracker` along the base's axes where
            its orientation is unknown
Ignores     t² and temperature (its variants); the changed direction of gravity on a
            base that turned
==========  ==========================================================================
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import (
    MOST_PARTS,
    Coeffs,
    Hypothesis,
    Shape,
    Shapes,
    apart,
)
from stiffness.effects.jacobian import BodyTwist, EffectJacobian, six_motions
from stiffness.experiment.static_state import StaticState

HOUR = 3600.0
NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")

CONSTANTS = (0.05, 0.15, 0.5, 2.0, 100.0)
"""T over the recording's length; chosen: the last is a straight line within 0.5 %."""
APART = 2.0
"""Factor by which the time constants of a sum are apart at least; chosen: three of them
make a course that turns back twice."""


@dataclass(frozen=True)
class Drift(Hypothesis):
    """Rigid motion of all readings that starts at a speed and comes to rest.

    A body whose parts warm up one after another may turn back: a sum, of which the part
    that explains most is reported. Speeds are those of the start. Drift of the base and
    drift of the tracker have the same columns.
    """

    effect: ClassVar[str] = "drift"
    shape_names: ClassVar[tuple[str, ...]] = ("time_s",)
    logarithmic: ClassVar[tuple[str, ...]] = ("time_s",)
    is_sum: ClassVar[bool] = True
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        f"{name}_per_h": (-0.1, 0.1) for name in NAMES
    } | {"time_s": (0.0, 1e9)}
    magnitudes: ClassVar[tuple[str, ...]] = tuple(f"{name}_per_h" for name in NAMES)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        recording = situation.recording
        if not recording.markers or np.ptp(recording.time) == 0.0:
            return ()
        return ("tracker", "base")

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return np.outer(CONSTANTS, np.ptp(situation.recording.time))

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        courses = [warmed(situation, constant) / HOUR for constant in shape]
        return wander(situation, where, *courses)

    @override
    def joined(
        self, shapes: Sequence[Float[np.ndarray, " _"]]
    ) -> Float[np.ndarray, " joined"]:
        constants = apart(np.concatenate([*shapes]), math.log(APART), scale=math.log)
        return np.array(constants[:MOST_PARTS])

    @override
    def further(
        self, found: Mapping[str, float], shape: Shape, coefficients: Coeffs
    ) -> list[dict[str, float]]:
        return _parts(shape, coefficients)[1:]

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
        return _parts(shape, coefficients)[0]


def _parts(shape: Shape, coefficients: Coeffs) -> list[dict[str, float]]:
    """Return the parameters of each part of a sum, the one that comes first first."""
    names = [f"{name}_per_h" for name in NAMES]
    return [
        dict(zip(names, speeds, strict=True)) | {"time_s": constant}
        for constant, speeds in zip(shape, coefficients.reshape(-1, 6), strict=True)
    ]


def warmed(situation: StaticState, constant: float) -> Float[np.ndarray, " rows"]:
    """Return the time in s that a drift at its first speed would need, row by row."""
    return -constant * np.expm1(-situation.recording.time / constant)


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
        twists.append(six_motions(0, along, centre).twist)
    return EffectJacobian(
        6 * len(courses), (BodyTwist(0, np.concatenate(twists, axis=2)),)
    )
