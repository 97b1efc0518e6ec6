"""Figs 6 to 9 of the paper: layers, epochs, methods side by side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from scenarios.paper.transfer.comparison import Contender
from scenarios.paper.transfer.pooled import MEASURES, pooled
from scenarios.paper.work.cells import Result
from scenarios.reporting import style
from stiffness.score import DIRECTIONS

COLOURS = (style.GREY, style.BLUE, style.ORANGE, style.GREEN, style.RED)


def figure_06(names: Sequence[str], results: Sequence[Result], file: Path) -> None:
    """Draw errors on learnt and on fresh poses for each unfreezing."""
    picture = Picture(figsize=(9, 3.6), layout="constrained")
    axes = picture.subplots()
    place = np.arange(len(names))
    learnt = [np.mean([r[f"{n}/learnt"][0, 0] for r in results]) for n in names]
    draws = [
        pooled(
            np.stack([np.abs(r[f"{n}/unseen"]).mean(axis=1) for r in results]),
            MEASURES["MAE"],
        ).interval
        for n in names
    ]
    fresh = np.array([[d.value, d.low, d.high] for d in draws]).T
    axes.bar(place - 0.2, learnt, 0.38, color=style.GREY, label="poses it learnt from")
    axes.bar(place + 0.2, fresh[0], 0.38, color=style.ORANGE, label="fresh poses")
    axes.errorbar(
        place + 0.2,
        fresh[0],
        (fresh[0] - fresh[1], fresh[2] - fresh[0]),
        fmt="none",
        ecolor="black",
        capsize=2,
    )
    labels = [name.removeprefix("unfrozen ") for name in names]
    axes.set_xticks(place, ["all" if n == "1+2+3+4+5" else n for n in labels])
    axes.set_xlabel("layers that are corrected (5 = output layer)")
    axes.set_ylabel("MAE over all directions [mm]")
    axes.set_ylim(top=1.25 * fresh[2].max())
    axes.grid(visible=False, axis="x")
    axes.legend(ncols=2, loc="upper right")
    style.save(picture, file)


def figure_07(result: Result, file: Path) -> None:
    """Draw training and validation error over the epochs, and the one that is kept."""
    picture = Picture(figsize=(6.5, 3.6), layout="constrained")
    axes = picture.subplots()
    training, validation = result["best/curve"]
    epoch = np.arange(1, len(training) + 1)
    kept = int(result["best/epoch"])
    axes.plot(epoch, training, color=style.GREY, label="poses it learns from")
    axes.plot(epoch, validation, color=style.ORANGE, label="poses held back")
    axes.plot(kept, validation[kept - 1], "o", color="black", label=f"kept: {kept}")
    axes.set_xlabel("epoch")
    axes.set_ylabel("MAE over all directions [mm]")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    style.save(picture, file)


def figure_08(contenders: Sequence[Contender], file: Path) -> None:
    """Draw how the signed errors of the paper's methods are distributed."""
    picture = Picture(figsize=(11, 4.2), layout="constrained")
    for k, axes in enumerate(picture.subplots(1, 3, sharex=True, sharey=True)):
        for colour, c in zip(COLOURS, contenders, strict=False):
            size = np.sort(np.abs(c.unseen[:, :, k]).ravel())
            share = 100.0 * (np.arange(len(size)) + 1) / len(size)
            axes.plot(size, share, color=colour, label=c.name)
        axes.set_xscale("log")
        axes.set_xlim(left=1e-3)
        style.plain_log(axes.xaxis)
        axes.set_xlabel(f"error in {DIRECTIONS[k].upper()} at most [mm]")
        axes.set_ylabel("share of fresh poses [%]" if k == 0 else "")
    handles = picture.axes[0].get_lines()
    picture.legend(handles=handles, loc="outside upper center", ncols=len(contenders))
    style.save(picture, file)


def figure_09(contenders: Sequence[Contender], file: Path) -> None:
    """Draw MAE, STDE and 99th percentile of VJM and FT-MLP in each direction."""
    picture = Picture(figsize=(11, 3.9), layout="constrained")
    width = 0.8 / len(contenders)
    for axes, (measure, title) in zip(
        picture.subplots(1, 3),
        (("MAE", "MAE"), ("STDE_signed", "STDE, signed"), ("P99", "99th percentile")),
        strict=True,
    ):
        for i, c in enumerate(contenders):
            place = np.arange(3) + (i - (len(contenders) - 1) / 2) * width
            all_three = [c.draws(k, measure).interval for k in range(3)]
            value = np.array([interval.value for interval in all_three])
            low = value - [interval.low for interval in all_three]
            high = [interval.high for interval in all_three] - value
            axes.bar(place, value, 0.92 * width, color=COLOURS[i], label=c.name)
            axes.errorbar(
                place, value, (low, high), fmt="none", ecolor="black", capsize=2
            )
        axes.set_xticks(np.arange(3), [d.upper() for d in DIRECTIONS])
        axes.set_ylabel(f"{title} [mm]")
        axes.grid(visible=False, axis="x")
    handles, labels = picture.axes[0].get_legend_handles_labels()
    picture.legend(handles, labels, loc="outside upper center", ncols=len(contenders))
    style.save(picture, file)
