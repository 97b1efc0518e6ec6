"""Colours, sizes and logarithmic axes that all figures of the reports share."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axis import Axis
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

ORANGE, GREY, BLUE, GREEN, RED = "#f06400", "#8a8a8a", "#1f6fb4", "#3a923a", "#c03d3e"
"""Orange is this tool, grey the paper or reference, others in order of appearance."""
HEAT = LinearSegmentedColormap.from_list(
    "heat", [(0.0, "#d9dcdf"), (0.6, ORANGE), (1.0, "#96141e")]
)
"""Of a share or an error: none, more than half, the largest."""

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


def save(figure: Figure, file: Path | None) -> Figure:
    """Write a figure as png without a time stamp: equal data give equal bytes.

    It is empty afterwards where it is written.
    """
    if file is not None:
        figure.savefig(file, metadata={"Software": None})
        figure.clear()
    return figure


def plain_log(axis: Axis) -> None:
    """Label a logarithmic axis by plain numbers, few enough not to overlap."""
    low, high = axis.get_view_interval()
    wide = np.log10(high / low) > 2.0
    axis.set_major_locator(LogLocator(subs=(1,) if wide else (1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
