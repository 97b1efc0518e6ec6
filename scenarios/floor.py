"""Measures how far each method is from the noise floor.

No method gets below what the instruments' noise makes of one who knows the truth's form
and has only its sizes to learn: 48 of them, from the same recording. How far from the
springs to that floor does each method come, and where in the workspace does it fail?

Run:    python -m scenarios.floor --out results/floor
Takes:  10 min on two cores
Expect: the oracle leaves a few micrometres; the network and the Gaussian process come
        about half of the way, and fail most where the arm is far stretched; named
        physics comes above 90 % of the way
"""

from dataclasses import asdict, dataclass, field
from pathlib import Path

from scenarios.report.command_line import run
from scenarios.studies.paper.budget import Transfer, budget


@dataclass(frozen=True)
class Settings:
    """What is judged, and where results go."""

    out: Path
    """Folder for report, table and figure."""
    unseen: int = 500
    """Fresh postures on which is judged."""
    seed: int = 0
    """Of the instruments, the split and the networks."""
    jobs: int = 2
    """How many cells are worked at once on this machine; 0: in this process."""
    scheduler: str = "local"
    """Where cells are worked: local, dask:ADDRESS or ray:ADDRESS."""
    poses: int = 151
    """How many of the 151 postures there are; fewer only to try things out."""
    known: int | None = None
    """Sizes that the oracle learns, the first so many; fewer only to try things out."""
    effort: Transfer = field(default_factory=lambda: budget("quick", 0).transfer)
    """What is spent on the networks."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Find the floor and write everything into the folder."""
    import numpy as np

    from bench.study_arm import default_truth
    from scenarios.report import data_files, page
    from scenarios.studies.paper.cells import Spread, swept
    from scenarios.studies.paper.experiment import Material, carry_out, unseen
    from scenarios.studies.paper.floor import (
        NudgeCell,
        columns_against_simulator,
        draw,
        finding,
        floor_rows,
        magnitudes,
        oracle_error,
        report_table,
        summary,
    )
    from scenarios.studies.paper.transfer import (
        ConvolutionCell,
        NamedPhysicsCell,
        PerceptronCell,
        SpringsCell,
    )
    from stiffness.experiment.deflections import every_plateau

    out, seed, effort = settings.out, settings.seed, settings.effort
    experiment = carry_out(seed, settings.poses)
    out.mkdir(parents=True, exist_ok=True)
    fresh = unseen(experiment.rig, experiment.arm, settings.unseen, seed)
    material = Material.of(experiment, fresh)
    count = len(magnitudes(default_truth())[: settings.known])
    plain = SpringsCell(seed, effort.evaluations)
    mlp = PerceptronCell(seed, "spanning", effort, ())
    cnn = ConvolutionCell(seed, "spanning", effort)
    named = NamedPhysicsCell(seed)
    nudges = [NudgeCell(k, settings.poses, seed) for k in range(-1, count)]
    results = swept([mlp, cnn, plain, named, *nudges], material, Spread.of(settings))
    still, *moved = (results[cell] for cell in nudges)
    data = every_plateau(material.arm, material.recording)
    noise = 1e3 * data.deflection - still["experiment"]
    errors = {
        "VJM": results[plain]["vjm/unseen"],
        "DT-CNN": results[cnn]["direct/unseen"],
        "FT-MLP": results[mlp]["best/unseen"],
        "VJM + GP": results[plain]["gp_residual/unseen"],
        "named physics": results[named]["named_physics/unseen"],
        "named physics, all markers": results[named]["named_physics_all/unseen"],
        "oracle": oracle_error(still, moved, noise),
    }
    rows = floor_rows(errors, seed)
    data_files.write_table(out / "floor.csv", rows)
    place = experiment.arm.placements(fresh.cases.posture, ["flange"])[:, 0, :3, 3]
    draw(errors, rows, place, out / "floor.png")
    blocks = [
        page.Figure(finding(rows, errors, place), "floor.png"),
        report_table(rows),
        page.Paragraph(
            f"A measured deflection is off by {np.abs(noise).mean():.4f} mm on average "
            "through the instruments alone. Fresh poses are judged by their true "
            "deflection, so a method can be better: noise reaches it through what it "
            f"learnt alone. The oracle learns {count} sizes (stiffness of six springs, "
            "how much there is of every effect) by least squares, to first order, from "
            "all readings of the experiment; methods learn from 80 % of the poses."
        ),
        page.Paragraph(columns_against_simulator(results[named])),
    ]
    page.write(out, "What is the floor?", summary(rows), blocks)
    command = data_files.command_of("scenarios.floor", settings)
    data_files.write_run_file(out, command, asdict(settings))
    print(f"Report: {out / 'report.html'}")
    return rows


if __name__ == "__main__":
    run(main, Settings)
