"""Silent instruments, after the gears too, saw where an arm stood."""

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from bench.recording import Recording
from bench.rig import Rig
from scenarios.trials.standing import Standing, along_base


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
    felt = along_base(seen, sensor_turn)
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
