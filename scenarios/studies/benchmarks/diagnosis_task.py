"""Benchmark task that ranks causes in columns, or by trying each in the simulator.

One other way simulates the mechanism of each hypothesis once, at one site and with one
size, and compares nothing: a lower bound on any search by simulation. One simulation is
run and its time multiplied. The other is this diagnosis on a longer recording, its time
divided by how much longer it is: about as long as ours, since the cost grows with the
number of poses and not with its square.
"""

import numpy as np

from bench import postures
from bench.effects.hysteresis import Hysteresis
from bench.experiment import record
from bench.postures import Room
from bench.rig import Rig
from bench.shared.plan import Plan, mixed_pulleys
from bench.standard_plans import table_one_plan as table_one
from scenarios.studies.benchmarks.race import Race, Way
from scenarios.studies.benchmarks.tasks import KR10, PAPERS
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects import HYPOTHESES
from stiffness.robot.arm import Arm

LONGER = 4
"""Factor on the poses of the longer recording; chosen for time."""


def race(poses: int) -> Race:
    """Return the race over the diagnosis of one hysteretic axis."""
    rig, plan = Rig(KR10, (Hysteresis("a2", width_rad=2.9e-4),)), table_one(poses)
    recording, arm = record(rig, plan), Arm.from_mjcf(KR10)
    longer = record(rig, _longer(rig, plan))
    count = len(HYPOTHESES)
    return Race(
        task=f"diagnosis: {len(recording.time)} rows, {count} hypotheses",
        ways=(
            Way("stiffness.diagnosis", lambda: diagnose(recording, arm)),
            Way(
                f"one simulation for each of {count} hypotheses",
                lambda: rig.carry_out(plan),
                share=1 / count,
            ),
            Way(
                f"ours on {LONGER} times the poses, for each of them",
                lambda: diagnose(longer, arm),
                share=LONGER,
            ),
        ),
        bar=3.0 if poses == PAPERS else None,
    )


def _longer(rig: Rig, plan: Plan) -> Plan:
    """Return a plan with postures spread over the joint limits."""
    poses = LONGER * plan.posture.shape[0]
    room = Room(rig.nominal, rig.anatomy, rig.mounted)
    return Plan(
        name=f"{poses} postures",
        posture=postures.spread(room.limits, poses, 0, room),
        posture_id=np.arange(poses),
        pulley=mixed_pulleys(poses, len(rig.mounted.pulley)),
        path=plan.path,
    )
