"""Table 9 and Fig. 7: which epoch of the fine-tuning is kept."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture

from scenarios.report import data_files, style
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table
from scenarios.studies.paper.budget import PLANS, Budget
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.comparison import perceptrons, pooled
from scenarios.studies.paper.published_values import TABLE_09_MM
from stiffness.networks.transfer import FineTuning, hold_back
from stiffness.regression.intervals import Interval

# --- Figures --------------------------------------------------------------------------


def figure_07(result: CellResult, file: Path) -> None:
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


# --- Table ----------------------------------------------------------------------------

ROWS = ("training", "validation", "fresh poses")
MEASURES = ("MAE", "STDE_absolute")
KEPT = {"last": "last epoch (normal)", "best": "best epoch"}
OVER_POSES, OVER_SEEDS = "95 %, poses and seeds", "least and most, seeds"


def report(
    budget: Budget, found: Mapping[Cell, CellResult], out: Path
) -> Sequence[Block]:
    """Write table and figure into a folder and return the section of the report."""
    seeds = budget.transfer.seeds
    by_plan = {plan: perceptrons(budget, found, plan) for plan in PLANS}
    rows = [row for plan in PLANS for row in _table_09(by_plan[plan], plan, seeds)]
    data_files.write_table(out / "table_09.csv", rows)
    shown, epochs = by_plan["spanning"][0], budget.transfer.epochs
    figure_07(shown, out / "figure_07.png")
    learnt = _learnt_from(shown)
    last = sum(
        int(r["best/epoch"]) == epochs for results in by_plan.values() for r in results
    )
    return [
        Heading("Which epoch is kept"),
        Paragraph(
            f"Of the {learnt} poses that may be learnt from "
            f"{100 * FineTuning().validation:.0f} % are held back; the paper keeps the "
            "epoch that is best on them, not the last, and judges on the same poses. "
            "Those poses flatter the epoch they chose, so fresh ones stand beside "
            f"them. {epochs} epochs, rate falling to zero, where the paper's stays at "
            f"0.03. The best epoch was the last one in {last} of "
            f"{len(PLANS) * len(seeds)} trainings; there both rows are the same."
        ),
        _shown_09(rows, seeds),
        Figure(
            "Fine-tuning on its way (the paper's Fig. 7), spanning plan, seed "
            f"{seeds[0]}: the running mean of the weights is judged on the poses held "
            f"back; epoch {int(shown['best/epoch'])} of {epochs} is kept.",
            "figure_07.png",
        ),
    ]


def _learnt_from(result: CellResult) -> int:
    return len(result["best/experiment"]) - len(result["best/held_out"])


def _table_09(
    results: Sequence[CellResult], plan: str, seeds: Sequence[int]
) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    poses = np.arange(_learnt_from(results[0]))
    back = len(hold_back(poses, FineTuning().validation, 0))
    for kept in KEPT:
        learnt = np.array([r[f"{kept}/learnt"] for r in results])
        fresh = np.abs([r[f"{kept}/unseen"] for r in results])
        n = (len(poses) - back, back, fresh.shape[1])
        for m, metric in enumerate(MEASURES):
            for i, on in enumerate(ROWS):
                if on == "fresh poses":
                    interval = pooled(fresh, (_mean, _stde)[m]).interval
                else:
                    value = learnt[:, i, m]
                    interval = Interval(*map(float, _range(value)))
                paper = TABLE_09_MM[kept]
                rows.append(
                    {
                        "kept": kept,
                        "rows": on,
                        "metric": metric,
                        "value_mm": interval.value,
                        "low_mm": interval.low,
                        "high_mm": interval.high,
                        "interval": OVER_POSES if on == "fresh poses" else OVER_SEEDS,
                        "paper_mm": paper[i][m] if i < len(paper) else None,
                        "n": n[i],
                        "seeds": " ".join(map(str, seeds)),
                        "plan": plan,
                    }
                )
    return rows


def _range(value: Float[np.ndarray, " seeds"]) -> tuple[float, float, float]:
    return value.mean(), value.min(), value.max()


def _mean(error: np.ndarray, weight: np.ndarray) -> np.ndarray:
    return weight @ error.mean(axis=1) / weight.sum(axis=-1)


def _stde(error: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return Eq. 8 over all directions: standard deviation of absolute errors."""
    square = weight @ (error**2).mean(axis=1) / weight.sum(axis=-1)
    return np.sqrt(square - _mean(error, weight) ** 2)


def _shown_09(rows: Sequence[dict], seeds: Sequence[int]) -> Table:
    by_name = {(r["plan"], r["rows"], r["metric"], r["kept"]): r for r in rows}
    shown = []
    for plan in PLANS:
        for on in ROWS:
            for metric in MEASURES:
                line = [plan, on, metric.removesuffix("_absolute")]
                for kept in KEPT:
                    r = by_name[plan, on, metric, kept]
                    one = r["interval"] == OVER_SEEDS and len(seeds) == 1
                    ends = f" ({r['low_mm']:.4f} to {r['high_mm']:.4f})" * (not one)
                    paper = r["paper_mm"]
                    line.append(f"{r['value_mm']:.4f}{ends}")
                    line.append("" if paper is None else f"{paper:.4f}")
                shown.append(line)
    n = {r["rows"]: r["n"] for r in rows}
    several = len(seeds) > 1
    return Table(
        f"Table 9. Normal training against the paper's [mm], over all directions, "
        f"seeds: {', '.join(map(str, seeds))}; STDE of absolute errors; "
        f"{n['training']} training, {n['validation']} validation, {n['fresh poses']} "
        "fresh poses; in brackets 95 % intervals over the fresh ones"
        + (", on the others least and most over the seeds." if several else "."),
        ("plan", "judged on", "", *(t for k in KEPT.values() for t in (k, "paper"))),
        shown,
    )
