"""Table 10, Figs 8 and 9: the methods side by side on poses that none has seen."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from scenarios.paper.numbers import TABLE_10_MM
from scenarios.paper.transfer import pictures
from scenarios.paper.transfer.comparison import Contender
from scenarios.paper.transfer.gains import finding, gain_rows, gains, verdict
from scenarios.paper.transfer.pooled import MEASURES
from scenarios.reporting import table
from scenarios.reporting.page import Block, Figure, Heading, Paragraph, Table
from stiffness.score import DIRECTIONS

NEAR_MM = 0.1
"""Error at which a caption counts; chosen: about the springs' standard deviation."""
PUBLISHED = {"MAE": "MAE", "STDE_signed": "STDE", "ME": "ME"}


def report(
    contenders: Sequence[Contender], seeds: Sequence[int], budget: str, out: Path
) -> Sequence[Block]:
    """Write tables and figures into a folder and return the section of the report."""
    springs = contenders[0]
    tuned = [c for c in contenders if c.method == "ft_mlp"]
    table.write(out / "table_10.csv", _tidy(contenders))
    changes = [row for c in contenders[1:] for row in gain_rows(c, springs)]
    table.write(out / "table_10_changes.csv", changes)
    paper_three = [c for c in contenders if c.method in TABLE_10_MM]
    pictures.figure_08(paper_three, out / "figure_08.png")
    pictures.figure_09([springs, *tuned], out / "figure_09.png")
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
        gains(tuned, springs),
        Paragraph(verdict(tuned, springs)),
        Figure(finding(tuned, springs), "figure_09.png"),
        Figure(
            "How many of the fresh poses stay below an error, for the paper's three "
            f"methods (its Figs 8 and 9 in one). {_below(paper_three)}",
            "figure_08.png",
        ),
    ]


def _below(contenders: Sequence[Contender]) -> str:
    """Say in how many poses each method stays near in every direction."""
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
                    interval = draws.interval
                    rows.append(
                        {
                            "method": c.method,
                            "direction": direction,
                            "metric": metric,
                            "value_mm": interval.value,
                            "low_mm": interval.low,
                            "high_mm": interval.high,
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
                line.append(f"{i.value:.3f}{ends}")
                if metric != "P99":
                    line.append("" if published is None else f"{published:.3f}")
            rows.append(line)
    count = "one seed" if seeds == 1 else f"{seeds} seeds"
    return Table(
        f"Table 10. Errors on {n} fresh poses, {count} [mm], budget {budget}; in "
        "brackets 95 % intervals, beside them the paper's numbers; STDE is of signed "
        "errors.",
        ("method", "", "MAE", "paper", "STDE", "paper", "ME", "paper", "99 %"),
        rows,
    )
