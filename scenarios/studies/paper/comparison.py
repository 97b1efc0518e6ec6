"""Compares methods over seeds and plans: errors and gains with their intervals.

`pooled` gives a statistic over seeds and poses with bootstrap replicates, as both
scatter; a `Contender` holds a method's errors on poses it has not seen; `gain_rows`,
`gains_table` and `verdict` compare FT-MLP with the springs, in per cent.

Interval of a pooled statistic (`pooled`):

==========  ==========================================================================
Equation    value = mean over seeds of statistic(errors of that seed); interval: 2.5 to
            97.5 % of the same with seeds and poses drawn anew, with replacement
Source      Efron, Tibshirani 1993, "An Introduction to the Bootstrap", chapter 8 and
            13; all seeds are judged on the same poses, which are drawn together
Needs       a few seeds, some hundred poses
Assumes     poses that are independent; with one seed it scatters with poses alone
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from bench.shared.settings import Interval
from scenarios.report.page import Table, table_of
from scenarios.studies.paper.budget import PLANS, Budget, said_seeds
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.transfer import (
    ConvolutionCell,
    NamedPhysicsCell,
    OwnCell,
    OwnMethod,
    PerceptronCell,
    SpringsCell,
)
from stiffness.methods.score import DIRECTIONS, METRICS, me
from stiffness.regression.intervals import Statistic

# --- Errors over seeds and poses ------------------------------------------------------

RESAMPLES = 2000


def p99(
    error: Float[np.ndarray, " rows"], weight: Float[np.ndarray, "*resamples rows"]
) -> Float[np.ndarray, "*resamples"]:
    """Return the 99th percentile of absolute errors, more robust than their maximum."""
    size = np.abs(error)
    order = np.argsort(size, kind="stable")
    share = np.cumsum(weight[..., order], axis=-1)
    first = np.argmax(share >= 0.99 * share[..., -1:], axis=-1)
    return np.asarray(size[order][first])


MEASURES: Final[Mapping[str, Statistic]] = MappingProxyType({**METRICS, "P99": p99})
"""The paper's measures and the 99th percentile."""


@dataclass(frozen=True)
class Draws:
    """A statistic with its bootstrap replicates over seeds and poses."""

    value: float
    replicates: Float[np.ndarray, " resamples"]

    @property
    def interval(self) -> Interval:
        """Value and 95 % interval; the ends are NaN where there is none."""
        low, high = np.quantile(self.replicates, [0.025, 0.975])
        return Interval(self.value, float(low), float(high))

    @property
    def row(self) -> dict[str, float]:
        """Value and interval of an error in mm as cells of a table."""
        value = self.interval
        return {"value_mm": value.estimate, "low_mm": value.low, "high_mm": value.high}

    @property
    def percent(self) -> dict[str, float]:
        """Value and interval of a relative difference in % as cells of a table."""
        value = self.interval
        return {
            "change_percent": 100 * value.estimate,
            "low_percent": 100 * value.low,
            "high_percent": 100 * value.high,
        }

    def change_from(self, other: "Draws") -> "Draws":
        """Return the relative difference from another, replicate by replicate."""
        return Draws(
            self.value / other.value - 1.0, self.replicates / other.replicates - 1.0
        )

    def way(self, top: "Draws", bottom: "Draws") -> "Draws":
        """Return (top - self) / (top - bottom), replicate by replicate."""
        return Draws(
            (top.value - self.value) / (top.value - bottom.value),
            (top.replicates - self.replicates) / (top.replicates - bottom.replicates),
        )


@lru_cache(maxsize=4)
def _resampled(
    seeds: int, poses: int, seed: int, resamples: int
) -> tuple[Float[np.ndarray, "resamples poses"], Float[np.ndarray, "resamples seeds"]]:
    """Return the bootstrap counts of poses and weights of seeds."""
    draw = np.random.default_rng(seed)
    weight = draw.multinomial(poses, np.full(poses, 1 / poses), resamples).astype(float)
    which = draw.multinomial(seeds, np.full(seeds, 1 / seeds), resamples) / seeds
    return weight, which


