"""Static equilibrium of a loaded arm in MuJoCo.

The engine says what is unbalanced, and `Settle` moves each joint by that over the
stiffness of all that carries there, until nothing is: levers couple joints by a share
of 1e-3 to 1e-2 only. Between two loads the torque of a gear changes one way, so that
what slips there is known by where it began (return mapping: Simo and Hughes 1998,
"Computational Inelasticity", chapter 1).

A creeping joint is frozen while the others balance and then released for the time of
the load, T its time constant, in one exact step θ(t) = θ∞ + (θ₀ - θ∞) exp(-t/T) of
MuJoCo's `discrete` integrator: that solves (M + hD + h²K) a = f, and with h = 10 s the
inertia M is negligible.

Visits that begin with nothing are computed side by side, in blocks, so that memory
stays small (`solve_in_blocks`). Where gears remember, one visit follows the other along
the way between their postures (`solve_in_turn`): what slipped or crept stays so,
relative to the motor, while the torque of gravity changes on the way.
"""

import copy
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int
from mujoco import batch

from bench.cell import LOAD_POINT
from bench.kinematic_chain import wraps_on_joints
from bench.shared.errors import BenchError

# --- Relaxation to rest ---------------------------------------------------------------

TIME_STEP = 10.0
"""The engine's time step, in s: so large that inertia is negligible."""
TOLERANCE = 1e-10
"""Largest unbalanced torque at convergence, in N m (N on a slide)."""
COARSE = 1e-6
"""Unbalanced torque at which what creeps may be released, in N m."""
MOST_STEPS, FURTHEST = 2000, 1.0
"""Steps at most, and how far a joint goes in one, in rad or m; chosen: no spring of an
arm that can be used winds up so far."""
FROZEN = 1e15
"""Damping that freezes a creeping joint within a step, N m s/rad."""


def made_static(model: mujoco.MjModel, creep: dict[int, float]) -> mujoco.MjModel:
    """Return a model whose steps are quasi-static; what creeps is frozen."""
    model = copy.copy(model)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    model.opt.timestep = TIME_STEP
    model.opt.tolerance = 1e-15
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= (
        off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_AUTORESET
    )
    model.dof_damping[:] = 0.0
    for joint in creep:
        model.dof_damping[model.jnt_dofadr[joint]] = FROZEN
    return model


