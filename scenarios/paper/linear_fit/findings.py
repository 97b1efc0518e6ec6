"""What the fit of six springs shows, in words that follow from its numbers."""

from collections.abc import Sequence

import numpy as np

from scenarios.paper.experiment import Experiment
from scenarios.paper.linear_fit.fit import LinearFit
from scenarios.paper.numbers import TABLE_02_MM, TABLE_03_NM_PER_RAD
from stiffness.methods.method import Parameter
from stiffness.score import Score


def against_truth(experiment: Experiment, found: LinearFit) -> str:
    """Say how the springs stand to the true axes, and which is furthest off."""
    rows = stiffness_of(experiment, found)
    softer = [p for p, secant, _ in rows if p.high < secant]
    stiffer = [p for p, secant, _ in rows if p.low > secant]
    worst, true, _ = max(rows, key=lambda row: abs(np.log(row[0].value / row[1])))
    ratio = max(worst.value / true, true / worst.value)
    said = [
        f"{_names(axes)} {kind} than true by more than the interval"
        for axes, kind in ((softer, "softer"), (stiffer, "stiffer"))
        if axes
    ]
    return "; ".join(
        [
            *(said or ["no interval leaves the truth out"]),
            f"furthest off is {worst.name.upper()}, by a factor of {ratio:.1f}. A "
            "spring also takes on what bearings, links and base give way along with it",
        ]
    )


def _names(axes: Sequence[Parameter]) -> str:
    names = ", ".join(p.name.upper() for p in axes)
    return f"{names} come{'s' * (len(axes) == 1)} out"


def against_paper(found: LinearFit) -> str:
    """Say by how much MAE and signed STDE differ from the paper's."""
    parts = []
    for metric in ("MAE", "STDE_signed"):
        change = [
            100 * (s.value_mm / paper - 1)
            for s in found.scores["vjm"]
            if s.metric == metric and (paper := published(s)) is not None
        ]
        listed = ", ".join(f"{c:+.0f}" for c in change)
        parts.append(f"{metric.replace('_', ', ')} {listed} %")
    return (
        "Against the paper's, in X, Y, Z: " + "; ".join(parts) + "; the truth was "
        "calibrated for that"
    )


def over_floor(found: LinearFit) -> float:
    """Return the springs' MAE over the instruments', mean over the directions."""
    floor = {s.direction: s.value_mm for s in found.floor if s.metric == "MAE"}
    own = {s.direction: s.value_mm for s in found.scores["vjm"] if s.metric == "MAE"}
    return sum(own[d] / floor[d] for d in floor) / len(floor)


def published(score: Score) -> float | None:
    """Return the paper's number of Table 2, in mm, where it prints one."""
    metric = {"MAE": "MAE", "STDE_signed": "STDE", "ME": "ME"}.get(score.metric)
    return TABLE_02_MM[score.direction, metric] if metric else None


def stiffness_of(
    experiment: Experiment, found: LinearFit
) -> list[tuple[Parameter, float, float]]:
    """Return identified, true secant and published stiffness of each axis."""
    secant = [float(k) for k in experiment.secant_stiffness]
    return list(zip(found.fitted.stiffness, secant, TABLE_03_NM_PER_RAD, strict=True))
