"""How fast is it, beside what a user would reach for otherwise?

Five tasks, each done by us and by the usual ways in turn, within one run: on a busy
machine seconds mean little, ratios keep their meaning. Each way's answer is compared
with ours first, for a fast wrong answer is no alternative.

Run:    python -m scenarios.benchmark --out results/benchmark
Takes:  3 min on two quiet cores
Expect: the whole experiment dozens of times faster than damped stepping, within 5 s on
        two cores; 106,400 source rows several times faster than a Pinocchio loop,
        within 0.5 s; six springs tens of times faster than an optimiser around MuJoCo,
        within 20 ms; benchmark.csv, report.md, report.html, run.json in the folder
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from scenarios.report.command_line import progress_bar, run

if TYPE_CHECKING:
    from scenarios.studies.benchmarks.race import Lap, Race


@dataclass(frozen=True)
class Settings:
    """How much is measured, and where it goes."""

    out: Path
    """Folder for the report and the table."""
    repeats: int = 3
    """Rounds of the slow tasks; quick ones have two or three times as many."""
    poses: int = 151
    """Postures of the experiment; fewer only to try things out."""


def main(settings: Settings) -> tuple[Lap, ...]:
    """Measure everything in turn and write it down."""
    from bench.shared.errors import Unusable
    from scenarios.report import data_files
    from scenarios.studies.benchmarks import race

    if settings.repeats < 1 or settings.poses < 1:
        fault = f"--repeats {settings.repeats}, --poses {settings.poses}: at least 1."
        raise Unusable("Flags", [fault])
    settings.out.mkdir(parents=True, exist_ok=True)
    laps: list[Lap] = []
    with TemporaryDirectory() as folder, progress_bar() as progress:
        task = progress.add_task("preparing", total=None)
        races, skipped = _races(settings, Path(folder))
        progress.update(task, total=sum(race.runs(r, settings.repeats) for r in races))
        for each in races:
            progress.update(task, description=each.task)
            laps += race.run(each, settings.repeats, lambda: progress.advance(task))
    race.show(laps, skipped)
    data_files.write_table(settings.out / "benchmark.csv", [lap.row for lap in laps])
    race.write(settings.out, laps, skipped)
    command = data_files.command_of("scenarios.benchmark", settings)
    facts = {"cores": os.cpu_count(), "load": os.getloadavg()[0]}
    data_files.write_run_file(settings.out, command, asdict(settings), **facts)
    return tuple(laps)


def _races(settings: Settings, folder: Path) -> tuple[list[Race], list[str]]:
    from scenarios.studies.benchmarks import tasks

    poses = settings.poses
    races = [
        tasks.experiment_race(poses),
        tasks.source_race(None if poses == 151 else 20 * poses),
        tasks.springs_race(poses),
        *tasks.reading_races(poses, folder),
        tasks.diagnosis_race(poses),
    ]
    skipped = [line for each in races for line in each.skipped]
    return races, skipped


if __name__ == "__main__":
    run(main, Settings)
