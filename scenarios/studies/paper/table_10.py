"""Table 10, Figs 8 and 9: the methods side by side on poses that none has seen."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from scenarios.report import data_files, figures
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table
from scenarios.studies.paper import TABLE_10_MM
from scenarios.studies.paper.budget import said_seeds
from scenarios.studies.paper.comparison import (
    MEASURES,
    Contender,
    best_method_rows,
    best_method_table,
    finding,
    gain_rows,
    gains_table,
    verdict,
)
from stiffness.methods.score import DIRECTIONS

# --- Figures --------------------------------------------------------------------------

COLOURS = (figures.GREY, figures.BLUE, figures.ORANGE, figures.GREEN, figures.RED)


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
        figures.plain_log(axes.xaxis)
        axes.set_xlabel(f"error in {DIRECTIONS[k].upper()} at most [mm]")
        axes.set_ylabel("share of fresh poses [%]" if k == 0 else "")
    handles = picture.axes[0].get_lines()
    picture.legend(handles=handles, loc="outside upper center", ncols=len(contenders))
    figures.save(picture, file)


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
            value = np.array([interval.estimate for interval in all_three])
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
    figures.save(picture, file)


# --- Table ----------------------------------------------------------------------------

NEAR_MM = 0.1
"""Error below which a caption counts poses, in mm; chosen: about the springs' STDE."""
PUBLISHED = {"MAE": "MAE", "STDE_signed": "STDE", "ME": "ME"}


def report(
    contenders: Sequence[Contender], seeds: Sequence[int], budget: str, out: Path
) -> Sequence[Block]:
    """Write tables and figures into a folder and return the section of the report."""
    springs = contenders[0]
    tuned = [c for c in contenders if c.method == "ft_mlp"]
    data_files.write_table(out / "table_10.csv", _tidy(contenders))
    changes = [row for c in contenders[1:] for row in gain_rows(c, springs)]
    data_files.write_table(out / "table_10_changes.csv", changes)
    data_files.write_table(out / "table_10_named.csv", best_method_rows(contenders))
    paper_three = [c for c in contenders if c.method in TABLE_10_MM]
    figure_08(paper_three, out / "figure_08.png")
    figure_09([springs, *tuned], out / "figure_09.png")
    n, held = springs.unseen.shape[1], springs.held_out.shape[1]
    return [
        Heading("The methods side by side"),
        Paragraph(
            f"Every method learns from 80 % of the experiment's poses and is judged on "
            f"{n} fresh postures of the same region, simulated with the same truth and "
            "silent instruments, each under its full load for the first time: what "
            "would be right is known there without noise. Split, weights and order of "
            f"rows follow from the seed; seeds: {', '.join(map(str, seeds))}. "
            "Intervals (95 %) draw poses and seeds anew. The csv also has the errors "
            f"on the {held} measured poses a seed that were held out, the paper's way, "
            "whose readings carry the instruments' noise (the floor of Table 2)."
        ),
        _table_10(contenders, n, len(seeds), budget),
        best_method_table(contenders),
        gains_table(tuned, springs),
        Paragraph(verdict(tuned, springs)),
        Figure(finding(tuned, springs), "figure_09.png"),
        Figure(
            "How many of the fresh poses stay below an error, for the paper's three "
            f"methods (its Figs 8 and 9 in one). {_below(paper_three)}",
            "figure_08.png",
        ),
    ]


def _below(contenders: Sequence[Contender]) -> str:
    """Return in how many poses each method's error is below `NEAR_MM` everywhere."""
    near = [
        f"{c.name} {100 * np.mean(np.abs(c.unseen).max(axis=2) < NEAR_MM):.0f} %"
        for c in contenders
    ]
    return f"Below {NEAR_MM} mm in every direction stay: {', '.join(near)}."


def _tidy(contenders: Sequence[Contender]) -> list[dict]:
    rows = []
    for c in contenders:
        for k, direction in enumerate(DIRECTIONS):
            for metric in MEASURES:
                paper = TABLE_10_MM.get(c.method, {}).get(direction, {})
                for judged, draws, n in (
                    ("fresh poses", c.draws(k, metric), c.unseen.shape[1]),
                    ("held out", c.held_out_draws(k, metric), c.held_out[:, :, 0].size),
                ):
                    rows.append(
                        {
                            "method": c.method,
                            "direction": direction,
                            "metric": metric,
                            **draws.row,
                            "paper_mm": paper.get(PUBLISHED.get(metric, "")),
                            "n": n,
                            "seeds": " ".join(map(str, c.seeds)),
                            "plan": c.plan,
                            "judged_on": judged,
                        }
                    )
    return rows


def _table_10(
    contenders: Sequence[Contender], n: int, seeds: int, budget: str
) -> Table:
    rows = []
    for c in contenders:
        for k, direction in enumerate(DIRECTIONS):
            line = [c.name if k == 0 else "", direction.upper()]
            paper = TABLE_10_MM.get(c.method, {}).get(direction, {})
            for metric in ("MAE", "STDE_signed", "ME", "P99"):
                i = c.draws(k, metric).interval
                published = paper.get(PUBLISHED.get(metric, ""))
                ends = "" if metric == "ME" else f" ({i.low:.3f} to {i.high:.3f})"
                line.append(f"{i.estimate:.3f}{ends}")
                if metric != "P99":
                    line.append("" if published is None else f"{published:.3f}")
            rows.append(line)
    return Table(
        f"Table 10. Errors on {n} fresh poses, {said_seeds(seeds)} [mm], budget "
        f"{budget}; in brackets 95 % intervals, beside them the paper's numbers; "
        "STDE is of signed errors.",
        ("method", "", "MAE", "paper", "STDE", "paper", "ME", "paper", "99 %"),
        rows,
    )
