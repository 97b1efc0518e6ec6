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

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from bench.recording import Recording
from bench.rig import Rig


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
        return _along_base(recording, self.sensor_turn)

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


def standing_of(
    rig: Rig, seen: Recording, point: Float[np.ndarray, "rows markers 3"]
) -> Standing:
    """Say where an arm stood at the postures that its controller reports.

    What silent instruments saw of it, after the gears too, puts its markers at `point`
    in the base's frame, in m.
    """
    assert seen.link_posture is not None and seen.wrench_sensor is not None
    model, arm = rig.nominal, rig.anatomy
    rows = int(np.sum(seen.visit == seen.visit[0]))
    posture = seen.posture[::rows]
    bodies = [arm.body(marker.body) for marker in seen.markers]
    turn = np.zeros((len(posture), len(bodies), 3, 3))
    axis = np.zeros((len(posture), len(arm.axes), 3))
    origin, sensor = np.zeros_like(axis), np.zeros((len(posture), 3))
    sensor_turn = np.zeros((len(posture), 3, 3))
    data = mujoco.MjData(model)
    addresses = [int(model.joint(a).qposadr[0]) for a in arm.axes]
    for v, angles in enumerate(posture):
        data.qpos[addresses] = angles
        mujoco.mj_kinematics(model, data)
        base, world = data.body(arm.base).xpos, data.body(arm.base).xmat.reshape(3, 3)
        for k, name in enumerate(arm.axes):
            axis[v, k] = data.joint(name).xaxis @ world
            origin[v, k] = (data.joint(name).xanchor - base) @ world
        for m, body in enumerate(bodies):
            turn[v, m] = world.T @ data.body(body).xmat.reshape(3, 3)
        flange = data.body(arm.flange)
        sensor_turn[v] = world.T @ flange.xmat.reshape(3, 3)
        sensor[v] = (flange.xpos - base) @ world
        sensor[v] += sensor_turn[v] @ seen.wrench_sensor.position
    wind_up = (seen.link_posture - seen.posture).reshape(len(posture), rows, -1)
    felt = _along_base(seen, sensor_turn)
    for k in np.flatnonzero(arm.slides):  # no second encoder; gravity on it is constant
        pushed = np.einsum("vri,vi->vr", felt[..., :3], axis[:, k])
        wind_up[:, :, k] = pushed / rig.springs[k]
    return Standing(
        point=point.reshape(len(posture), rows, -1, 3),
        turn=turn,
        axis=axis,
        origin=origin,
        wind_up=wind_up,
        beyond=_beyond(model, arm.links, bodies),
        slides=np.array(arm.slides),
        stiffness=rig.springs,
        sensor=sensor,
        sensor_turn=sensor_turn,
        felt=felt,
    )


def _along_base(
    recording: Recording, sensor_turn: Float[np.ndarray, "visits 3 3"]
) -> Float[np.ndarray, "visits rows 6"]:
    assert recording.wrench is not None
    split = recording.wrench.reshape(len(sensor_turn), -1, 2, 3)
    turned = np.einsum("vij,vrsj->vrsi", sensor_turn, split)
    return turned.reshape(*split.shape[:2], 6)


def _beyond(
    model: mujoco.MjModel, links: tuple[str, ...], bodies: list[str]
) -> Bool[np.ndarray, "axes markers"]:
    found = np.zeros((len(links), len(bodies)), dtype=bool)
    for m, name in enumerate(bodies):
        body = model.body(name).id
        while body:
            if model.body(body).name in links:
                found[links.index(model.body(body).name), m] = True
            body = int(model.body_parentid[body])
    return found
