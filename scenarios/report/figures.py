"""Figures of a diagnosis, a calibration and a comparison of encoders.

Of a diagnosis: each axis' wind-up over its torque, the named law at an axis, held-out
poses, and errors by body. Of a calibration: errors before and after, errors of uneven
gears, and maps of the residual. Of a patch on another recording: errors before and
after, and over the axes' angles. Of a comparison of encoders: their difference over
time, torque and speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis as FigureAxis
from matplotlib.colors import LinearSegmentedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from bench.proof.comparison import residual_of
from bench.proof.explained_share import Channel
from bench.proof.proof import Proof
from bench.proof.proof_checks import squares
from bench.shared.models import axis_unit
from bench.shared.settings import MICRO, MM, URAD
from scenarios.pipelines.diagnosis import Curves, courses_of
from scenarios.pipelines.patching import NEAR

if TYPE_CHECKING:
    from scenarios.pipelines.calibration_proof import CalibrationProof
    from scenarios.pipelines.encoder_axes import Axis
    from scenarios.pipelines.judgement import Judgement
    from stiffness.calibration.result import Calibrated
    from stiffness.dual_encoder.motions import Motion

# --- Colours, sizes and axes that all figures share -----------------------------------

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


def plain_log(axis: FigureAxis) -> None:
    """Label a logarithmic axis by plain numbers, few enough not to overlap."""
    low, high = axis.get_view_interval()
    wide = np.log10(high / low) > 2.0
    axis.set_major_locator(LogLocator(subs=(1,) if wide else (1, 2, 5)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())


# --- A diagnosis ----------------------------------------------------------------------

ACROSS = 3
MOST_POINTS = 4000


def of_axes(curves: Curves, named: frozenset[str], file: Path | None = None) -> Figure:
    """Draw each axis' rotation beyond the nominal arm over its torque, if it shows."""
    shown = [k for k, seen in enumerate(curves.visible) if seen]
    across = min(ACROSS, max(len(shown), 1))
    down = -(-len(shown) // across)
    figure = Figure(figsize=(10.5, 2.9 * down + 0.5), layout="constrained")
    rows = np.arange(len(curves.torque))
    if len(rows) > MOST_POINTS:
        rows = rows[:: -(-len(rows) // MOST_POINTS)]
    if shown:
        axes = figure.subplots(down, across, squeeze=False).ravel()
        for ax, k in zip(axes, shown, strict=False):
            _one(ax, curves, k, rows, curves.axes[k] in named)
        for empty in axes[len(shown) :]:
            empty.set_visible(False)
        handles, labels = axes[0].get_legend_handles_labels()
        place = {"loc": "outside upper center", "ncols": len(labels)}
        figure.legend(handles, labels, **place, markerscale=3)
    if rest := [
        _not_seen(curves, k) for k in range(len(curves.axes)) if k not in shown
    ]:
        said = f"No turn beyond what noise makes: {', '.join(rest)}."
        figure.supxlabel(said, fontsize=9, color=GREY)
    return save(figure, file)


def of_poses(channel: Channel, unit: str, file: Path) -> None:
    """Draw the error of every held-out pose before and after, the worst first."""
    order = np.argsort(-channel.before_of)
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    axes = figure.subplots()
    at = np.arange(len(order))
    before, after = MICRO * channel.before_of[order], MICRO * channel.after_of[order]
    axes.vlines(at, after, before, color="#d8d8d8", lw=2.5, zorder=1)
    axes.plot(at, before, "o", color=GREY, ms=6, label="nominal arm, fitted")
    axes.plot(at, after, "o", color=ORANGE, ms=6, label="with the patch")
    axes.axhline(
        MICRO * channel.noise, color=BLUE, lw=1.2, ls="--", label="noise alone"
    )
    axes.set_xticks(at, [str(p) for p in channel.posture_id[order]], fontsize=7)
    axes.set_xlabel("pose kept back")
    axes.set_ylabel(f"rms error [{unit}]")
    axes.set_ylim(bottom=0)
    axes.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=3)
    save(figure, file)


def of_bodies(simulated: Proof, proved: bool, file: Path) -> None:
    """Draw the rms error of each body, before and after."""
    before, after = by_body(simulated)
    figure = Figure(figsize=(10.5, 2.8), layout="constrained")
    axes = figure.subplots()
    at, wide, aside = np.arange(len(before)), 0.38 if proved else 0.6, 0.2 * proved
    drawn = [(before, -aside, GREY, "nominal arm, fitted")]
    drawn += [(after, aside, ORANGE, "with the patch")] * proved
    for sizes, shift, colour, label in drawn:
        height = [MICRO * v for v in sizes.values()]
        axes.bar(at + shift, height, wide, color=colour, label=label)
    axes.set_xticks(at, list(before))
    axes.set_ylabel("rms error [µm]")
    axes.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=2)
    save(figure, file)


def of_marks(simulated: Proof, file: Path | None = None) -> Figure:
    """Draw what marks do along what the patch does to them, measured over simulated.

    Of a row with the residuals b of the nominal arm and a of the patched one, l = b -
    a: |l| and b · l / |l|, over the root of the number of marks.
    """
    simulation, mode = simulated.simulation, simulated.mode
    points = 3 * len(simulation.recording.markers)
    before, after = (
        residual_of(simulation, simulation.see(one), mode)[:, :points]
        for one in (simulated.nominal, simulated.patched)
    )
    law = np.nan_to_num(before - after)
    size = np.maximum(np.linalg.norm(law, axis=1), 1e-12)
    marks = np.sqrt(np.maximum(np.isfinite(before).sum(axis=1) / 3.0, 1.0))
    x = MICRO * size / marks
    y = MICRO * np.sum(np.nan_to_num(before) * law, axis=1) / size / marks
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    axes = figure.subplots()
    low, high = min(float(y.min()), 0.0), max(float(x.max()), float(y.max()))
    axes.plot([0.0, x.max()], [0.0, x.max()], color=ORANGE, lw=1.2)
    _by_split(axes, x, y, ~mode.keep, simulated.folds)
    axes.set(xlim=(0.0, 1.03 * x.max()), ylim=(1.05 * low, 1.05 * high))
    axes.set_xlabel("patch, simulated [µm]")
    axes.set_ylabel("measured along it [µm]")
    axes.legend(markerscale=2)
    return save(figure, file)


def _by_split(
    axes: Axes, x: np.ndarray, y: np.ndarray, held: np.ndarray, folds: int
) -> None:
    """Draw rows as points: those that were fitted, and those that were kept back."""
    first = f", first of {folds} fits" if folds > 1 else ""
    for rows, colour, word in (
        (~held, GREY, f"fitted poses{first}"),
        (held, BLUE, f"poses kept back{first}"),
    ):
        axes.plot(x[rows], y[rows], ".", color=colour, ms=4, label=word)


def by_body(simulated: Proof) -> tuple[dict[str, float], dict[str, float]]:
    """Return the rms of each body's markers over all rows, before and after, in m."""
    simulation, mode = simulated.simulation, simulated.mode
    found = []
    names = [marker.body for marker in simulation.recording.markers]
    for assumed in (simulated.nominal, simulated.patched):
        left = residual_of(simulation, simulation.see(assumed), mode)
        square = squares(simulation, left)[0]
        found.append(
            {
                body: float(np.sqrt(np.nanmean(square[:, [n == body for n in names]])))
                for body in dict.fromkeys(names)
            }
        )
    return found[0], found[1]


def _one(axes: Axes, curves: Curves, k: int, rows: np.ndarray, named: bool) -> None:
    limit = _limit(curves, k)
    unit, torque = ("µm", "force [N]") if curves.slides[k] else ("µrad", "torque [N m]")
    ms, alpha = (2.5, 0.9) if named else (1.2, 0.35)
    for turn, colour, size, shade, label in (
        (curves.before, GREY, 2.5, 0.45, "measured, beyond the nominal arm"),
        (curves.law, ORANGE, ms, alpha, "patch, simulated"),
    ):
        look = {"color": colour, "ms": size, "alpha": shade, "rasterized": True}
        x, y = curves.torque[rows, k], MICRO * turn[rows, k]
        axes.plot(x, y, ".", label=label, **look)
    axes.set_title(
        f"{curves.axes[k]}{', named' if named else ''}",
        loc="left",
        fontsize=10,
        fontweight="bold" if named else "normal",
        color=ORANGE if named else "#1c1c1c",
    )
    axes.set_ylim(-limit, limit)
    axes.set_xlabel(torque)
    axes.set_ylabel(f"turn [{unit}]")


def _not_seen(curves: Curves, k: int) -> str:
    """Say how uncertain an axis' turn is, where a cloud of points would show noise."""
    unit = "µm" if curves.slides[k] else "µrad"
    return f"{curves.axes[k]} (± {MICRO * curves.noise[k]:.0f} {unit})"


def _limit(curves: Curves, k: int) -> float:
    """Return half the height of an axis' plot: holds all but stray points."""
    sizes, law = np.abs(curves.before[:, k]), np.max(np.abs(curves.law[:, k]))
    seen = min(np.max(sizes), STRAY * np.quantile(sizes, 0.995))
    return 1.1 * MICRO * max(seen, law, 1e-7)


# --- A named law ----------------------------------------------------------------------

WORDS = ("patch, simulated", "measured", "where a visit begins")
STRAY = 1.5
"""Factor on the 99.5 % quantile of readings up to which a reading is shown; chosen."""
LOOPS = 3
"""Number of visits drawn as loading curves; chosen: more cannot be told apart."""


def of_law(
    curves: Curves, name: str, file: Path | None = None, over: str = "torque"
) -> Figure:
    """Draw an axis' rotation over torque or angle, and measured over simulated rows."""
    k = curves.axes.index(name)
    unit = "µm" if curves.slides[k] else "µrad"
    measured, law = curves.before[:, k], curves.law[:, k]
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    draw = _over_angle if over == "angle" else _loops
    draw(left, curves, k)
    left.set_ylabel(f"turn beyond the nominal arm [{unit}]")
    left.legend()
    lim = _limit(curves, k)
    right.plot([-lim, lim], [-lim, lim], color=ORANGE, lw=1.2)
    _by_split(right, MICRO * law, MICRO * measured, curves.held, curves.folds)
    right.set_xlim(-lim, lim)
    right.set_ylim(-lim, lim)
    right.set_xlabel(f"patch, simulated [{unit}]")
    right.set_ylabel(f"measured [{unit}]")
    means = "" if curves.absolute else ", each visit's mean taken off"
    right.set_title(f"all rows{means}", loc="left")
    right.legend(markerscale=2)
    return save(figure, file)


def _loops(axes: Axes, curves: Curves, k: int) -> None:
    """Draw the visits with the widest load over an axis' torque."""
    name = curves.axes[k]
    for i, course in enumerate(courses_of(curves, name, LOOPS)):
        words = WORDS if i == 0 else (None,) * 3
        shown, seen = MICRO * course.law, MICRO * course.measured
        axes.plot(course.torque, shown, "-", color=ORANGE, lw=1.6, label=words[0])
        axes.plot(course.torque, seen, "o", color=GREY, ms=5, label=words[1])
        begins = (course.torque[:1], shown[:1], "o")
        axes.plot(*begins, color=ORANGE, ms=7, label=words[2])
    axes.set_xlabel("force [N]" if curves.slides[k] else "torque [N m]")
    axes.set_title(f"{name}: the {LOOPS} visits with the widest load", loc="left")


def _over_angle(axes: Axes, curves: Curves, k: int) -> None:
    """Draw all rows over an axis' angle."""
    unit, factor = axis_unit(curves.slides[k])
    at = factor * curves.angle[:, k]
    seen, law = MICRO * curves.before[:, k], MICRO * curves.law[:, k]
    axes.plot(at, seen, ".", color=GREY, ms=4, label=WORDS[1])
    axes.plot(at, law, ".", color=ORANGE, ms=4, label=WORDS[0])
    limit = _limit(curves, k)
    axes.set(xlabel=f"angle [{unit}]", ylim=(-limit, limit))
    axes.set_title(f"{curves.axes[k]}: all rows over its angle", loc="left")


# --- A calibration --------------------------------------------------------------------

NAMES = ("as drawn", "as calibrated")


def calibration_before_after(
    found: Calibrated, proof: CalibrationProof, file: Path | None = None
) -> Figure:
    """Draw where the held-out poses are and the simulator's error there."""
    from stiffness.calibration.model import CalibrationState

    at = CalibrationState.of(found.readings, found.corrected_geometry).point[found.held]
    figure = Figure(figsize=(11, 4), layout="constrained")
    *places, shares = figure.subplots(1, 3, width_ratios=(1, 1, 1.15))
    sizes = [MM * np.linalg.norm(r, axis=1) for r in (proof.before, proof.after)]
    colours = LogNorm(*np.quantile(np.concatenate(sizes), [0.02, 0.98]))
    look = {"norm": colours, "cmap": "inferno_r", "rasterized": True}
    look["s"] = np.clip(2000 / len(at), 5, 30)
    drawn = []
    for ax, size, name in zip(places, sizes, NAMES, strict=True):
        order = np.argsort(size)
        x, z = MM * at[order, 0], MM * at[order, 2]
        drawn.append(ax.scatter(x, z, c=size[order], **look))
        ax.set_title(f"{name}: {np.sqrt(np.mean(size**2)):.3f} mm rms", size=10)
        ax.set(xlabel="x [mm]")
        ax.set_aspect("equal", adjustable="datalim")
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    places[0].set_ylabel("z [mm]")
    places[1].tick_params(labelleft=False)
    bar = figure.colorbar(drawn[-1], ax=places, shrink=0.9)
    bar.ax.set_title("error [mm]", size=9)
    plain_log(bar.ax.yaxis)
    for size, name, colour, lw in zip(
        sizes, NAMES, (GREY, ORANGE), (3.5, 2), strict=True
    ):
        share = np.linspace(0, 100, len(size))
        shares.plot(np.sort(size), share, color=colour, lw=lw, label=name)
    noise = MM * found.at_last.noise
    shares.axvline(noise, color=BLUE, ls="--", lw=1, label="neighbours differ")
    shares.set(xscale="log", xlabel="error [mm]", ylabel="poses below [%]")
    shares.set(ylim=(0, 101))
    plain_log(shares.xaxis)
    above = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 3}
    shares.legend(**above, fontsize=8, columnspacing=1.2, handlelength=1.5)
    return save(figure, file)


