"""How many poses are enough?

Every method learns from 5 to 121 poses of the study's experiment, drawn anew several
times, and is judged on fresh postures with their true deflection. Where few poses
cannot show an axis' spring, it is taken from the model file.

Run:    python -m scenarios.how_many_poses --out results/how_many_poses
Takes:  8 min on two cores; 35 min with --splits 20
Expect: springs are as good after some twenty poses as they will ever be; what learns on
        top of them goes on gaining to the last pose
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from scenarios.command import run
from scenarios.paper.comparison import TITLES
from scenarios.paper.experiment import carry_out
from scenarios.paper.few_poses import Effort, FewPosesCell, prepared
from scenarios.paper.few_poses_picture import METHODS, course, draw
from scenarios.paper.material import Material
from scenarios.paper.sweeping import swept
from scenarios.paper.unseen import unseen
from scenarios.reporting import page, run_file, table


@dataclass(frozen=True)
class Settings:
    """How many poses, how often, and where results go."""

    out: Path
    """Folder for report, table and figure."""
    counts: tuple[int, ...] = (5, 10, 20, 40, 80, 121)
    """How many poses are learnt from."""
    splits: int = 4
    """How often they are drawn anew; 20 for the committed result."""
    unseen: int = 500
    """Fresh postures on which is judged."""
    seed: int = 0
    """Of the instruments, the draws and the networks."""
    jobs: int = 2
    """How many cells are worked at once."""
    poses: int = 151
    """How many of the 151 postures there are; fewer only to try things out."""
    effort: Effort = field(default_factory=Effort)
    """What is spent on the networks."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Run the comparison and write everything into the folder."""
    out, seed = settings.out, settings.seed
    experiment = carry_out(seed, settings.poses)
    out.mkdir(parents=True, exist_ok=True)
    fresh = unseen(experiment.rig, experiment.arm, settings.unseen, seed)
    material = Material.of(experiment, fresh)
    for kind in ("mlp", "cnn"):  # once, before the cells that share them
        prepared(kind, material, settings.effort, seed, out / "cells")
    cells = [
        FewPosesCell(count, draw, settings.effort, seed)
        for count in settings.counts
        for draw in range(seed, seed + settings.splits)
    ]
    results = swept(cells, material, out / "cells", settings.jobs)
    rows = _tidy(settings, results)
    table.write(out / "how_many_poses.csv", rows)
    draw(settings.counts, rows, out / "how_many_poses.png")
    caption = (
        f"MAE over x, y and z on {settings.unseen} fresh poses: mean and range of "
        f"{settings.splits} draws of the poses learnt from."
    )
    blocks = [
        page.Figure(caption, "how_many_poses.png"),
        page.Table(caption + " [mm]", *_shown(settings, rows)),
        page.Paragraph(
            "Networks are pre-trained once on the springs of the model file and go on "
            f"for {settings.effort.on.steps} steps with the springs that the few poses "
            "show: a full pre-training for each draw would take days. The draws of "
            f"{max(settings.counts)} poses share most of them, so their range is too "
            "narrow as an interval."
        ),
    ]
    page.write(out, "How many poses are enough?", _summary(settings, rows), blocks)
    counts = " ".join(map(str, settings.counts))
    command = f"python -m scenarios.how_many_poses --counts {counts} --splits "
    command += f"{settings.splits} --seed"
    run_file.write(out, f"{command} {seed} --out {out.as_posix()}", asdict(settings))
    print(f"Report: {out / 'report.html'}")
    return rows


def _tidy(settings: Settings, results: Mapping) -> list[dict[str, object]]:
    rows = []
    for count in settings.counts:
        found = [r for cell, r in results.items() if cell.poses == count]
        for method in METHODS:
            size = np.abs([r[method] for r in found])  # (draws, poses, 3) mm
            mae = size.mean(axis=(1, 2))
            p99 = np.quantile(size, 0.99, axis=1).mean(axis=1)
            for metric, value in (("MAE", mae), ("P99", p99)):
                rows.append(
                    {
                        "poses": count,
                        "method": method,
                        "metric": metric,
                        "value_mm": float(value.mean()),
                        "low_mm": float(value.min()),
                        "high_mm": float(value.max()),
                        "held_axes": float(np.mean([r["held"] for r in found])),
                        "n": settings.unseen,
                        "draws": settings.splits,
                        "plan": "spanning",
                    }
                )
    return rows


def _shown(settings: Settings, rows: list[dict]) -> tuple[list[str], list[list[str]]]:
    header = ["poses", *(TITLES[method] for method in METHODS)]
    cells = []
    for i, count in enumerate(settings.counts):
        ranges = [course(rows, method)[:, i] for method in METHODS]
        texts = [f"{v:.3f} ({low:.3f} to {high:.3f})" for v, low, high in ranges]
        cells.append([str(count), *texts])
    return header, cells


def _summary(settings: Settings, rows: list[dict]) -> str:
    ends = {m: course(rows, m)[0] for m in METHODS}
    beats = []
    for m in METHODS[1:]:
        worse = np.flatnonzero(ends[m] >= ends["vjm"])
        first = 0 if len(worse) == 0 else worse[-1] + 1  # better from here to the last
        said = f"from {settings.counts[first]}" if first < len(ends[m]) else "never"
        beats.append(f"{TITLES[m]} {said}")
    return (
        f"With {settings.counts[-1]} poses the springs leave {ends['vjm'][-1]:.3f} mm "
        f"on fresh ones, with {settings.counts[0]} {ends['vjm'][0]:.3f} mm. On average "
        f"over the draws better than springs, in poses: {'; '.join(beats)}."
    )


if __name__ == "__main__":
    run(main, Settings)
