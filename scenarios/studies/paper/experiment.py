"""The paper's experiment on the bench: 151 postures, a rope, a tracker.

`Experiment` holds recording and truth; `Material` holds what methods may see of it, and
the fresh poses on which they are evaluated: all that a worker process needs.
"""

from dataclasses import dataclass, fields
from hashlib import sha256
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.experiment import observed
from bench.instruments import Instruments, Tracker
from bench.rig import Rig, States
from bench.shared.plan import Plan
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan as table_one
from bench.study_arm import default_truth
from scenarios.studies.paper.fresh_postures import Unseen
from stiffness.experiment.deflections import Deflections, one_per_pose
from stiffness.robot.arm import Arm

# --- The experiment -------------------------------------------------------------------

KR10 = Path(__file__).parents[3] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
REVISITS = 12  # chosen: every twelfth posture or so twice shows the real noise


@dataclass(frozen=True)
class Experiment:
    """The experiment's plan, its recording, and, because this is a bench, its truth.

    Attributes:
        rig: The true arm.
        plan: Postures and loads.
        recording: Readings of the instruments.
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
        point = self.measured.cases.point_in_flange
        flange = self.states.bodies.index(self.rig.anatomy.flange)
        loaded = self.measured.row
        unloaded = self.plan.row_visit[loaded] * len(self.plan.path)
        ends = [
            self.states.position[row, flange]
            + np.einsum("nij,nj->ni", self.states.rotation[row, flange], point)
            for row in (loaded, unloaded)
        ]
        return ends[0] - ends[1]

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
    """Record the experiment on the default truth.

    Args:
        seed: Of the instruments.
        poses: Number of the 151 postures.
    """
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


# --- Data of the methods --------------------------------------------------------------

HELD_OUT = 0.2
"""Share of the experiment's poses that no method sees; Wu et al. 2024, section 5.3: the
models are established by 80 % of the data."""


@dataclass(frozen=True)
class Material:
    """One experiment as methods may see it, and fresh poses.

    Attributes:
        arm: The nominal arm.
        recording: Readings of the instruments.
        measured: One deflection per posture, as the paper takes them.
        unseen: Fresh poses with their true deflection.
    """

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
