"""The noise floor: errors of an oracle that knows the truth's form and fits its sizes.

No method that has to learn the form can do better. Sizes are the springs' first
stiffness and the magnitudes of every effect; the instruments' noise in their estimates
is all of the oracle's error. `floor_rows` gives every method's share of the way from
the springs to this floor.

Error of the oracle (`oracle_error`):

==========  ==========================================================================
Equation    theta = least squares of what was measured; error on fresh poses
            = J_fresh (J^T J)^-1 J^T (measured - true), J = d deflection / d log size
Source      Gauss-Newton's last step: Nocedal, Wright 2006, "Numerical Optimization",
            section 10.3; J by forward differences of the rig
Valid       errors small enough that deflections are linear in the sizes there
Ignores     weights of the readings: all have the same noise
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import fill

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture
from typing_extensions import override

from bench import standard_plans
from bench.effects.effect import Effect
from bench.rig import Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.study_arm import Truth, default_truth
from scenarios.pipelines.synthetic_recording import KR10
from scenarios.report import figures, page
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.comparison import MEASURES, Draws, pooled
from scenarios.studies.paper.experiment import (
    REVISITS,
    Material,
    displacement,
    fresh_plan,
)
from stiffness.experiment.deflections import every_plateau

# --- The oracle -----------------------------------------------------------------------

NUDGE = 0.02
"""Relative step of a size; chosen: far above rounding, small against nonlinearity."""


@dataclass(frozen=True)
class NudgeCell(Cell):
    """Deflections of the truth with one size changed, for forward differences.

    Attributes:
        size: Number of the size in `magnitudes`; -1 for none.
        seed: Of the fresh poses.
    """

    size: int
    poses: int
    seed: int

    @property
    @override
    def cost(self) -> float:
        return 15.0

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        truth = default_truth() if self.size < 0 else nudged(self.size)
        rig = Rig(KR10, truth.effects, truth.stiffness)
        experiment = standard_plans.table_one_plan(
            self.poses, revisits=min(REVISITS, self.poses)
        )
        fresh = fresh_plan(material.unseen.cases.posture, self.seed)
        data = every_plateau(material.arm, material.recording)
        loaded = np.arange(1, fresh.visits + 1) * len(fresh.path) - 1
        found = {}
        for name, plan, rows, cases in (
            ("experiment", experiment, data.row, data.cases),
            ("unseen", fresh, loaded, material.unseen.cases),
        ):
            first, point = plan.row_visit[rows] * len(plan.path), cases.point_in_flange
            moved = displacement(rig, rig.carry_out(plan), (first, rows), point)
            found[name] = 1e3 * moved
        return found


def magnitudes(truth: Truth) -> list[tuple[Effect, str] | int]:
    """Return every size: an axis' stiffness by number, or an effect and its field."""
    found: list[tuple[Effect, str] | int] = list(range(len(truth.stiffness)))
    for effect in truth.effects:
        names = CATALOGUE[effect.name].magnitudes
        own = ((name, getattr(effect, name)) for name in names)
        found += [(effect, name) for name, size in own if size and np.isfinite(size)]
    return found


def nudged(size: int) -> Truth:
    """Return the truth with one size a little larger."""
    truth = default_truth()
    what = magnitudes(truth)[size]
    if isinstance(what, int):
        stiffness = truth.stiffness.copy()
        stiffness[what] *= 1.0 + NUDGE
        return Truth(truth.effects, stiffness)
    effect, name = what
    more = replace(effect, **{name: (1.0 + NUDGE) * getattr(effect, name)})
    effects = [more if e is effect else e for e in truth.effects]
    return Truth(tuple(effects), truth.stiffness)


def oracle_error(
    still: CellResult, moved: Sequence[CellResult], noise: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "poses 3"]:
    """Return the oracle's error on the fresh poses.

    Deflections are of the truth and of the truth with each size a little larger; noise
    is measured less true deflections, in mm.
    """
    j, fresh = (
        np.stack([(m[on] - still[on]).ravel() / NUDGE for m in moved], axis=1)
        for on in ("experiment", "unseen")
    )
    off, *_ = np.linalg.lstsq(j, noise.ravel())
    return (fresh @ off).reshape(-1, 3)


# --- Tables ---------------------------------------------------------------------------


def report_table(rows: Sequence[Mapping]) -> page.Table:
    """Return every method's error and its share of the way, as a table."""
    caption = (
        f"Errors over all directions on {rows[0]['n']} fresh poses, seed "
        f"{rows[0]['seeds']} [mm]; intervals over poses; 99th percentile of a pose's "
        "mean of x, y and z, and the largest error in any direction"
    )
    columns: dict[str, Callable[[Mapping], str]] = {
        "method": lambda r: r["method"],
        "MAE": lambda r: f"{r['MAE_mm']:.4f}",
        "95 % interval": lambda r: f"{r['low_mm']:.4f} to {r['high_mm']:.4f}",
        "99 %": lambda r: f"{r['P99_mm']:.4f}",
        "largest": lambda r: f"{r['ME_mm']:.4f}",
        "share of the way [%]": lambda r: f"{100 * r['share_of_the_way']:.0f}",
        "interval": lambda r: (
            f"{100 * r['share_low']:.0f} to {100 * r['share_high']:.0f}"
        ),
    }
    return page.table_of(caption, rows, columns)


def summary(rows: Sequence[Mapping]) -> str:
    """Return each method's share of the way from springs to oracle, in words."""
    mae = {r["method"]: r["MAE_mm"] for r in rows}
    way = [
        f"{r['method']} {100 * r['share_of_the_way']:.0f} %"
        for r in rows
        if r["method"] not in ("VJM", "oracle")
    ]
    return (
        f"Springs leave {mae['VJM']:.4f} mm on fresh poses, one who knows the truth's "
        f"form {mae['oracle']:.4f} mm. Of the way between them go: {', '.join(way)}."
    )