class Settle:
    """Moves each joint by its unbalanced torque over its stiffness until none is left.

    A spring that a step would make tight counts, one that slips does not: it carries
    its yield, from where it was when the load began to change.
    """

    def __init__(
        self,
        runs: batch.Batch,
        model: mujoco.MjModel,
        axes: Int[np.ndarray, " axes"],
        creep: dict[int, float],
        before: int = 0,
    ):
        """Prepare runs of a static model, one a visit, with some visits before them."""
        self.runs, self.before = runs, before
        self.own, self.lever = runs.expand("jnt_stiffness"), _tendon_lengthening(model)
        across = np.count_nonzero(self.lever, axis=1) > 1
        self.coupled = np.flatnonzero(self.lever[across].any(axis=0))
        self.along, lever = model.tendon_stiffness, np.abs(self.lever)
        # across several joints, the sum of absolute values in the joint's row of the
        # stiffness matrix: a diagonal of these is never too soft (Gershgorin 1931)
        on = lever * lever.sum(axis=1, keepdims=True)
        self.tendons = model.tendon_stiffness[:, None] * on
        self.slips = model.tendon_plasticadr >= 0
        # the two ends of where a tendon is slack; of one that slips they are the same
        self.slots = model.tendon_plasticadr[self.slips, None] + np.arange(2)
        self.yields = model.tendon_springyield[self.slips]
        angle = np.full(model.njnt, 1e-3)  # what a rounded angle may be, in rad
        angle[axes] = 2 * np.pi
        stiffest = model.jnt_stiffness + self.tendons.sum(axis=0)
        self.allowed = TOLERANCE + np.finfo(float).eps * angle * stiffest
        self.free = ~np.isin(np.arange(model.njnt), list(creep))
        self.length = runs.bind("ten_length")
        self.slack = runs.expand("tendon_lengthspring")
        self.qpos, self.velocity = runs.bind("qpos"), runs.bind("qvel")
        self.force, self.plastic = runs.bind("qfrc_smooth"), runs.bind("plastic")

    def __call__(self, most: float = TOLERANCE) -> float:
        """Bring every run to equilibrium; return the largest unbalanced torque, in N m.

        Args:
            most: Unbalanced torque that may be left, in N m.

        Raises:
            BenchError: Where a run does not converge, naming the visit.
        """
        largest, left = np.full(len(self.qpos), np.inf), np.arange(len(self.qpos))
        before = self.plastic[:, self.slots[:, 0]]
        for _ in range(MOST_STEPS):
            largest[left] = self._unbalanced(left)
            left = left[largest[left] > most / TOLERANCE]
            if not np.isfinite(largest[left]).all():
                break
            if not len(left):
                return float(np.abs(self.force[:, self.free]).max())
            self._step(left, before[left])
        raise BenchError(
            f"Visit {self.before + int(largest.argmax())} finds no rest: "
            f"{largest.max():.2g} times the {TOLERANCE} N m allowed stay unbalanced. "
            "A spring may be too soft for its load, or a rope just leaves its pulley."
        )

    def _step(
        self, left: Int[np.ndarray, " left"], before: Float[np.ndarray, "left slips"]
    ) -> None:
        """Move the joints of some runs to where springs balance; what slips follows.

        Where a spring begins to carry on the way, the rest of it is that much stiffer.

        Args:
            left: Which runs.
            before: Where slipping tendons were slack before the load changed.
        """
        own, length, force = self.own[left], self.length[left], self.force[left]
        low, high = np.moveaxis(self.slack[left], -1, 0)
        low[:, self.slips] = before - self.yields
        high[:, self.slips] = before + self.yields
        carries = ((length <= low) | (length >= high)) != self.slips
        stiffness = own + carries @ self.tendons
        step = self.free * force / stiffness
        if len(self.coupled):
            step[:, self.coupled] = self._step_together(own, carries, force)
        moved = step @ self.lever.T
        edge = np.where((moved > 0.0) != self.slips, high, low)
        reached = ~carries & ((edge - length) * (edge - length - moved) < 0.0)
        if reached.any():
            share = np.where(
                reached, (edge - length) / np.where(reached, moved, 1.0), 1.0
            )
            first = np.where(self.tendons > 0.0, share[..., None], 1.0).min(axis=1)
            stiffer = stiffness / (stiffness + reached @ self.tendons)
            step *= first + (1.0 - first) * stiffer
        step = np.clip(step, -FURTHEST, FURTHEST)
        self.qpos[left] += step
        length = (length + step @ self.lever.T)[:, self.slips]
        slipped = np.clip(before, length - self.yields, length + self.yields)
        self.plastic[left[:, None, None], self.slots] = slipped[..., None]

    def _step_together(
        self,
        own: Float[np.ndarray, "left joints"],
        carries: Bool[np.ndarray, "left tendons"],
        force: Float[np.ndarray, "left joints"],
    ) -> Float[np.ndarray, "left coupled"]:
        """Return steps of joints that tendons couple, by the stiffness matrix."""
        on, lever = self.coupled, self.lever[:, self.coupled]
        carried = (carries * self.along)[:, :, None] * lever
        matrix = lever.T @ carried + own[:, on, None] * np.eye(len(on))
        return np.linalg.solve(matrix, force[:, on, None])[..., 0]

    def _unbalanced(self, some: Int[np.ndarray, " some"]) -> Float[np.ndarray, " some"]:
        """Return the largest share of what is allowed that runs leave unbalanced."""
        self.velocity[:] = 0.0
        self.runs.forward(some)
        with np.errstate(over="ignore"):  # a load without end
            share = (np.abs(self.force[some]) / self.allowed)[:, self.free]
        return np.nan_to_num(share, nan=np.inf).max(axis=1)


def _tendon_lengthening(model: mujoco.MjModel) -> Float[np.ndarray, "tendons joints"]:
    """Return by how much each fixed tendon grows with each joint."""
    on = np.zeros((model.ntendon, model.njnt))
    for t in range(model.ntendon):
        wraps = wraps_on_joints(model, t)
        on[t, model.wrap_objid[wraps]] = model.wrap_prm[wraps]
    return on


# --- Loads in the order of time -------------------------------------------------------

SLIPS, SLIPPED = 50, 1e-6
"""Steps that bring slipping tendons to a torque at most, and the error over the yield
that ends them; chosen."""


