"""Rows of a lab's own table that are readings, and those that are none.

A row of units, an empty line and a row that was never finished are no readings.
"""

import re

import numpy as np
import pyarrow as pa
import pyarrow.compute
from jaxtyping import Float

from bench.shared.format.cells import COMPUTE
from bench.shared.format.columns import WORD, Layout
from bench.shared.format.faults import LONGEST, SHOWN, Place
from bench.shared.format.manifest import Csv
from bench.shared.format.table import Cells, Header

MISSING = ("", "-", "--", "---", "n/a", "na", "nan", "null", "none", "#n/a", "#nv")
"""What stands where nothing was read (chosen: what spreadsheets and loggers write)."""
UNIT_ROWS = 3
"""Most rows below a header that are told to be none (chosen: names, units, remarks)."""
_DIGIT = re.compile(r"[0-9]")

Readings = tuple[Cells, Float[np.ndarray, " rows"], list[str], list[str]]


def readings_of(header: Header, cells: Cells, layout: Layout, about: Csv) -> Readings:
    """Keep the rows that are readings.

    Args:
        header: Of the file.
        cells: Its columns that are read.
        layout: What they stand for.
        about: Whether incomplete rows are left out.

    Returns:
        The cells; the number of each row among the readings, from 0, those counted too
        that are left out as incomplete; what to note; and rows that are at fault.
    """
    texts = {n: c for n, c in cells.columns.items() if _is_text(c)}
    if not texts:
        return cells, np.arange(cells.rows, dtype=float), [], []
    place, faults = cells.location, []
    none = _rows_of_words(texts, layout)
    left_out = {*header.left_out, *(int(n) for n in place.rows(cells.rows)[none])}
    if none:
        faults.append(_say_units(place, none, texts, header))
        cells = cells.drop(none)
    required = {
        source
        for held in layout.held.values()
        for source in held.sources
        if not held.column.may_be_blank and source in texts
    }
    blank = {n: _blank(cells.columns[n], about.skip_incomplete) for n in texts}
    empty = np.all([*blank.values()], axis=0) & (len(texts) > 1)
    gone, notes = empty, []
    if about.skip_incomplete and required:
        gone = empty | np.any([blank[n] for n in sorted(required)], axis=0)
        skipped = [int(n) for n in cells.location.rows(cells.rows)[gone]]
        notes = _said_of_skipped(cells.location, sorted([*skipped, *cells.short]))
    elif not about.skip_incomplete:
        rows = np.flatnonzero(empty)
        say = "nothing in any column that is read; delete the line, or say "
        say += "skip_incomplete = true in [csv]."
        faults += [f"{cells.location.row(int(r))}: {say}" for r in rows[:SHOWN]]
        if len(rows) > SHOWN:
            more = f"and {len(rows) - SHOWN} more rows like these."
            faults.append(f"{place.file}: {more}")
    cells = cells.drop(np.flatnonzero(gone).tolist())
    numbers = cells.location.rows(cells.rows)
    before = np.searchsorted(sorted(left_out), numbers)
    return cells, (numbers - before).astype(float), notes, faults


def _is_text(column: pa.ChunkedArray) -> bool:
    return pa.types.is_string(column.type)


def _rows_of_words(texts: dict[str, pa.ChunkedArray], layout: Layout) -> list[int]:
    """Return the first rows that hold words where all others hold numbers."""
    numeric = {
        source
        for held in layout.held.values()
        for source in held.sources
        if held.column.kind != WORD and source in texts
    }
    heads = [
        [str(v).strip() for v in texts[n].slice(0, UNIT_ROWS + 1).to_pylist()]
        for n in sorted(numeric)
    ]
    rows = []
    for row, cells in enumerate(zip(*heads, strict=True)):
        words = [c for c in cells if c.casefold() not in MISSING]
        if row == UNIT_ROWS or not words or any(_begins_as_number(c) for c in words):
            break
        rows.append(row)
    follows = len(heads[0]) > len(rows) if heads else False
    return rows if follows else []


def _begins_as_number(cell: str) -> bool:
    return _DIGIT.match(cell.lstrip("+-., ")) is not None


def _say_units(
    place: Place, rows: list[int], texts: dict[str, pa.ChunkedArray], header: Header
) -> str:
    words = [str(texts[n][rows[0]]).strip() for n in header.names if n in texts]
    shown = ";".join(dict.fromkeys(w for w in words if w))[:LONGEST]
    numbers = [int(n) for n in place.rows(len(rows) + rows[-1] + 1)[rows]]
    lines = [n + 2 + place.above for n in numbers]
    earlier = [n + 2 + place.above for n in header.left_out]
    above = list(range(1, place.above + 1))
    first = [*range(len(earlier) + len(lines))]
    plain = not above and sorted(n - 2 for n in [*earlier, *lines]) == first
    say = len(first) if plain else sorted([*above, *earlier, *lines])
    return (
        f"{place.row(rows[0])}: words where numbers are read ({shown!r}), as in a row "
        f"of units; if it is one, say so in [csv]: skip_rows = {say}."
    )


def _blank(column: pa.ChunkedArray, or_missing: bool) -> np.ndarray:
    """Tell which cells hold nothing, or a word for nothing."""
    trimmed = COMPUTE.utf8_lower(COMPUTE.utf8_trim_whitespace(column))
    words = pa.array(MISSING if or_missing else MISSING[:1])
    return np.asarray(COMPUTE.is_in(trimmed, value_set=words).to_numpy(), dtype=bool)


def _said_of_skipped(place: Place, rows: list[int]) -> list[str]:
    """Count the rows of a file that were left out, and name the first."""
    if not rows:
        return []
    lines = [str(row + 2 + place.above) for row in rows[:SHOWN]]
    more = f" and {len(rows) - SHOWN} more" if len(rows) > SHOWN else ""
    many = len(rows) > 1
    shown = f"line{'s' if many else ''} {', '.join(lines)}{more}"
    are = "rows were skipped as incomplete" if many else "row was skipped as incomplete"
    return [f"{place.file}: {len(rows)} {are} ({shown})."]
