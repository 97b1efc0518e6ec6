"""Cells of a study: pieces of work whose results are kept, on this machine or others.

`results` works a sweep of cells and keeps each finished one in a file, a plain archive
of arrays, named by the cell, its settings, the data and the library's version. An
interrupted sweep continues with the same numbers, since a cell follows from its
settings and the data alone; files of several machines merge by copying them together.
Workers return arrays; this process writes them. `swept` does the same under a progress
bar.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from zipfile import BadZipFile

import numpy as np
import torch
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bench.shared import replaced_whole
from scenarios.report.command_line import progress_bar
from scenarios.studies.paper.experiment import Material
from scenarios.studies.sweep import Task, run

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

        Intermediate states of a long training may stand in the scratch file.
        """


@dataclass(frozen=True)
class Spread:
    """Where the cells of a sweep are worked, and where their results are kept.

    Attributes:
        folder: Folder of the kept results.
        jobs: Number of processes of this machine, each on one core; 0: this process.
        scheduler: Where workers are, as `sweep.run` reads it.
        attached: Names of files in the folder that cells need: workers of a cluster are
            sent their contents.
    """

    folder: Path
    jobs: int = 2
    scheduler: str = "local"
    attached: tuple[str, ...] = ()

    @classmethod
    def of(cls, flags: Any, attached: tuple[str, ...] = ()) -> "Spread":
        """Return what a command's flags `out`, `jobs` and `scheduler` say."""
        return cls(flags.out / "cells", flags.jobs, flags.scheduler, attached)


@dataclass(frozen=True)
class _Shared:
    """What each worker is sent: the data, and either our folder or files out of it."""

    material: Material
    folder: Path | None
    files: Mapping[str, bytes]


def results(
    cells: Sequence[Cell],
    material: Material,
    spread: Spread,
    told: Callable[[Cell, CellResult], None] = lambda _cell, _result: None,
) -> list[CellResult]:
    """Return the results of cells, in their order, working those that are not kept yet.

    The most expensive are worked first. `told` is called with every cell and its
    result, kept ones first.
    """
    folder = spread.folder
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / _name(cell, material.digest()) for cell in cells]
    found = [_kept(file) for file in files]
    for cell, result in zip(cells, found, strict=True):
        if result is not None:
            told(cell, result)
    missing = [i for i, result in enumerate(found) if result is None]
    missing.sort(key=lambda i: -cells[i].cost)
    tasks = [Task(str(i), (cells[i], files[i].stem)) for i in missing]
    shared = _Shared(material, folder.absolute(), {})
    if spread.scheduler != "local":
        contents = {name: (folder / name).read_bytes() for name in spread.attached}
        shared = _Shared(material, None, contents)
    for key, result in run(_worked, tasks, shared, spread.scheduler, spread.jobs):
        _keep(files[int(key)], result)
        found[int(key)] = result
        told(cells[int(key)], result)
    return [result for result in found if result is not None]


def _worked(sent: tuple[Cell, str], shared: _Shared) -> CellResult:
    """Work one cell, in a worker; only a training's state is written here."""
    cell, name = sent
    with TemporaryDirectory(prefix="cell-") as aside:
        folder = shared.folder or Path(aside)
        for file, content in shared.files.items():
            (folder / file).write_bytes(content)
        scratch = folder / f"{name}.training.npz"
        found = cell.work(shared.material, scratch)
        result = {k: np.asarray(v) for k, v in found.items()}
        scratch.unlink(missing_ok=True)
    return result


def _keep(file: Path, result: CellResult) -> None:
    """Write a finished cell, whole or not at all."""
    with replaced_whole(file) as beside, beside.open("wb") as data:
        np.savez(data, **result)  # pyright: ignore[reportArgumentType]


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
    spread: Spread,
    told: Callable[[Cell, CellResult], None] | None = None,
) -> dict[Cell, CellResult]:
    """Return the results of cells, worked under a progress bar that counts cost."""
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

        return dict(zip(cells, results(cells, material, spread, tell), strict=True))
