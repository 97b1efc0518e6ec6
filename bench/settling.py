"""What slips must not overshoot, and what is nearly at rest must come to rest.

The engine's step is made safe beforehand, and the last digits are removed afterwards:
its solver works on a cost and stops near the square root of the machine's precision.
"""

import copy

import mujoco
import numpy as np
from jaxtyping import Int
from mujoco import batch

from bench.errors import BenchError

TIME_STEP = 10.0
"""Of the engine's step, in s: so large that inertia plays no part."""
TOLERANCE = 1e-10
"""Largest torque that may stay unbalanced, in N m (N on a slide)."""
COARSE = 1e-6
"""Unbalanced torque at which the engine's own steps end, in N m."""
STEPS, MOST_STEPS = 3, 2000
FROZEN = 1e15
"""Damping that keeps a creeping joint still within a step, N m s/rad."""


def made_static(model: mujoco.MjModel, creep: dict[int, float]) -> mujoco.MjModel:
    """Return a model whose steps lead to rest.

    Args:
        model: The arm.
        creep: Joints that creep, which stay frozen.
    """
    model = copy.copy(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    model.opt.timestep = TIME_STEP
    model.opt.tolerance = 1e-15
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= (
        off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_AUTORESET
    )
    model.dof_damping[:] = 0.0
    tendons = _tendons_on_joints(model)
    slips = model.tendon_plasticadr >= 0
    beside = tendons[slips].any(axis=0)
    overshoots = TIME_STEP * np.where(beside, tendons[~slips].sum(axis=0), 0.0)
    model.dof_damping[model.jnt_dofadr] = overshoots
    for joint in creep:
        model.dof_damping[model.jnt_dofadr[joint]] = FROZEN
    return model


class Settle:
    """Steps until the arm rests, then removes the last rounding of the step's solver.

    For the last digits each joint is moved by its torque over its stiffness.
    """

    def __init__(
        self,
        runs: batch.Batch,
        model: mujoco.MjModel,
        axes: Int[np.ndarray, " axes"],
        creep: dict[int, float],
        before: int = 0,
    ):
        """Watch these runs of a static model.

        Args:
            runs: One for each visit.
            model: What runs.
            axes: Joint ids of the axes.
            creep: Joints that creep and are not asked to balance.
            before: How many visits came before these.
        """
        self.runs, self.before = runs, before
        self.own, self.tendons = model.jnt_stiffness, _tendons_on_joints(model)
        self.slips = model.tendon_plasticadr >= 0
        angle = np.full(model.njnt, 1e-3)  # what a rounded angle may be, in rad
        angle[axes] = 2 * np.pi
        stiffest = self.own + self.tendons.sum(axis=0)
        self.allowed = TOLERANCE + np.finfo(float).eps * angle * stiffest
        self.free = ~np.isin(np.arange(model.njnt), list(creep))
        self.length = runs.bind("ten_length")
        self.slack = runs.expand("tendon_lengthspring")
        self.qpos, self.velocity = runs.bind("qpos"), runs.bind("qvel")
        self.force = runs.bind("qfrc_smooth")

    def nearly(self) -> None:
        """Bring every run close to rest by the engine's own steps."""
        for _ in range(MOST_STEPS // STEPS):
            self.velocity[:] = 0.0
            self.runs.step(nstep=STEPS)
            if self._unbalanced().max() <= COARSE / TOLERANCE:
                break

    def __call__(self) -> float:
        """Bring every run to rest; return the largest torque left, in N m.

        Raises:
            BenchError: Where a run finds no rest, naming the visit.
        """
        largest = np.full(self.qpos.shape[0], np.inf)
        self.nearly()
        for _ in range(MOST_STEPS):
            largest = self._unbalanced()
            if largest.max() <= 1.0:
                return float(np.abs(self.force[:, self.free]).max())
            tight = (self.length < self.slack[..., 0]) | (
                self.length > self.slack[..., 1]
            )
            stiffness = self.own + (tight | self.slips) @ self.tendons
            self.qpos += self.free * self.force / stiffness
        raise BenchError(
            f"Visit {self.before + int(largest.argmax())} finds no rest: "
            f"{largest.max():.2g} times the {TOLERANCE} N m allowed stay unbalanced. "
            "A spring may be too soft for its load."
        )

    def _unbalanced(self) -> np.ndarray:
        self.velocity[:] = 0.0
        self.runs.forward()
        share = (np.abs(self.force) / self.allowed)[:, self.free]
        return np.nan_to_num(share, nan=np.inf).max(axis=1)


def _tendons_on_joints(model: mujoco.MjModel) -> np.ndarray:
    """Return the stiffness each fixed tendon gives to each joint, (tendons, joints).

    Across several joints it is the sum of the absolute values in the joint's row of
    the stiffness matrix: a diagonal of these is never too soft (Gershgorin 1931).
    """
    on = np.zeros((model.ntendon, model.njnt))
    for t in range(model.ntendon):
        first = model.tendon_adr[t]
        if model.wrap_type[first] != mujoco.mjtWrap.mjWRAP_JOINT:
            continue
        wraps = slice(first, first + model.tendon_num[t])
        lever = np.abs(model.wrap_prm[wraps])
        on[t, model.wrap_objid[wraps]] = model.tendon_stiffness[t] * lever * lever.sum()
    return on
