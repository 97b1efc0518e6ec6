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
    means, lines = picture.subplots(1, 2)
    width = 0.5 / len(errors)
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
        ends = (value - low, high - value)
        means.errorbar(place, value, ends, fmt="o", color=colour, capsize=3, label=name)
        for part in (slice(None, n), slice(n, None)):
            steps = _by_angle(angle[part], size[:, part])
            lines.plot(*steps, "o-", ms=4, color=colour)
    means.set_xticks([0, 1], [f"pulled {load}" for load in loads])
    means.set_xlim(-0.5, 1.5)
    means.set_ylabel("MAE [mm]")
    means.set_yscale("log")
    means.grid(visible=False, axis="x")
    means.legend(fontsize=8)
    lines.set_xlabel("angle to the nearest direction of the experiment [°]")
    lines.set_ylabel("median error [mm]")
    lines.set_yscale("log")
    for chart in (means, lines):
        style.plain_log(chart.yaxis)
    style.save(picture, file)


def _by_angle(
    angle: Float[np.ndarray, " poses"], size: Float[np.ndarray, "seeds poses"]
) -> tuple[list[float], list[float]]:
    """Return median angle and error of each quarter of the poses by their angle."""
    quarters = np.array_split(np.argsort(angle), 4)
    return (
        [float(np.median(angle[q])) for q in quarters],
        [float(np.median(size[:, q])) for q in quarters],
    )
