"""A diagnosis weighs every cause in columns; the simulator would try one at a time.

The other way simulates each hypothesis' mechanism once, at one place and with one size,
and compares nothing: less than any search by simulation can cost. One is run.
"""

from bench.effects.hysteresis import Hysteresis
from bench.experiment import record
from bench.rig import Rig
from bench.table_one import plan as table_one
from scenarios.benchmarks.experiment import KR10
from scenarios.benchmarks.race import Race, Way
from stiffness.arm import Arm
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.hypotheses import HYPOTHESES


def race(poses: int) -> Race:
    """Return the race over the diagnosis of one hysteretic axis."""
    rig, plan = Rig(KR10, (Hysteresis("a2", width_rad=2.9e-4),)), table_one(poses)
    recording, arm = record(rig, plan), Arm.from_mjcf(KR10)
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
        ),
    )
