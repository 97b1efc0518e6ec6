"""Few pictures say most: axes, the law that was named, poses kept back, bodies."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bench.proof import Proof
from bench.proving.channels import Channel
from bench.proving.gauge import residual_of
from bench.proving.trials import squares
from scenarios.diagnosing.finding import MICRO, Curves
from scenarios.reporting.style import BLUE, GREY, ORANGE, save

ACROSS = 3
MOST_POINTS = 4000


def of_axes(curves: Curves, named: frozenset[str], file: Path) -> None:
    """Draw what each axis turns beyond the nominal arm against its torque.

    Args:
        curves: Of all axes.
        named: Axes to which something was ascribed.
        file: Where the picture goes.
    """
    count = len(curves.axes)
    down = -(-count // ACROSS)
    figure = Figure(figsize=(10.5, 2.9 * down), layout="constrained")
    axes = np.atleast_1d(
        figure.subplots(down, min(ACROSS, count), squeeze=False)
    ).ravel()
    rows = np.arange(len(curves.torque))
    if len(rows) > MOST_POINTS:
        rows = rows[:: -(-len(rows) // MOST_POINTS)]
    limit = _limit(curves)
    for k, name in enumerate(curves.axes):
        _one(axes[k], curves, k, rows, name in named, limit[k])
    for empty in axes[count:]:
        empty.set_visible(False)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(labels), markerscale=3
    )
    save(figure, file)


def of_poses(channel: Channel, unit: str, file: Path) -> None:
    """Draw before and after of every pose kept back, the worst first."""
    order = np.argsort(-channel.before_of)
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    axes = figure.subplots()
    at = np.arange(len(order))
    before, after = MICRO * channel.before_of[order], MICRO * channel.after_of[order]
    axes.vlines(at, after, before, color="#d8d8d8", lw=2.5, zorder=1)
    axes.plot(at, before, "o", color=GREY, ms=6, label="nominal arm, fitted")
    axes.plot(at, after, "o", color=ORANGE, ms=6, label="with the patch")
    axes.axhline(
        MICRO * channel.noise, color=BLUE, lw=1.2, ls="--", label="stated noise"
    )
    axes.set_xticks(at, [str(p) for p in channel.pose[order]], fontsize=7)
    axes.set_xlabel("pose kept back")
    axes.set_ylabel(f"rms error [{unit}]")
    axes.set_ylim(bottom=0)
    axes.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=3)
    save(figure, file)


def of_bodies(simulated: Proof, proved: bool, file: Path) -> None:
    """Draw the error by body, before and after."""
    before, after = by_body(simulated)
    figure = Figure(figsize=(10.5, 2.8), layout="constrained")
    axes = figure.subplots()
    at = np.arange(len(before))
    wide = 0.38 if proved else 0.6
    axes.bar(
        at - 0.2 * proved,
        [MICRO * v for v in before.values()],
        wide,
        color=GREY,
        label="nominal arm, fitted",
    )
    if proved:
        axes.bar(
            at + 0.2,
            [MICRO * v for v in after.values()],
            wide,
            color=ORANGE,
            label="with the patch",
        )
    axes.set_xticks(at, list(before))
    axes.set_ylabel("rms error [µm]")
    axes.grid(visible=False, axis="x")
    figure.legend(loc="outside upper center", ncols=2)
    save(figure, file)


def by_body(simulated: Proof) -> tuple[dict[str, float], dict[str, float]]:
    """Return the rms of each body's marks over all rows, before and after, in m."""
    world, gauge = simulated.world, simulated.gauge
    found = []
    names = [marker.body for marker in world.recording.markers]
    for assumed in (simulated.nominal, simulated.patched):
        left = residual_of(world, world.see(assumed), gauge)
        square = squares(world, left)[0]
        found.append(
            {
                body: float(np.sqrt(np.nanmean(square[:, [n == body for n in names]])))
                for body in dict.fromkeys(names)
            }
        )
    return found[0], found[1]


def _one(
    axes: Axes, curves: Curves, k: int, rows: np.ndarray, named: bool, limit: float
) -> None:
    unit, torque = ("µm", "force [N]") if curves.slides[k] else ("µrad", "torque [N m]")
    axes.plot(
        curves.torque[rows, k],
        MICRO * curves.before[rows, k],
        ".",
        color=GREY,
        ms=2.5,
        alpha=0.45,
        label="measured, beyond the nominal arm",
        rasterized=True,
    )
    axes.plot(
        curves.torque[rows, k],
        MICRO * curves.law[rows, k],
        ".",
        color=ORANGE,
        ms=2.5 if named else 1.2,
        alpha=0.9 if named else 0.35,
        label="patch, simulated",
        rasterized=True,
    )
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


def _limit(curves: Curves) -> np.ndarray:
    """Return the half height of each axis' plot: all but stray points."""
    stray = np.quantile(np.abs(curves.before), 0.995, axis=0)
    law = np.max(np.abs(curves.law), axis=0)
    return 1.15 * MICRO * np.maximum(np.maximum(stray, law), 1e-7)