@dataclass(frozen=True)
class Schedule:
    """Loads and references of the arm, the same number of steps in every visit.

    Attributes:
        reference: Angle at which each axis' spring is slack, in rad.
        tension: Tension of each rope, in N.
        wrench: Wrench on the sensor's origin along the base axes, in N and N m.
        hold: Time from each change of load to the reading of its row, in s.
    """

    reference: Float[np.ndarray, "visits axes"]
    stiffness: Float[np.ndarray, "visits axes"]
    tension: Float[np.ndarray, "visits steps ropes"]
    wrench: Float[np.ndarray, "visits steps 6"]
    hold: Float[np.ndarray, "visits steps"]


@dataclass(frozen=True)
class GearStates:
    """What gears bring to each visit, by names of the model's parts.

    Attributes:
        slipped: Torque of slipping tendons under the first load, over the one at which
            they slip; others come to it as that load makes them.
        crept: Torque in the springs of creeping joints before the first load, in N m;
            others have none.
    """

    slipped: Mapping[str, Float[np.ndarray, " visits"]] = field(default_factory=dict)
    crept: Mapping[str, Float[np.ndarray, " visits"]] = field(default_factory=dict)

    def of(self, visits: slice) -> "GearStates":
        """Return what is brought to some visits."""
        parts = (self.slipped, self.crept)
        return GearStates(*({n: v[visits] for n, v in part.items()} for part in parts))

    def leaving_out(self, names: Collection[str]) -> "GearStates":
        """Return the same without some parts."""
        parts = (self.slipped, self.crept)
        kept = ({n: v for n, v in p.items() if n not in names} for p in parts)
        return GearStates(*kept)


@dataclass(frozen=True)
class Rest:
    """State at equilibrium in every row.

    Attributes:
        position: Origins of all bodies in the base's world frame, in m.
        rotation: Their orientations, columns are the bodies' axes.
        joint: Positions of all joints of the model, in rad or m.
        force: Readings of the model's sensors.
        residual: Largest unbalanced torque anywhere, in N m.
        initial: What gears brought to each visit from the one before; None: nothing.
    """

    position: Float[np.ndarray, "visits steps bodies 3"]
    rotation: Float[np.ndarray, "visits steps bodies 3 3"]
    joint: Float[np.ndarray, "visits steps joints"]
    force: Float[np.ndarray, "visits steps sensors"]
    residual: float
    initial: GearStates | None = None


def solve(
    model: mujoco.MjModel,
    axes: Int[np.ndarray, " axes"],
    creep: dict[int, float],
    schedule: Schedule,
    before: int = 0,
    initial: GearStates | None = None,
) -> Rest:
    """Return the equilibrium under every load of every visit, in the order of time.

    Joints that creep are given with their time constant, in s. Gears begin each visit
    with nothing but what arrives.

    Raises:
        BenchError: Where an arm does not converge, naming the visit.
    """
    arms, steps = _Arms(model, axes, creep, schedule, before), schedule.hold.shape[1]
    if initial is not None:
        arms.crept = initial.crept
    course = [arms.load(schedule, 0)]
    if initial is not None and initial.slipped:
        course = [arms.slip(initial.slipped)]
    course += [arms.load(schedule, step) for step in range(1, steps)]
    return replace(_rest_of(course, arms), initial=initial)


@dataclass(frozen=True)
class Ways:
    """Ways from posture to posture, the same number of points on each.

    Attributes:
        reference: As in `Schedule`, at each point; the last is the visit's own.
        stiffness: Likewise.
        time: How long each way takes, in s.
    """

    reference: Float[np.ndarray, "visits points axes"]
    stiffness: Float[np.ndarray, "visits points axes"]
    time: Float[np.ndarray, " visits"]


def solve_in_turn(
    model: mujoco.MjModel,
    axes: Int[np.ndarray, " axes"],
    creep: dict[int, float],
    schedule: Schedule,
    ways: Ways,
) -> Rest:
    """Return the equilibrium of every visit, each beginning as the one before ended.

    Arguments are as in `solve`. Ways lead from the posture before to that of each
    visit, without a load; the first visit has none, and grows its gravity from nothing.

    Raises:
        BenchError: Where an arm does not converge, naming the visit.
    """
    visits, steps = schedule.hold.shape
    arms, rests = None, []
    for visit in range(visits):
        own = _some(schedule, slice(visit, visit + 1))
        if arms is None:
            arms = _Arms(model, axes, creep, own, 0)
        else:
            arms.move(_some(ways, slice(visit, visit + 1)), visit)
        crept, course = arms.crept, [arms.load(own, 0)]
        initial = GearStates(arms.slipped, crept)
        course += [arms.load(own, step) for step in range(1, steps)]
        rests.append(replace(_rest_of(course, arms), initial=initial))
    return _joined(rests)


