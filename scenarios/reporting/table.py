"""A tidy table has one number a row and says everything about it in its columns."""

import csv
import math
from collections.abc import Sequence
from pathlib import Path


def write(file: Path, rows: Sequence[dict[str, object]]) -> None:
    """Write rows of the same columns as csv; floats keep seven digits, NaN is blank."""
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _cell(value) for name, value in row.items()})


def read(file: Path) -> list[dict[str, str]]:
    """Read such a table back, as text."""
    with file.open(newline="", encoding="utf-8") as source:
        return list(csv.DictReader(source))


def _cell(value: object) -> object:
    if not isinstance(value, float):
        return value
    return "" if math.isnan(value) else f"{value:.7g}"
