"""Stated specifications of instruments: noise, volumetric error, mounting."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

ASSUMED = 3e-5
"""Repeatability where nothing is stated and nothing shows it, one sigma in m; chosen:
between a laser tracker's 0.01 mm and a camera's 0.1 mm."""


@dataclass(frozen=True)
class TrackerSpec:
    """Stated specification of a tracker.

    Attributes:
        repeatability: One sigma of a row (of a frame, where the recording counts
            frames) along x, y, z of the tracker, in m.
        volumetric: Size of its slowly varying error, in m; None where not stated.
        is_stated: Whether somebody stated the repeatability; else it is `ASSUMED`, or
            was measured.
    """

    repeatability: Float[np.ndarray, "3"]
    volumetric: float | None = None
    is_stated: bool = True


@dataclass(frozen=True)
class WrenchSpec:
    """Stated specification of a force sensor.

    Attributes:
        accuracy_force: One sigma of a row, in N.
        accuracy_torque: One sigma of a row, in N m.
        body: The body it is mounted on.
        position: Its origin in that body's frame, in m.
        quaternion_wxyz: v_body = R(quaternion) v_sensor.
        frame: Axes along which the readings are given.
        includes_tool_weight: Whether the weight beyond the sensor is still in them.
    """

    accuracy_force: float
    accuracy_torque: float
    body: str = "flange"
    position: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    quaternion_wxyz: Float[np.ndarray, "4"] = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0])
    )
    frame: Literal["sensor", "base"] = "sensor"
    includes_tool_weight: bool = False

    @property
    def sigma(self) -> Float[np.ndarray, "6"]:
        """One sigma of each channel of a row, in N and N m."""
        return np.repeat([self.accuracy_force, self.accuracy_torque], 3)
