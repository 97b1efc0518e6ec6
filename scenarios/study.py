"""Runs the study of the 2024 paper on an arm whose truth is known.

A virtual KR10 with catalogue-sized hardening gears, hysteresis, tilting bearings,
bending links and a foot that gives way goes through the 151 postures of the paper's
Table 1. Springs are identified as the paper does, networks learn from the springs and
are corrected by what was measured, and every method is judged on fresh postures, whose
true deflection is known, beside the paper's numbers.

What is finished is kept in OUT/cells: interrupted, the study goes on where it stopped.

Run:    python -m scenarios.study --budget quick --seed 0 --out results/study
Takes:  4 min on two cores; --budget full some three core-hours, in parts if need be
Expect: Table 2 within 25 % of the paper's MAE and STDE in each direction; FT-MLP far
        below the VJM where the source plan spans the wrenches, above it where it does
        not; report.html, table_02.csv to table_10.csv and study.rrd in the folder
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from scenarios.studies.paper import discussion


@dataclass(frozen=True)
class Settings:
    """How much of the study is run, and where it goes."""

    out: Path
    """Folder for report, tables, figures and the recording."""
    budget: Literal["quick", "full", "tiny"] = "quick"
    """quick: minutes; full: the numbers committed; tiny: only to see that it runs."""
    seed: int = 0
    """Of the instruments and of everything that is drawn."""
    method: str | None = None
    """A method of your own, package.module:Class, built from an arm; judged beside."""
    jobs: int = 2
    """How many cells are worked at once on this machine; 0: in this process."""
    scheduler: str = "local"
    """Where cells are worked: local, dask:ADDRESS or ray:ADDRESS."""
    poses: int = 151
    """How many of the 151 postures; fewer only to try things out; 55 and more show all
    six springs."""
    view: bool = False
    """Stream to a viewer while it runs, instead of saving study.rrd."""


def main(settings: Settings) -> discussion.Study:
    """Run the study and write everything into the folder."""
    from scenarios.report import data_files, page
    from scenarios.studies.paper import (
        discussion,
        fine_tuning,
        imitation,
        linear_fit,
        playback,
        table_10,
        transfer,
    )
    from scenarios.studies.paper.budget import budget
    from scenarios.studies.paper.cells import Cell, CellResult, Spread, swept
    from scenarios.studies.paper.comparison import contenders
    from scenarios.studies.paper.experiment import Material, carry_out, unseen

    out, seed = settings.out, settings.seed
    spent = budget(settings.budget, seed)
    own = None if settings.method is None else transfer.OwnMethod.named(settings.method)
    experiment = carry_out(seed, settings.poses)
    fresh = unseen(experiment.rig, experiment.arm, spent.unseen, seed)
    material = Material.of(experiment, fresh)
    linear_fit.refuse_if_blind(material, spent.transfer.seeds)
    if own is not None:
        transfer.checked(own, experiment.arm, experiment.recording)
    out.mkdir(parents=True, exist_ok=True)
    found = linear_fit.fit(experiment, seed)
    stream = playback.opened(seed) if settings.view else None

    def told(cell: Cell, result: CellResult) -> None:
        for curve in playback.curves(cell, result):
            if stream is not None:
                playback.show_curve(stream, curve)

    cells = [*transfer.cells(spent, own), *imitation.cells(spent, seed)]
    results = swept(cells, material, Spread.of(settings), told)
    methods = contenders(spent, results, own)
    blocks = [
        *linear_fit.report(experiment, found, seed, out),
        *imitation.report(spent, results, seed, out),
        *fine_tuning.layers_report(spent, results, out),
        *fine_tuning.epochs_report(spent, results, out),
        *table_10.report(methods, spent.transfer.seeds, spent.name, out),
        *discussion.report(spent, methods, results),
    ]
    curves = [c for one in results.items() for c in playback.curves(*one)]
    learnt = playback.Learnt(playback.shown_errors(methods), curves)
    if stream is not None:
        playback.show(stream, experiment, found, learnt)
    else:
        playback.save(out / "study.rrd", seed, experiment, found, learnt)
    first = discussion.summary(found, methods, results)
    page.write(out, "The study on the bench", first, blocks)
    command = data_files.command_of("scenarios.study", settings)
    known = {"fresh_poses": spent.unseen, "seeds": list(spent.transfer.seeds)}
    rows = len(experiment.recording.time)
    data_files.write_run_file(out, command, asdict(settings), rows=rows, **known)
    print(f"Report:    {out / 'report.html'}\nRecording: rerun {out / 'study.rrd'}")
    return discussion.Study(found, methods)


if __name__ == "__main__":
    run(main, Settings)