Of = TypeVar("Of", Schedule, Ways)


def _some(whole: Of, visits: slice) -> Of:
    """Return a schedule or ways of some visits."""
    parts = {f.name: getattr(whole, f.name)[visits] for f in fields(whole)}
    return type(whole)(**parts)


class _Arms:
    """Arms in the simulator, one for each visit that is computed side by side."""

    def __init__(
        self,
        model: mujoco.MjModel,
        axes: Int[np.ndarray, " axes"],
        creep: dict[int, float],
        schedule: Schedule,
        before: int,
    ):
        """Put the arms into their postures, weightless; see `solve`."""
        model = made_static(model, creep)
        self.model, self.axes, self.creep = model, axes, creep
        runs = batch.Batch(model, nsim=len(schedule.hold), nthread=_threads())
        self.runs = runs
        self.settle = settle = Settle(runs, model, axes, creep, before)
        settle.plastic[:, settle.slots] = settle.slack[:, settle.slips]
        runs.bind("qpos")[:] = runs.expand("qpos_spring")
        self.reference = model.qpos_spring[model.jnt_qposadr[axes]]
        self._stand(schedule.reference, schedule.stiffness)
        self.ctrl, self.push = runs.bind("ctrl"), runs.bind("xfrc_applied")
        self.fields = [
            runs.bind(name) for name in ("xpos", "xmat", "qpos", "sensordata")
        ]
        self.mount = model.body(LOAD_POINT).id
        self.creeping = _Creep(runs, model, creep)
        self.worst = 0.0

    def load(self, schedule: Schedule, step: int) -> list[np.ndarray]:
        """Apply the loads of a step; return fields of the arms at rest."""
        self.ctrl[:] = schedule.tension[:, step]
        self.push[:, self.mount] = schedule.wrench[:, step]
        if self.creep:
            self.settle(COARSE)
            self.creeping.hold(schedule.hold[:, step])
        self.worst = max(self.worst, self.settle())
        return [field.copy() for field in self.fields]

    @property
    def crept(self) -> dict[str, Float[np.ndarray, " visits"]]:
        """Torque in the springs of creeping joints, in N m, by the joint's name."""
        model, found = self.model, {}
        for joint in self.creep:
            at = model.jnt_qposadr[joint]
            wound = self.runs.bind("qpos")[:, at] - model.qpos_spring[at]
            found[model.joint(joint).name] = model.jnt_stiffness[joint] * wound
        return found

    @crept.setter
    def crept(self, torque: Mapping[str, Float[np.ndarray, " visits"]]) -> None:
        model = self.model
        for joint in self.creep:
            own = torque.get(model.joint(joint).name)
            if own is not None:
                at = model.jnt_qposadr[joint]
                wound = own / model.jnt_stiffness[joint]
                self.runs.bind("qpos")[:, at] = model.qpos_spring[at] + wound

    @property
    def slipped(self) -> dict[str, Float[np.ndarray, " visits"]]:
        """Torque of slipping tendons over that at which they slip, by name."""
        settle = self.settle
        away = settle.length[:, settle.slips] - settle.plastic[:, settle.slots[:, 0]]
        share = np.clip(away / settle.yields, -1.0, 1.0)
        return dict(zip(self._slipping, share.T, strict=True))

    @property
    def _slipping(self) -> list[str]:
        """Names of slipping tendons, in order."""
        every = np.flatnonzero(self.settle.slips)
        return [self.model.tendon(t).name for t in every]

    def slip(
        self, asked: Mapping[str, Float[np.ndarray, " visits"]]
    ) -> list[np.ndarray]:
        """Bring slipping tendons to shares of their yield, by name; others stay.

        A step reckons with how far the joint follows what changes, over the stiffness
        of all that does not slip; steps end where no tendon is off by `SLIPPED`.

        Raises:
            BenchError: Where they do not end.
        """
        settle, names = self.settle, self._slipping
        plastic, length = settle.plastic, settle.length
        some = np.isin(names, list(asked))
        slips, slots = np.flatnonzero(settle.slips)[some], settle.slots[some]
        share = np.zeros((len(length), len(slips)))
        for k, name in enumerate(name for name in names if name in asked):
            share[:, k] = asked[name]
        yields, joint = settle.yields[some], settle.tendons[slips].argmax(axis=1)
        others = np.delete(settle.tendons, slips, axis=0)
        beside = settle.own[:, joint] + others.sum(axis=0)[joint]
        stiffness = settle.tendons[slips, joint]
        for _ in range(SLIPS):
            stretched = np.clip(
                length[:, slips] - plastic[:, slots[:, 0]], -yields, yields
            )
            missing = share * yields - stretched
            if np.abs(missing).max(initial=0.0) <= SLIPPED * yields.max(initial=0.0):
                self.worst = max(self.worst, self.settle())
                return [field.copy() for field in self.fields]
            torque = (stiffness * missing) @ (joint[:, None] == joint)  # of its joint
            follows = -torque / beside
            rest = length[:, slips] + follows - share * yields
            plastic[:, slots] = rest[..., None]
            self.settle(COARSE)
        raise BenchError("What slips in the gears does not come to what is asked for.")

    def move(self, ways: Ways, before: int) -> None:
        """Unload the arms and move them; gears keep what slipped and what crept."""
        self.settle.before = before
        self.ctrl[:], self.push[:, self.mount] = 0.0, 0.0
        self.settle(COARSE)
        points = ways.reference.shape[1]
        self._creep(
            ways.time / points / 2
        )  # the torque at either end acts half as long
        for point in range(points):
            self._stand(ways.reference[:, point], ways.stiffness[:, point])
            self.settle(COARSE)
            self._creep(ways.time / points / (1 + (point == points - 1)))

    def _creep(self, time: Float[np.ndarray, " visits"]) -> None:
        if self.creep and np.all(time > 0.0):
            self.creeping.hold(time)

    def _stand(self, reference: np.ndarray, stiffness: np.ndarray) -> None:
        model, runs = self.model, self.runs
        step = np.zeros_like(runs.bind("qpos"))
        step[:, model.jnt_qposadr[self.axes]] = reference - self.reference
        self.reference = reference
        for name in ("qpos_spring", "qpos"):
            field = runs.expand(name) if name == "qpos_spring" else runs.bind(name)
            field[:] = field + step
        settle, longer = self.settle, step @ self.settle.lever.T
        settle.own[:, self.axes] = stiffness
        settle.slack += longer[..., None]
        settle.plastic[:, settle.slots] += longer[:, settle.slips, None]