def gears(found: Calibrated, file: Path) -> None:
    """Draw each gear's transmission error over the fitted angles, and the readings."""
    from stiffness.calibration.model import CalibrationState

    count = len(found.error_tables)
    figure = Figure(figsize=(11, 1.9 * count), layout="constrained")
    plots = figure.subplots(count, 1, squeeze=False)[:, 0]
    keep = ~found.held
    lever = CalibrationState.of(found.readings, found.corrected_geometry).lever[:, keep]
    posture, left = found.readings.posture[keep], found.residual[keep]
    for ax, (axis, table) in zip(
        plots, sorted(found.error_tables.items()), strict=True
    ):
        k = int(axis[1:]) - 1
        turn = np.sum(lever[k] ** 2, axis=1)
        clear = turn > np.quantile(turn, 0.3)
        own = np.sum(lever[k] * left, axis=1)[clear] / turn[clear]
        angle = posture[clear, k]
        grid = np.linspace(posture[:, k].min(), posture[:, k].max(), 4000)
        known = np.sort(posture[:, k])
        at = np.clip(np.searchsorted(known, grid), 1, len(known) - 1)
        far = np.minimum(np.abs(grid - known[at - 1]), np.abs(grid - known[at]))
        law = np.where(far < np.radians(1.0), 1e6 * table.at(grid), np.nan)
        dots = 1e6 * (table.at(angle) + own)
        ax.plot(np.degrees(angle), dots, ".", color=GREY, ms=1, rasterized=True)
        ax.plot(np.degrees(grid), law, color=ORANGE, lw=1.2)
        span = 1.3 * np.nanmax(np.abs(law))
        ax.set(ylim=(-span, span), ylabel=f"{axis} [µrad]")
    plots[-1].set_xlabel("angle of the axis [°]")
    save(figure, file)


