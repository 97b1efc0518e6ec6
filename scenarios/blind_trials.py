"""Tests whether the diagnosis finds concealed effects and says when it does not know.

Effects, places, sizes and nuisance are drawn from a seed. Recordings go to one folder;
the truth is sealed by its hash and written to another once the answers are hashed, and
they come from a process that was given recordings and the robot's model alone.

Every kind of trial is tried N times; trial k of a kind is the same whatever N is. What
is finished is kept in OUT/rows: the same command goes on, and a larger N adds to it.
`--first K` begins with trial K, for a part on another machine: files of its OUT/rows
are copied beside those of the first, and the report is on all that are there. Whole
arms, twins and one mark are tried where `--strata` asks for them.
`--against FOLDER` compares marks and answers with those of the same trials in another
run: another version, kernel (OPENBLAS_CORETYPE), or readings with `--nudge-mm 1e-9`.

Run:    python -m scenarios.blind_trials --trials 4 --seed 0 --out results/blind_trials
Takes:  about 15 s of one core a trial: 10 min for 48 trials on two; of a whole arm 40 s
Expect: summary.json and report.html in the folder, failures first; exit status 0
        however the trials went
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bench.shared.errors import UnknownName, refuse
from scenarios.report.command_line import progress_bar, run
from scenarios.studies.blind_trials.strata import STRATA, USUAL

if TYPE_CHECKING:
    from scenarios.studies.blind_trials.score import TrialScore


@dataclass(frozen=True)
class Settings:
    """How much is tried."""

    out: Path
    """Folder for everything."""
    trials: int = 4
    """Trials of each kind."""
    first: int = 0
    """Number of the first trial of each kind."""
    seed: int = 0
    """Of everything that is drawn."""
    strata: tuple[str, ...] = USUAL
    """Kinds of trials; see scenarios/studies/blind_trials/strata.py."""
    proof: bool = False
    """Prove names in the simulator too, against what the truth would gain."""
    keep: bool = False
    """Keep the recordings, 2.6 MB each, after they were answered."""
    nudge_mm: float = 0.0
    """Move every reading at random by up to so much: no answer should change."""
    poses: int = 151
    """Postures of a recording; below 100 names say how many splits give them."""
    arm: Literal["kr10", "six", "seven", "column"] = "kr10"
    """The KR10, or one drawn from the seed: six or seven axes, or six on a column."""
    jobs: int = 2
    """Trials that run side by side on this machine; 0: in this process."""
    scheduler: str = "local"
    """Where trials run: local, dask:ADDRESS or ray:ADDRESS; see scenarios/README.md."""
    against: Path | None = None
    """Folder of another run of the same seed, with which the marks are compared."""


def main(settings: Settings) -> list[TrialScore]:
    """Carry out the trials and mark the answers."""
    from scenarios.report import data_files
    from scenarios.studies.blind_trials import report
    from scenarios.studies.blind_trials.arms import arm_of
    from scenarios.studies.blind_trials.run import (
        Sweep,
        refuse_other_trials,
        run_trials,
        scored,
    )

    s = settings
    _check(s)
    flags = (s.proof, s.keep, s.nudge_mm, s.jobs, s.scheduler)
    sweep = Sweep(s.out, s.seed, s.arm, s.poses, *flags)
    refuse_other_trials(sweep)
    arm_of(s.arm, s.seed, s.out / "models")  # for people: workers make their own
    with progress_bar() as progress:
        task = progress.add_task("concealing, asking", total=s.trials * len(s.strata))
        for done in run_trials(sweep, s.strata, s.first, s.trials):
            progress.update(task, advance=done)
    scores, codes = scored(sweep)
    other = report.another_run(s.against, scores, sweep.rows)
    report.write(s.out, scores, _drawn_from(s) | {"code_sha256": sorted(codes)}, other)
    command = data_files.command_of("scenarios.blind_trials", s)
    data_files.write_run_file(s.out, command, asdict(s))
    report.print_summary(scores, other, s.out)
    return scores


def _check(settings: Settings) -> None:
    from scenarios.studies.blind_trials.report import faults_of_another_run

    faults = []
    least_of = {"trials": 1, "first": 0, "seed": 0, "poses": 1, "jobs": 0}
    for flag, least in (least_of | {"nudge_mm": 0}).items():
        value = getattr(settings, flag)
        if value < least:
            faults.append(f"--{flag} is {value}, expected at least {least}.")
    if settings.against is not None:
        faults += faults_of_another_run(settings.against, _drawn_from(settings))
    unknown = [name for name in settings.strata if name not in STRATA]
    faults += [str(UnknownName("kind of trial", name, STRATA)) for name in unknown]
    refuse("Flags", faults)


def _drawn_from(settings: Settings) -> dict[str, object]:
    """Return the flags that decide what the trials of a kind are."""
    return {flag: getattr(settings, flag) for flag in ("seed", "arm", "poses")}


if __name__ == "__main__":
    run(main, Settings)
