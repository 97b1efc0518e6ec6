"""Cells of a study: pieces of work that are cached and worked in parallel.

`results` works a sweep of cells and keeps each finished one in a file, a plain archive
of arrays, named by the cell, its settings, the data and the library's version. An
interrupted sweep continues with the same numbers, since a cell follows from its
settings and the data alone. `swept` does the same under a progress bar.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import cast
from zipfile import BadZipFile

import numpy as np
import torch
from joblib import Parallel, delayed, parallel_config
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from scenarios.report.command_line import progress_bar
from scenarios.studies.paper.experiment import Material

# --- Cells and their cache ------------------------------------------------------------

CellResult = Mapping[str, np.ndarray]
"""Arrays that a cell computed, by names such as `best/unseen`."""


class Cell(ABC):
    """One piece of work; a frozen dataclass, whose repr states all of its settings."""

    @property
    @abstractmethod
    def cost(self) -> float:
        """Approximate time on one core, in s; for the progress bar."""

    @abstractmethod
    def work(self, material: Material, scratch: Path) -> CellResult:
        """Do the work and return its arrays.

        Args:
            material: The data.
            scratch: File for intermediate states of a long training.
        """


def results(
    cells: Sequence[Cell],
    material: Material,
    folder: Path,
    jobs: int,
    told: Callable[[Cell, CellResult], None] = lambda _cell, _result: None,
) -> list[CellResult]:
    """Return the results of cells, working those that are not kept yet.

    Args:
        cells: In any order; the most expensive are worked first.
        material: The data of all of them.
        folder: Folder of the kept results.
        jobs: Number of processes, each on one core.
        told: Called with every cell and its result, kept ones first.

    Returns:
        The results, in the order of the cells.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / _name(cell, material.digest()) for cell in cells]
    found = [_kept(file) for file in files]
    for cell, result in zip(cells, found, strict=True):
        if result is not None:
            told(cell, result)
    missing = [i for i, result in enumerate(found) if result is None]
    missing.sort(key=lambda i: -cells[i].cost)
    work = (delayed(_worked)(i, cells[i], material, files[i]) for i in missing)
    with parallel_config(backend="loky", inner_max_num_threads=1):
        team = Parallel(
            n_jobs=jobs, return_as="generator_unordered", pre_dispatch="all"
        )
        for i, result in cast(Iterator[tuple[int, CellResult]], team(work)):
            found[i] = result
            told(cells[i], result)
    return [result for result in found if result is not None]


def _worked(
    i: int, cell: Cell, material: Material, file: Path
) -> tuple[int, CellResult]:
    scratch = file.with_suffix(".training.npz")
    result = {k: np.asarray(v) for k, v in cell.work(material, scratch).items()}
    with NamedTemporaryFile(dir=file.parent, suffix=".partial", delete=False) as beside:
        try:
            np.savez(beside, **result)  # pyright: ignore[reportArgumentType]
            beside.close()
            os.replace(beside.name, file)
        except BaseException:
            Path(beside.name).unlink(missing_ok=True)
            raise
    scratch.unlink(missing_ok=True)
    return i, result


def _kept(file: Path) -> CellResult | None:
    """Read a finished cell; None where there is none or it is damaged."""
    try:
        with file.open("rb") as data, np.load(data, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None


def _name(cell: Cell, digest: str) -> str:
    key = sha256(f"{cell!r} {digest} {torch.__version__}".encode()).hexdigest()[:16]
    return f"{type(cell).__name__.lower()}-{key}.npz"


# --- Progress -------------------------------------------------------------------------


def swept(
    cells: Sequence[Cell],
    material: Material,
    folder: Path,
    jobs: int,
    told: Callable[[Cell, CellResult], None] | None = None,
) -> dict[Cell, CellResult]:
    """Work all cells under a progress bar that counts their cost.

    Args:
        cells: Cells to be worked; kept results are taken from their files.
        material: The data of all of them.
        folder: Folder of the kept results.
        jobs: Number of processes.
        told: Called with every cell and its result.

    Returns:
        The results, by cell.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with progress_bar(*columns) as progress:
        total = sum(cell.cost for cell in cells)
        task = progress.add_task(f"{len(cells)} cells", total=total)
        left = len(cells)

        def tell(cell: Cell, result: CellResult) -> None:
            nonlocal left
            left -= 1
            progress.update(task, advance=cell.cost, description=f"{left} cells left")
            if told is not None:
                told(cell, result)

        return dict(
            zip(cells, results(cells, material, folder, jobs, tell), strict=True)
        )
