"""Tables 6 and 7 and Fig. 5: which network imitates six springs best.

In cells networks of several shapes learn what six springs predict. A row of a table is
a mean over seeds, with the smallest and the largest; captions
follow from the numbers; Fig. 5 shows the error over width and depth, and a loss curve.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure as Picture
from typing_extensions import override

from scenarios.report import data_files, figures
from scenarios.report.page import Block, Figure, Heading, Paragraph, Table
from scenarios.studies.paper import TABLE_06_MM, TABLE_07_MM
from scenarios.studies.paper.budget import Budget, said_seeds
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.experiment import Material
from stiffness.experiment.deflections import every_plateau
from stiffness.methods.transferred_networks import domain_of
from stiffness.methods.vjm import Vjm
from stiffness.networks.model import Mlp
from stiffness.networks.pretraining import Pretrained, Pretraining, pretrain, split
from stiffness.networks.source_domain import (
    SourcePlan,
    spanning_plan,
    table_4_postures,
    table_5_plan,
)
from stiffness.networks.training import Training

# --- Cells ---------------------------------------------------------------------------

PLAN = "table 5"
"""Source plan of the sweep: the paper's own."""
CURVE = 200
"""Number of points kept of a loss curve; each is a mean over an interval of steps."""
SECONDS_A_WEIGHT = 4e-8
"""Time of a step of 256 rows per weight of the network, to which 2 ms are added."""


@dataclass(frozen=True)
class Imitation(Cell):
    """A network that is pre-trained on the springs of the whole experiment.

    Attributes:
        seed: Of weights, split and order.
        every: Every how many of Table 4's postures are in the source plan.
    """

    shape: Mlp
    plan: str
    steps: int
    seed: int
    every: int = 1

    @property
    @override
    def cost(self) -> float:
        return step_cost(self.shape) * self.steps + 4.0

    @override
    def work(self, material: Material, scratch: Path) -> CellResult:
        arm, recording = material.arm, material.recording
        springs = Vjm(arm).fit(recording)
        data = every_plateau(arm, recording, springs.compliance)
        settings = Pretraining(
            self.shape, training=Training(steps=self.steps), seed=self.seed
        )
        domain = domain_of(springs, source_plan(self.plan, self.every), data)
        return imitated(pretrain(domain, settings, scratch))


def cells(budget: Budget, seed: int) -> list[Imitation]:
    """Return every cell of Tables 6 and 7 and Fig. 5, without repetitions."""
    found = [
        *(cell for row in depth_cells(budget).values() for cell in row),
        *(cell for row in longer_cells(budget).values() for cell in row),
        *(cell for row in activation_cells(budget).values() for cell in row),
        *width_cells(budget, seed).values(),
    ]
    return list(dict.fromkeys(found))


def depth_cells(budget: Budget) -> dict[int, list[Imitation]]:
    """Return the cells of Table 6, all seeds, by hidden layers."""
    return {
        depth: _seeds(budget, Mlp(depth, 100), budget.sweep.depth_steps)
        for depth in budget.sweep.depths
    }


def longer_cells(budget: Budget) -> dict[int, list[Imitation]]:
    """Return cells of four layers of 100, by number of steps."""
    return {
        steps: _seeds(budget, Mlp(4, 100), steps) for steps in budget.sweep.convergence
    }


def activation_cells(budget: Budget) -> dict[str, list[Imitation]]:
    """Return the cells of Table 7, all seeds, by activation."""
    chosen, steps = budget.sweep.chosen, budget.sweep.activation_steps
    return {
        name: _seeds(budget, Mlp(chosen.hidden, chosen.width, name), steps)
        for name in ("sigmoid", "tanh", "relu")
    }


def width_cells(budget: Budget, seed: int) -> dict[tuple[int, int], Imitation]:
    """Return the cells of Fig. 5, one seed, by hidden layers and width."""
    sweep = budget.sweep
    return {
        (depth, width): Imitation(
            Mlp(depth, width), PLAN, sweep.width_steps, seed, sweep.every
        )
        for depth in sweep.width_depths
        for width in sweep.widths
    }


def rows_of(cell: Imitation) -> tuple[int, int]:
    """Return how many rows train and test a cell."""
    rows = source_plan(cell.plan, cell.every).rows
    training, test = split(rows, cell.seed)
    return len(training), len(test)


