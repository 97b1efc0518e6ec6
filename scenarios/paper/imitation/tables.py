"""Tables 6 and 7 and Fig. 5: which network imitates six springs best."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from scenarios.paper.budget import Budget
from scenarios.paper.imitation import pictures
from scenarios.paper.imitation.cells import (
    Imitation,
    activation_cells,
    depth_cells,
    longer_cells,
    rows_of,
    width_cells,
)
from scenarios.paper.imitation.findings import (
    best_of,
    of_doubling,
    of_end,
    of_widths,
)
from scenarios.paper.imitation.rows import (
    MAE,
    ROWS,
    STDE,
    Found,
    errors_of,
    mean_of,
    said_seeds,
    shown,
    spread_of,
)
from scenarios.paper.numbers import TABLE_06_MM, TABLE_07_MM
from scenarios.reporting import table
from scenarios.reporting.page import Block, Figure, Heading, Paragraph
from stiffness.networks.training import Training

MEASURES = ("MAE", "STDE_absolute")


def report(budget: Budget, found: Found, seed: int, out: Path) -> Sequence[Block]:
    """Write tables and figures into a folder and return the section of the report."""
    depths, activations = depth_cells(budget), activation_cells(budget)
    table.write(out / "table_06.csv", _tidy("hidden", depths, found, TABLE_06_MM))
    table.write(
        out / "table_07.csv", _tidy("activation", activations, found, TABLE_07_MM)
    )
    widths = width_cells(budget, seed)
    table.write(out / "figure_05.csv", _widths(widths, found))
    pictures.figure_05(widths, found, activations["relu"][0], out / "figure_05.png")
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
        shown(
            f"Table 6. Hidden layers of 100, {sweep.depth_steps} steps, {seeds} a cell "
            f"[mm]: {best_of(depths, found, 4)}.",
            depths,
            found,
            TABLE_06_MM,
        ),
        shown(
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
        table.write(out / "convergence.csv", _tidy("steps", longer, found, {}))
        blocks.append(
            shown(
                f"Are the steps enough? Four layers of 100, {seeds} a cell [mm]; "
                "enough is where doubling moves the test MAE by less than the seeds "
                f"spread: {of_doubling(longer, found)}.",
                longer,
                found,
                {},
            )
        )
    return blocks


def _tidy(what: str, rows: Mapping, found: Found, paper: Mapping) -> list[dict]:
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
    cells: Mapping[tuple[int, int], Imitation], found: Found
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
