"""Static response of joints to loads and to errors of wrench and encoders.

==========  ==========================================================================
Equation    torque_k = l . F + a . (M + p x F), (l, a) the screw of axis k about the
            base's origin; turn of the axis = compliance_k torque_k
Source      virtual work: Siciliano et al. 2009, "Robotics: Modelling, Planning and
            Control", section 3.8
Valid       loads so small that lever arms stay
Ignores     what gives way besides the axes' own springs
==========  ==========================================================================
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from stiffness.effects.base import point_of
from stiffness.effects.jacobian import EffectJacobian, JacobianBlock, JointRotation
from stiffness.experiment.static_state import StaticState
from stiffness.robot.wrench import felt_body, turned, weight_of

ROUNDING = 1e-9
"""Torque in N m that only rounding makes; chosen: far below any sensor's."""


def wind_up(
    situation: StaticState, torque: Float[np.ndarray, "rows axes columns"]
) -> EffectJacobian:
    """Return how all sprung axes turn under torques, in N m per unit of coefficient."""
    parts = (
        JointRotation(k, compliance * torque[:, k])
        for k, compliance in enumerate(situation.compliance)
        if compliance > 0.0
    )
    return EffectJacobian(torque.shape[2], tuple(parts))


def felt(
    situation: StaticState, torque: Float[np.ndarray, "rows axes columns"]
) -> list[int]:
    """Return the columns that some sprung axis carries beyond rounding, 1e-9 N m."""
    carried = np.abs(torque[:, situation.arm.compliance > 0.0]) > ROUNDING
    return [int(i) for i in np.flatnonzero(np.any(carried, axis=(0, 1)))]


def torque_of(
    situation: StaticState,
    body: str,
    force: Float[np.ndarray, "rows 3 columns"],
    moment: Float[np.ndarray, "rows 3 columns"],
    point: Float[np.ndarray, "rows 3"],
) -> Float[np.ndarray, "rows axes columns"]:
    """Return the torques on all axes of loads on a body, in N m.

    Args:
        situation: Where the axes are.
        body: What the loads act on.
        force: In N, along the base's axes.
        moment: About the point, in N m.
        point: Where the force acts, in m.
    """
    arm = situation.arm
    about_base = moment + np.cross(point[:, :, None], force, axis=1)
    load = np.concatenate([force, about_base], axis=1)
    torque = np.einsum("rki,ric->rkc", situation.screw, load)
    carriers = arm.chain.carriers(arm.attachment(body).axis)
    others = [k for k in range(len(arm.axes)) if k not in carriers]
    torque[:, others] = 0.0
    return torque


def torque_at_sensor(
    situation: StaticState, wrench: Float[np.ndarray, "rows 6 columns"]
) -> Float[np.ndarray, "rows axes columns"]:
    """Return the torques of wrenches at the sensor's origin, along the base's axes."""
    body = felt_body(situation.recording)
    return torque_of(situation, body, wrench[:, :3], wrench[:, 3:], situation.sensor)


def encoder_offset_response(situation: StaticState, k: int) -> EffectJacobian:
    """Return how the arm stands when an axis is one radian beside its reported angle.

    A sensor beyond it is turned, and the springs before feel the load from elsewhere.
    """
    loaded = wind_up(situation, turned_load(situation, k))
    return EffectJacobian(
        1, _added(JointRotation(k, np.ones((situation.rows, 1))), loaded.parts)
    )


def _added(
    own: JointRotation, parts: tuple[JacobianBlock, ...]
) -> tuple[JacobianBlock, ...]:
    """Return turns of axes with one more, each axis once."""
    others = [p for p in parts if isinstance(p, JointRotation) and p.axis != own.axis]
    same = [p.law for p in parts if isinstance(p, JointRotation) and p.axis == own.axis]
    return (JointRotation(own.axis, own.law + sum(same)), *others)


