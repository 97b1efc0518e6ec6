"""Tries the diagnosis on arms of any model file, with the base as shipped and turned.

Each model of a folder (MJCF or URDF, from any collection) is given springs; two effects
are concealed, once with the base as shipped and once turned and moved at random; names,
springs, the proof and `model.xml` are held against the truth, which both have in
common. Each trial is written when it is done; started again, it goes on, and tries anew
what failed.

Run:    python -m scenarios.arm_trials --models DIR --trials 3 --out results/arm_trials
Takes:  1 to 2 minutes a trial (two recordings of 60 postures, diagnosed and proved)
Expect: the same with either base: both effects named, springs of the patch within 5 %,
        the simulator at the noise on the poses kept back
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from scenarios.report.command_line import at_least, progress_bar, run

if TYPE_CHECKING:
    from scenarios.studies.arm_trials import ArmTrial


@dataclass(frozen=True)
class Settings:
    """Which arms, and how much is tried."""

    models: Path
    """Folder of model files."""
    out: Path
    """Folder for the table and the report."""
    trials: int = 3
    """Trials of each arm."""
    poses: int = 60
    """Postures of a recording."""
    seed: int = 0
    """Of everything that is drawn."""
    stated: Literal["springs", "none", "urdf"] = "springs"
    """What the model that is diagnosed says of its joints' stiffness: all, nothing, or
    nothing because it is a URDF."""


def main(settings: Settings) -> list[ArmTrial]:
    """Carry out the trials and write what was found."""
    from scenarios.report import data_files, page
    from scenarios.studies import arm_trials

    s = settings
    at_least(1, trials=s.trials, poses=s.poses)
    at_least(0, seed=s.seed)
    models = arm_trials.model_files(s.models)
    s.out.mkdir(parents=True, exist_ok=True)
    file = s.out / f"arm_trials_{s.stated}_{s.poses}_{s.seed}.csv"
    rows = data_files.read_table(file) if file.exists() else []
    trials: list[ArmTrial] = arm_trials.trials_in(rows)
    bases = Counter((t.model, t.number) for t in trials if not t.failed)
    known = {pair for pair, count in bases.items() if count == len(arm_trials.BASES)}
    trials = [t for t in trials if (t.model, t.number) in known]
    with progress_bar() as progress:
        total = len(models) * s.trials * len(arm_trials.BASES)
        task = progress.add_task("concealing, diagnosing", total=total)
        progress.update(task, advance=len(trials))
        for trial in arm_trials.trials_of(
            models, s.trials, s.poses, s.seed, s.out / "models", known, s.stated
        ):
            trials.append(trial)
            data_files.write_table(file, arm_trials.rows_of(trials))
            progress.update(task, advance=1)
    right = sum(t.right for t in trials)
    first = f"Both effects were named or declared in {right} of {len(trials)} trials."
    table = arm_trials.summary_of(trials)
    page.write(s.out, "Arms of any model file", first, [table])
    anywhere = replace(s, models=Path("DIR"))
    command = data_files.command_of("scenarios.arm_trials", anywhere)
    data_files.write_run_file(s.out, command, asdict(s) | {"models": len(models)})
    print(f"{first}\n{s.out / 'report.html'}")
    return trials


if __name__ == "__main__":
    run(main, Settings)
