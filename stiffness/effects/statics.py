"""Static response of joints to loads and to errors of wrench and encoders.

==========  ==========================================================================
Equation    torque_k = l . F + a . (M + p x F), (l, a) the screw of axis k about the
            base's origin; turn of the axis = compliance_k torque_k
Source      virtual work: Siciliano et al. 2009, "Robotics: Modelling, Planning and
            Control", section 3.8
Valid       loads so small that lever arms do not change
Ignores     compliance besides the axes' own springs
==========  ==========================================================================
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from stiffness.effects.base import point_of
from stiffness.effects.jacobian import (
    NOTHING,
    EffectJacobian,
    JacobianBlock,
    JointRotation,
    hstack,
    turn,
    values,
    with_values,
)
from stiffness.experiment.static_state import StaticState
from stiffness.robot.wrench import felt_body, turned, weight_of

ROUNDING = 1e-9
"""Torque in N m attributed to rounding; chosen: far below any sensor's."""


def springs_of(
    situation: StaticState, springs: Sequence[int]
) -> tuple[EffectJacobian, ...]:
    """Return what more compliance of each fitted axis does."""
    return tuple(turn(k, situation.torque[:, k]) for k in springs)


def wind_up(
    situation: StaticState, torque: Float[np.ndarray, "rows axes columns"]
) -> EffectJacobian:
    """Return the rotations of all sprung axes under torques, in N m per unit."""
    parts = (
        JointRotation(k, compliance * torque[:, k])
        for k, compliance in enumerate(situation.compliance)
        if compliance > 0.0
    )
    return EffectJacobian(torque.shape[2], tuple(parts))


def felt(
    situation: StaticState, torque: Float[np.ndarray, "rows axes columns"]
) -> list[int]:
    """Return the columns that load some sprung axis beyond rounding, 1e-9 N m."""
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
        situation: Static state of the arm.
        body: What the loads act on.
        force: In N, along the base's axes.
        moment: About the point, in N m.
        point: Point of application of the force, in m.
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


def misread(
    situation: StaticState,
    to: Int[np.ndarray, " columns"],
    wrong: Float[np.ndarray, "rows columns"],
) -> EffectJacobian:
    """Return what sprung axes do where channels of the sensor take up more.

    Args:
        situation: Static state of the arm.
        to: The channel of each column.
        wrong: What that takes up, along the sensor's axes, in N or N m.
    """
    wrench = np.zeros((situation.rows, 6, len(to)))
    wrench[:, to, np.arange(len(to))] = wrong
    torque = torque_at_sensor(situation, from_sensor_axes(situation, wrench))
    return wind_up(situation, torque)


def encoder_offset_response(situation: StaticState, k: int) -> EffectJacobian:
    """Return the arm's displacement per radian of an axis' encoder offset.

    A sensor beyond it is turned, which changes the load on the springs before it.
    """
    loaded = wind_up(
        situation, turned_load(situation, k, situation.screw[:, k, :, None])
    )
    return EffectJacobian(
        1, _added(JointRotation(k, np.ones((situation.rows, 1))), loaded.parts)
    )


def _added(
    own: JointRotation, parts: tuple[JacobianBlock, ...]
) -> tuple[JacobianBlock, ...]:
    """Return rotations of axes with one more added, each axis once."""
    others = [p for p in parts if isinstance(p, JointRotation) and p.axis != own.axis]
    same = [p.law for p in parts if isinstance(p, JointRotation) and p.axis == own.axis]
    return (JointRotation(own.axis, own.law + sum(same)), *others)


def given_way(
    situation: StaticState, loads: Sequence[Callable[[StaticState], StaticState]]
) -> EffectJacobian:
    """Return what named effects that give way under loads do more under added ones.

    Args:
        situation: With the named effects.
        loads: What adds each load; a column each.
    """
    if not situation.giving:
        return NOTHING
    before = [p for give in situation.giving for p in give(situation)]
    loaded = [load(situation) for load in loads]
    after = [[p for give in situation.giving for p in give(s)] for s in loaded]
    parts = [
        tuple(
            with_values(new, values(new) - values(old))
            for new, old in zip(own, before, strict=True)
        )
        for own in after
    ]
    return hstack([EffectJacobian(1, own) for own in parts])


@dataclass(frozen=True, eq=False)
class CarriedLoads:
    """What loads exert on all that carries them, a column each.

    Attributes:
        force: On each place, in N per unit, as in `StaticState`.
        moment: About each place's origin, in N m per unit.
        torque: On each axis, in N m per unit.
    """

    force: Float[np.ndarray, "rows places 3 columns"]
    moment: Float[np.ndarray, "rows places 3 columns"]
    torque: Float[np.ndarray, "rows axes columns"]

    def added_to(
        self, situation: StaticState, size: Float[np.ndarray, " columns"]
    ) -> StaticState:
        """Return the static state with these loads beside those so far."""
        return replace(
            situation,
            force=situation.force + np.tensordot(self.force, size, 1),
            moment=situation.moment + np.tensordot(self.moment, size, 1),
            torque=situation.torque + np.tensordot(self.torque, size, 1),
        )


