"""Every figure of a report looks the same: few colours, units on every axis."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

mpl.use("Agg")

ORANGE, GREY, BLUE, GREEN, RED = "#f06400", "#8a8a8a", "#1f6fb4", "#3a923a", "#c03d3e"
"""Orange is ours, grey the paper's or the reference, then in order of appearance."""

mpl.rcParams.update(
    {
        "figure.dpi": 110,
        "savefig.dpi": 110,
        "savefig.bbox": "tight",
        "font.size": 10,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.grid": True,
        "grid.color": "#e6e6e6",
        "axes.axisbelow": True,
        "legend.frameon": False,
    }
)


def save(figure: Figure, file: Path) -> None:
    """Write a figure as png without a time stamp, so that same data are same bytes."""
    figure.savefig(file, metadata={"Software": None})
    figure.clear()
