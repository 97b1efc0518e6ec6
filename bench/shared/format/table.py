"""Table of samples as CSV or Parquet: header, size limits, cells.

What to use when: `samples.csv` for people and spreadsheets, `samples.parquet` for
long streams. Both give the same `Cells`; nothing in them is evaluated. Separator,
encoding and header of a CSV are checked first; a parquet file is checked against size
limits before it is decompressed.
"""

import codecs
import csv
import io
import json
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pa_parquet

from bench.shared.format.faults import SHOWN, Place, first_line, line_of, quoted
from bench.shared.format.manifest import Csv

# --- Header of a CSV ------------------------------------------------------------------

CSV_FILE = "samples.csv"
SEPARATORS = ";\t|,"
"""Other separators that spreadsheets write, the most likely first."""
_ENCODINGS = {
    b"\xff\xfe": "UTF-16",
    b"\xfe\xff": "UTF-16",
    b"PK\x03\x04": "a zip or Excel file",
}


ENCODINGS = (
    *("utf-8", "utf-16", "cp1250", "cp1251", "cp1252", "latin-1", "iso-8859-15"),
    *("cp437", "cp850", "mac-roman", "shift_jis", "gb18030"),
)
"""What `[csv]` may name: what spreadsheets write."""
FIRST_LINES = 30
"""Lines among which a header is looked for (chosen: a page of remarks above it)."""


@dataclass(frozen=True)
class Heading:
    """The header of a CSV file.

    Attributes:
        names: Of the columns; none where there is no table.
        separator: What does stand between the cells.
        line: Of the header, from 0.
    """

    names: tuple[str, ...]
    separator: str
    line: int = 0


def decoded(
    source: bytes, encoding: str, separator: str = ","
) -> tuple[bytes | None, list[str]]:
    """Return a file as UTF-8, None where it is no text; and what is wrong with it.

    A file in another encoding than was said is a fault, and is read in its own.
    """
    encoding = encoding if is_encoding(encoding) else "utf-8"
    plain = _same_encoding(encoding, "utf-8")
    for start, kind in _ENCODINGS.items():
        if source.startswith(start) and not _same_encoding(encoding, kind):
            more = ', or say encoding = "utf-16" in [csv]' if kind == "UTF-16" else ""
            return None, [f"{CSV_FILE} is {kind}. Save it as CSV, UTF-8{more}."]
    if plain:
        fault = _garbage(source, separator)
        if not fault:
            return source.removeprefix(b"\xef\xbb\xbf"), []
        western = None if b"\0" in source else _in(source, "cp1252")
        if western is not None:
            fault += ' Or say what it is in [csv]: encoding = "cp1252", most likely.'
        return western, [fault]
    own = None if source.isascii() else _in(source, "utf-8")
    if own is not None:
        say = f"it is UTF-8, not {encoding}; leave out encoding in [csv]."
        return own.removeprefix(b"\xef\xbb\xbf"), [f"{CSV_FILE}: {say}"]
    text = _in(source, encoding)
    if text is None or b"\0" in text:
        return None, [f"{CSV_FILE}: it is no {encoding} text; see encoding in [csv]."]
    return text.removeprefix(b"\xef\xbb\xbf"), []


def is_encoding(name: str) -> bool:
    """Return whether `[csv]` may name an encoding so."""
    return any(_same_encoding(name, known) for known in ENCODINGS)


def _same_encoding(one: str, other: str) -> bool:
    try:
        return codecs.lookup(one).name == codecs.lookup(other).name
    except (LookupError, ValueError):
        return False


def _in(source: bytes, encoding: str) -> bytes | None:
    try:
        return source.decode(encoding).encode()
    except UnicodeError:
        return None


