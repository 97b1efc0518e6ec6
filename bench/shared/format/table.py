"""Table of samples as CSV or Parquet: header, size limits, cells.

The first line of a CSV names its columns, and tells what stands between cells.

A parquet file is small for what it holds, so it is measured before it unfolds.

The samples are a table of text or of numbers, read whole or refused with reasons.

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
import pyarrow.parquet as pa_parquet

from bench.shared.format.faults import SHOWN, Place, first_line, line_of, quoted

# --- Header of a CSV ------------------------------------------------------------------

CSV_FILE = "samples.csv"
SEPARATORS = ";\t|,"
"""What else a spreadsheet puts between cells, likeliest first."""
_ENCODINGS = {
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
    b"PK\x03\x04": "a zip or Excel file",
}


def heading_of(source: bytes, separator: str) -> tuple[tuple[str, ...], str, list[str]]:
    """Read the names of the columns.

    Args:
        source: The whole file, without a byte order mark of UTF-8.
        separator: What is said to stand between its cells.

    Returns:
        The names, none where there is no table; what does stand between the cells; and
        the faults, so that one wrong word does not hide what else is wrong.
    """
    for start, kind in _ENCODINGS.items():
        if source.startswith(start):
            fault = f"{CSV_FILE} is {kind}. Save it as CSV, UTF-8."
            return (), separator, [fault]
    if fault := _garbage(source, separator):
        return (), separator, [fault]
    text = source[: (source.find(b"\n") + 1) or None].decode()
    names = _names(text, separator)
    if len(names) < 2:
        for other in SEPARATORS:
            if len(found := _names(text, other)) > 1:
                say = f"its columns stand apart by {other!r}; say so in [csv]: "
                fault = f"{CSV_FILE}, line 1: {say}separator = {json.dumps(other)}."
                return found, other, [fault]
    say = "there is no header"
    if text.count('"') % 2:
        say = "the name of a column goes on in the next line; write each in one line"
    return names, separator, [] if names else [f"{CSV_FILE}, line 1: {say}."]


def _names(text: str, separator: str) -> tuple[str, ...]:
    """Return the names in a line; none where it is not of a table."""
    try:
        cells = next(csv.reader(io.StringIO(text), delimiter=separator, strict=True))
    except (StopIteration, csv.Error):
        return ()
    return tuple(cell.strip() for cell in cells)


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
        f"{CSV_FILE}, {line_of(line - 2)}, column number {cell}: byte "
        f"0x{source[bad]:02x} is not UTF-8 text. Save the file as CSV, UTF-8."
    )


# --- Parquet --------------------------------------------------------------------------

PARQUET_FILE = "samples.parquet"
MAX_CELLS = 150_000_000
"""Most cells of a table (chosen: 1.2 GB)."""
MAX_SIZE = 8 * MAX_CELLS
"""Most bytes of one, unpacked (chosen: its cells as numbers)."""


def measured(source: bytes) -> tuple[tuple[str, ...], str]:
    """Return the names of the columns, and what is too large; empty where nothing.

    Raises:
        ArrowException, OSError, ValueError, OverflowError: Where it is no parquet file.
    """
    about = pa_parquet.ParquetFile(pa.BufferReader(source))
    parts = [about.metadata.row_group(g) for g in range(about.num_row_groups)]
    cells = sum(
        part.column(c).num_values for part in parts for c in range(part.num_columns)
    )
    size = sum(part.total_byte_size for part in parts)
    names = tuple(about.schema_arrow.names)
    if cells > MAX_CELLS:
        return names, f"{PARQUET_FILE} holds {cells} cells; the most is {MAX_CELLS}."
    if size > MAX_SIZE:
        return names, f"{PARQUET_FILE} unfolds to {size} B; the most is {MAX_SIZE}."
    return names, ""


def unfolded(source: bytes, wanted: Collection[str]) -> pa.Table:
    """Read some columns.

    Raises:
        ValueError: Where few long words stand in many rows.
    """
    buffer = pa.BufferReader(source)
    schema = pa_parquet.ParquetFile(buffer).schema_arrow
    words = [field.name for field in schema if _is_text(field.type)]
    file = pa_parquet.ParquetFile(buffer, read_dictionary=words)
    table = file.read(columns=list(wanted), use_threads=False)
    for name in set(words) & set(wanted):
        longest = sum(part.dictionary.nbytes for part in table.column(name).chunks)
        if longest * table.num_rows > MAX_SIZE:
            raise ValueError(f"column {quoted(name)} unfolds to over {MAX_SIZE} B")
    return table


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind)


# --- Samples --------------------------------------------------------------------------

MAX_BYTES = 512 * 2**20
"""Largest samples file (chosen: 30 columns at 250 Hz for 90 minutes)."""
MAX_COLUMNS = 10_000
"""Most columns (chosen: 3,000 markers)."""


@dataclass(frozen=True)
class Header:
    """The names of the columns of a samples file, in its own order.

    Attributes:
        location: The file.
        names: As they stand there, without the blanks around them.
        source: Its bytes, already within the limits.
        separator: Between the cells of a CSV.
    """

    location: Place
    names: tuple[str, ...]
    source: bytes
    separator: str = ","

    def read(self, wanted: Collection[str]) -> "Cells":
        """Read the wanted columns."""
        once = {name for name, count in Counter(self.names).items() if count == 1}
        wanted = once & set(wanted)
        index = {name: i for i, name in enumerate(self.names) if name in wanted}
        if not index:
            return Cells(self.location, {}, [])
        try:
            if self.location.has_lines:
                table, unread, faults = _csv_cells(self, sorted(index.values()))
                table = _without_last_blanks(table)
            else:
                table, unread, faults = unfolded(self.source, list(index)), (), []
        except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
            fault = f"{self.location.file} cannot be read: {first_line(error)}."
            return Cells(self.location, {}, [fault])
        by_name = {
            name: table.column(str(i) if self.location.has_lines else name)
            for name, i in index.items()
        }
        return Cells(replace(self.location, unread=unread), by_name, faults)


@dataclass(frozen=True)
class Cells:
    """Columns of a samples file, text or numbers, as they stand there.

    Attributes:
        location: The file, and which of its rows are not here.
        columns: By their name in the file.
        faults: Rows that are not of the table.
    """

    location: Place
    columns: Mapping[str, pa.ChunkedArray]
    faults: Sequence[str]


def open_csv(source: bytes, separator: str) -> tuple[Header | None, list[str]]:
    """Read the header of a CSV file; one that is cut otherwise is a fault, and read."""
    source = source.removeprefix(b"\xef\xbb\xbf")
    names, separator, faults = heading_of(source, separator)
    if not names:
        return None, faults
    header, found = _checked(Header(Place(CSV_FILE, True), names, source, separator))
    return header, faults + found


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
    names, file = header.names, header.location.file
    if len(names) > MAX_COLUMNS:
        return None, [f"{file} has {len(names)} columns; the most is {MAX_COLUMNS}."]
    twice = sorted(n for n, count in Counter(names).items() if n and count > 1)
    line = ", line 1" if header.location.has_lines else ""
    faults = [f"{file}{line}: column {quoted(n)} is there twice." for n in twice]
    return header, faults


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
    file, count = header.location.file, len(names)
    faults = [
        f"{file}, {line_of(line - 2)}: {cells} cells, but the header has {count} "
        "columns."
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