def finding(
    rows: Sequence[Mapping],
    errors: Mapping[str, Float[np.ndarray, "poses 3"]],
    place: Float[np.ndarray, "poses 3"],
) -> str:
    """Return the figure's caption: the best method, and where each method is worst.

    Errors are in mm, those of the oracle last; places of the flange in m.
    """
    learnt = [r for r in rows if r["method"] not in ("VJM", "oracle")]
    best = max(learnt, key=lambda r: r["share_of_the_way"])
    far = np.argsort(np.linalg.norm(place, axis=1))
    quarter = max(len(far) // 4, 1)
    size = {name: np.abs(error).mean(axis=1) for name, error in errors.items()}
    times = ", ".join(
        f"{name} {s[far[-quarter:]].mean() / s[far[:quarter]].mean():.1f}"
        for name, s in list(size.items())[:-1]
    )
    return (
        f"{best['method']} comes furthest, {100 * best['share_of_the_way']:.0f} % of "
        f"the way from the springs to the oracle (left, with 95 % intervals over "
        f"{rows[0]['n']} fresh poses). Right: mean error of each pose at the place of "
        "the flange, seen from the side; in the quarter of poses furthest from the "
        f"foot it is so many times that in the nearest quarter: {times}."
    )


def columns_against_simulator(named: CellResult) -> str:
    """Return how far names' columns are from the same names as mechanisms, in words."""
    apart = np.abs(named["named_physics/patched"])
    if not len(apart):
        return "The diagnosis named nothing, so there is no patch to compare with."
    return (
        f"The diagnosis named {int(named['named_physics/names'])} effects. On "
        f"{len(apart)} fresh poses the columns of these names are within "
        f"{apart.mean():.4f} mm on average, {apart.max():.3f} mm at most, of the "
        "simulator that was patched with them, each with the sizes that the diagnosis "
        "gave it: that is what the forms of the laws differ by."
    )


# --- Figure ---------------------------------------------------------------------------


def draw(
    errors: Mapping[str, Float[np.ndarray, "poses 3"]],
    rows: Sequence[dict],
    place: Float[np.ndarray, "poses 3"],
    file: Path,
) -> None:
    """Draw shares of the way, and a map of errors for every method but the oracle.

    Errors are in mm, those of the oracle last; places of the flange in m.
    """
    shown = list(errors)[:-1]
    picture = Picture(figsize=(4 + 2 * len(shown), 4.2), layout="constrained")
    axes = picture.subplots(1, 1 + len(shown), width_ratios=[1.4, *[1] * len(shown)])
    learnt = [r for r in rows if r["method"] not in ("VJM", "oracle")]
    names = [r["method"] for r in learnt]
    share = np.array([[r[f"share_{k}"] for r in learnt] for k in ("low", "high")])
    value = np.array([r["share_of_the_way"] for r in learnt])
    axes[0].barh(names, 100 * value, 0.6, color=figures.ORANGE)
    axes[0].errorbar(
        100 * value, names, xerr=100 * np.abs(share - value), fmt="none", ecolor="black"
    )
    for end, called, side in ((0.0, "springs", "right"), (100.0, "oracle", "left")):
        axes[0].axvline(end, color="black", lw=1.0)
        axes[0].annotate(
            called,
            (end, 1.0),
            (0, 4),
            ("data", "axes fraction"),
            textcoords="offset points",
            ha=side,
        )
    axes[0].set_xlim(min(0.0, *(100 * share[0])) - 15, 115)
    axes[0].invert_yaxis()
    axes[0].set_xlabel("share of the way [%]")
    radius = np.hypot(place[:, 0], place[:, 1])
    size = {name: np.abs(errors[name]).mean(axis=1) for name in shown}
    most = np.quantile(size["VJM"], 0.98)
    for k, (ax, name) in enumerate(zip(axes[1:], shown, strict=True)):
        order = np.argsort(size[name])
        ax.scatter(
            radius[order], place[order, 2], c=size[name][order], s=9, vmax=most, vmin=0
        )
        ax.set_title(fill(name, width=14), size=10)
        ax.set_xlabel("from A1's axis [m]")
        ax.set_ylabel("height [m]" if k == 0 else "")
        ax.set_aspect("equal", adjustable="box")
    picture.colorbar(
        axes[-1].collections[0], ax=axes[-1], label="error [mm]", shrink=0.7
    )
    figures.save(picture, file)


# --- Shares of the way to the floor ---------------------------------------------------


def _mae(error: Float[np.ndarray, "poses 3"]) -> Draws:
    return pooled(np.abs(error).mean(axis=1)[None], MEASURES["MAE"])


def floor_rows(errors: dict, seed: int) -> list[dict[str, object]]:
    """Return the table of mean errors and of shares of the way to the oracle."""
    draws = {name: _mae(error) for name, error in errors.items()}
    top, floor, rows = draws["VJM"], draws["oracle"], []
    for name, d in draws.items():
        size = np.abs(errors[name]).mean(axis=1)
        way = d.way(top, floor).interval
        rows.append(
            {
                "method": name,
                "MAE_mm": d.value,
                "low_mm": d.interval.low,
                "high_mm": d.interval.high,
                "P99_mm": pooled(size[None], MEASURES["P99"]).value,
                "ME_mm": float(np.abs(errors[name]).max()),
                "share_of_the_way": way.estimate,
                "share_low": way.low,
                "share_high": way.high,
                "n": len(errors[name]),
                "seeds": seed,
            }
        )
    return rows
