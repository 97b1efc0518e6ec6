"""A recording that is checked cell by cell costs more to read than a bare table.

The other ways only turn the samples into an array, or back: no unit, no manifest, no
fault is looked at. They are what the checks are to be weighed against.
"""

import csv
from pathlib import Path

import numpy as np
import pyarrow.csv

from bench import files
from bench.experiment import record
from bench.format.samples import CSV_FILE
from bench.rig import Rig
from bench.table_one import plan as table_one
from scenarios.benchmarks.experiment import KR10
from scenarios.benchmarks.race import Race, Way


def races(poses: int, folder: Path) -> tuple[Race, Race]:
    """Return the races over writing and reading one recording.

    Args:
        poses: Of its postures, nine rows of 28 markers each.
        folder: Where to; one that is empty and goes away afterwards.
    """
    recording = record(Rig(KR10), table_one(poses))
    files.write(folder / "ours", recording)
    table = folder / "ours" / CSV_FILE
    with table.open(newline="", encoding="utf-8") as source:
        names = next(csv.reader(source))
    numbers = _numbers(table)
    size = f"{len(recording.time)} rows, {len(names)} columns"
    writing = Race(
        task=f"write a recording: {size}",
        ways=(
            Way("bench.files.write", lambda: files.write(folder / "new", recording)),
            Way("csv module", lambda: _write(folder / "bare.csv", numbers)),
            Way(
                "numpy.savetxt",
                lambda: np.savetxt(folder / "np.csv", numbers, delimiter=","),
            ),
        ),
    )
    reading = Race(
        task=f"read a recording: {size}",
        ways=(
            Way("bench.files.read", lambda: files.read(folder / "ours")[0]),
            Way("csv module", lambda: _numbers(table)),
            Way("pyarrow.csv", lambda: pyarrow.csv.read_csv(table)),
        ),
    )
    return writing, reading


def _numbers(table: Path) -> np.ndarray:
    """Read a table of samples; what is no number becomes NaN."""
    with table.open(newline="", encoding="utf-8") as source:
        rows = list(csv.reader(source))[1:]
    return np.array([[_number(cell) for cell in row] for row in rows])


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


def _write(table: Path, numbers: np.ndarray) -> None:
    with table.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows(numbers.tolist())