def pulled(
    situation: StaticState,
    body: str,
    force: Float[np.ndarray, "rows 3"],
    moment: Float[np.ndarray, "rows 3"],
    point: Float[np.ndarray, "rows 3"],
) -> StaticState:
    """Return the situation with one more load on a body, felt by all that carry it.

    Args:
        situation: Where the axes are, and what they feel already.
        body: What the load acts on.
        force: In N, along the base's axes.
        moment: About the point, in N m.
        point: Where the force acts, in m.
    """
    arm = situation.arm
    under = arm.chain.carriers(arm.attachment(body).axis)
    places = [0, *(k + 1 for k in under)]
    lever = point[:, None] - situation.origin[:, places]
    forces, moments = situation.force.copy(), situation.moment.copy()
    forces[:, places] += force[:, None]
    moments[:, places] += moment[:, None] + np.cross(lever, force[:, None])
    load = np.concatenate([force, moment], axis=1)[:, :, None]
    torque = torque_of(situation, body, load[:, :3], load[:, 3:], point)[:, :, 0]
    whole = situation.torque + torque
    return replace(situation, force=forces, moment=moments, torque=whole)


def read_right(
    situation: StaticState, missing: Float[np.ndarray, "rows 6"]
) -> StaticState:
    """Return the situation under the wrench that was there, not the one that was read.

    Args:
        situation: Under the wrench as it was read.
        missing: What that lacks, about the sensor's origin, along the base's axes.
    """
    body, force, moment = felt_body(situation.recording), missing[:, :3], missing[:, 3:]
    under = pulled(situation, body, force, moment, situation.sensor)
    load = situation.load_torque + under.torque - situation.torque
    return replace(under, load_torque=load)


def turned_load(situation: StaticState, k: int) -> Float[np.ndarray, "rows axes 1"]:
    """Return what an axis' standing beside its reported angle does to all torques.

    A sensor that turns with the axis takes the load's direction with it: the axes
    beyond feel nothing. A load along the base's axes stays, and they turn under it.

    Args:
        situation: Where the arm is thought to stand.
        k: The axis, from 0.

    Returns:
        Torque in N m per radian (metre).
    """
    arm, sensor = situation.arm, situation.recording.wrench_sensor
    carriers = arm.chain.carriers(arm.attachment(felt_body(situation.recording)).axis)
    torque = np.zeros((situation.rows, len(situation.axes), 1))
    if k not in carriers:
        return torque
    own = carriers.index(k) + 1
    beyond, before = carriers[:own], carriers[own:]
    twist = situation.screw[:, k]
    shift = twist[:, :3] + np.cross(twist[:, 3:], situation.sensor)
    force, moment = situation.wrench[:, :3], situation.wrench[:, 3:]
    moved = np.concatenate([np.zeros_like(force), np.cross(shift, force)], axis=1)
    parts = [np.cross(twist[:, 3:], part) for part in (force, moment)]
    turned = np.concatenate(parts, axis=1)
    if sensor is None or sensor.frame == "sensor":
        moved, turned = moved + turned, 0.0 * turned
    torque[:, before] = torque_at_sensor(situation, moved[:, :, None])[:, before]
    torque[:, beyond] = torque_at_sensor(situation, -turned[:, :, None])[:, beyond]
    return torque


def along_sensor(
    situation: StaticState, wrench: Float[np.ndarray, "rows 6 columns"]
) -> Float[np.ndarray, "rows 6 columns"]:
    """Turn wrenches along the sensor's axes to the base's."""
    turn = situation.sensor_axes
    return np.concatenate([turn @ wrench[:, :3], turn @ wrench[:, 3:]], axis=1)


def reading(situation: StaticState) -> Float[np.ndarray, "rows 6"]:
    """Return the wrench as it was read, along the sensor's axes, in N and N m.

    With the tool's weight where that was read as well: a sensor errs in all it feels.
    """
    spec, tool = situation.recording.wrench_sensor, situation.recording.tool
    wrench = situation.wrench
    if spec is not None and spec.includes_tool_weight and tool is not None:
        lever = point_of(situation, "flange", tool.com) - situation.sensor
        wrench = wrench + weight_of(tool, situation.arm.chain.gravity, lever)
    return turned(wrench, situation.sensor_axes.swapaxes(1, 2))
