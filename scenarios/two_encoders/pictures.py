"""What goes apart between two encoders is drawn over time, torque and speed."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from scenarios.reporting.style import GREY, ORANGE, save
from scenarios.two_encoders.axis import Axis, whole_rms
from stiffness.two_encoders.motions import Motion

URAD = 1e6


def before_after(axes: Sequence[Axis], file: Path) -> None:
    """Draw what a rigid gear leaves of the judged motion, and what the patch does."""
    figure = Drawing(figsize=(11, 2.1 * len(axes)), layout="constrained")
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
    save(figure, file)


def looks_like(axes: Sequence[Axis], file: Path) -> None:
    """Draw what goes apart over the motor's torque, where it was read, and speed."""
    figure = Drawing(figsize=(11, 2.6 * len(axes)), layout="constrained")
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
    """Say what the picture shows, and how closely the difference follows it."""
    told = []
    for a in axes:
        motions = (*a.fitted, a.judged)
        speed = f"speed {_alike(motions, [m.speed for m in motions]):+.2f}"
        torque = [m.torque for m in motions if m.torque is not None and _read(m)]
        if len(torque) == len(motions):
            speed = f"torque {_alike(motions, torque):+.2f}, {speed}"
        told.append(f"{a.name}: {speed}")
    over = "over the motor's torque (left) and speed (right)"
    if not _with_torque(axes):
        over = "over speed"
    return (
        f"The second encoder less the first {over}, judged motion in orange. "
        f"Correlation with {'; '.join(told)}."
    )


def _legend(figure: Drawing, drawn: Sequence[Line2D], said: Sequence[str]) -> None:
    figure.legend(drawn, said, loc="outside upper left", ncols=len(said), fontsize=9)


def _alike(motions: Sequence[Motion], other: Sequence[np.ndarray]) -> float:
    """Return the correlation with what goes apart, each motion's mean taken off."""
    apart = np.concatenate([m.apart for m in motions])
    beside = np.concatenate([x - x.mean() for x in other])
    size = np.linalg.norm(apart) * np.linalg.norm(beside)
    return float(apart @ beside / size) if size > 0.0 else 0.0


def _with_torque(axes: Sequence[Axis]) -> bool:
    return any(_read(m) for a in axes for m in (*a.fitted, a.judged))


def _read(motion: Motion) -> bool:
    torque = motion.torque
    return motion.measured and torque is not None and bool(np.ptp(torque) > 0.0)
