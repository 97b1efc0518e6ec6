"""Gravity and load pull at all that a place carries; the arm rests where springs hold.

==========  ==========================================================================
Equation    F_p = sum m g + F_load; M_p = sum (c - o_p) x m g + (s - o_p) x F_load + T
            over all that place p carries; torque of axis k = z_k . M_k (slide: z_k . F)
            with o_p and z_k of the row; places for lever arms: with the mean wind-up of
            the row's visit
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", 7.3
Valid       an arm at rest
Ignores     what gives way beyond the axes' own springs
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.channels import clear_channels
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.tare import tared
from stiffness.diagnosis.visits import held_at_mean
from stiffness.equilibrium import equilibrium
from stiffness.standing import Standing
from stiffness.wrench import felt_body, wrench_in_base


def situation_of(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"],
    bodies: Sequence[str],
) -> Situation:
    """Let the arm come to rest in every row and say what acts where.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: What was done.
        compliance: Of each axis, in rad/(N m); 0 = rigid.
        bodies: Bodies whose motion will be asked for.
    """
    rest, wrench = _rest(arm, recording, compliance)
    standing = arm.at(rest)
    rows, axes = rest.shape
    sensor, sensor_axes = _sensor(recording, standing)
    force, moment = _carried(recording, standing, wrench, sensor)
    midway = _midway(recording, rest)
    origin, frame = _places(arm.at(midway))
    load = np.zeros((rows, axes))
    if recording.wrench is not None and recording.wrench_sensor is not None:
        spec = recording.wrench_sensor
        load = standing.load_torque(wrench, spec.body, spec.position)
    along = standing.rotation[..., 2].transpose(1, 0, 2)
    torque = np.where(
        arm.slides,
        np.einsum("rai,rai->ra", along, force[:, 1:]),
        np.einsum("rai,rai->ra", along, moment[:, 1:]),
    )
    seat = frame.copy()
    cos, sin = np.cos(midway)[..., None], np.sin(midway)[..., None]
    x, y = frame[:, 1:, :, 0], frame[:, 1:, :, 1]
    turns = ~arm.slides
    seat[:, 1:, :, 0][:, turns] = (cos * x - sin * y)[:, turns]
    seat[:, 1:, :, 1][:, turns] = (sin * x + cos * y)[:, turns]
    carried = np.ones((axes + 1, len(bodies)), dtype=bool)
    for b, body in enumerate(bodies):
        under = arm.chain.carriers(arm.place(body).axis)
        carried[1:, b] = np.isin(np.arange(axes), under)
    return Situation(
        recording=recording,
        arm=arm,
        compliance=compliance,
        rest=rest,
        torque=torque,
        load_torque=load,
        force=force,
        moment=moment,
        origin=origin,
        frame=frame,
        seat=seat,
        wrench=wrench,
        sensor=sensor,
        sensor_axes=sensor_axes,
        carried=carried,
        bodies=tuple(bodies),
        tracker=recording.base_from_tracker,
    )


def _rest(
    arm: Arm, recording: Recording, compliance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the links' posture and the wrench along the base's axes, which agree."""
    rest = recording.posture
    if recording.wrench is None or recording.wrench_sensor is None:
        rest = equilibrium(arm, rest, compliance, payload=recording.tool)
        return rest, np.zeros((len(rest), 6))
    spec = recording.wrench_sensor
    wrench = _felt(recording, arm.at(rest))
    for _ in range(2):  # the sensor turns with the flange: by 1e-3, then by 1e-6
        rest = equilibrium(
            arm,
            recording.posture,
            compliance,
            wrench,
            spec.position,
            recording.tool,
            spec.body,
        )
        wrench = _felt(recording, arm.at(rest))
    return rest, wrench


def _felt(recording: Recording, standing: Standing) -> Float[np.ndarray, "rows 6"]:
    """Return the wrench along the base's axes, without what is noise alone."""
    spec, (_, axes) = recording.wrench_sensor, _sensor(recording, standing)
    wrench = tared(recording, wrench_in_base(recording, standing), axes)
    return wrench if spec is None else clear_channels(spec, wrench, axes)


def _sensor(recording: Recording, standing: Standing) -> tuple[np.ndarray, np.ndarray]:
    """Return where the sensor is and its own axes, in whatever axes it reports."""
    spec = recording.wrench_sensor
    if spec is None:
        return standing.point("flange", np.zeros(3)), standing.turn("flange")
    at = standing.point(spec.body, spec.position)
    mounting = Rotation.from_quat(spec.quaternion_wxyz, scalar_first=True).as_matrix()
    return at, standing.turn(spec.body) @ mounting


def _midway(
    recording: Recording, rest: Float[np.ndarray, "rows axes"]
) -> Float[np.ndarray, "rows axes"]:
    """Return where the links rest with the mean wind-up of a row's visit.

    Lever arms are taken there, where a visit's markers are on average: what a place
    carries goes with it under load, and a constant turn shows no load.
    """
    wound = rest - recording.posture
    return recording.posture + held_at_mean(recording.visit, wound)


def _places(standing: Standing) -> tuple[np.ndarray, np.ndarray]:
    """Return origin and frame of every place."""
    axes, rows = standing.origin.shape[:2]
    origin = np.zeros((rows, axes + 1, 3))
    frame = np.tile(np.eye(3), (rows, axes + 1, 1, 1))
    origin[:, 1:] = standing.origin.transpose(1, 0, 2)
    frame[:, 1:] = standing.rotation.transpose(1, 0, 2, 3)
    return origin, frame


def _carried(
    recording: Recording, standing: Standing, wrench: np.ndarray, sensor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return force and moment at every place."""
    chain = standing.chain
    origin, _ = _places(standing)
    force, moment = np.zeros_like(origin), np.zeros_like(origin)
    pulls = [
        (axis, mass * chain.gravity, at)
        for axis, mass, at in zip(*standing.masses(recording.tool), strict=True)
    ]
    pulls.append((-1, chain.foot_mass * chain.gravity, chain.foot_centre[None]))
    if recording.wrench is not None:
        felt = standing.place(felt_body(recording)).axis
        pulls.append((felt, wrench[:, :3], sensor))
    for axis, pull, at in pulls:
        for place in [0, *(k + 1 for k in chain.carriers(axis))]:
            arm = at - origin[:, place]
            force[:, place] += pull
            moment[:, place] += np.cross(arm, np.broadcast_to(pull, arm.shape))
    if recording.wrench is not None:
        felt = standing.place(felt_body(recording)).axis
        for place in [0, *(k + 1 for k in chain.carriers(felt))]:
            moment[:, place] += wrench[:, 3:]
    return force, moment
