"""Dynamic simulation of a load path: soft loads, damping, the same state of rest.

`bench.equilibrium` computes only states of rest; here the same model is run as
dynamics, by another integrator with small steps, and no joint is frozen. It is far too
slow for an experiment and serves as a reference for the computed states.
"""

import copy

import mujoco
import numpy as np
from jaxtyping import Float

from bench.cell import LOAD_POINT
from bench.rig import Rig

TIME_STEP = 1e-4
"""In s; chosen: stable for the closed play, the stiffest spring."""
DAMPING_TIME = 0.03
"""Damping over stiffness of every joint, in s; chosen: the arm's slowest oscillation,
10 to 13 Hz, decays without overshooting, and nothing slips that would not under slow
loads."""
RAMP = 0.5
"""Duration of a change of load, in s; chosen: six of those oscillations."""
UPDATE = 10
"""Number of steps between two values of the load."""


def dynamic_run(
    rig: Rig,
    posture: Float[np.ndarray, " axes"],
    wrench: Float[np.ndarray, "steps 6"],
    hold: Float[np.ndarray, " steps"],
) -> Float[np.ndarray, "steps 3"]:
    """Simulate one visit as dynamics.

    Gravity comes with the first load.

    Args:
        rig: The arm with its effects.
        posture: Angles that the controller reports, in rad.
        wrench: Wrenches at the sensor's origin along the base's axes, in N and N m.
        hold: From the middle of each change of load to the reading, in s; at least
            half of `RAMP`. The next load is half applied after half of `RAMP` more.

    Returns:
        Origin of the flange at the end of every step, in the base's world frame, in m.
    """
    model = _damped(rig)
    data = mujoco.MjData(model)
    _command(rig, model, data, posture)
    pushed, flange = model.body(LOAD_POINT).id, model.body(rig.anatomy.flange).id
    gravity, load, places = model.opt.gravity.copy(), np.zeros(6), []
    for s in range(len(hold)):
        start, count = load, round((hold[s] + RAMP / 2) / (TIME_STEP * UPDATE))
        for i in range(count):
            share = min(1.0, (i + 0.5) * UPDATE * TIME_STEP / RAMP)
            share = (1 - np.cos(np.pi * share)) / 2
            load = start + share * (wrench[s] - start)
            data.xfrc_applied[pushed] = load
            if s == 0:
                model.opt.gravity = share * gravity
            mujoco.mj_step(model, data, UPDATE)
        places.append(data.xpos[flange].copy())
    return np.array(places)


def _damped(rig: Rig) -> mujoco.MjModel:
    """Return the rig's model with damping in every joint that does not creep."""
    model = copy.copy(rig.model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.timestep = TIME_STEP
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_LIMIT
    damping = DAMPING_TIME * model.jnt_stiffness
    for t in range(model.ntendon):
        for w in _wraps(model, t):
            damping[model.wrap_objid[w]] += TIME_STEP * model.tendon_stiffness[t]
    own = model.dof_damping[model.jnt_dofadr]
    model.dof_damping[model.jnt_dofadr] = np.maximum(own, damping)  # creep has more
    return model


def _command(
    rig: Rig,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    posture: Float[np.ndarray, " axes"],
) -> None:
    """Set the arm to the posture that the gears should hold, all springs slack."""
    command = rig.command(posture[None])
    axes = [model.joint(axis).id for axis in rig.anatomy.axes]
    model.jnt_stiffness[axes] = command.stiffness[0]
    turned = np.zeros(model.nq)
    address = model.jnt_qposadr[axes]
    turned[address] = command.reference[0] - model.qpos_spring[address]
    model.qpos_spring += turned
    data.qpos[:] = model.qpos_spring
    for t in range(model.ntendon):
        for w in _wraps(model, t):
            shift = model.wrap_prm[w] * turned[model.jnt_qposadr[model.wrap_objid[w]]]
            model.tendon_lengthspring[t] += shift
        slot = model.tendon_plasticadr[t]
        if slot >= 0:
            data.plastic[slot : slot + 2] = model.tendon_lengthspring[t]


def _wraps(model: mujoco.MjModel, tendon: int) -> range:
    """Return the entries of a fixed tendon; none for a rope."""
    first = int(model.tendon_adr[tendon])
    fixed = model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT
    return range(first, first + int(model.tendon_num[tendon]) * bool(fixed))
