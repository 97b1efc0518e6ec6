"""Fig. 4 of the paper and a picture of Table 3."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from scenarios.paper.experiment import Experiment
from scenarios.paper.linear_fit.fit import LinearFit
from scenarios.paper.numbers import TABLE_03_NM_PER_RAD
from scenarios.reporting import style
from stiffness.score import DIRECTIONS


def figure_04(experiment: Experiment, found: LinearFit, file: Path) -> None:
    """Draw predicted against measured deflection in each direction."""
    picture = Picture(figsize=(11, 3.9), layout="constrained")
    measured = 1e3 * experiment.measured.deflection
    predicted = 1e3 * found.predicted["vjm"]
    for k, axes in enumerate(picture.subplots(1, 3)):
        x, y = measured[:, k], predicted[:, k]
        ends = np.array([min(x.min(), y.min()), max(x.max(), y.max())])
        r = np.corrcoef(x, y)[0, 1]
        axes.plot(ends, ends, color=style.GREY, lw=1, label="equal")
        axes.plot(x, y, "o", ms=4, color=style.ORANGE, mec="white", mew=0.4)
        axes.set_title(f"{DIRECTIONS[k].upper()}: r = {r:.4f}, n = {len(x)}")
        axes.set_xlabel("measured deflection [mm]")
        axes.set_ylabel("six springs [mm]" if k == 0 else "")
        axes.set_aspect("equal", adjustable="datalim")
    style.save(picture, file)


def stiffness_points(experiment: Experiment, found: LinearFit, file: Path) -> None:
    """Draw identified, true secant and published stiffness of each axis."""
    picture = Picture(figsize=(8, 3.8), layout="constrained")
    axes = picture.subplots()
    springs = found.fitted.stiffness
    place = np.arange(len(springs))
    value = np.array([p.value for p in springs]) / 1e3
    low = value - np.array([p.low for p in springs]) / 1e3
    high = np.array([p.high for p in springs]) / 1e3 - value
    paper = np.array(TABLE_03_NM_PER_RAD) / 1e3
    for shift, (label, height, colour) in zip(
        (-0.2, 0.0, 0.2),
        (
            ("identified", value, style.ORANGE),
            ("truth, secant", experiment.secant_stiffness / 1e3, style.BLUE),
            ("paper", paper, style.GREY),
        ),
        strict=True,
    ):
        axes.plot(place + shift, height, "o", color=colour, label=label)
    axes.errorbar(
        place - 0.2, value, (low, high), fmt="none", ecolor=style.ORANGE, capsize=2
    )
    axes.set_yscale("log")
    style.plain_log(axes.yaxis)
    axes.set_xticks(place, [p.name.upper() for p in springs])
    axes.set_ylabel("stiffness [kN m/rad]")
    axes.grid(visible=False, axis="x")
    axes.legend(ncols=3, loc="upper right")
    style.save(picture, file)
