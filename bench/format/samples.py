"""The samples are a table of text or of numbers, read whole or refused with reasons.

What to use when: `samples.csv` for people and spreadsheets, `samples.parquet` for
long streams. Both come out as the same `Table`; nothing in them is evaluated.
"""

import csv
import io
import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import pyarrow as pa
import pyarrow.csv as pa_csv

from bench.format.faults import SHOWN, Place, quoted
from bench.format.parquet import PARQUET_FILE, measured, unfolded
from bench.format.sections import first_line

CSV_FILE = "samples.csv"

MAX_BYTES = 512 * 2**20
"""Largest samples file (chosen: 30 columns at 250 Hz for 90 minutes)."""
MAX_COLUMNS = 10_000
"""Most columns (chosen: 3,000 markers)."""
_ENCODINGS = {
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
    b"PK\x03\x04": "a zip or Excel file",
}


@dataclass(frozen=True)
class Header:
    """The names of the columns of a samples file, in its own order.

    Attributes:
        place: The file.
        names: As they stand there, without the blanks around them.
        source: Its bytes, already within the limits.
        separator: Between the cells of a CSV.
    """

    place: Place
    names: tuple[str, ...]
    source: bytes
    separator: str = ","

    def read(self, wanted: Collection[str]) -> "Cells":
        """Read the wanted columns."""
        once = {name for name, count in Counter(self.names).items() if count == 1}
        wanted = once & set(wanted)
        index = {name: i for i, name in enumerate(self.names) if name in wanted}
        if not index:
            return Cells(self.place, {}, [])
        try:
            if self.place.has_lines:
                table, unread, faults = _csv_cells(self, sorted(index.values()))
                table = _without_last_blanks(table)
            else:
                table, unread, faults = unfolded(self.source, list(index)), (), []
        except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
            fault = f"{self.place.file} cannot be read: {first_line(error)}."
            return Cells(self.place, {}, [fault])
        by_name = {
            name: table.column(str(i) if self.place.has_lines else name)
            for name, i in index.items()
        }
        return Cells(replace(self.place, unread=unread), by_name, faults)


@dataclass(frozen=True)
class Cells:
    """Columns of a samples file, text or numbers, as they stand there.

    Attributes:
        place: The file, and which of its rows are not here.
        columns: By their name in the file.
        faults: Rows that are not of the table.
    """

    place: Place
    columns: Mapping[str, pa.ChunkedArray]
    faults: Sequence[str]


def open_csv(source: bytes, separator: str) -> tuple[Header | None, list[str]]:
    """Read the header of a CSV file."""
    for start, kind in _ENCODINGS.items():
        if source.startswith(start):
            fault = f"{CSV_FILE} is {kind}. Save it as CSV, UTF-8."
            return None, [fault]
    source = source.removeprefix(b"\xef\xbb\xbf")
    if fault := _garbage(source, separator):
        return None, [fault]
    text = source[: (source.find(b"\n") + 1) or None].decode()
    try:
        cells = next(csv.reader(io.StringIO(text), delimiter=separator, strict=True))
    except (StopIteration, csv.Error):
        return None, [f"{CSV_FILE}, line 1: there is no header."]
    names = tuple(cell.strip() for cell in cells)
    other = next((mark for mark in ";\t|" if mark in text), "")
    if len(names) == 1 and other:
        say = f"its columns stand apart by {other!r}; say so in [csv]: separator ="
        return None, [f"{CSV_FILE}, line 1: {say} {json.dumps(other)}."]
    return _checked(Header(Place(CSV_FILE, True), names, source, separator))


def open_parquet(source: bytes) -> tuple[Header | None, list[str]]:
    """Read the header of a parquet file, and how much it would unfold to."""
    try:
        names, fault = measured(source)
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        return None, [f"{PARQUET_FILE} cannot be read: {first_line(error)}."]
    if fault:
        return None, [fault]
    return _checked(Header(Place(PARQUET_FILE, False), names, source))


def _checked(header: Header) -> tuple[Header | None, list[str]]:
    names, file = header.names, header.place.file
    if len(names) > MAX_COLUMNS:
        return None, [f"{file} has {len(names)} columns; the most is {MAX_COLUMNS}."]
    twice = sorted(n for n, count in Counter(names).items() if n and count > 1)
    line = ", line 1" if header.place.has_lines else ""
    faults = [f"{file}{line}: column {quoted(n)} is there twice." for n in twice]
    return header, faults


def _garbage(source: bytes, separator: str) -> str:
    """Say where a file stops being UTF-8 text; empty where it is text throughout."""
    bad = source.find(b"\0")
    if bad < 0:
        try:
            source.decode()
        except UnicodeDecodeError as error:
            bad = error.start
    if bad < 0:
        return ""
    start = source.rfind(b"\n", 0, bad) + 1
    line = source.count(b"\n", 0, bad) + 1
    cell = source.count(separator.encode(), start, bad) + 1
    return (
        f"{CSV_FILE}, row {line - 1} (line {line}), column number {cell}: byte "
        f"0x{source[bad]:02x} is not UTF-8 text. Save the file as CSV, UTF-8."
    )


def _csv_cells(
    header: Header, wanted: list[int]
) -> tuple[pa.Table, tuple[int, ...], list[str]]:
    names = [str(i) for i in range(len(header.names))]
    ragged: list[tuple[int, int]] = []

    def note(row: pa_csv.InvalidRow) -> str:
        ragged.append((row.number or 0, row.actual_columns))
        return "skip"

    chosen = [str(i) for i in wanted]
    table = pa_csv.read_csv(
        pa.BufferReader(header.source),
        pa_csv.ReadOptions(
            use_threads=False, column_names=names, skip_rows=1, block_size=2**24
        ),
        pa_csv.ParseOptions(
            delimiter=header.separator,
            invalid_row_handler=note,
            ignore_empty_lines=False,
        ),
        pa_csv.ConvertOptions(
            column_types=dict.fromkeys(chosen, pa.string()),
            include_columns=chosen,
            strings_can_be_null=False,
        ),
    )
    file, count = header.place.file, len(names)
    faults = [
        f"{file}, row {line - 1} (line {line}): {cells} cells, but the header has "
        f"{count} columns."
        for line, cells in ragged[:SHOWN]
    ]
    if len(ragged) > SHOWN:
        faults.append(f"{file}: and {len(ragged) - SHOWN} more rows like these.")
    return table, tuple(line - 2 for line, _ in ragged), faults


def _without_last_blanks(table: pa.Table) -> pa.Table:
    """Drop empty lines at the end, which spreadsheets leave there."""
    length = table.num_rows
    while length and not any(c[length - 1].as_py().strip() for c in table.columns):
        length -= 1
    return table.slice(0, length)
