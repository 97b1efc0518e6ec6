"""How many poses are enough?

Every method learns from 5 to 121 poses of the study's experiment, drawn anew several
times, and is judged on fresh postures with their true deflection. Where few poses
cannot show an axis' spring, it is taken from the model file. What is finished is kept
in OUT/cells: interrupted, it goes on where it stopped.

Run:    python -m scenarios.how_many_poses --out results/how_many_poses
Takes:  an hour of one core with --splits 5 --network-splits 2, named physics most of it
Expect: springs come within a tenth of their best with some forty poses; a network and
        a Gaussian process on top of them need some forty to be better in every draw
        and go on gaining; named physics is far below from five poses on
"""

from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path

from scenarios.report.command_line import run
from scenarios.studies.paper.budget import Effort


@dataclass(frozen=True)
class Settings:
    """How many poses, how often, and where results go."""

    out: Path
    """Folder for report, table and figure."""
    counts: tuple[int, ...] = (5, 10, 20, 40, 80, 121)
    """How many poses are learnt from."""
    splits: int = 20
    """How often they are drawn anew."""
    network_splits: int = 5
    """How many of these draws networks and all markers take part in: they cost most."""
    unseen: int = 500
    """Fresh postures on which is judged."""
    seed: int = 0
    """Of the instruments, the draws and the networks."""
    jobs: int = 2
    """How many cells are worked at once on this machine; 0: in this process."""
    scheduler: str = "local"
    """Where cells are worked: local, dask:ADDRESS or ray:ADDRESS."""
    poses: int = 151
    """How many of the 151 postures there are; fewer only to try things out."""
    effort: Effort = field(default_factory=Effort)
    """What is spent on the networks."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Run the comparison and write everything into the folder."""
    from scenarios.report import data_files, page
    from scenarios.studies.paper import few_poses
    from scenarios.studies.paper.cells import Spread, swept
    from scenarios.studies.paper.experiment import Material, carry_out, unseen
    from scenarios.studies.paper.few_poses import (
        FewPosesNamed,
        FewPosesNetworks,
        FewPosesPlain,
        draw_courses,
        prepared_files,
    )

    out, seed, splits = settings.out, settings.seed, settings.splits
    experiment = carry_out(seed, settings.poses)
    out.mkdir(parents=True, exist_ok=True)
    fresh = unseen(experiment.rig, experiment.arm, settings.unseen, seed)
    material = Material.of(experiment, fresh)
    attached = prepared_files(material, settings.effort, seed, out / "cells")
    every, some = (range(seed, seed + n) for n in (splits, settings.network_splits))
    cells = [
        *(FewPosesPlain(n, draw) for n, draw in product(settings.counts, every)),
        *(
            FewPosesNamed(n, draw, draw in some)
            for n, draw in product(settings.counts, every)
        ),
        *(
            FewPosesNetworks(n, draw, settings.effort, seed)
            for n, draw in product(settings.counts, some)
        ),
    ]
    results = swept(cells, material, Spread.of(settings, attached))
    found = {count: {} for count in settings.counts}
    for cell in cells:
        found[cell.poses].setdefault(cell.draw, {}).update(results[cell])
    rows = few_poses.tidy(found, settings.unseen)
    data_files.write_table(out / "how_many_poses.csv", rows)
    draw_courses(rows, out / "how_many_poses.png")
    blocks = [
        page.Figure(
            f"MAE on {settings.unseen} fresh poses against the poses learnt from: mean "
            "and range (bars) of the draws, which the legend counts.",
            "how_many_poses.png",
        ),
        few_poses.errors(rows),
        page.Paragraph(
            "Networks are pre-trained once on the springs of the model file and go on "
            f"for {settings.effort.on.steps} steps with the springs that the few poses "
            "show: a full pre-training for each draw would take hours more. Of the "
            "axes that the poses do not show, the one furthest out is held at the "
            "model file's spring, until the others are shown. So every method can be "
            f"fitted from {min(settings.counts)} poses; the table says with how many "
            "axes held. Methods are compared draw by draw. The draws of "
            f"{max(settings.counts)} poses of {settings.poses} share most of them, so "
            "their range is too narrow as an interval."
        ),
    ]
    page.write(out, "How many poses are enough?", few_poses.summary(rows), blocks)
    command = data_files.command_of("scenarios.how_many_poses", settings)
    data_files.write_run_file(out, command, asdict(settings))
    print(f"Report: {out / 'report.html'}")
    return rows


if __name__ == "__main__":
    run(main, Settings)
