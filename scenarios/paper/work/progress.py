"""Long work shows how far it is and how long it will take."""

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.progress import (
    BarColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from scenarios.paper.material import Material
from scenarios.paper.work.cells import Cell, Result, results
from scenarios.reporting.bar import bar


def swept(
    cells: Sequence[Cell],
    material: Material,
    folder: Path,
    jobs: int,
    told: Callable[[Cell, Result], None] | None = None,
) -> dict[Cell, Result]:
    """Work all cells under a progress bar that counts what they cost.

    Args:
        cells: To be worked; those that are kept are there at once.
        material: The data of all of them.
        folder: Where finished cells are kept.
        jobs: How many at once.
        told: Is told of every cell that is there.

    Returns:
        What was found, by cell.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with bar(*columns) as progress:
        total = sum(cell.cost for cell in cells)
        task = progress.add_task(f"{len(cells)} cells", total=total)
        left = len(cells)

        def tell(cell: Cell, result: Result) -> None:
            nonlocal left
            left -= 1
            progress.update(task, advance=cell.cost, description=f"{left} cells left")
            if told is not None:
                told(cell, result)

        return dict(
            zip(cells, results(cells, material, folder, jobs, tell), strict=True)
        )
