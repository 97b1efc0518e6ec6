"""Table 8 and Fig. 6: which layers of the network are fine-tuned."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Picture

from scenarios.report import data_files, style
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table
from scenarios.studies.paper.budget import Budget
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.comparison import MEASURES, Draws, perceptrons, pooled
from scenarios.studies.paper.transfer import ALL_LAYERS, UNFREEZINGS, unfrozen
from stiffness.methods.score import DIRECTIONS
from stiffness.networks.transfer import FineTuning

# --- Figures --------------------------------------------------------------------------


def figure_06(names: Sequence[str], results: Sequence[CellResult], file: Path) -> None:
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


# --- Table ----------------------------------------------------------------------------

PLAN = "spanning"


def report(
    budget: Budget, found: Mapping[Cell, CellResult], out: Path
) -> Sequence[Block]:
    """Write table and figure into a folder and return the section of the report."""
    names = [unfrozen(layers) for layers in (*UNFREEZINGS, ALL_LAYERS)]
    some = [r for r in perceptrons(budget, found, PLAN) if f"{names[0]}/unseen" in r]
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
    draws = {name: _mae(results, name) for name in names}
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


def _mae(results: Sequence[CellResult], name: str) -> Draws:
    """Return the MAE over all directions on the fresh poses."""
    error = np.stack([np.abs(r[f"{name}/unseen"]).mean(axis=1) for r in results])
    return pooled(error, MEASURES["MAE"])


def _table_08(
    names: Sequence[str], results: Sequence[CellResult], seeds: Sequence[int]
) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    for name in names:
        for k, direction in enumerate(DIRECTIONS):
            error = np.stack([r[f"{name}/unseen"][:, k] for r in results])
            for metric in MEASURES:
                interval = pooled(error, MEASURES[metric]).interval
                rows.append(
                    {
                        "unfrozen": _layers(name),
                        "direction": direction,
                        "metric": metric,
                        "value_mm": interval.value,
                        "low_mm": interval.low,
                        "high_mm": interval.high,
                        "paper_mm": None,
                        "n": error.shape[1],
                        "seeds": " ".join(map(str, seeds)),
                        "plan": PLAN,
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
        i = _mae(results, name).interval
        rows.append(
            (
                _layers(name),
                f"{learnt[0, 0]:.4f}",
                f"{learnt[0, 1]:.4f}",
                f"{i.value:.4f}",
                f"{i.low:.4f} to {i.high:.4f}",
            )
        )
    n = results[0][f"{names[0]}/unseen"].shape[0]
    which = ", ".join(map(str, seeds))
    return Table(
        f"Table 8. Unfrozen layers, {budget.transfer.unfreezing_epochs} epochs, seeds: "
        f"{which}; {n} fresh poses [mm], over all directions. The paper's own numbers "
        "are of learnt poses alone and not beside these.",
        ("layers", "learnt MAE", "STDE", "fresh MAE", "95 % interval"),
        rows,
    )
