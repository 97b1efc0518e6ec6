"""Before and after, the uneven gears, and what is left where."""

from pathlib import Path

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from scenarios.calibrating.proof import Proof, rms
from scenarios.reporting.style import BLUE, GREY, ORANGE, plain_log, save
from stiffness.calibration.calibrated import Calibrated
from stiffness.calibration.stance import Stance

MM = 1e3
NAMES = ("as drawn", "as calibrated")


def before_after(found: Calibrated, proof: Proof, file: Path) -> None:
    """Draw where the poses kept back stand and how far off the simulator is there."""
    at = Stance.of(found.readings, found.drawn).point[found.held]
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
    save(figure, file)


def gears(found: Calibrated, file: Path) -> None:
    """Draw each uneven gear over the angles that were fitted, and the readings."""
    count = len(found.tables)
    figure = Figure(figsize=(11, 1.9 * count), layout="constrained")
    plots = figure.subplots(count, 1, squeeze=False)[:, 0]
    keep = ~found.held
    lever = Stance.of(found.readings, found.drawn).lever[:, keep]
    posture, left = found.readings.posture[keep], found.residual[keep]
    for ax, (axis, table) in zip(plots, sorted(found.tables.items()), strict=True):
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


def residual_map(found: Calibrated, proof: Proof, new: np.ndarray, file: Path) -> None:
    """Draw what is left over place, angles and time."""
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
    things = [(np.degrees(posture[:, k]), f"a{k + 1} [°]") for k in axes]
    for ax, (x, label) in zip(plots, [*things, (hours, "time [h]")], strict=False):
        ax.plot(x[~new], size[~new], ".", color=GREY, ms=2, rasterized=True)
        ax.plot(x[new], size[new], ".", color=ORANGE, ms=2, rasterized=True)
        ax.set(xlabel=label, ylim=(0, top))
    for ax in plots[::columns]:
        ax.set_ylabel("left [mm]")
    figure.suptitle(
        f"{MM * rms(proof.after):.3f} mm rms on poses kept back; orange: at an angle "
        "that no fitted pose had",
        size=10,
    )
    save(figure, file)
