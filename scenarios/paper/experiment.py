"""The paper's experiment, carried out on the bench: 151 postures, a rope, a tracker."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.experiment import observed
from bench.instruments import Instruments, Tracker
from bench.plan import Plan
from bench.recording import Recording
from bench.rig import Rig
from bench.states import States
from bench.table_one import plan as table_one
from bench.truth import default_truth
from stiffness.arm import Arm
from stiffness.deflections import Deflections, one_per_pose

KR10 = Path(__file__).parents[2] / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
REVISITS = 12  # chosen: every twelfth posture or so twice shows the real noise


@dataclass(frozen=True)
class Experiment:
    """What was done, what was seen, and, because this is a bench, what was true.

    Attributes:
        rig: The arm made real.
        plan: What was done.
        recording: What the instruments saw.
        states: What was true; only for comparison, never for a method.
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
        """What `measured` would be with silent instruments, in m, base's frame."""
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
    """Carry out the experiment on the default truth.

    Args:
        seed: Of the instruments.
        poses: How many of the 151 postures.
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
