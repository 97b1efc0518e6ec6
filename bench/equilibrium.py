"""Held still under a load, an arm comes to rest where all its springs balance.

MuJoCo's `discrete` integrator at a very large time step is a Newton solver for that
rest: one step solves (M + hD + h²K) a = f, and with h = 10 s the inertia M plays no
part. Loads grow in small steps, so that what slips, slips as it would in slow motion:

- beside a spring that can slip, the step is stiffened (D) by all that may come to
  carry, so that no iterate overshoots;
- a creeping joint is frozen while the others balance and then let go for the time
  the load stands, T its time constant, in one exact step of
  θ(t) = θ∞ + (θ₀ - θ∞) exp(-t/T).
"""

import os
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float, Int
from mujoco import batch

from bench.cell import LOAD_POINT
from bench.settling import FROZEN, STEPS, TIME_STEP, Settle, made_static

LOAD_STEPS = (0.02, 0.33, 0.67, 1.0)
"""Fractions of a change of load, one after the other; chosen: a small one first."""


@dataclass(frozen=True)
class Schedule:
    """What is done to the arm, the same number of steps in every visit.

    Attributes:
        reference: Angle at which each axis' spring is slack, in rad.
        stiffness: Stiffness of each axis' spring, in N m/rad.
        tension: Tension of each rope, in N.
        wrench: Wrench on the sensor's origin along the base axes, in N and N m.
        hold: For how long each load stands before its row is read, in s.
    """

    reference: Float[np.ndarray, "visits axes"]
    stiffness: Float[np.ndarray, "visits axes"]
    tension: Float[np.ndarray, "visits steps ropes"]
    wrench: Float[np.ndarray, "visits steps 6"]
    hold: Float[np.ndarray, "visits steps"]


@dataclass(frozen=True)
class Rest:
    """Where everything came to rest.

    Attributes:
        position: Origins of all bodies in the base's world frame, in m.
        rotation: Their orientations, columns are the bodies' axes.
        joint: Positions of all joints of the model, in rad or m.
        force: Readings of the model's sensors.
        residual: Largest torque left unbalanced anywhere, in N m.
    """

    position: Float[np.ndarray, "visits steps bodies 3"]
    rotation: Float[np.ndarray, "visits steps bodies 3 3"]
    joint: Float[np.ndarray, "visits steps joints"]
    force: Float[np.ndarray, "visits steps sensors"]
    residual: float


def solve(
    model: mujoco.MjModel,
    axes: Int[np.ndarray, " axes"],
    creep: dict[int, float],
    schedule: Schedule,
    before: int = 0,
) -> Rest:
    """Bring the arm to rest under every load of every visit, in the order of time.

    Args:
        model: The arm with its effects and its cell.
        axes: Ids of the axes' joints.
        creep: Joint id and time constant, in s, of every joint that creeps.
        schedule: What is done to it.
        before: How many visits came before these.

    Returns:
        Where everything came to rest.

    Raises:
        BenchError: Where an arm finds no rest, naming the visit.
    """
    visits, steps = schedule.hold.shape
    model = made_static(model, creep)
    runs = batch.Batch(model, nsim=visits, nthread=_threads())
    _command(runs, model, axes, schedule)
    gravity = runs.expand("opt.gravity")
    full_gravity = gravity.copy()
    ctrl, push = runs.bind("ctrl"), runs.bind("xfrc_applied")
    xpos, xmat = runs.bind("xpos"), runs.bind("xmat")
    sensors, qpos = runs.bind("sensordata"), runs.bind("qpos")
    mount = model.body(LOAD_POINT).id
    creeping = _Creep(runs, model, creep)
    settle = Settle(runs, model, axes, creep, before)

    rest, worst = [], 0.0
    for step in range(steps):
        start = (ctrl.copy(), push[:, mount].copy())
        for fraction in LOAD_STEPS if model.nplastic else (1.0,):
            if step == 0:
                gravity[:] = fraction * full_gravity
            ctrl[:] = start[0] + fraction * (schedule.tension[:, step] - start[0])
            push[:, mount] = start[1] + fraction * (schedule.wrench[:, step] - start[1])
            runs.step(nstep=STEPS)
        if creep:
            settle.nearly()
            creeping.hold(schedule.hold[:, step])
        worst = max(worst, settle())
        rest.append([field.copy() for field in (xpos, xmat, qpos, sensors)])
    position, rotation, joint, force = (
        np.stack([entry[i] for entry in rest], axis=1) for i in range(4)
    )
    return Rest(
        position, rotation.reshape(*rotation.shape[:3], 3, 3), joint, force, worst
    )


def _threads() -> int:
    """As many as OMP_NUM_THREADS allows, so that processes side by side share."""
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    return int(allowed) if allowed.isdigit() else os.cpu_count() or 1


def _command(
    runs: batch.Batch,
    model: mujoco.MjModel,
    axes: Int[np.ndarray, " axes"],
    schedule: Schedule,
) -> None:
    reference = runs.expand("qpos_spring")
    stiffness = runs.expand("jnt_stiffness")
    lengths = runs.expand("tendon_lengthspring")
    qpos, plastic = runs.bind("qpos"), runs.bind("plastic")
    address = model.jnt_qposadr[axes]
    turned = np.zeros_like(qpos)
    turned[:, address] = schedule.reference - model.qpos_spring[address]
    reference[:] = reference + turned
    stiffness[:, axes] = schedule.stiffness
    qpos[:] = reference
    for t in range(model.ntendon):
        first, count = model.tendon_adr[t], model.tendon_num[t]
        if model.wrap_type[first] != mujoco.mjtWrap.mjWRAP_JOINT:
            continue
        for w in range(first, first + count):
            shift = turned[:, model.jnt_qposadr[model.wrap_objid[w]]]
            lengths[:, t] += (model.wrap_prm[w] * shift)[:, None]
        slot = model.tendon_plasticadr[t]
        if slot >= 0:
            plastic[:, slot : slot + 2] = lengths[:, t]


class _Creep:
    """Lets creeping joints go for the time that a load stands."""

    def __init__(
        self, runs: batch.Batch, model: mujoco.MjModel, creep: dict[int, float]
    ):
        self.runs, self.model, self.creep = runs, model, creep
        self.damping = runs.expand("dof_damping") if creep else None

    def hold(self, time: Float[np.ndarray, " visits"]) -> None:
        if self.damping is None:
            return
        for joint, time_constant in self.creep.items():
            remembered = np.exp(-time / time_constant)
            stiffness = self.model.jnt_stiffness[joint]
            self.damping[:, self.model.jnt_dofadr[joint]] = np.minimum(
                TIME_STEP * stiffness * remembered / -np.expm1(-time / time_constant),
                FROZEN,
            )
        self.runs.step(nstep=1)
        for joint in self.creep:
            self.damping[:, self.model.jnt_dofadr[joint]] = FROZEN
