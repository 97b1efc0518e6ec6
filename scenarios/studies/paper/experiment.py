"""The paper's experiment on the bench: 151 postures, a rope, a tracker.

`Experiment` holds recording and truth; `Material` holds what methods may see of it, and
the fresh poses on which they are evaluated: all that a worker process needs.

Fresh poses (`unseen`) are of the region of the paper's Table 1, with true deflections.
One of the first group lies within half a step of one of that group's postures, one of
the second group in the box of its grid, flange straight down. As in the experiment,
60 : 90 are of the first : second.
"""

from dataclasses import dataclass, fields
from hashlib import sha256

import numpy as np
from jaxtyping import Float, Int

from bench import standard_plans
from bench.experiment import observed, record
from bench.instruments import ForceSensor, Instruments, Tracker
from bench.inverse_kinematics import inverse
from bench.postures import Room, spread
from bench.rig import Rig, States
from bench.shared.plan import DEFAULT_PATH, Plan, mixed_pulleys
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan as table_one
from bench.study_arm import default_truth
from scenarios.pipelines.synthetic_recording import KR10
from stiffness.experiment.deflections import Deflections, LoadCases, one_per_pose
from stiffness.robot.arm import Arm

# --- The experiment -------------------------------------------------------------------

REVISITS = 12  # chosen: every twelfth posture or so twice shows the real noise


@dataclass(frozen=True)
class Experiment:
    """The experiment's plan, its recording, and, because this is a bench, its truth.

    Attributes:
        rig: The true arm.
        states: True states; only for comparison, never for a method.
        arm: The nominal arm.
        measured: Deflections as the paper takes them: one row per posture.
    """

    rig: Rig
    plan: Plan
    recording: Recording
    states: States
    arm: Arm
    measured: Deflections

    @property
    def true_deflection(self) -> Float[np.ndarray, "rows 3"]:
        """True deflection for each row of `measured`, in m, along the base's axes."""
        point, loaded = self.measured.cases.point_in_flange, self.measured.row
        unloaded = self.plan.row_visit[loaded] * len(self.plan.path)
        return displacement(self.rig, self.states, (unloaded, loaded), point)

    @property
    def secant_stiffness(self) -> Float[np.ndarray, " axes"]:
        """Torque over wind-up of each true axis, by least squares over `measured`.

        K = Σ Δτ² / Σ Δτ Δθ in N m/rad, Δτ the load's torque about the axis and Δθ what
        all that gives way about the axis turned by.
        """
        cases = self.measured.cases
        torque = self.arm.load_torque(
            cases.posture, cases.wrench_in_base, "flange", cases.origin_in_flange
        )
        loaded = self.measured.row
        unloaded = self.plan.row_visit[loaded] * len(self.plan.path)
        turned = self.states.axis_angle[loaded] - self.states.axis_angle[unloaded]
        return (torque**2).sum(axis=0) / (torque * turned).sum(axis=0)


def carry_out(seed: int, poses: int = 151) -> Experiment:
    """Record the experiment on the default truth."""
    truth = default_truth()
    rig = Rig(KR10, truth.effects, truth.stiffness)
    plan = table_one(poses, revisits=min(REVISITS, poses))
    instruments = Instruments(tracker=Tracker(field=15e-6))
    states = rig.carry_out(plan)
    name = "KR10 pulley bench, Table 1"
    recording = observed(rig, plan, states, instruments, seed, name)
    arm = Arm.from_mjcf(KR10).for_recording(recording)
    return Experiment(
        rig=rig,
        plan=plan,
        recording=recording,
        states=states,
        arm=arm,
        measured=one_per_pose(arm, recording, None),
    )


def displacement(
    rig: Rig,
    states: States,
    rows: tuple[Int[np.ndarray, " points"], Int[np.ndarray, " points"]],
    point: Float[np.ndarray, "points 3"],
) -> Float[np.ndarray, "points 3"]:
    """Return how far points of the flange move from the first rows to the second.

    All in m, along the base's axes.
    """
    flange = states.bodies.index(rig.anatomy.flange)
    before, after = (
        states.position[row, flange]
        + np.einsum("nij,nj->ni", states.rotation[row, flange], point)
        for row in rows
    )
    return after - before


# --- Fresh postures ------------------------------------------------------------------

SILENT = Instruments(
    tracker=Tracker(noise=0.0, frame_error=(0.0,) * 6),
    force_sensor=ForceSensor(noise=0.0),
)
UP_TO_LOAD = DEFAULT_PATH[:5]
"""The experiment's path up to its first reading under the full load."""
STEPS_DEG = (15.0, 15.0, 30.0, 0.0, 15.0, 15.0)
"""Steps of Table 1's first group by axis; those of A5 and A6 were chosen there."""
GRID = np.array([[0.3, 0.8], [-0.3, 0.3], [0.3, 0.8]])
"""Limits of the grid of Table 1's second group along x, y, z, in m."""


