"""Payload of an arm: as its model states it, or estimated from its effort limits.

==========  ==========================================================================
Equation    m = min over postures q and axes i of
            (SHARE Lᵢ - |gᵢ(q)|) / (g |Jᵢ(q)|) - what is mounted on the flange;
            L effort limit, gᵢ torque of the links' weight, Jᵢ velocity of the hook per
            velocity of the axis: a rope can pull in any direction
Source      statics of a serial arm (virtual work); `SHARE` is chosen, see there
Valid       axes at rest
Ignores     accelerations, limits of bearings and of the flange, heat
==========  ==========================================================================

A model states its payload as MJCF's `<custom><numeric name="payload_kg" data="10"/>`.
Effort limits are a joint's `actuatorfrcrange`, which is also what a URDF's
`<limit effort="…"/>` becomes, the `forcerange` of the actuators on a joint, and the
`ctrlrange` of its motors. A range of controls is a program's choice and may be a
controller's rest beside gravity's torque: one that does not hold the arm is none.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from bench import postures
from bench.cell import GRAVITY
from bench.kinematic_chain import Statics
from bench.model_file import load
from bench.postures import Room
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import DEFAULT_PATH, LoadStep

# --- Payload --------------------------------------------------------------------------

NUMERIC = "payload_kg"
"""Name of MJCF's custom number that states a payload."""
SHARE = 0.8
"""Of an effort limit that weight and load may take. Chosen: on arms whose makers state
both, a UR10, UR5e, KR10 R1100-2, LBR iiwa 14 and Panda of 10, 5, 10, 14 and 3 kg, it
leaves 9.6, 6.0, 8.5, 15.4 and 1.6 kg."""
STARTS, REFINED, ROUNDS, GRID = 500, 6, 2, 15
"""Postures tried, how many of them are made worse, and in how many steps; chosen."""


@dataclass(frozen=True)
class RatedLoad:
    """What may hang on the hook of an arm.

    Attributes:
        mass: The most, in kg.
    """

    mass: float
    source: str


def payload_of(rig: Rig) -> RatedLoad | None:
    """Return what may hang on an arm's hook; None where its model does not say.

    Raises:
        Unusable: Where what the model says leaves no load at all.
    """
    model, what = load(rig.arm_file), f"Model {str(rig.arm_file)!r}"
    for k in range(model.nnumeric):
        if model.numeric(k).name == NUMERIC:
            mass = float(model.numeric_data[model.numeric_adr[k]])
            if not (np.isfinite(mass) and mass > 0.0):
                raise Unusable(what, [f"{NUMERIC} is {mass:g}, expected above 0."])
            return RatedLoad(mass, "the payload that its model states")
    limits = effort_limits(model, rig.anatomy.axes)
    narrower = np.minimum(limits, _control_limits(model, rig.anatomy.axes))
    mass, axis = _estimate(rig, SHARE * narrower)
    if not mass > 0.0:
        mass, axis = _estimate(rig, SHARE * limits)
    if not np.isfinite(mass):
        return None
    name = rig.anatomy.axes[axis]
    if not mass > 0.0:
        unit = "N" if rig.anatomy.slides[axis] else "N m"
        fault = (
            f"{SHARE:.0%} of the effort limit of {name!r}, {limits[axis]:g} {unit}, do "
            f"not hold the arm's own weight; correct the limit, state {NUMERIC}, or "
            "say what hangs on the hook by --path and --overload."
        )
        raise Unusable(what, [fault])
    source = f"estimated from the effort limits, of which {name!r} comes first"
    return RatedLoad(mass, source)


def effort_limits(
    model: mujoco.MjModel, axes: Sequence[str]
) -> Float[np.ndarray, " axes"]:
    """Return what drives may exert, in N m (slides in N); infinite where not said.

    The model is the arm as its file has it, actuators included.
    """
    limits = np.full(len(axes), np.inf)
    for i, axis in enumerate(axes):
        joint = model.joint(axis).id
        if model.jnt_actfrclimited[joint]:
            limits[i] = np.abs(model.jnt_actfrcrange[joint]).min()
        on = _actuators_on(model, joint)
        if on.any() and model.actuator_forcelimited[on].all():
            force = np.abs(model.actuator_forcerange[on]).min(axis=1)
            limits[i] = min(limits[i], force @ np.abs(model.actuator_gear[on, 0]))
    return np.where(limits > 0.0, limits, np.inf)  # 0: its author did not know


def _control_limits(
    model: mujoco.MjModel, axes: Sequence[str]
) -> Float[np.ndarray, " axes"]:
    """Return what the ranges of motors' controls allow; infinite where not limited."""
    limits = np.full(len(axes), np.inf)
    motor = (
        (model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED)
        & (model.actuator_biastype == mujoco.mjtBias.mjBIAS_NONE)
        & (model.actuator_dyntype == mujoco.mjtDyn.mjDYN_NONE)
        & model.actuator_ctrllimited.astype(bool)
    )
    for i, axis in enumerate(axes):
        on = _actuators_on(model, model.joint(axis).id)
        if on.any() and motor[on].all():
            control = np.abs(model.actuator_ctrlrange[on]).min(axis=1)
            gain = model.actuator_gainprm[on, 0] * model.actuator_gear[on, 0]
            limits[i] = control @ np.abs(gain)
    return np.where(limits > 0.0, limits, np.inf)


def _actuators_on(model: mujoco.MjModel, joint: int) -> Bool[np.ndarray, " actuators"]:
    return (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT) & (
        model.actuator_trnid[:, 0] == joint
    )


def _estimate(rig: Rig, allowed: Float[np.ndarray, " axes"]) -> tuple[float, int]:
    """Return the largest mass on the hook in kg, and the axis that allows no more."""
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    limits = postures.within(room.limits, rig.anatomy.slides)
    statics = Statics(rig.nominal, rig.anatomy)
    hook = rig.mounted.sensor_position + np.array(rig.mounted.hook)

    def mass(posture: np.ndarray) -> tuple[float, int]:
        weight, jacobian = statics.at(posture, hook)
        lever = np.linalg.norm(jacobian, axis=0)
        each = (allowed - np.abs(weight)) / np.maximum(GRAVITY * lever, 1e-9)
        return float(each.min()), int(each.argmin())

    tried = postures.spread(limits, STARTS, 0, central=1.0)
    worst = sorted(tried, key=lambda posture: mass(posture)[0])[:REFINED]
    for posture in worst:
        for axis in (*range(len(limits)),) * ROUNDS:
            line = np.tile(posture, (GRID, 1))
            line[:, axis] = np.linspace(limits[axis, 0], limits[axis, 1], GRID)
            posture[:] = min((*line, posture.copy()), key=lambda q: mass(q)[0])
    least, axis = min(mass(posture) for posture in worst)
    return least - rig.mounted.payload.mass, axis


# --- Load paths within it -------------------------------------------------------------


def usual_path(payload: RatedLoad | None) -> tuple[LoadStep, ...]:
    """Return the usual load path, scaled down where an arm carries less than it."""
    usual = max(step.mass for step in DEFAULT_PATH)
    if payload is None or payload.mass >= usual:
        return DEFAULT_PATH
    digits = int(np.floor(np.log10(payload.mass))) - 1  # two digits are kept
    largest = np.floor(payload.mass / 10.0**digits + 1e-9) * 10.0**digits
    return tuple(
        replace(step, mass=round(step.mass / usual * largest, 9))
        for step in DEFAULT_PATH
    )
