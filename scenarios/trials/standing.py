"""Where an arm stands says how its markers move when an axis gives way.

==========  ==========================================================================
Equation    dp = a_k × (p - o_k) θ_k for a marker beyond axis k, a_k θ_k where it
            slides; torque of a wrench at p_s: a_k · (T + (p_s - o_k) × F), or a_k · F
Source      first-order kinematics and virtual work: Siciliano et al. 2009, chapter 3
Valid       wind-ups of milliradians
Ignores     how a wind-up changes the lever arms of the load
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from bench.recording import Recording


@dataclass(frozen=True)
class Standing:
    """An arm at the postures of a plan, all in the base's frame.

    Attributes:
        point: Where the markers were, in m.
        turn: base_from_body of each marker's body.
        axis: Direction of each axis.
        origin: A point of each axis, in m.
        wind_up: Of each axis, in rad.
        beyond: Which markers each axis carries.
        slides: Which axes slide.
        stiffness: Of each axis' spring, in N m/rad.
        sensor: Where the force sensor sits, in m.
        sensor_turn: base_from_sensor.
        felt: What it read, along the base's axes, in N and N m.
    """

    point: Float[np.ndarray, "visits rows markers 3"]
    turn: Float[np.ndarray, "visits markers 3 3"]
    axis: Float[np.ndarray, "visits axes 3"]
    origin: Float[np.ndarray, "visits axes 3"]
    wind_up: Float[np.ndarray, "visits rows axes"]
    beyond: Bool[np.ndarray, "axes markers"]
    slides: Bool[np.ndarray, " axes"]
    stiffness: Float[np.ndarray, " axes"]
    sensor: Float[np.ndarray, "visits 3"]
    sensor_turn: Float[np.ndarray, "visits 3 3"]
    felt: Float[np.ndarray, "visits rows 6"]

    def turned(
        self, k: int, angle: Float[np.ndarray, "visits rows"] | None = None
    ) -> Float[np.ndarray, "visits rows markers 3"]:
        """Return how markers move when an axis turns, by its wind-up if not said."""
        angle = self.wind_up[:, :, k] if angle is None else angle
        along = self.axis[:, None, None, k]
        lever = self.point - self.origin[:, None, None, k]
        moved = along + 0 * lever if self.slides[k] else np.cross(along, lever)
        return moved * angle[:, :, None, None] * self.beyond[k][:, None]

    def wrench(self, recording: Recording) -> Float[np.ndarray, "visits rows 6"]:
        """Return readings of the force sensor along the base's axes."""
        return along_base(recording, self.sensor_turn)

    def response(
        self, wrench: Float[np.ndarray, "visits rows 6"]
    ) -> Float[np.ndarray, "n markers 3"]:
        """Return what the springs make of a wrench on the sensor, row by row, in m."""
        moved = np.zeros(self.point.shape)
        force, torque = wrench[..., :3], wrench[..., 3:]
        for k, stiffness in enumerate(self.stiffness):
            lever = self.sensor - self.origin[:, k]
            about = torque + np.cross(lever[:, None], force)
            about = force if self.slides[k] else about
            angle = np.einsum("vri,vi->vr", about, self.axis[:, k]) / stiffness
            moved += self.turned(k, angle)
        return moved.reshape(-1, *self.point.shape[2:])

    def force_errors(
        self, turn: float, size: float
    ) -> Float[np.ndarray, "visits rows markers 3 4"]:
        """Return what a visit's force, turned about each axis or scaled, would do.

        Args:
            turn: One sigma of the turn, in rad.
            size: One sigma of the scale.
        """
        parts = np.split(self.felt, 2, axis=-1)
        wrong = [
            turn * np.concatenate([np.cross(e, part) for part in parts], axis=-1)
            for e in np.eye(3)
        ]
        moved = [self.response(w) for w in (*wrong, size * self.felt)]
        return np.stack([m.reshape(self.point.shape) for m in moved], axis=-1)


def along_base(
    recording: Recording, sensor_turn: Float[np.ndarray, "visits 3 3"]
) -> Float[np.ndarray, "visits rows 6"]:
    """Return readings of the force sensor along the base's axes."""
    assert recording.wrench is not None
    split = recording.wrench.reshape(len(sensor_turn), -1, 2, 3)
    turned = np.einsum("vij,vrsj->vrsi", sensor_turn, split)
    return turned.reshape(*split.shape[:2], 6)
