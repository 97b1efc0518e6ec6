"""Errors against the number of poses that were learnt from, with their scatter."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from scenarios.paper.comparison import TITLES
from scenarios.reporting import style

METHODS = ("vjm", "ft_mlp", "dt_cnn", "gp_residual")
TICKS_MM = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 1, 2, 5)
COLOURS = (style.GREY, style.ORANGE, style.BLUE, style.GREEN)


def course(rows: Sequence[dict], method: str, metric: str = "MAE") -> np.ndarray:
    """Return value, low and high of a method, one column a count."""
    chosen = [r for r in rows if (r["method"], r["metric"]) == (method, metric)]
    names = ("value_mm", "low_mm", "high_mm")
    return np.array([[r[name] for r in chosen] for name in names])


def draw(counts: Sequence[int], rows: Sequence[dict], file: Path) -> None:
    """Draw mean and range of every method's MAE."""
    picture = Picture(figsize=(7, 4.2), layout="constrained")
    axes = picture.subplots()
    for colour, method in zip(COLOURS, METHODS, strict=True):
        value, low, high = course(rows, method)
        axes.fill_between(counts, low, high, color=colour, alpha=0.18, lw=0)
        axes.plot(counts, value, "o-", ms=4, color=colour, label=TITLES[method])
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(counts, [str(count) for count in counts])
    axes.minorticks_off()
    top, bottom = max(r["high_mm"] for r in rows), min(r["low_mm"] for r in rows)
    ticks = [t for t in TICKS_MM if 0.7 * bottom < t < 1.4 * top]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xlabel("poses learnt from")
    axes.set_ylabel("MAE on fresh poses [mm]")
    axes.legend()
    style.save(picture, file)
