"""Two pictures of a sweep: what was said of what, and how sure against how right."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from scenarios.reporting.style import BLUE, GREY, ORANGE

Rows = Sequence[dict[str, object]]

LIGHT = 0.5
"""Share from which a cell is too dark for black digits; chosen."""


def confusion(rows: Rows) -> Figure:
    """Draw how often each truth was answered by each name."""
    truths = sorted({str(r["truth"]) for r in rows})
    answers = sorted({str(r["answer"]) for r in rows})
    count = np.zeros((len(truths), len(answers)), dtype=int)
    for r in rows:
        at = truths.index(str(r["truth"])), answers.index(str(r["answer"]))
        count[at] += int(str(r["trials"]))
    figure = Figure(figsize=(2.5 + 0.34 * len(answers), 1.8 + 0.28 * len(truths)))
    axes = figure.subplots()
    axes.grid(False)
    share = count / count.sum(axis=1, keepdims=True)
    axes.imshow(share, cmap="Oranges", vmin=0, vmax=1)
    for i, j in zip(*np.nonzero(count), strict=True):
        ink = "white" if share[i, j] > LIGHT else "black"
        axes.text(j, i, str(count[i, j]), color=ink, ha="center", va="center", size=7)
    axes.set_xticks(range(len(answers)), answers, rotation=90, fontsize=8)
    axes.set_yticks(range(len(truths)), truths, fontsize=8)
    axes.set_xlabel("said [trials]")
    axes.set_ylabel("true")
    return figure


def calibration(rows: Rows) -> Figure:
    """Draw how often statements are true against their probability."""
    stated, true, low, high = (
        np.array([float(str(r[k])) for r in rows])
        for k in ("stated", "true", "low", "high")
    )
    figure = Figure(figsize=(4.2, 4.0))
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=GREY, lw=1, label="as stated")
    reach = np.maximum([true - low, high - true], 0.0)
    axes.errorbar(stated, true, reach, fmt="o", color=ORANGE, ecolor=BLUE, capsize=3)
    axes.set_xlabel("stated probability")
    axes.set_ylabel("share that is true")
    axes.legend(loc="upper left")
    return figure
