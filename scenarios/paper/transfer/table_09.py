"""Table 9 and Fig. 7: which epoch of the fine-tuning is kept."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from scenarios.paper.budget import PLANS, Budget
from scenarios.paper.imitation.rows import said_range
from scenarios.paper.numbers import TABLE_09_MM
from scenarios.paper.transfer import pictures
from scenarios.paper.transfer.comparison import perceptrons
from scenarios.paper.work.cells import Cell, Result
from scenarios.reporting import table
from scenarios.reporting.page import Block, Figure, Heading, Paragraph, Table

ROWS = ("training", "validation")
KEPT = {"last": "normal: the last epoch", "best": "best on the validation poses"}


def report(budget: Budget, found: Mapping[Cell, Result], out: Path) -> Sequence[Block]:
    """Write table and figure into a folder and return the section of the report."""
    rows = [
        row
        for plan in PLANS
        for row in _table_09(
            perceptrons(budget, found, plan), plan, budget.transfer.seeds
        )
    ]
    table.write(out / "table_09.csv", rows)
    shown = perceptrons(budget, found, "spanning")[0]
    pictures.figure_07(shown, out / "figure_07.png")
    return [
        Heading("Which epoch is kept"),
        Paragraph(
            "A fifth of the poses that may be learnt from is held back; the paper "
            "keeps the epoch that is best on them, not the last, and judges on the "
            "same poses. Those poses flatter the epoch they chose, so fresh ones stand "
            f"beside them. {budget.transfer.epochs} epochs, rate falling to zero: with "
            "it the last epoch is already a quiet one, and there is less to gain than "
            "at the paper's constant rate of 0.03."
        ),
        _shown_09(rows),
        Figure(
            "Fine-tuning on its way (the paper's Fig. 7): the running mean of the "
            "weights is judged on the poses held back; epoch "
            f"{int(shown['best/epoch'])} of {budget.transfer.epochs} is kept.",
            "figure_07.png",
        ),
    ]


def _table_09(
    results: Sequence[Result], plan: str, seeds: Sequence[int]
) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for kept in KEPT:
        learnt = np.array([r[f"{kept}/learnt"] for r in results])
        fresh = np.array(
            [
                [e.mean(), e.std()]
                for e in (np.abs(r[f"{kept}/unseen"]) for r in results)
            ]
        )
        for m, metric in enumerate(("MAE", "STDE_absolute")):
            judged = {**{r: learnt[:, i, m] for i, r in enumerate(ROWS)}}
            judged["fresh poses"] = fresh[:, m]
            for on, value in judged.items():
                paper = TABLE_09_MM[kept]
                rows.append(
                    {
                        "kept": kept,
                        "rows": on,
                        "metric": metric,
                        "value_mm": float(value.mean()),
                        "low_mm": float(value.min()),
                        "high_mm": float(value.max()),
                        "paper_mm": paper[ROWS.index(on)][m] if on in ROWS else None,
                        "seeds": " ".join(map(str, seeds)),
                        "plan": plan,
                    }
                )
    return rows


def _shown_09(rows: Sequence[dict[str, object]]) -> Table:
    shown = []
    for r in rows:
        paper = r["paper_mm"]
        shown.append(
            (
                KEPT[str(r["kept"])],
                str(r["plan"]),
                str(r["rows"]),
                str(r["metric"]).removesuffix("_absolute"),
                f"{r['value_mm']:.4f}",
                said_range(
                    float(str(r["low_mm"])),
                    float(str(r["high_mm"])),
                    len(str(r["seeds"]).split()),
                ),
                "" if paper is None else f"{paper:.4f}",
            )
        )
    return Table(
        "Table 9. Normal training against the paper's [mm], over all directions; STDE "
        "of absolute errors. The poses that chose the epoch flatter it.",
        ("kept", "plan", "judged on", "measure", "ours", "over seeds", "paper"),
        shown,
    )
