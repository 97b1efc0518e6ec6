"""Transforms of wrenches between force sensor, flange, tool and base.

==========  ==========================================================================
Equation    w_base = R_base_body(q) R_body_sensor w_sensor, less the tool's weight
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", 3.8
Needs       the sensor's mounting; the tool's mass where its weight is included
Assumes     the sensor sits on the flange or beyond it
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.recording import Payload, Recording, WrenchSpec
from stiffness.robot.arm import Arm
from stiffness.robot.kinematics import ArmState


def axes_of_sensor(
    sensor: WrenchSpec, standing: ArmState
) -> Float[np.ndarray, "rows 3 3"]:
    """Return a force sensor's own axes along the base's, one a column."""
    mounting = Rotation.from_quat(sensor.quaternion_wxyz, scalar_first=True).as_matrix()
    return standing.turn(sensor.body) @ mounting


def wrench_in_base(
    recording: Recording, standing: ArmState
) -> Float[np.ndarray, "rows 6"]:
    """Return each row's wrench along the base's axes, about the sensor's origin.

    Args:
        recording: With a wrench.
        standing: The arm in each row's posture.

    Returns:
        Wrench of the world on the robot, N and N m, the tool's weight subtracted.

    Raises:
        Unusable: Where there is no wrench, or the sensor's mounting is not stated.
    """
    sensor, wrench = recording.wrench_sensor, recording.wrench
    if wrench is None or sensor is None:
        fault = "no wrench: give the columns fx_n … tz_nm and [sensors.wrench]."
        raise Unusable(f"Recording {recording.name!r}", [fault])
    if sensor.frame == "sensor":
        wrench = turned(wrench, axes_of_sensor(sensor, standing))
    tool = recording.tool
    if sensor.includes_tool_weight and tool is not None and tool.mass:
        lever = standing.point("flange", tool.com)
        lever = lever - standing.point(sensor.body, sensor.position)
        wrench = wrench - weight_of(tool, standing.chain.gravity, lever)
    return wrench


def weight_of(
    tool: Payload, gravity: Float[np.ndarray, "3"], lever: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "rows 6"]:
    """Return a tool's weight about a point, N and N m along the base's axes.

    Args:
        tool: The tool.
        gravity: Along the base's axes, in m/s^2.
        lever: From the point to the tool's centre in each row, in m.
    """
    force = tool.mass * gravity
    weight = np.broadcast_to(force, lever.shape)
    return np.concatenate([weight, np.cross(lever, force)], axis=1)


def turned(
    wrench: Float[np.ndarray, "rows 6"], axes: Float[np.ndarray, "rows 3 3"]
) -> Float[np.ndarray, "rows 6"]:
    """Return axes times force and axes times torque, row by row."""
    parts = np.stack([wrench[:, :3], wrench[:, 3:]], axis=1)
    return np.einsum("rij,rpj->rpi", axes, parts).reshape(-1, 6)


def felt_body(recording: Recording) -> str:
    """Return the body that the wrench acts on: the sensor's body, or the flange."""
    sensor = recording.wrench_sensor
    return "flange" if sensor is None else sensor.body


def sensor_in_flange(arm: Arm, recording: Recording) -> Float[np.ndarray, "3"]:
    """Return the force sensor's origin in the flange's frame, in m.

    Raises:
        Unusable: Where the sensor does not sit on the flange or beyond it.
    """
    sensor = recording.wrench_sensor
    if sensor is None:
        fault = "[sensors.wrench] is missing."
        raise Unusable(f"Recording {recording.name!r}", [fault])
    return to_flange(arm, sensor.body, "the force sensor", sensor.position)


def to_flange(
    arm: Arm, body: str, what: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Return a point of a body fixed to the flange in the flange's frame, m.

    Raises:
        Unusable: Where the body does not move with the flange.
    """
    place, flange = arm.attachment(body), arm.attachment("flange")
    if place.axis != flange.axis:
        raise Unusable(
            what, [f"it is on {body!r}, which does not move with the flange."]
        )
    inner = place.placement[:3, :3] @ position + place.placement[:3, 3]
    return flange.placement[:3, :3].T @ (inner - flange.placement[:3, 3])