def _rest_of(course: list[list[np.ndarray]], arms: _Arms) -> Rest:
    position, rotation, joint, force = (
        np.stack([entry[i] for entry in course], axis=1) for i in range(4)
    )
    rotation = rotation.reshape(*rotation.shape[:3], 3, 3)
    return Rest(position, rotation, joint, force, arms.worst)


def _threads() -> int:
    """Return the number of threads that OMP_NUM_THREADS allows this process."""
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    return int(allowed) if allowed.isdigit() else os.cpu_count() or 1


class _Creep:
    """Releases creeping joints for the time of a load."""

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


# --- Many visits in blocks ------------------------------------------------------------

BLOCK = 1000
"""Number of visits computed side by side; chosen: about 100 MB."""


def solve_in_blocks(
    model: mujoco.MjModel,
    axes: Int[np.ndarray, " axes"],
    creep: dict[int, float],
    schedule: Schedule,
    initial: GearStates | None = None,
) -> Rest:
    """Return the equilibrium of every visit, in blocks; see `solve`."""
    rests = []
    for start in range(0, len(schedule.hold), BLOCK):
        some = slice(start, start + BLOCK)
        brought = None if initial is None else initial.of(some)
        own = _some(schedule, some)
        rests.append(solve(model, axes, creep, own, start, brought))
    return _joined(rests)


def _joined(rests: list[Rest]) -> Rest:
    """Return the states of all visits, one after the other."""
    if len(rests) == 1:
        return rests[0]
    arrays = ("position", "rotation", "joint", "force")
    joined = {n: np.concatenate([getattr(rest, n) for rest in rests]) for n in arrays}
    each = [rest.initial for rest in rests if rest.initial is not None]
    initial = None if not each else GearStates(
        *(
            {n: np.concatenate([getattr(a, part)[n] for a in each]) for n in of_first}
            for part in ("slipped", "crept")
            for of_first in [getattr(each[0], part)]
        )
    )  # fmt: skip
    return Rest(**joined, residual=max(r.residual for r in rests), initial=initial)
