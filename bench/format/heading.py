"""The first line of a CSV names its columns, and tells what stands between cells."""

import csv
import io
import json

from bench.format.faults import line_of

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
