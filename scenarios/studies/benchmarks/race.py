"""Times several ways of doing one task in turn, and reports their ratios.

On a busy machine only ways that run in turn can be compared, and only as ratios; the
report gives seconds, cores and load beside them.

Ratio of a way to ours (`run`):

==========  ==========================================================================
Equation    ratio = median over rounds of t_other / t_ours, both of the same round
Ours        runs first in every round: A B C A B C, so that a slow minute hits all
Ends        smallest and largest ratio of a round; of a few rounds no more can be said
==========  ==========================================================================
"""

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture
from rich.console import Console
from rich.table import Table as RichTable

from scenarios.report import figures, page
from scenarios.report.page import Block, Figure, Paragraph, Table

# --- Timing in turn -------------------------------------------------------------------


@dataclass(frozen=True)
class Way:
    """One way to do a task.

    Attributes:
        share: Part of the task that is run; times are divided by it.
    """

    name: str
    run: Callable[[], Any]
    share: float = 1.0


@dataclass(frozen=True)
class Race:
    """One task and the ways to do it.

    Attributes:
        ways: Ways to do it, ours first.
        difference: Describes the difference of our answer and another one.
        bar: Limit for ours on two idle cores, in s; None: there is none.
        skipped: Ways that cannot run here, and why.
    """

    task: str
    ways: tuple[Way, ...]
    difference: Callable[[Any, Any], str] = lambda _ours, _other: ""
    bar: float | None = None
    rounds: int = 1
    skipped: tuple[str, ...] = ()


@dataclass(frozen=True)
class Lap:
    """Times of one way of a task.

    Attributes:
        wall: Wall time in each round, scaled to the whole task, in s.
        cpu: Time of all cores in each round, scaled alike, in s.
        ratio: Wall time over ours in each round.
        bar: Limit for ours, in s; None for the others.
    """

    task: str
    way: str
    share: float
    wall: Float[np.ndarray, " rounds"]
    cpu: Float[np.ndarray, " rounds"]
    ratio: Float[np.ndarray, " rounds"]
    difference: str
    bar: float | None

    @property
    def row(self) -> dict[str, object]:
        """One row of benchmark.csv."""
        return {
            "task": self.task,
            "way": self.way,
            "median_s": float(np.median(self.wall)),
            "least_s": float(self.wall.min()),
            "most_s": float(self.wall.max()),
            "cpu_s": float(np.median(self.cpu)),
            "ratio": float(np.median(self.ratio)),
            "ratio_low": float(self.ratio.min()),
            "ratio_high": float(self.ratio.max()),
            "rounds": len(self.wall),
            "share_run": self.share,
            "differs_from_ours": self.difference,
            "bar_s": self.bar,
        }


def run(race: Race, repeats: int, tick: Callable[[], object]) -> Sequence[Lap]:
    """Run every way once unmeasured, for its answer, and then in turn.

    It calls `tick` after each run.
    """
    answers = []
    for way in race.ways:
        answers.append(way.run())
        tick()
    rounds = repeats * race.rounds
    wall, cpu = np.empty((2, len(race.ways), rounds))
    for r in range(rounds):
        for w, way in enumerate(race.ways):
            begin = time.perf_counter(), time.process_time()
            way.run()
            wall[w, r] = (time.perf_counter() - begin[0]) / way.share
            cpu[w, r] = (time.process_time() - begin[1]) / way.share
            tick()
    return [
        Lap(
            task=race.task,
            way=way.name,
            share=way.share,
            wall=wall[w],
            cpu=cpu[w],
            ratio=wall[w] / wall[0],
            difference=race.difference(answers[0], answers[w]) if w else "",
            bar=None if w else race.bar,
        )
        for w, way in enumerate(race.ways)
    ]


def runs(race: Race, repeats: int) -> int:
    """Return how often `run` calls `tick`."""
    return len(race.ways) * (1 + repeats * race.rounds)


# --- The report -----------------------------------------------------------------------

CAPTION = (
    "Time of each other way over ours (orange line), median and range over rounds: "
    "right of the line ours is faster."
)
HEADER = ("way", "median [s]", "core time [s]", "times ours", "range", "answer")


def _cells(lap: Lap) -> tuple[str, ...]:
    row = lap.row
    scaled = "" if lap.share == 1.0 else f" ({lap.share:.2g} of it run, scaled)"
    if lap.bar is None:
        answer = f"{lap.difference} from ours" if lap.difference else ""
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
    look = {"left": 1.0, "color": figures.GREY, "height": 0.6}
    axes.barh(range(len(others)), middle - 1.0, **look)
    axes.errorbar(middle, range(len(others)), xerr=(middle - low, high - middle),
                  fmt="none", ecolor="black", capsize=2)  # fmt: skip
    axes.axvline(1.0, color=figures.ORANGE, lw=2)
    axes.set_xscale("log")
    figures.plain_log(axes.xaxis)
    labels = [f"{lap.task.partition(':')[0]}: {lap.way}" for lap in others]
    axes.set_yticks(range(len(others)), labels)
    axes.set_xlabel("times as long as ours (orange)")
    axes.grid(visible=False, axis="y")
    figures.save(picture, file)
