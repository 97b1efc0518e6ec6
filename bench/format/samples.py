"""The samples are a table of text or of numbers, read whole or refused with reasons.

What to use when: `samples.csv` for people and spreadsheets, `samples.parquet` for
long streams. Both come out as the same `Table`; nothing in them is evaluated.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import pyarrow as pa
import pyarrow.csv as pa_csv

from bench.format.faults import SHOWN, Place, line_of, quoted
from bench.format.heading import CSV_FILE, heading_of
from bench.format.parquet import PARQUET_FILE, measured, unfolded
from bench.format.sections import first_line

MAX_BYTES = 512 * 2**20
"""Largest samples file (chosen: 30 columns at 250 Hz for 90 minutes)."""
MAX_COLUMNS = 10_000
"""Most columns (chosen: 3,000 markers)."""


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
    names, file = header.names, header.place.file
    if len(names) > MAX_COLUMNS:
        return None, [f"{file} has {len(names)} columns; the most is {MAX_COLUMNS}."]
    twice = sorted(n for n, count in Counter(names).items() if n and count > 1)
    line = ", line 1" if header.place.has_lines else ""
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
    file, count = header.place.file, len(names)
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