def _seeds(budget: Budget, shape: Mlp, steps: int) -> list[Imitation]:
    sweep = budget.sweep
    return [Imitation(shape, PLAN, steps, s, sweep.every) for s in sweep.seeds]


def imitated(pretrained: Pretrained) -> dict[str, np.ndarray]:
    """Return errors on training and test rows, in mm, and the loss curve.

    Returns:
        `errors`: (training and test) x (MAE, STDE, ME) x (x, y, z); `loss` and `step`.
    """
    errors = [
        [e.mae, e.stde, e.me] for e in (pretrained.on_training, pretrained.on_test)
    ]
    step, loss = thinned(pretrained.loss)
    return {"errors": 1e3 * np.array(errors), "loss": loss, "step": step}


def thinned(
    loss: Float[np.ndarray, " steps"],
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """Return the end steps and mean losses of equal intervals of a curve."""
    parts = np.array_split(loss, min(CURVE, len(loss)))
    ends = np.cumsum([len(part) for part in parts]).astype(float)
    return ends, np.array([part.mean() for part in parts])


def source_plan(name: str, every: int = 1) -> SourcePlan:
    """Return one of `budget.PLANS` over every so many of Table 4's postures."""
    postures = table_4_postures()[::every]
    return table_5_plan(postures) if name == "table 5" else spanning_plan(postures)


def step_cost(shape: Mlp) -> float:
    """Return the approximate time of a training step, in s."""
    weights = shape.width * (21 + (shape.hidden - 1) * shape.width)
    return 2e-3 + SECONDS_A_WEIGHT * weights


# --- Rows over seeds ------------------------------------------------------------------

CellResults = Mapping[Cell, CellResult]
MAE, STDE = 0, 1
ROWS = ("training", "test")


def mean_of(cells: Sequence[Imitation], found: CellResults) -> Float[np.ndarray, "2 3"]:
    """Return (training and test) x (MAE, STDE, ME), over directions and seeds."""
    return np.mean([errors_of(found[cell]) for cell in cells], axis=0)


def errors_of(result: CellResult) -> Float[np.ndarray, "2 3"]:
    """Return (training and test) x (MAE, STDE, ME), over directions."""
    return result["errors"].mean(axis=2)


def spread_of(
    cells: Sequence[Imitation], found: CellResults
) -> Float[np.ndarray, "2 2 3"]:
    """Return (least, most over seeds) x (training and test) x (MAE, STDE, ME)."""
    each = np.array([errors_of(found[cell]) for cell in cells])
    return np.array([each.min(axis=0), each.max(axis=0)])


def report_table(
    caption: str, rows: Mapping, found: CellResults, paper: Mapping
) -> Table:
    """Return rows of cells as a table, the paper's test errors beside them."""
    header = ["", "training MAE", "STDE", "test MAE", "over seeds", "STDE"]
    cells = []
    for value, all_seeds in rows.items():
        mean, spread = mean_of(all_seeds, found), spread_of(all_seeds, found)
        line = [
            str(value),
            *(f"{mean[0, m]:.4f}" for m in (MAE, STDE)),
            f"{mean[1, MAE]:.4f}",
            said_range(spread[0, 1, MAE], spread[1, 1, MAE], len(all_seeds)),
            f"{mean[1, STDE]:.4f}",
        ]
        if paper:
            line.append(" / ".join(f"{number:.4f}" for number in paper[value][1]))
        cells.append(line)
    return Table(caption, [*header, *["paper, test"] * bool(paper)], cells)


def said_range(low: float, high: float, seeds: int) -> str:
    """Return the range over seeds in words; of one seed, that it is one."""
    return "one seed" if seeds == 1 else f"{low:.4f} to {high:.4f}"


# --- Findings in words ----------------------------------------------------------------

TEST = 1


def best_of(rows: Mapping, found: CellResults, theirs: object) -> str:
    """Return which row tests best, which equal it over seeds, and the paper's best."""
    mae = {name: mean_of(cells, found)[TEST, MAE] for name, cells in rows.items()}
    best = min(mae, key=lambda name: mae[name])
    said = f"least test MAE: {best} here, {theirs} in the paper"
    seeds = len(rows[best])
    if seeds == 1:
        return f"{said}; one seed cannot tell close ones apart"
    high = spread_of(rows[best], found)[1, TEST, MAE]
    alike = [
        str(name)
        for name, cells in rows.items()
        if name != best and spread_of(cells, found)[0, TEST, MAE] <= high
    ]
    if not alike:
        return f"{said}; no seed of another comes as near"
    return f"{said}; over the seeds {', '.join(alike)} cannot be told from it"


def of_widths(widths: Mapping[tuple[int, int], Imitation], found: CellResults) -> str:
    """Return at which width each depth tests best, in words."""
    parts = []
    for depth in sorted({d for d, _ in widths}):
        mae = {
            w: errors_of(found[cell])[TEST, MAE]
            for (d, w), cell in widths.items()
            if d == depth
        }
        best = min(mae, key=lambda w: mae[w])
        parts.append(f"{best} neurons at {depth} hidden layers ({mae[best]:.4f} mm)")
    widest = max(w for _, w in widths)
    return f"of up to {widest} tried, least test MAE with {', '.join(parts)}"


def of_end(loss: Float[np.ndarray, " points"]) -> str:
    """Return the change of the loss over the last fifth of the steps, in words."""
    fifth = max(len(loss) // 5, 1)
    few = max(fifth // 4, 1)
    end, before = np.mean(loss[-few:]), np.mean(loss[-fifth - few : -fifth or None])
    change = 100 * (end / before - 1)
    return f"the last fifth of the steps changes the loss by {change:+.0f} %"


def of_doubling(longer: Mapping[int, Sequence[Imitation]], found: CellResults) -> str:
    """Return from which steps on doubling changes the test MAE less than seeds do."""
    steps = sorted(longer)
    mae = {s: mean_of(longer[s], found)[TEST, MAE] for s in steps}
    spread = {s: np.ptp(spread_of(longer[s], found)[:, TEST, MAE]) for s in steps}
    moved = {
        few: (many, mae[many] - mae[few], max(spread[few], spread[many]))
        for few, many in pairwise(steps)
    }
    still = [few for few, (_, by, seeds) in moved.items() if abs(by) >= seeds]
    first = steps.index(still[-1]) + 1 if still else 0  # from this one to the last
    few = steps[min(first, len(steps) - 2)]
    many, by, seeds = moved[few]
    verdict = "not even {} are enough" if few in still else "{} are enough"
    return (
        f"{verdict.format(few)}: {many} move the test MAE by {by:+.4f} mm, the seeds "
        f"spread by {seeds:.4f} mm"
    )


# --- Figure ---------------------------------------------------------------------------

COLOURS = (figures.GREY, figures.ORANGE, figures.BLUE)


def figure_05(
    widths: Mapping[tuple[int, int], Imitation],
    found: Mapping[Cell, CellResult],
    curve: Imitation,
    file: Path,
) -> None:
    """Draw test MAE and STDE over the width, and one loss curve."""
    picture = Picture(figsize=(11, 3.6), layout="constrained")
    mae, stde, loss = picture.subplots(1, 3)
    for colour, depth in zip(COLOURS, sorted({d for d, _ in widths}), strict=False):
        chosen = {
            w: found[c]["errors"][1] for (d, w), c in widths.items() if d == depth
        }
        for axes, measure in ((mae, 0), (stde, 1)):
            value = [errors[measure].mean() for errors in chosen.values()]
            axes.plot(list(chosen), value, "o-", ms=4, color=colour, label=f"{depth}")
    for axes, name in ((mae, "test MAE [mm]"), (stde, "test STDE [mm]")):
        axes.set_xlabel("neurons a layer")
        axes.set_ylabel(name)
        axes.set_ylim(bottom=0.0)
    mae.legend(title="hidden layers")
    result = found[curve]
    loss.plot(result["step"], result["loss"], color=figures.ORANGE)
    loss.set_yscale("log")
    loss.set_xlabel("step of 256 rows")
    loss.set_ylabel("loss [no unit]")
    figures.save(picture, file)


# --- Tables ---------------------------------------------------------------------------

MEASURES = ("MAE", "STDE_absolute")


def report(budget: Budget, found: CellResults, seed: int, out: Path) -> Sequence[Block]:
    """Write tables and figures into a folder and return the section of the report."""
    depths, activations = depth_cells(budget), activation_cells(budget)
    data_files.write_table(
        out / "table_06.csv", _tidy("hidden", depths, found, TABLE_06_MM)
    )
    data_files.write_table(
        out / "table_07.csv", _tidy("activation", activations, found, TABLE_07_MM)
    )
    widths = width_cells(budget, seed)
    data_files.write_table(out / "figure_05.csv", _widths(widths, found))
    figure_05(widths, found, activations["relu"][0], out / "figure_05.png")
    sweep, seeds = budget.sweep, said_seeds(len(budget.sweep.seeds))
    relu = activations["relu"][0]
    training, test = rows_of(relu)
    batch = Training().batch
    blocks: list[Block] = [
        Heading("Which network imitates the springs best"),
        Paragraph(
            f"Networks learn from {training:,} answers of the fitted springs (postures "
            f"of Table 4, wrenches of Table 5) and are tested on {test:,} others. "
            "Errors are means over x, y, z; STDE is of absolute errors, Eq. 8 to the "
            "letter. Rows of one plan are no witnesses against each other, so what "
            "scatters are seeds: mean, smallest and largest are shown. The paper takes "
            "100,000 steps on all rows at once, which would take days on two cores; "
            f"here each step sees {batch} rows. Budget: {budget.name}."
        ),
        report_table(
            f"Table 6. Hidden layers of 100, {sweep.depth_steps} steps, {seeds} a cell "
            f"[mm]: {best_of(depths, found, 4)}.",
            depths,
            found,
            TABLE_06_MM,
        ),
        report_table(
            f"Table 7. Activation of {sweep.chosen.hidden} layers of "
            f"{sweep.chosen.width}, {sweep.activation_steps} steps, {seeds} a cell "
            f"[mm]: {best_of(activations, found, 'relu')}.",
            activations,
            found,
            TABLE_07_MM,
        ),
        Figure(
            f"Width (the paper's Fig. 5a, b), one seed, {sweep.width_steps} steps a "
            f"cell: {of_widths(widths, found)}. Convergence of the ReLU network of "
            f"Table 7 (Fig. 5c), seed {relu.seed}: {of_end(found[relu]['loss'])}.",
            "figure_05.png",
        ),
    ]
    longer = longer_cells(budget)
    if longer:
        data_files.write_table(
            out / "convergence.csv", _tidy("steps", longer, found, {})
        )
        blocks.append(
            report_table(
                f"Are the steps enough? Four layers of 100, {seeds} a cell [mm]; "
                "enough is where doubling moves the test MAE by less than the seeds "
                f"spread: {of_doubling(longer, found)}.",
                longer,
                found,
                {},
            )
        )
    return blocks


def _tidy(what: str, rows: Mapping, found: CellResults, paper: Mapping) -> list[dict]:
    return [
        {
            what: value,
            "rows": ROWS[r],
            "metric": MEASURES[m],
            "value_mm": float(mean_of(cells, found)[r, m]),
            "low_mm": float(spread_of(cells, found)[0, r, m]),
            "high_mm": float(spread_of(cells, found)[1, r, m]),
            "paper_mm": paper[value][r][m] if value in paper else None,
            "n": rows_of(cells[0])[r],
            "steps": cells[0].steps,
            "seeds": " ".join(str(cell.seed) for cell in cells),
            "plan": cells[0].plan,
        }
        for value, cells in rows.items()
        for r in range(2)
        for m in (MAE, STDE)
    ]


def _widths(
    cells: Mapping[tuple[int, int], Imitation], found: CellResults
) -> list[dict[str, object]]:
    return [
        {
            "hidden": depth,
            "width": width,
            "rows": ROWS[r],
            "MAE_mm": float(errors_of(found[cell])[r, MAE]),
            "STDE_absolute_mm": float(errors_of(found[cell])[r, STDE]),
            "n": rows_of(cell)[r],
            "steps": cell.steps,
            "seeds": cell.seed,
            "plan": cell.plan,
        }
        for (depth, width), cell in cells.items()
        for r in range(2)
    ]
