"""The law that was named is drawn through what the marks show of its axis."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from scenarios.diagnosing.finding import MICRO, Curves, courses_of
from scenarios.reporting.style import BLUE, GREY, ORANGE, save

WORDS = ("patch, simulated", "measured", "where a visit begins")
STRAY = 1.5
"""How far beyond all but a few readings one is still shown; chosen."""
LOOPS = 3
"""Visits whose course is drawn as a line; chosen: more is a tangle."""


def of_law(curves: Curves, name: str, file: Path) -> None:
    """Draw the course of an axis' turn in a few visits, and all of it against the law.

    Args:
        curves: Of all axes.
        name: The axis.
        file: Where the picture goes.
    """
    k = curves.axes.index(name)
    unit, load = ("µm", "force [N]") if curves.slides[k] else ("µrad", "torque [N m]")
    measured, law = curves.before[:, k], curves.law[:, k]
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    for i, course in enumerate(courses_of(curves, name, LOOPS)):
        words = WORDS if i == 0 else (None,) * 3
        shown, seen = MICRO * course.law, MICRO * course.measured
        left.plot(course.torque, shown, "-", color=ORANGE, lw=1.6, label=words[0])
        left.plot(course.torque, seen, "o", color=GREY, ms=5, label=words[1])
        begins = (course.torque[:1], shown[:1], "o")
        left.plot(*begins, color=ORANGE, ms=7, label=words[2])
    left.set_xlabel(load)
    left.set_ylabel(f"turn beyond the nominal arm [{unit}]")
    left.set_title(f"{name}: the {LOOPS} visits with the widest load", loc="left")
    left.legend()
    sizes = np.abs(measured)
    seen = min(np.max(sizes), STRAY * np.quantile(sizes, 0.995))
    lim = 1.1 * MICRO * max(np.max(np.abs(law)), seen)
    right.plot([-lim, lim], [-lim, lim], color=ORANGE, lw=1.2)
    for rows, colour, word in (
        (~curves.held, GREY, "fitted poses"),
        (curves.held, BLUE, "poses kept back"),
    ):
        right.plot(
            MICRO * law[rows],
            MICRO * measured[rows],
            ".",
            color=colour,
            ms=4,
            label=word,
        )
    right.set_xlim(-lim, lim)
    right.set_ylim(-lim, lim)
    right.set_xlabel(f"patch, simulated [{unit}]")
    right.set_ylabel(f"measured [{unit}]")
    right.set_title("all rows, each visit's mean taken off", loc="left")
    right.legend(markerscale=2)
    save(figure, file)
