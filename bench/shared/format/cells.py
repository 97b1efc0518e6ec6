"""Cells of the table as numbers in SI units or as faults, and rows of readings.

A row of units, an empty line and a row that was never finished are no readings.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
from jaxtyping import Float

from bench.shared.format.columns import COUNT, WORD, Held, Layout, Unit
from bench.shared.format.faults import LONGEST, SHOWN, Place, first_line, quoted
from bench.shared.format.manifest import Csv
from bench.shared.format.table import Cells, Header

COMPUTE: Any = pyarrow.compute  # its functions are made at run time

_MARKS = {".": "point", ",": "comma"}
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_LARGEST_COUNT = 2.0**53


def all_values_of(
    held: Mapping[str, Held], cells: Cells, mark: str
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Return columns of a file in SI.

    Where no number has the decimal mark that was declared but some have the other one,
    that is one fault of the file, and the other one is read, for what else is wrong.
    Columns that the file lacks are left out.

    Returns:
        The values as `values_of` gives them, by the names of `held`; and the faults.
    """
    values, faults = {}, []
    for name, one in held.items():
        if all(source in cells.columns for source in one.sources):
            values[name], found = _value_of(one, cells, mark)
            faults += found
    faults = list(dict.fromkeys(faults))  # a column may be read for two
    meant = "," if mark == "." else "."
    if not faults or not _any(held, cells, meant) or _any(held, cells, mark):
        return values, faults
    values, faults = all_values_of(held, cells, meant)
    say = f'{_MARKS[meant]}; say so in [csv]: decimal = "{meant}".'
    return values, [f"{cells.location.file}: its numbers have a decimal {say}", *faults]


def _value_of(one: Held, cells: Cells, mark: str) -> tuple[np.ndarray, list[str]]:
    """Turn one column of the format, which may be a sum of the file's, into SI."""
    if not one.terms:
        return values_of(one, cells.columns[one.source], cells.location, mark)
    total, faults = None, []
    for source, factor in one.terms:
        term = Held(one.column, source, Unit())
        numbers, found = values_of(term, cells.columns[source], cells.location, mark)
        faults += found
        if numbers.dtype.kind == "f":
            total = factor * numbers if total is None else total + factor * numbers
    if total is None:  # words; a fault of the mapping
        return np.full(cells.rows, np.nan), faults
    return one.unit.inward(total), faults


def _any(held: Mapping[str, Held], cells: Cells, mark: str) -> bool:
    """Return whether any number has this decimal mark."""
    pattern = rf"^\s*[+-]?[0-9]*[{mark}][0-9]*([eE][+-]?[0-9]+)?\s*$"
    numbers = [h for h in held.values() if h.column.kind != WORD]
    sources = {source for h in numbers for source in h.sources}
    columns = [cells.columns[s] for s in sources if s in cells.columns]
    texts = [c for c in columns if pa.types.is_string(c.type)]
    return any(
        COMPUTE.any(COMPUTE.match_substring_regex(c, pattern)).as_py() for c in texts
    )


def values_of(
    held: Held, cells: pa.ChunkedArray, place: Place, mark: str
) -> tuple[np.ndarray, list[str]]:
    """Return a column of a file in SI.

    Returns:
        The values, NaN where blank or at fault (text for words); and the faults.
    """
    if pa.types.is_dictionary(cells.type):
        cells = cells.cast(cells.type.value_type)
    text = pa.types.is_string(cells.type) or pa.types.is_large_string(cells.type)
    if held.column.kind == WORD:
        if not text:
            return _no_column(held, cells, place)
        return np.array([(w or "").strip() for w in cells.to_pylist()]), []
    if text:
        numbers, wrong = _from_text(cells, mark)
    else:
        try:
            numbers, wrong = _from_numbers(cells), {}
        except (pa.ArrowException, ValueError, TypeError):
            return _no_column(held, cells, place)
    blank = np.isnan(numbers) & ~np.isin(np.arange(len(numbers)), list(wrong))
    faults = place.at(held.source, wrong, lambda r: wrong[r])
    if np.any(np.isinf(numbers)):
        rows = np.flatnonzero(np.isinf(numbers))
        faults += place.at(held.source, rows, lambda r: "not a finite number.")
        numbers[rows] = np.nan
    if not held.column.may_be_blank:
        faults += place.at(held.source, np.flatnonzero(blank), _blank)
    if held.column.kind == COUNT:
        whole = (numbers == np.round(numbers)) & (abs(numbers) <= _LARGEST_COUNT)
        rows = np.flatnonzero(~whole & np.isfinite(numbers))
        say = "{} is not an integer."
        faults += place.at(held.source, rows, lambda r: say.format(numbers[r]))
        numbers[rows] = np.nan
    return held.unit.inward(numbers), faults


