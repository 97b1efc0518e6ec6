"""Two pictures of a sweep: what was said of what, and how sure against how right."""

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from scenarios.reporting.style import BLUE, GREY, ORANGE, RED

Rows = Sequence[dict[str, object]]

LIGHT = 0.5
"""Share from which a cell is too dark for black digits; chosen."""
NOTHING, NO_NAME = "nothing", ("unexplained", "failed")
"""What is no effect's name; it stands behind the names."""


def confusion(rows: Rows) -> Figure:
    """Draw how often each truth was answered by each name: right, none or another."""
    truths, answers = ({str(r[k]) for r in rows} for k in ("truth", "answer"))
    down = sorted(truths, key=lambda name: (name == NOTHING, name not in answers, name))
    shared = [name for name in down if name in answers]
    others = sorted(answers - truths - {NOTHING, *NO_NAME})
    last = [n for n in (NOTHING, *NO_NAME) if n in answers and n not in shared]
    across = [*shared, *others, *last]
    count = np.zeros((len(down), len(across)), dtype=int)
    for r in rows:
        at = down.index(str(r["truth"])), across.index(str(r["answer"]))
        count[at] += int(str(r["trials"]))
    share = count / count.sum(axis=1, keepdims=True)
    picture = np.ones((*count.shape, 3))
    for i, j in zip(*np.nonzero(count), strict=True):
        kind = GREY if across[j] in NO_NAME else RED
        full = np.array(to_rgb(ORANGE if across[j] == down[i] else kind))
        picture[i, j] = 1.0 - (0.25 + 0.75 * share[i, j]) * (1.0 - full)
    size = (2.7 + 0.3 * len(across), 2.2 + 0.28 * len(down))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    axes.imshow(picture, aspect="auto")
    for i, j in zip(*np.nonzero(count), strict=True):
        ink = "white" if share[i, j] > LIGHT else "black"
        axes.text(j, i, str(count[i, j]), color=ink, ha="center", va="center", size=8)
    words = [[name.replace("_", " ") for name in names] for names in (across, down)]
    axes.set_xticks(range(len(across)), words[0], rotation=90, fontsize=8)
    axes.set_yticks(range(len(down)), words[1], fontsize=8)
    axes.set_xticks(np.arange(0.5, len(across)), minor=True)
    axes.set_yticks(np.arange(0.5, len(down)), minor=True)
    axes.grid(visible=False)
    axes.grid(visible=True, which="minor")
    axes.tick_params(which="minor", length=0)
    axes.set_xlabel("what was said")
    axes.set_ylabel("what is true")
    return figure


def calibration(rows: Rows) -> Figure:
    """Draw how often statements are true against their probability."""
    stated, true, low, high = (
        np.array([float(str(r[k])) for r in rows])
        for k in ("stated", "true", "low", "high")
    )
    figure = Figure(figsize=(4.8, 4.4), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color=GREY, lw=1, label="true as often as stated")
    reach = np.maximum([true - low, high - true], 0.0)
    look = {"fmt": "o", "color": ORANGE, "ecolor": BLUE, "capsize": 3}
    axes.errorbar(stated, true, reach, **look, label="names, 95 % interval")
    axes.set_xlabel("stated probability")
    axes.set_ylabel("share that is true")
    axes.legend(loc="upper left")
    return figure
