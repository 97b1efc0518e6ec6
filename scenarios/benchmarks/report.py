"""A benchmark is reported as ratios, with the seconds, cores and load beside them."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture
from rich.console import Console
from rich.table import Table as RichTable

from scenarios.benchmarks.race import Lap
from scenarios.reporting import page, style
from scenarios.reporting.page import Block, Figure, Paragraph, Table

CAPTION = (
    "Time of each other way over ours (orange line), median and range over rounds: "
    "right of the line ours is faster."
)
HEADER = ("way", "median [s]", "core time [s]", "times ours", "range", "answer")


def _cells(lap: Lap) -> tuple[str, ...]:
    row = lap.row
    scaled = "" if lap.share == 1.0 else f" ({lap.share:.2g} of it run, scaled)"
    if lap.bar is None:
        answer = f"{lap.differs} from ours" if lap.differs else ""
    elif np.median(lap.wall) <= lap.bar:
        answer = f"bar {lap.bar:g} s: kept"
    elif np.median(lap.cpu) <= lap.bar:
        answer = f"bar {lap.bar:g} s: over under this load, core time within"
    else:
        answer = f"bar {lap.bar:g} s: missed"
    return (
        lap.way + scaled,
        f"{row['median_s']:.3g}",
        f"{row['cpu_s']:.3g}",
        f"{row['ratio']:.3g}",
        f"{row['ratio_low']:.3g} to {row['ratio_high']:.3g}",
        answer,
    )


def _by_task(laps: Sequence[Lap]) -> dict[str, list[Lap]]:
    tasks: dict[str, list[Lap]] = {}
    for lap in laps:
        tasks.setdefault(lap.task, []).append(lap)
    return tasks


def show(laps: Sequence[Lap], skipped: Sequence[str]) -> None:
    """Print a table for each task."""
    console = Console()
    for task, of_task in _by_task(laps).items():
        shown = RichTable(*HEADER, title=task, title_justify="left")
        for lap in of_task:
            shown.add_row(*_cells(lap))
        console.print(shown)
    for line in skipped:
        console.print(f"left out: {line}", markup=False)


def write(out: Path, laps: Sequence[Lap], skipped: Sequence[str]) -> None:
    """Write report.md and report.html with their picture into a folder."""
    _draw(laps, out / "benchmark.png")
    tasks = _by_task(laps)
    blocks: list[Block] = [
        Figure(CAPTION, "benchmark.png"),
        *(
            Table(task, HEADER, [_cells(lap) for lap in of_task])
            for task, of_task in tasks.items()
        ),
        *(Paragraph(f"Left out: {line}") for line in skipped),
    ]
    summary = (
        f"{len(tasks)} tasks, and {len(laps) - len(tasks)} other ways to do them, each "
        f"measured in turn with ours on {os.cpu_count()} cores under a load of "
        f"{os.getloadavg()[0]:.1f}. Seconds depend on that load, ratios much less; the "
        "range is over rounds."
    )
    page.write(out, "Speed beside the alternatives", summary, blocks)


def _draw(laps: Sequence[Lap], file: Path) -> None:
    others = [lap for of in _by_task(laps).values() for lap in of[1:]][::-1]
    picture = Picture(figsize=(9, 0.5 + 0.38 * len(others)), layout="constrained")
    axes = picture.subplots()
    ratio = np.array([[f(lap.ratio) for lap in others] for f in (np.median, min, max)])
    middle, low, high = ratio
    look = {"left": 1.0, "color": style.GREY, "height": 0.6}
    axes.barh(range(len(others)), middle - 1.0, **look)
    axes.errorbar(middle, range(len(others)), xerr=(middle - low, high - middle),
                  fmt="none", ecolor="black", capsize=2)  # fmt: skip
    axes.axvline(1.0, color=style.ORANGE, lw=2)
    axes.set_xscale("log")
    style.plain_log(axes.xaxis)
    labels = [f"{lap.task.partition(':')[0]}: {lap.way}" for lap in others]
    axes.set_yticks(range(len(others)), labels)
    axes.set_xlabel("times as long as ours (orange)")
    axes.grid(visible=False, axis="y")
    style.save(picture, file)
