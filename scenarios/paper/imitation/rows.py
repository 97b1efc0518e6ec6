"""A row of a table is a mean over seeds, with the smallest and the largest."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from scenarios.paper.imitation.cells import Imitation
from scenarios.paper.work.cells import Cell, Result
from scenarios.reporting.page import Table

Found = Mapping[Cell, Result]
MAE, STDE = 0, 1
ROWS = ("training", "test")


def mean_of(cells: Sequence[Imitation], found: Found) -> Float[np.ndarray, "2 3"]:
    """Return (training and test) x (MAE, STDE, ME), over directions and seeds."""
    return np.mean([errors_of(found[cell]) for cell in cells], axis=0)


def errors_of(result: Result) -> Float[np.ndarray, "2 3"]:
    """Return (training and test) x (MAE, STDE, ME), over directions."""
    return result["errors"].mean(axis=2)


def spread_of(cells: Sequence[Imitation], found: Found) -> Float[np.ndarray, "2 2 3"]:
    """Return smallest and largest over the seeds."""
    each = np.array([errors_of(found[cell]) for cell in cells])
    return np.array([each.min(axis=0), each.max(axis=0)])


def shown(caption: str, rows: Mapping, found: Found, paper: Mapping) -> Table:
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
    """Say between which values seeds lie; of one seed there is nothing to say."""
    return "one seed" if seeds == 1 else f"{low:.4f} to {high:.4f}"


def said_seeds(n: int) -> str:
    """Say how many seeds there are."""
    return "one seed" if n == 1 else f"{n} seeds"
