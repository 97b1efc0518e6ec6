"""Tables 8 and 9, Figs 6 and 7: which layers are fine-tuned, which epoch is kept."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture

from bench.shared.settings import Interval
from scenarios.report import data_files, figures
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table
from scenarios.studies.paper import TABLE_09_MM
from scenarios.studies.paper.budget import PLANS, Budget
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.comparison import MEASURES, overall, perceptrons, pooled
from scenarios.studies.paper.transfer import ALL_LAYERS, UNFREEZINGS, unfrozen
from stiffness.methods.score import DIRECTIONS
from stiffness.networks.transfer import FineTuning, hold_back

# --- Table 8 and Fig. 6: layers -------------------------------------------------------


def figure_06(names: Sequence[str], results: Sequence[CellResult], file: Path) -> None:
    """Draw errors on learnt and on fresh poses for each unfreezing."""
    picture = Picture(figsize=(9, 3.6), layout="constrained")
    axes = picture.subplots()
    place = np.arange(len(names))
    learnt = [np.mean([r[f"{n}/learnt"][0, 0] for r in results]) for n in names]
    draws = [overall(results, n).interval for n in names]
    fresh = np.array([[d.estimate, d.low, d.high] for d in draws]).T
    axes.bar(
        place - 0.2, learnt, 0.38, color=figures.GREY, label="poses it learnt from"
    )
    axes.bar(place + 0.2, fresh[0], 0.38, color=figures.ORANGE, label="fresh poses")
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
    figures.save(picture, file)


SHOWN_PLAN = "spanning"


def layers_report(
    budget: Budget, found: Mapping[Cell, CellResult], out: Path
) -> Sequence[Block]:
    """Write table and figure into a folder and return the section of the report."""
    names = [unfrozen(layers) for layers in (*UNFREEZINGS, ALL_LAYERS)]
    some = [
        r for r in perceptrons(budget, found, SHOWN_PLAN) if f"{names[0]}/unseen" in r
    ]
    seeds = budget.transfer.seeds[: len(some)]
    data_files.write_table(out / "table_08.csv", _table_08(names, some, seeds))
    figure_06(names, some, out / "figure_06.png")
    return [
        Heading("Which layers are corrected"),
        Paragraph(
            "The network pre-trained on the spanning plan is corrected by the training "
            "poses: one layer, two neighbours or all; layer 5 is the output layer. The "
            "paper judges the fit to the data that was learnt, finds that two layers "
            "fit much better than one, and corrects 1 and 2; here poses nobody has "
            "seen stand beside it. The paper's rate of 0.03 is replaced by "
            f"{FineTuning().rate:g} falling to zero over "
            f"{budget.transfer.unfreezing_epochs} epochs, with a pull towards the "
            "pre-trained weights."
        ),
        _shown_08(names, some, seeds, budget),
        Figure(_finding(names, some), "figure_06.png"),
    ]


def _finding(names: Sequence[str], results: Sequence[CellResult]) -> str:
    """Return the gain of two layers over one, and the choices equal to the best."""
    draws = {name: overall(results, name) for name in names}
    learnt = {
        n: float(np.mean([r[f"{n}/learnt"][0, 0] for r in results])) for n in names
    }
    one, two = (
        [unfrozen(u) for u in UNFREEZINGS if len(u) == count] for count in (1, 2)
    )
    alone, pair = (min(n, key=lambda name: learnt[name]) for n in (one, two))
    best = min(names, key=lambda name: draws[name].value)
    alike = [
        _layers(name)
        for name in names
        if name != best and draws[name].change_from(draws[best]).interval.low <= 0.0
    ]
    as_good = ", ".join(alike) if alike else "none"
    return (
        "Correcting layers (the paper's Fig. 6). On poses that were learnt the best "
        f"pair ({_layers(pair)}) leaves {learnt[pair]:.4f} mm, the best single layer "
        f"({_layers(alone)}) {learnt[alone]:.4f} mm; on fresh poses {_layers(best)} "
        f"leaves least, {draws[best].value:.4f} mm. As good as that by the 95 % "
        f"interval of the difference: {as_good}. Bars: 95 % intervals."
    )


def _layers(name: str) -> str:
    return name.removeprefix("unfrozen ")


def _table_08(
    names: Sequence[str], results: Sequence[CellResult], seeds: Sequence[int]
) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for name in names:
        for k, direction in enumerate(DIRECTIONS):
            error = np.stack([r[f"{name}/unseen"][:, k] for r in results])
            for metric in MEASURES:
                rows.append(
                    {
                        "unfrozen": _layers(name),
                        "direction": direction,
                        "metric": metric,
                        **pooled(error, MEASURES[metric]).row,
                        "paper_mm": None,
                        "n": error.shape[1],
                        "seeds": " ".join(map(str, seeds)),
                        "plan": SHOWN_PLAN,
                    }
                )
    return rows


def _shown_08(
    names: Sequence[str],
    results: Sequence[CellResult],
    seeds: Sequence[int],
    budget: Budget,
) -> Table:
    rows = []
    for name in names:
        learnt = np.mean([r[f"{name}/learnt"] for r in results], axis=0)
        i = overall(results, name).interval
        ends = f"{i.low:.4f} to {i.high:.4f}"
        numbers = (f"{x:.4f}" for x in (*learnt[0, :2], i.estimate))
        rows.append((_layers(name), *numbers, ends))
    n = results[0][f"{names[0]}/unseen"].shape[0]
    which = ", ".join(map(str, seeds))
    return Table(
        f"Table 8. Unfrozen layers, {budget.transfer.unfreezing_epochs} epochs, seeds: "
        f"{which}; {n} fresh poses [mm], over all directions. The paper's own numbers "
        "are of learnt poses alone and not beside these.",
        ("layers", "learnt MAE", "STDE", "fresh MAE", "95 % interval"),
        rows,
    )


# --- Table 9 and Fig. 7: epochs -------------------------------------------------------


def figure_07(result: CellResult, file: Path) -> None:
    """Draw training and validation error over the epochs, and the one that is kept."""
    picture = Picture(figsize=(6.5, 3.6), layout="constrained")
    axes = picture.subplots()
    training, validation = result["best/curve"]
    epoch = np.arange(1, len(training) + 1)
    kept = int(result["best/epoch"])
    axes.plot(epoch, training, color=figures.GREY, label="poses it learns from")
    axes.plot(epoch, validation, color=figures.ORANGE, label="poses held back")
    axes.plot(kept, validation[kept - 1], "o", color="black", label=f"kept: {kept}")
    axes.set_xlabel("epoch")
    axes.set_ylabel("MAE over all directions [mm]")
    axes.set_ylim(bottom=0.0)
    axes.legend()
    figures.save(picture, file)


ROWS = ("training", "validation", "fresh poses")
METRICS = ("MAE", "STDE_absolute")
KEPT = {"last": "last epoch (normal)", "best": "best epoch"}
OVER_POSES, OVER_SEEDS = "95 %, poses and seeds", "least and most, seeds"


def epochs_report(
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
        for m, metric in enumerate(METRICS):
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
                        "value_mm": interval.estimate,
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
            for metric in METRICS:
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