@dataclass(frozen=True)
class Unseen:
    """Fresh load cases and their true deflections.

    Attributes:
        deflection: True, without noise, in m, along the base's axes.
    """

    cases: LoadCases
    deflection: Float[np.ndarray, "cases 3"]


def unseen(rig: Rig, arm: Arm, count: int, seed: int) -> Unseen:
    """Simulate fresh poses, each under its full load for the first time."""
    plan = fresh_plan(fresh_postures(rig, count, seed), seed)
    seen = one_per_pose(arm, record(rig, plan, SILENT, seed))
    return Unseen(seen.cases, seen.deflection)


def fresh_plan(posture: Float[np.ndarray, "count 6"], seed: int) -> Plan:
    """Return the plan that visits fresh postures, with pulleys in another order."""
    count = len(posture)
    return Plan(
        f"{count} fresh postures",
        posture,
        np.arange(count),
        np.random.default_rng(seed).permutation(mixed_pulleys(count)),
        UP_TO_LOAD,
    )


def fresh_postures(rig: Rig, count: int, seed: int) -> Float[np.ndarray, "count 6"]:
    """Return postures of the experiment's region without collisions, in rad."""
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    second = round(count * 90 / 150)
    inside = spread(GRID, second, seed, lambda p: room(facing_down(p)), central=1.0)
    box = np.array([[0.0, 1.0]] * 6)
    near = spread(box, count - second, seed, lambda u: room(_near(u)), central=1.0)
    return np.concatenate([_near(near), facing_down(inside)])


def facing_down(place: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 6"]:
    """Return postures with the flange at positions in m, as Table 1's second group."""
    transform = np.tile(np.eye(4), (len(place), 1, 1))
    away = np.arctan2(place[:, 1], place[:, 0])
    transform[:, 0, 0], transform[:, 1, 0] = -np.cos(away), -np.sin(away)
    transform[:, 0, 1], transform[:, 1, 1] = -np.sin(away), np.cos(away)
    transform[:, 2, 2] = -1.0
    transform[:, :3, 3] = place
    return inverse(standard_plans.KR10, transform)[:, standard_plans.FACING_ELBOW_UP]


def _near(unit: Float[np.ndarray, "rows 6"]) -> Float[np.ndarray, "rows 6"]:
    """Turn numbers from 0 to 1 into postures near those of the first group.

    The number of the axis that does not move chooses the posture of the table.
    """
    table = standard_plans.joint_space_postures()[:-1]  # home stands alone
    still = STEPS_DEG.index(0.0)
    row = np.minimum((unit[:, still] * len(table)).astype(int), len(table) - 1)
    posture = table[row] + np.deg2rad(STEPS_DEG) * (unit - 0.5)
    low, high = table.min(axis=0), table.max(axis=0)
    return np.clip(posture, low, high)


# --- Data of the methods --------------------------------------------------------------

HELD_OUT = 0.2
"""Share of the experiment's poses that no method sees; Wu et al. 2024, section 5.3: the
models are established by 80 % of the data."""


@dataclass(frozen=True)
class Material:
    """One experiment as methods may see it, and fresh poses."""

    arm: Arm
    recording: Recording
    measured: Deflections
    unseen: Unseen

    @classmethod
    def of(cls, experiment: Experiment, unseen: Unseen) -> "Material":
        """Return an experiment without its truth, with fresh poses."""
        return cls(experiment.arm, experiment.recording, experiment.measured, unseen)

    def held_out(self, seed: int) -> np.ndarray:
        """Draw the ids of poses that no method sees."""
        poses = np.unique(self.recording.posture_id)
        order = np.random.default_rng([seed, len(poses)]).permutation(poses)
        return np.sort(order[: max(round(HELD_OUT * len(poses)), 1)])

    def training(self, seed: int) -> Recording:
        """Return the recording without the poses held out; visits stay whole."""
        kept = ~np.isin(self.recording.posture_id, self.held_out(seed))
        return self.recording.take(kept)

    def digest(self) -> str:
        """Return a SHA-256 of all data, for the names of kept cells."""
        told = sha256()
        for part in (self.recording, self.unseen, self.unseen.cases):
            for field in fields(part):
                value = getattr(part, field.name)
                if isinstance(value, np.ndarray) and value.dtype.kind in "fiu":
                    told.update(np.ascontiguousarray(value).tobytes())
        return told.hexdigest()
