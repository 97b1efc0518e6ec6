"""Errors under loads as in the experiment, and under others."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture

from scenarios.paper.transfer.pooled import MEASURES, pooled
from scenarios.reporting import style

COLOURS = (style.GREY, style.GREEN, style.BLUE, style.ORANGE)


def draw(
    errors: Mapping[str, Float[np.ndarray, "seeds poses 3"]],
    angle: Float[np.ndarray, " poses"],
    loads: Sequence[str],
    file: Path,
) -> None:
    """Draw MAE under both kinds of loads, and median errors against the angle.

    Args:
        errors: Of each method, in mm; the second half of the poses is loaded otherwise.
        angle: To the nearest direction that the experiment used, in deg.
        loads: What both kinds are called.
        file: Where to.
    """
    n = len(angle) // 2
    picture = Picture(figsize=(10.5, 3.9), layout="constrained")
    bars, lines = picture.subplots(1, 2)
    width = 0.8 / len(errors)
    ends = np.unique(np.quantile(angle, np.linspace(0, 1, 9)))
    for i, (colour, (name, error)) in enumerate(
        zip(COLOURS, errors.items(), strict=True)
    ):
        size = np.abs(error).mean(axis=2)
        place = np.arange(2) + (i - (len(errors) - 1) / 2) * width
        found = [
            pooled(part, MEASURES["MAE"]).interval
            for part in (size[:, :n], size[:, n:])
        ]
        value, low, high = np.array([[f.value, f.low, f.high] for f in found]).T
        bars.bar(place, value, 0.92 * width, color=colour, label=name)
        bars.errorbar(
            place, value, (value - low, high - value), fmt="none", ecolor="black"
        )
        which = np.digitize(angle, ends[1:-1])
        steps = range(len(ends) - 1)
        middle = [np.median(angle[which == b]) for b in steps]
        median = [np.median(size[:, which == b]) for b in steps]
        lines.plot(middle, median, "o-", ms=4, color=colour)
    bars.set_xticks([0, 1], [f"pulled {load}" for load in loads])
    bars.set_ylabel("MAE [mm]")
    bars.set_yscale("log")
    bars.grid(visible=False, axis="x")
    bars.legend(fontsize=8)
    lines.set_xlabel("angle to the nearest direction of the experiment [deg]")
    lines.set_ylabel("median error [mm]")
    lines.set_yscale("log")
    for chart in (bars, lines):
        chart.yaxis.set_major_formatter("{x:g}")
        chart.yaxis.set_minor_formatter("{x:g}")
    style.save(picture, file)