def carried_loads(
    situation: StaticState,
    body: str,
    force: Float[np.ndarray, "rows 3 columns"],
    moment: Float[np.ndarray, "rows 3 columns"],
    point: Float[np.ndarray, "rows 3"],
) -> CarriedLoads:
    """Return what loads on a body exert.

    Args:
        situation: Static state of the arm.
        body: What the loads act on.
        force: In N, along the base's axes.
        moment: About the point, in N m.
        point: Point of application of the force, in m.
    """
    arm = situation.arm
    under = arm.chain.carriers(arm.attachment(body).axis)
    places = [0, *(k + 1 for k in under)]
    lever = (point[:, None] - situation.origin[:, places])[..., None]
    shape = (*situation.force.shape, force.shape[2])
    forces, moments = np.zeros(shape), np.zeros(shape)
    forces[:, places] = force[:, None]
    moments[:, places] = moment[:, None] + np.cross(lever, force[:, None], axis=2)
    return CarriedLoads(
        forces, moments, torque_of(situation, body, force, moment, point)
    )


def read_right(
    situation: StaticState, missing: Float[np.ndarray, "rows 6"]
) -> StaticState:
    """Return the static state under the true wrench instead of the measured one.

    Args:
        situation: State under the measured wrench.
        missing: True less measured wrench, about the sensor's origin, along the base's
            axes.
    """
    body, load = felt_body(situation.recording), missing[:, :, None]
    loads = carried_loads(situation, body, load[:, :3], load[:, 3:], situation.sensor)
    under = loads.added_to(situation, np.ones(1))
    load = situation.load_torque + under.torque - situation.torque
    return replace(under, load_torque=load)


def turned_load(
    situation: StaticState, axis: int, twist: Float[np.ndarray, "rows 6 columns"]
) -> Float[np.ndarray, "rows axes columns"]:
    """Return the change of all torques as an axis and all that it carries moves.

    A sensor that it carries turns the load with it: the torques of the axes beyond do
    not change. A load along the base's axes stays, and they turn under it.

    Args:
        situation: Nominal state of the arm.
        axis: Index of the axis, from 0.
        twist: Of what it carries, about the base's origin.

    Returns:
        Torque in N m per unit of each column.
    """
    arm, sensor = situation.arm, situation.recording.wrench_sensor
    carriers = arm.chain.carriers(arm.attachment(felt_body(situation.recording)).axis)
    torque = np.zeros((situation.rows, len(situation.axes), twist.shape[2]))
    if axis not in carriers:
        return torque
    own = carriers.index(axis) + 1
    beyond, before = carriers[:own], carriers[own:]
    shift, turn = np.split(twist, 2, axis=1)
    shift = shift + np.cross(turn, situation.sensor[:, :, None], axis=1)
    force, moment = np.split(situation.wrench[:, :, None], 2, axis=1)
    moved = np.cross(shift, force, axis=1)
    moved = np.concatenate([np.zeros_like(moved), moved], axis=1)
    parts = [np.cross(turn, part, axis=1) for part in (force, moment)]
    turned = np.concatenate(parts, axis=1)
    if sensor is None or sensor.frame == "sensor":
        moved, turned = moved + turned, 0.0 * turned
    torque[:, before] = torque_at_sensor(situation, moved)[:, before]
    torque[:, beyond] = torque_at_sensor(situation, -turned)[:, beyond]
    return torque


def from_sensor_axes(
    situation: StaticState, wrench: Float[np.ndarray, "rows 6 columns"]
) -> Float[np.ndarray, "rows 6 columns"]:
    """Rotate wrenches from the sensor's axes to the base's."""
    turn = situation.sensor_axes
    return np.concatenate([turn @ wrench[:, :3], turn @ wrench[:, 3:]], axis=1)


def reading(situation: StaticState) -> Float[np.ndarray, "rows 6"]:
    """Return the wrench as it was read, along the sensor's axes, in N and N m.

    The tool's weight is included where the reading includes it: sensor errors act on
    the whole load.
    """
    spec, tool = situation.recording.wrench_sensor, situation.recording.tool
    wrench = situation.wrench
    if spec is not None and spec.includes_tool_weight and tool is not None:
        lever = point_of(situation, "flange", tool.com) - situation.sensor
        wrench = wrench + weight_of(tool, situation.arm.chain.gravity, lever)
    return turned(wrench, situation.sensor_axes.swapaxes(1, 2))
