"""Does the paper's line of argument hold on an arm whose truth is known?

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

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal

from scenarios.command import run
from scenarios.paper.budget import budget
from scenarios.paper.experiment import carry_out
from scenarios.paper.imitation import cells as imitation
from scenarios.paper.imitation import tables as imitation_tables
from scenarios.paper.linear_fit import fit as linear_fit
from scenarios.paper.linear_fit import tables as linear_fit_tables
from scenarios.paper.linear_fit.fit import LinearFit
from scenarios.paper.linear_fit.identifiable import refuse_if_blind
from scenarios.paper.material import Material
from scenarios.paper.playback import playback, training_curves
from scenarios.paper.transfer import cells as transfer
from scenarios.paper.transfer import table_08, table_09, table_10
from scenarios.paper.transfer.comparison import Contender, contenders
from scenarios.paper.transfer.own_method import OwnMethod, checked
from scenarios.paper.unseen import unseen
from scenarios.paper.words import discussion
from scenarios.paper.words.summary import summary
from scenarios.paper.work.cells import Cell, Result
from scenarios.paper.work.progress import swept
from scenarios.reporting import page, run_file


@dataclass(frozen=True)
class Settings:
    """How much of the study is run, and where it goes."""

    out: Path
    """Folder for report, tables, figures and the recording."""
    budget: Literal["quick", "full", "tiny"] = "quick"
    """quick: minutes on two cores; full: the numbers that are committed; tiny: to see
    that everything runs, the numbers mean nothing."""
    seed: int = 0
    """Of the instruments and of everything that is drawn."""
    method: str | None = None
    """A method of your own, package.module:Class, built from an arm; judged beside."""
    jobs: int = 2
    """How many cells are worked at once, each on one core."""
    poses: int = 151
    """How many of the 151 postures; fewer only to try things out; 55 and more show all
    six springs."""
    view: bool = False
    """Stream to a viewer while it runs, instead of saving study.rrd."""


@dataclass(frozen=True)
class Study:
    """What was found: six springs' fit, and every method on fresh poses."""

    springs: LinearFit
    methods: Sequence[Contender]


def main(settings: Settings) -> Study:
    """Run the study and write everything into the folder."""
    out, seed = settings.out, settings.seed
    spent = budget(settings.budget, seed)
    own = None if settings.method is None else OwnMethod.named(settings.method)
    experiment = carry_out(seed, settings.poses)
    fresh = unseen(experiment.rig, experiment.arm, spent.unseen, seed)
    material = Material.of(experiment, fresh)
    refuse_if_blind(material, spent.transfer.seeds)
    if own is not None:
        checked(own, experiment.arm, experiment.recording)
    out.mkdir(parents=True, exist_ok=True)
    found = linear_fit.fit(experiment, seed)
    stream = playback.live(seed) if settings.view else None

    def told(cell: Cell, result: Result) -> None:
        for curve in training_curves.curves(cell, result):
            if stream is not None:
                training_curves.show(stream, curve)

    cells = [*transfer.cells(spent, own), *imitation.cells(spent, seed)]
    results = swept(cells, material, out / "cells", settings.jobs, told)
    methods = contenders(spent, results, own)
    blocks = [
        *linear_fit_tables.report(experiment, found, seed, out),
        *imitation_tables.report(spent, results, seed, out),
        *table_08.report(spent, results, out),
        *table_09.report(spent, results, out),
        *table_10.report(methods, spent.transfer.seeds, spent.name, out),
        *discussion.report(spent, methods, results),
    ]
    curves = [
        curve
        for cell, result in results.items()
        for curve in training_curves.curves(cell, result)
    ]
    learnt = playback.Learnt(_shown(methods), curves)
    if stream is not None:
        playback.show(stream, experiment, found, learnt)
    else:
        playback.save(out / "study.rrd", seed, experiment, found, learnt)
    page.write(out, "The study on the bench", summary(found, methods, results), blocks)
    run_file.write(
        out,
        run_file.command("scenarios.study", settings),
        asdict(settings),
        rows=len(experiment.recording.time),
        fresh_poses=spent.unseen,
        seeds=list(spent.transfer.seeds),
    )
    print(f"Report:    {out / 'report.html'}\nRecording: rerun {out / 'study.rrd'}")
    return Study(found, methods)


def _shown(methods: Sequence[Contender]) -> dict:
    """Return the errors that the recording shows: each method on its best plan."""
    variants = ("pretrained", "aligned", "frozen")
    return {
        c.method: c.experiment
        for c in methods
        if c.method not in variants and c.plan in ("-", "spanning")
    }


if __name__ == "__main__":
    run(main, Settings)