def pooled(
    error: Float[np.ndarray, "seeds poses *more"],
    statistic: Statistic,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Draws:
    """Pool a statistic over seeds; calls of one shape and seed share their resamples.

    A largest error has no interval, for resamples of these poses cannot exceed it. All
    seeds have the same poses; the statistic is vectorised over weights.
    """
    seeds, poses = error.shape[:2]
    weight, which = _resampled(seeds, poses, seed, resamples)
    values = [float(statistic(row, np.ones(poses))) for row in error]
    if statistic is me:
        return Draws(float(np.mean(values)), np.full(resamples, np.nan))
    replicates = np.stack([statistic(row, weight) for row in error], axis=1)
    return Draws(float(np.mean(values)), (which * replicates).sum(axis=1))


def overall(results: Sequence[CellResult], name: str) -> Draws:
    """Return the MAE over all directions on the fresh poses, of cells one a seed."""
    error = np.stack([np.abs(r[f"{name}/unseen"]).mean(axis=1) for r in results])
    return pooled(error, MEASURES["MAE"])


# --- Contenders -----------------------------------------------------------------------

TITLES = {
    "vjm": "VJM",
    "ft_mlp": "FT-MLP",
    "dt_cnn": "DT-CNN",
    "gp_residual": "VJM + GP",
    "named_physics": "named physics",
    "named_physics_all": "named physics, all markers",
    "pretrained": "MLP, not tuned",
    "aligned": "DT-CNN, aligned",
    "frozen": "DT-CNN, fine-tuned",
}
NO_PLAN = "-"
NAMED = ("named_physics", "named_physics_all")
"""The best method from the readings of the others, and from those of all markers."""


@dataclass(frozen=True)
class Contender:
    """One method, on one source plan where it has one.

    Attributes:
        method: Its name in data files.
        title: Its name in reports.
        seeds: Of its splits and networks.
        unseen: Errors in mm of every seed on the fresh poses.
        held_out: Errors in mm of every seed on the measured poses it has not seen.
        experiment: Errors in mm of the first seed on all measured poses.
    """

    method: str
    title: str
    plan: str
    seeds: tuple[int, ...]
    unseen: Float[np.ndarray, "seeds poses 3"]
    held_out: Float[np.ndarray, "seeds out 3"]
    experiment: Float[np.ndarray, "measured 3"]

    def draws(self, direction: int, measure: str) -> Draws:
        """Return a measure on the fresh poses, pooled over seeds."""
        return pooled(self.unseen[:, :, direction], MEASURES[measure])

    def held_out_draws(self, direction: int, measure: str) -> Draws:
        """Return a measure on measured poses held out; each seed holds out its own."""
        error = self.held_out[:, :, direction].reshape(1, -1)
        return pooled(error, MEASURES[measure])

    def overall(self, measure: str = "MAE") -> Draws:
        """Return a measure over all directions on the fresh poses."""
        return pooled(np.abs(self.unseen).mean(axis=2), MEASURES[measure])

    @property
    def name(self) -> str:
        """Title, and plan where it has one."""
        return self.title if self.plan == NO_PLAN else f"{self.title} ({self.plan})"


def contenders(
    budget: Budget, found: Mapping[Cell, CellResult], own: OwnMethod | None
) -> list[Contender]:
    """Return every method's errors, the paper's three methods first."""
    seeds, evaluations = budget.transfer.seeds, budget.transfer.evaluations
    springs = {seed: found[SpringsCell(seed, evaluations)] for seed in seeds}
    gathered = [of_results("vjm", NO_PLAN, springs, "vjm")]
    by_plan = {
        (kind, plan): dict(zip(seeds, perceptrons(budget, found, plan), strict=True))
        if kind is PerceptronCell
        else {s: found[ConvolutionCell(s, plan, budget.transfer)] for s in seeds}
        for plan in PLANS
        for kind in (PerceptronCell, ConvolutionCell)
    }
    wanted = [
        ("ft_mlp", PerceptronCell, "best"),
        ("dt_cnn", ConvolutionCell, "direct"),
        ("aligned", ConvolutionCell, "aligned"),
        ("frozen", ConvolutionCell, "frozen"),
        ("pretrained", PerceptronCell, "pretrained"),
    ]
    for method, kind, name in wanted:
        for plan in PLANS:
            results = by_plan[kind, plan]
            if f"{name}/unseen" in results[seeds[0]]:
                gathered.append(of_results(method, plan, results, name))
    gathered.append(of_results("gp_residual", NO_PLAN, springs, "gp_residual"))
    named = {seed: found[NamedPhysicsCell(seed)] for seed in seeds}
    for method in NAMED:
        gathered.append(of_results(method, NO_PLAN, named, method))
    if own is not None:
        results = {seed: found[OwnCell(seed, own)] for seed in seeds}
        gathered.append(of_results(own.title, NO_PLAN, results, "own"))
    return gathered


def perceptrons(
    budget: Budget, found: Mapping[Cell, CellResult], plan: str
) -> list[CellResult]:
    """Return FT-MLP's cells of one plan, one a seed."""
    cells = [c for c in found if isinstance(c, PerceptronCell) and c.plan == plan]
    cells = {c.seed: c for c in cells if c.settings == budget.transfer}
    return [found[cells[seed]] for seed in budget.transfer.seeds]


def of_results(
    method: str, plan: str, by_seed: Mapping[int, CellResult], name: str
) -> Contender:
    """Return one method's errors from its cells, one a seed."""
    results = list(by_seed.values())
    return Contender(
        method,
        TITLES.get(method, method),
        plan,
        tuple(by_seed),
        np.stack([r[f"{name}/unseen"] for r in results]),
        np.stack([r[f"{name}/held_out"] for r in results]),
        results[0][f"{name}/experiment"],
    )


def best_method_rows(everyone: Sequence[Contender]) -> list[dict[str, object]]:
    """Return how named physics differs from every other method, pose by pose.

    Resamples of poses and seeds are the same for both, so the intervals are paired.
    """
    best = next(c for c in everyone if c.method == NAMED[0])
    rows = []
    for other in everyone:
        if other.method in NAMED or other.seeds != best.seeds:
            continue
        for metric in ("MAE", "P99"):
            change = best.overall(metric).change_from(other.overall(metric))
            rows.append(
                {
                    "method": best.method,
                    "against": other.name,
                    "metric": metric,
                    **change.percent,
                    "n": best.unseen.shape[1],
                    "seeds": " ".join(map(str, best.seeds)),
                }
            )
    return rows


def best_method_table(everyone: Sequence[Contender]) -> Table:
    """Return the same as a table, with the largest errors in its caption."""
    best = next(c for c in everyone if c.method == NAMED[0])
    largest = ", ".join(
        f"{c.name} {np.abs(c.unseen).max():.3f}"
        for c in everyone
        if c.method in ("vjm", "ft_mlp", "dt_cnn", "gp_residual", *NAMED)
    )
    return table_of(
        f"Errors of named physics, mean of x, y and z of each pose, against every "
        f"other method's on the same {best.unseen.shape[1]} fresh poses, in per cent; "
        "intervals (95 %) draw poses and seeds anew, the same for both. Largest error "
        f"of any pose, direction and seed [mm]: {largest}.",
        best_method_rows(everyone),
        {
            "against": lambda r: str(r["against"]),
            "measure": lambda r: "99 %" if r["metric"] == "P99" else str(r["metric"]),
            "change": lambda r: f"{r['change_percent']:+.1f}",
            "95 % interval": _ends,
        },
    )


# --- Gains over the springs -----------------------------------------------------------

GAINS = {
    "MAE": (0.414, 0.431, 0.249),
    "STDE_signed": (0.318, 0.392, 0.142),
    "ME": (0.077, 0.209, 0.439),
}
"""Reduction of the VJM's error by FT-MLP in the paper's Table 10 in x, y, z; MAE and
STDE as its text says, ME as its table prints (its text says 8.5, 21.7 and 44.2 %)."""
BARS = {"MAE": 0.249, "STDE_absolute": 0.142, "STDE_signed": 0.142, "P99": 0.077}
"""The paper's least gain of any direction; that in ME is required of the 99th
percentile, for a largest error depends on a single pose."""
CALLED = {"STDE_absolute": "STDE, absolute", "STDE_signed": "STDE, signed"}
SURELY, YES, NO = "surely", "yes", "no"


def gain_rows(c: Contender, springs: Contender) -> list[dict[str, object]]:
    """Return rows with the difference of a method's errors from the springs', in %."""
    rows = []
    for k, direction in enumerate(DIRECTIONS):
        for metric in MEASURES:
            change = c.draws(k, metric).change_from(springs.draws(k, metric))
            tuned = c.method == "ft_mlp"
            paper = -100 * GAINS[metric][k] if tuned and metric in GAINS else None
            bar = -100 * BARS[metric] if tuned and metric in BARS else None
            rows.append(
                {
                    "method": c.method,
                    "plan": c.plan,
                    "direction": direction,
                    "metric": metric,
                    **change.percent,
                    "paper_percent": paper,
                    "bar_percent": bar,
                    "reached": None
                    if bar is None
                    else _reached(change.interval, bar / 100),
                    "n": c.unseen.shape[1],
                    "seeds": " ".join(map(str, c.seeds)),
                }
            )
    return rows


def gains_table(tuned: Sequence[Contender], springs: Contender) -> Table:
    """Return a table of FT-MLP's gains over the springs, beside the paper's."""
    rows = [row for c in tuned for row in gain_rows(c, springs)]
    return table_of(
        f"FT-MLP's error against the VJM's on {springs.unseen.shape[1]} fresh poses, "
        f"seeds: {_seeds(tuned)}; in per cent, negative is better. The bar is the "
        "paper's least gain in any direction; surely: the whole interval is below.",
        [row for row in rows if row["bar_percent"] is not None],
        {
            "plan": lambda r: str(r["plan"]),
            "": lambda r: str(r["direction"]).upper(),
            "measure": _called,
            "change": lambda r: f"{r['change_percent']:+.1f}",
            "95 % interval": _ends,
            "paper": lambda r: _percent(r["paper_percent"]),
            "bar": lambda r: _percent(r["bar_percent"]),
            "reached": lambda r: str(r["reached"]),
        },
    )


def _ends(row: Mapping[str, object]) -> str:
    return f"{row['low_percent']:+.1f} to {row['high_percent']:+.1f}"


def _seeds(tuned: Sequence[Contender]) -> str:
    each = [", ".join(map(str, c.seeds)) for c in tuned]
    if len(set(each)) == 1:
        return each[0]
    return "; ".join(f"{s} ({c.plan})" for s, c in zip(each, tuned, strict=True))


def verdict(tuned: Sequence[Contender], springs: Contender) -> str:
    """Return in words which of the paper's gains are reached, and which are not."""
    said = [
        "The paper's least gains over the springs are 24.9 % in MAE, 14.2 % in STDE "
        "and 7.7 % in ME, which is asked of the 99th percentile here; judged on "
        f"{springs.unseen.shape[1]} fresh poses of the experiment's region."
    ]
    for c in tuned:
        rows = gain_rows(c, springs)
        rows = [row for row in rows if row["reached"] is not None]
        missed = [row for row in rows if row["reached"] == NO]
        surely = sum(row["reached"] == SURELY for row in rows)
        reached, seeds = len(rows) - len(missed), len(c.seeds)
        text = f"Pre-trained on the {c.plan} plan ({said_seeds(seeds)}) FT-MLP reaches "
        if reached == 0:
            text += f"none of these {len(rows)} gains"
        else:
            text += (
                f"{reached} of these {len(rows)} gains, {surely} of them with the "
                "whole interval"
            )
        if 0 < len(missed) < len(rows):
            text += f"; it misses {', '.join(_missed(row) for row in missed)}"
        said.append(f"{text}.")
    return " ".join(said)


def finding(tuned: Sequence[Contender], springs: Contender) -> str:
    """Return the caption of Fig. 9: changes of FT-MLP's MAE by plan."""
    parts = []
    for c in tuned:
        change = [
            100 * c.draws(k, "MAE").change_from(springs.draws(k, "MAE")).value
            for k in range(3)
        ]
        x, y, z = (f"{value:+.0f}" for value in change)
        parts.append(f"{x}, {y}, {z} % where pre-trained on the {c.plan} plan")
    return (
        "Errors of VJM and FT-MLP on fresh poses (the paper's Fig. 9): MAE changes in "
        f"X, Y, Z by {'; '.join(parts)}. Bars: 95 % intervals over "
        f"{springs.unseen.shape[1]} poses and {len(springs.seeds)} "
        f"seed{'s' * (len(springs.seeds) > 1)}."
    )


def _reached(change: Interval, bar: float) -> str:
    if change.estimate > bar:
        return NO
    return SURELY if change.high <= bar else YES


def _called(row: Mapping[str, object]) -> str:
    return CALLED.get(str(row["metric"]), str(row["metric"]))


def _missed(row: Mapping[str, object]) -> str:
    return (
        f"{_called(row)} in {str(row['direction']).upper()} ("
        f"{row['change_percent']:+.0f} %, {row['low_percent']:+.0f} to "
        f"{row['high_percent']:+.0f})"
    )


def _percent(value: object) -> str:
    return "" if value is None else f"{value:+.1f}"
