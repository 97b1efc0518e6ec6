"""Errors against the number of poses that were learnt from, with their scatter."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from scenarios.paper.few_poses.tables import METHODS, of
from scenarios.paper.transfer.comparison import TITLES
from scenarios.reporting import style

TICKS_MM = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 5)
BESIDE = 1.035
"""By which factor methods stand beside each other, so that their bars are seen."""
COLOURS = (style.GREY, style.ORANGE, style.BLUE, style.GREEN)


def draw_courses(rows: Sequence[Mapping], file: Path) -> None:
    """Draw mean and range of every method's MAE."""
    picture = Picture(figsize=(7, 4.2), layout="constrained")
    axes = picture.subplots()
    counts = [row["poses"] for row in of(rows, "vjm")]
    for colour, method in zip(COLOURS, METHODS, strict=True):
        mine = of(rows, method)
        if not mine:
            continue
        value, low, high = (
            [row[name] for row in mine] for name in ("value_mm", "low_mm", "high_mm")
        )
        place = np.array(counts) * BESIDE ** (METHODS.index(method) - 1.5)
        ends = (np.subtract(value, low), np.subtract(high, value))
        label = f"{TITLES[method]}, {mine[0]['draws']} draws"
        axes.errorbar(
            place, value, ends, fmt="o-", ms=4, color=colour, capsize=2, label=label
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.minorticks_off()
    shown = [row for row in rows if row["metric"] == "MAE"]
    top, bottom = max(r["high_mm"] for r in shown), min(r["low_mm"] for r in shown)
    ticks = [t for t in TICKS_MM if 0.7 * bottom < t < 1.4 * top]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xlabel("poses learnt from")
    axes.set_ylabel("MAE on fresh poses [mm]")
    axes.legend()
    style.save(picture, file)