def heading_of(
    source: bytes, about: Csv, wanted: Collection[str] = ()
) -> tuple[Heading, list[str]]:
    """Read the names of the columns.

    A header that stands elsewhere is known by the wanted names.

    Returns:
        The header; and the faults, so that one wrong word does not hide what else is
        wrong.
    """
    separator = about.separator if is_separator(about.separator) else ""
    lines = source.split(b"\n", FIRST_LINES)[:FIRST_LINES]
    first = header_line(about.skip_rows)
    text = _line(source, first)
    names = _names(text, separator or ",")
    others = [separator, *(s for s in SEPARATORS if s != separator)]
    best = Heading(names, separator or ",", first)
    whole = text.count('"') % 2 == 0
    if whole and (_count(names, wanted) < 2 or not separator):
        for line in [first, *(k for k in range(len(lines)) if k != first)]:
            shown = lines[line].decode() if line < len(lines) else ""
            for other in (s for s in others if s):
                found = _names(shown, other)
                if _count(found, wanted) > max(_count(best.names, wanted), 1):
                    best = Heading(found, other, line)
    if best.names == names and len(names) < 2:
        for other in SEPARATORS:
            if len(found := _names(text, other)) > 1:
                best = Heading(found, other, first)
                break
    faults = []
    if separator and best.separator != separator:
        say = f"its columns stand apart by {best.separator!r}; say so in [csv]: "
        say += f"separator = {json.dumps(best.separator)}."
        faults.append(f"{CSV_FILE}, line {best.line + 1}: {say}")
    if best.line != first:
        say = "the names of the columns stand here; say so in [csv]: skip_rows = "
        no_rows = [*range(1, best.line + 1), *_lines_below(about, best.line)]
        faults.append(f"{CSV_FILE}, line {best.line + 1}: {say}{no_rows}.")
    if not best.names:
        say = "there is no header"
        if text.count('"') % 2:
            say = (
                "the name of a column goes on in the next line; write each in one line"
            )
        faults.append(f"{CSV_FILE}, line {first + 1}: {say}.")
    return best, faults


def is_separator(text: str) -> bool:
    """Return whether a text can stand between cells."""
    return len(text) == 1 and text.isascii() and text not in '\r\n"\0'


def header_line(skip_rows: int | tuple[int, ...]) -> int:
    """Return the line of the header, from 0: the first that is not left out."""
    if isinstance(skip_rows, int):
        return 0
    return next(k for k in range(len(skip_rows) + 1) if k + 1 not in skip_rows)


MOST_LEFT_OUT = 1_000_000
"""Rows below a header that may be said to be no readings (chosen)."""


def rows_left_out(skip_rows: int | tuple[int, ...], above: int) -> tuple[int, ...]:
    """Return which rows are said to be no readings, from 0 below the header."""
    if isinstance(skip_rows, int):
        return tuple(range(min(max(skip_rows, 0), MOST_LEFT_OUT)))
    return tuple(sorted({n - 2 - above for n in skip_rows if n - 2 - above >= 0}))


def _lines_below(about: Csv, line: int) -> list[int]:
    """Return the lines below a header that were said to be no rows."""
    return [r + 2 + line for r in rows_left_out(about.skip_rows, line)]


def _count(names: Collection[str], wanted: Collection[str]) -> int:
    return len(set(names) & set(wanted))


def _line(source: bytes, number: int) -> str:
    lines = source.split(b"\n", number + 1)
    return (lines[number] + b"\n").decode() if number < len(lines) else ""


def _names(text: str, separator: str) -> tuple[str, ...]:
    """Return the names in a line; none where it is not of a table."""
    try:
        cells = next(csv.reader(io.StringIO(text), delimiter=separator, strict=True))
    except (StopIteration, csv.Error):
        return ()
    return tuple(cell.strip() for cell in cells)


def _garbage(source: bytes, separator: str) -> str:
    """Return where a file is not UTF-8 text; empty where it is throughout."""
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
    cell = source.count(separator.encode() or b",", start, bad) + 1
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
    """Return the names of the columns, and which limit is exceeded; empty if none.

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
    """Return some columns.

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
    """Header of a samples file: names of its columns, in its own order.

    Attributes:
        location: The file.
        names: As they stand there, without the blanks around them.
        source: Its bytes, already within the limits.
        left_out: Rows below the header that are said to be no readings, from zero.
        may_be_short: Whether a row with fewer cells is left out and no fault.
    """

    location: Place
    names: tuple[str, ...]
    source: bytes
    separator: str = ","
    left_out: tuple[int, ...] = ()
    may_be_short: bool = False

    def read(self, wanted: Collection[str]) -> "Cells":
        """Read the wanted columns."""
        once = {name for name, count in Counter(self.names).items() if count == 1}
        wanted = once & set(wanted)
        index = {name: i for i, name in enumerate(self.names) if name in wanted}
        if not index:
            return Cells(self.location, {}, [])
        try:
            if self.location.has_lines:
                table, unread, short, faults = _csv_cells(self, sorted(index.values()))
                table = _without_last_blanks(table)
            else:
                table, faults = unfolded(self.source, list(index)), []
                unread, short = (), ()
        except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
            fault = f"{self.location.file} cannot be read: {first_line(error)}."
            return Cells(self.location, {}, [fault])
        by_name = {
            name: table.column(str(i) if self.location.has_lines else name)
            for name, i in index.items()
        }
        location = replace(self.location, unread=unread)
        cells = Cells(location, by_name, faults, short)
        rows = np.flatnonzero(np.isin(location.rows(cells.rows), self.left_out))
        return cells.drop(rows.tolist())