SKIPPED = "Rows like this are left out and counted by skip_incomplete = true in [csv]"
NO_READING = f" {SKIPPED}; of a marker that was not seen the cell is blank."


def _blank(row: int) -> str:
    return (
        f"blank; a blank is legal in marker and aK_link_deg columns alone. {SKIPPED}."
    )


def _no_column(
    held: Held, cells: pa.ChunkedArray, place: Place
) -> tuple[np.ndarray, list[str]]:
    wanted = "words" if held.column.kind == WORD else "numbers"
    fault = f"{place.file}, column {held.source!r}: {cells.type}, expected {wanted}."
    if held.column.kind == WORD:
        return np.full(len(cells), ""), [fault]
    return np.full(len(cells), np.nan), [fault]


def _from_numbers(cells: pa.ChunkedArray) -> Float[np.ndarray, " rows"]:
    if pa.types.is_boolean(cells.type) or pa.types.is_temporal(cells.type):
        raise TypeError(first_line(TypeError("no numbers")))
    exact = cells.cast(pa.float64(), safe=not pa.types.is_decimal(cells.type))
    return np.array(exact.to_numpy(), dtype=float)


def _from_text(
    cells: pa.ChunkedArray, mark: str
) -> tuple[Float[np.ndarray, " rows"], dict[int, str]]:
    """Return numbers, parsed at once where all are plain, else one by one."""
    trimmed = COMPUTE.utf8_trim_whitespace(cells)
    plain = trimmed
    if mark == ",":
        swapped = COMPUTE.replace_substring(trimmed, ".", "?")  # never a thousands mark
        plain = COMPUTE.replace_substring(swapped, ",", ".")
    filled = COMPUTE.if_else(
        COMPUTE.equal(plain, ""), pa.scalar(None, pa.string()), plain
    )
    try:
        cast = filled.cast(pa.float64())
    except pa.ArrowInvalid:
        return _one_by_one(trimmed.to_pylist(), plain.to_pylist(), mark)
    numbers = np.array(cast.to_numpy(), dtype=float)
    if np.sum(~np.isfinite(numbers)) == cast.null_count:  # no "nan", no "inf"
        return numbers, {}
    return _one_by_one(trimmed.to_pylist(), plain.to_pylist(), mark)


def _one_by_one(
    shown: Sequence[str | None], plain: Sequence[str | None], mark: str
) -> tuple[Float[np.ndarray, " rows"], dict[int, str]]:
    numbers = np.full(len(plain), np.nan)
    wrong = {}
    for row, cell in enumerate(plain):
        if cell and _NUMBER.fullmatch(cell):
            numbers[row] = float(cell)
        elif cell:
            wrong[row] = f"{quoted(shown[row])} is not a number{_with(mark, cell)}."
            wrong[row] += NO_READING if cell.strip().casefold() in MISSING else ""
    return numbers, wrong


def _with(mark: str, cell: str) -> str:
    other = mark == "." and "," in cell
    if mark == ",":
        return " with a decimal comma"
    return ' (a decimal comma is declared in [csv]: decimal = ",")' if other else ""


# --- Rows that are readings -----------------------------------------------------------

MISSING = ("", "-", "--", "---", "n/a", "na", "nan", "null", "none", "#n/a", "#nv")
"""What stands where nothing was read (chosen: what spreadsheets and loggers write)."""
UNIT_ROWS = 3
"""Most rows below a header that are told to be none (chosen: names, units, remarks)."""
_DIGIT = re.compile(r"[0-9]")

Readings = tuple[Cells, Float[np.ndarray, " rows"], list[str], list[str]]


def readings_of(header: Header, cells: Cells, layout: Layout, about: Csv) -> Readings:
    """Keep the rows that are readings.

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
    blank = {n: _blank_cells(cells.columns[n], about.skip_incomplete) for n in texts}
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
    if about.skip_incomplete:  # then a word for nothing is a blank where that is legal
        emptied = {
            n: COMPUTE.if_else(pa.array(blank[n]), "", cells.columns[n])
            for n in texts
            if n not in required
        }
        cells = replace(cells, columns={**cells.columns, **emptied})
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


def _blank_cells(column: pa.ChunkedArray, or_missing: bool) -> np.ndarray:
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