def residual_map(
    found: Calibrated, proof: CalibrationProof, new: np.ndarray, file: Path
) -> None:
    """Draw the residual over position, joint angles and time."""
    from scenarios.pipelines.calibration_proof import rms

    held = found.held
    posture, hours = found.readings.posture[held], found.readings.hours
    hours = (hours - hours.min())[held]
    axes = [k for k in range(posture.shape[1]) if np.ptp(posture[:, k]) > 0.0]
    size = MM * np.linalg.norm(proof.after, axis=1)
    columns = 4
    rows = -(-(len(axes) + 1) // columns)
    figure = Figure(figsize=(12, 2.6 * rows), layout="constrained")
    plots = figure.subplots(rows, columns, squeeze=False).ravel()
    top = 1.2 * np.quantile(size, 0.995)
    for ax in plots[len(axes) + 1 :]:
        ax.axis("off")
    units = {k: axis_unit(found.readings.arm.slides[k]) for k in axes}
    things = [(f * posture[:, k], f"a{k + 1} [{u}]") for k, (u, f) in units.items()]
    for ax, (x, label) in zip(plots, [*things, (hours, "time [h]")], strict=False):
        ax.plot(x[~new], size[~new], ".", color=GREY, ms=2, rasterized=True)
        ax.plot(x[new], size[new], ".", color=ORANGE, ms=2, rasterized=True)
        ax.set(xlabel=label, ylim=(0, top))
        ax.locator_params(axis="x", nbins=5)
    for ax in plots[::columns]:
        ax.set_ylabel("left [mm]")
    figure.suptitle(
        f"{MM * rms(proof.after):.3f} mm rms on poses kept back; orange: at an angle "
        "that no fitted pose had",
        size=10,
    )
    save(figure, file)


# --- A patch on another recording -----------------------------------------------------

BINS = 24


def judged_before_after(judgement: Judgement, file: Path) -> None:
    """Draw the share of readings below each error, as drawn and with the patch."""
    j = judgement
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    parts = [("all readings", np.ones(len(j.noise), dtype=bool))]
    if j.inside is not None and j.outside is not None and j.covered is not None:
        parts += [("covered", j.covered), ("not covered", ~j.covered)]
    plots = figure.subplots(1, len(parts), squeeze=False, sharey=True)[0]
    drawn: list[Line2D] = []
    for ax, (title, rows) in zip(plots, parts, strict=True):
        drawn = []
        for error, colour, lw in ((j.before, GREY, 3.5), (j.after, ORANGE, 2)):
            size = MICRO * np.sort(error[rows][np.isfinite(error[rows])])
            drawn += ax.plot(size, np.linspace(0, 100, len(size)), color=colour, lw=lw)
        noise = MICRO * float(np.sqrt(np.mean(j.noise[rows] ** 2)))
        drawn.append(ax.axvline(noise, color=BLUE, ls="--", lw=1))
        ax.set(xscale="log", xlabel="error [µm]", ylim=(0, 101))
        sizes = " → ".join(f"{_root(error[rows]):.1f}" for error in (j.before, j.after))
        ax.set_title(f"{title}: {sizes} µm rms", loc="left", size=10)
        plain_log(ax.xaxis)
    _legend(figure, drawn, ("as drawn", "with the patch", "noise alone"))
    plots[0].set_ylabel("readings below [%]")
    save(figure, file)


def judged_over_angles(judgement: Judgement, file: Path) -> None:
    """Draw the rms error in stretches of each axis' angle, and where it was fitted."""
    j = judgement
    axes = [k for k, a in enumerate(j.axes) if a.angle[1] > a.angle[0]]
    figure = Figure(figsize=(10.5, 2.7 * -(-len(axes) // ACROSS)), layout="constrained")
    plots = figure.subplots(-(-len(axes) // ACROSS), ACROSS, squeeze=False).ravel()
    drawn: list[Line2D] = []
    for ax, k in zip(plots, axes, strict=False):
        axis, angle = j.axes[k], j.recording.posture[:, k]
        unit, factor = axis_unit(axis.name in j.slides)
        edge = np.linspace(*axis.angle, BINS + 1)
        part = np.clip(np.searchsorted(edge, angle, side="right") - 1, 0, BINS - 1)
        for low, high in () if axis.fitted is None else axis.fitted.angle_rad:
            ends = factor * (low - NEAR), factor * (high + NEAR)
            ax.axvspan(*ends, color="#f3e3cc", lw=0)
        middle = factor * (edge[1:] + edge[:-1]) / 2
        drawn = []
        for error, colour in ((j.before, GREY), (j.after, ORANGE)):
            size = [_root(error[part == b]) for b in range(BINS)]
            drawn += ax.plot(middle, size, "o-", color=colour, ms=3, lw=1)
        ax.set(xlabel=f"{axis.name} [{unit}]", ylim=(0, None))
        ax.set_xlim(factor * axis.angle[0], factor * axis.angle[1])
    for ax in plots[len(axes) :]:
        ax.axis("off")
    for ax in plots[::ACROSS]:
        ax.set_ylabel("rms [µm]")
    _legend(figure, drawn, ("as drawn", "with the patch"))
    save(figure, file)


def _root(error: np.ndarray) -> float:
    good = error[np.isfinite(error)]
    return MICRO * float(np.sqrt(np.mean(good**2))) if len(good) else np.nan


# --- A comparison of encoders ---------------------------------------------------------


def encoders_before_after(axes: Sequence[Axis], file: Path | None = None) -> Figure:
    """Draw the residual of the judged motion, nominal and patched, over time."""
    from scenarios.pipelines.encoder_axes import whole_rms

    figure = Figure(figsize=(11, 2.1 * len(axes)), layout="constrained")
    plots = figure.subplots(len(axes), 1, squeeze=False, sharex=True)[:, 0]
    drawn = []
    for ax, a in zip(plots, axes, strict=True):
        time = a.judged.time - a.judged.time[0]
        drawn = ax.plot(time, URAD * a.before, color=GREY, lw=1)
        drawn += ax.plot(time, URAD * a.after, color=ORANGE, lw=0.8)
        sizes = [URAD * whole_rms(x) for x in (a.before, a.after)]
        ax.set_ylabel(f"{a.name} [µrad]")
        ax.set_title(f"{sizes[0]:.0f} → {sizes[1]:.0f} µrad rms", size=9, loc="right")
    plots[-1].set_xlabel("time [s]")
    _legend(figure, drawn, ("as modelled", "with what was named"))
    return save(figure, file)


def looks_like(axes: Sequence[Axis], file: Path) -> None:
    """Draw the encoders' difference over measured motor torque, and over speed."""
    figure = Figure(figsize=(11, 2.6 * len(axes)), layout="constrained")
    plots = figure.subplots(len(axes), 1 + _with_torque(axes), squeeze=False)
    for row, a in zip(plots, axes, strict=True):
        left, right = row[0], row[-1]
        for m in (*a.fitted, a.judged):
            colour = ORANGE if m is a.judged else GREY
            look = {"color": colour, "ms": 1.5, "rasterized": True}
            if m.torque is not None and _read(m):
                left.plot(m.torque / 1e3, URAD * m.apart, ".", **look)
            right.plot(m.speed, URAD * m.apart, ".", **look)
        left.set_ylabel(f"{a.name}: after − before [µrad]")
    two = [Line2D([], [], marker=".", ls="", color=c) for c in (GREY, ORANGE)]
    _legend(figure, two, ("motions that were fitted", "judged motion"))
    plots[-1][0].set_xlabel("torque of the motor [kN m]")
    plots[-1][-1].set_xlabel("speed [rad/s]")
    save(figure, file)


def followed(axes: Sequence[Axis]) -> str:
    """Return a caption with the correlations of the difference, torque and speed."""
    told = []
    for a in axes:
        motions = (*a.fitted, a.judged)
        speed = f"speed {_correlation(motions, [m.speed for m in motions]):+.2f}"
        torque = [m.torque for m in motions if m.torque is not None and _read(m)]
        if len(torque) == len(motions):
            speed = f"torque {_correlation(motions, torque):+.2f}, {speed}"
        told.append(f"{a.name}: {speed}")
    over = "over the motor's torque (left) and speed (right)"
    if not _with_torque(axes):
        over = "over speed"
    return (
        f"The second encoder less the first {over}, judged motion in orange. "
        f"Correlation with {'; '.join(told)}."
    )


def _legend(figure: Figure, drawn: Sequence[Line2D], said: Sequence[str]) -> None:
    figure.legend(drawn, said, loc="outside upper left", ncols=len(said), fontsize=9)


def _correlation(motions: Sequence[Motion], other: Sequence[np.ndarray]) -> float:
    """Return the correlation with the encoders' difference, less each motion's mean."""
    apart = np.concatenate([m.apart for m in motions])
    beside = np.concatenate([x - x.mean() for x in other])
    size = np.linalg.norm(apart) * np.linalg.norm(beside)
    return float(apart @ beside / size) if size > 0.0 else 0.0


def _with_torque(axes: Sequence[Axis]) -> bool:
    return any(_read(m) for a in axes for m in (*a.fitted, a.judged))


def _read(motion: Motion) -> bool:
    torque = motion.torque
    return motion.measured and torque is not None and bool(np.ptp(torque) > 0.0)