@dataclass(frozen=True)
class Cells:
    """Columns of a samples file, text or numbers, as in the file.

    Attributes:
        location: The file, and which of its rows are not here.
        faults: Rows that are not of the table.
        short: Rows of the file that are left out because they have fewer cells.
    """

    location: Place
    columns: Mapping[str, pa.ChunkedArray]
    faults: Sequence[str]
    short: tuple[int, ...] = ()

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(next(iter(self.columns.values()), ()))

    def drop(self, rows: Collection[int]) -> "Cells":
        """Return the cells without some rows, counted from zero."""
        if not len(rows):
            return self
        numbers = self.location.rows(self.rows)
        kept = np.ones(self.rows, dtype=bool)
        kept[list(rows)] = False
        unread = (*self.location.unread, *(int(n) for n in numbers[~kept]))
        columns = {n: c.filter(pa.array(kept)) for n, c in self.columns.items()}
        location = replace(self.location, unread=tuple(sorted(unread)))
        return replace(self, location=location, columns=columns)


def open_csv(
    source: bytes, about: Csv | None = None, wanted: Collection[str] = ()
) -> tuple[Header | None, list[str]]:
    """Read the header of a CSV file; one written otherwise is a fault, and read.

    A header that stands elsewhere is known by the wanted names.
    """
    about = about or Csv()
    text, faults = decoded(source, about.encoding, about.separator)
    if text is None:
        return None, faults
    heading, found = heading_of(text, about, wanted)
    faults += found
    if not heading.names:
        return None, faults
    above = heading.line
    header = Header(
        Place(CSV_FILE, True, above=above),
        heading.names,
        text,
        heading.separator,
        rows_left_out(about.skip_rows, above),
        about.skip_incomplete,
    )
    checked, found = _checked(header)
    return checked, faults + found


def open_parquet(source: bytes) -> tuple[Header | None, list[str]]:
    """Return the header of a parquet file, after a check of its decompressed size."""
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
    place = header.location
    line = f", line {place.above + 1}" if place.has_lines else ""
    faults = [f"{file}{line}: column {quoted(n)} is there twice." for n in twice]
    return header, faults


def _csv_cells(
    header: Header, wanted: list[int]
) -> tuple[pa.Table, tuple[int, ...], tuple[int, ...], list[str]]:
    """Read columns; which rows are not among them, those too short; and the faults."""
    names = [str(i) for i in range(len(header.names))]
    ragged: list[tuple[int, int]] = []
    above = header.location.above

    def note(row: pa_csv.InvalidRow) -> str:
        ragged.append(((row.number or 0) - 2 - above, row.actual_columns))
        return "skip"

    chosen = [str(i) for i in wanted]
    source = header.source
    table = pa_csv.read_csv(
        pa.BufferReader(source if source.endswith(b"\n") else source + b"\n"),
        pa_csv.ReadOptions(
            use_threads=False, column_names=names, skip_rows=1 + above, block_size=2**24
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
    short = {r for r, n in ragged if n < count and header.may_be_short}
    short -= set(header.left_out)
    wrong = [(r, n) for r, n in ragged if r not in {*short, *header.left_out}]
    faults = [
        f"{file}, {line_of(row, above)}: {cells} cells, but the header has {count} "
        "columns."
        for row, cells in wrong[:SHOWN]
    ]
    if len(wrong) > SHOWN:
        faults.append(f"{file}: and {len(wrong) - SHOWN} more rows like these.")
    return table, tuple(row for row, _ in ragged), tuple(sorted(short)), faults


def _without_last_blanks(table: pa.Table) -> pa.Table:
    """Return cells without empty lines at the end, which spreadsheets write."""
    length = table.num_rows
    while length and not any(c[length - 1].as_py().strip() for c in table.columns):
        length -= 1
    return table.slice(0, length)
