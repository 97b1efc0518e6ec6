"""Cells of the table as numbers in SI units, or as faults."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute
from jaxtyping import Float

from bench.shared.format.columns import COUNT, WORD, Held, Unit
from bench.shared.format.faults import Place, first_line, quoted
from bench.shared.format.table import Cells

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

    Args:
        held: The columns; those that the file lacks are left out.
        cells: Text or numbers.
        mark: The decimal mark of a text.

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

    Args:
        held: Which column of the format it is, and in which unit.
        cells: Text or numbers.
        place: The file, for the faults.
        mark: The decimal mark of a text.

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


def _blank(row: int) -> str:
    return (
        "blank; a blank is legal in marker and aK_link_deg columns alone. Rows like "
        "this are left out and counted by skip_incomplete = true in [csv]."
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
    return numbers, wrong


def _with(mark: str, cell: str) -> str:
    other = mark == "." and "," in cell
    if mark == ",":
        return " with a decimal comma"
    return ' (a decimal comma is declared in [csv]: decimal = ",")' if other else ""
