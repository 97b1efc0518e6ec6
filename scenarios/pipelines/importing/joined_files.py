"""Joins several CSV files into one recording, row by row or on the clock of the axes.

The first file holds the axes. Another one gives its columns to the same rows: the k-th
reading of each belongs together, and rows of units, empty lines and lines that are left
out are no readings. Or it has a clock of its own, and then what is kept is one row for
each reading of the slowest.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Int

from bench.shared.errors import Unusable, refuse
from bench.shared.format.faults import Place
from bench.shared.format.folder import LEFT_ALONE
from bench.shared.format.table import CSV_FILE, Header, open_csv
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording
from scenarios.pipelines.importing import spreadsheet
from scenarios.pipelines.importing.clocks import Channel, rows_of
from scenarios.pipelines.importing.log_files import (
    Read,
    header_of,
    in_names_of,
    log_of,
    missing_of,
    offsets_of,
    required_columns_of,
    unread_of,
    without_jumps,
)
from scenarios.pipelines.importing.mapping import Extras, Log

# --- Row by row -----------------------------------------------------------------------

_CELL = re.compile(r"line \d+ \(row (\d+) below the header\), column '([^.']+)\.(.*)")
"""How a fault of a cell begins whose column came from another file."""


@dataclass(frozen=True)
class JoinedRows:
    """Columns of further files beside the rows of the first.

    Attributes:
        lines: For each row of the first file, from 0, the row of the other one.
    """

    columns: int = 0
    files: Mapping[str, Place] = field(default_factory=dict)
    lines: Mapping[str, Mapping[int, int]] = field(default_factory=dict)

    def in_own_lines(self, fault: str) -> str:
        """Name file and line of a cell as they are where it stands."""
        match = _CELL.search(fault)
        if match is None or match[2] not in self.files:
            return fault
        own = self.lines[match[2]].get(int(match[1]) - 1)
        place = self.files[match[2]]
        row = place.file if own is None else place.row(own)
        return f"{row}, column '{match[3]}"


def with_rows_of(
    source: bytes,
    manifest: Mapping[str, Any],
    extras: Extras,
    files: Mapping[str, Log],
    beside: Path,
) -> tuple[bytes, JoinedRows, list[str], list[str]]:
    """Add the columns of further files to a CSV, row by row.

    Returns:
        The CSV with their columns; what was added; notes; and all faults, in the names
        and lines of the files.
    """
    about = spreadsheet.csv_of(manifest)
    first, _ = open_csv(source, about, spreadsheet.names_in(manifest))
    notes: list[str] = []
    faults: list[str] = []
    if first is None or not files:
        return source, JoinedRows(), notes, faults
    rows = _readings(first, [*first.names])
    places, lines, columns = {}, {}, {}
    for name, log in files.items():
        wanted, found = required_columns_of(name, manifest, extras)
        faults += found
        if not wanted.columns:
            continue
        zeros = {f"{name}.{c}": np.zeros(len(rows)) for c in wanted.columns}
        columns |= zeros  # so that a fault here makes none there
        header, found = header_of(name, log, wanted, beside, manifest)
        if header is None:
            faults += found
            continue
        found += missing_of(header, [*wanted.columns])
        notes += [
            f"{log.file}: column {c!r} {LEFT_ALONE}"
            for c in unread_of(header, wanted.columns)
        ]
        own = _readings(header, [*wanted.columns])
        if len(own) != len(rows) and not found:
            found.append(
                f"{CSV_FILE} has {_many(own)} and FILE {_many(rows)}; joined row by "
                "row they must be as many."
            )
        mark = log.decimal or about.mark
        blank = {n: about.skip_incomplete or may for n, may in wanted.columns.items()}
        held = spreadsheet.plain(blank)
        values, cells, more = spreadsheet.numbers_of(header, held, mark)
        faults += in_names_of(log, [*found, *more])
        if not found:
            at = np.searchsorted(own, cells.location.rows(cells.rows))
            for c, column in values.items():
                full = np.full(len(rows), np.nan)
                full[at] = column
                columns[f"{name}.{c}"] = full
            places[name] = Place(log.file, True, above=header.location.above)
            lines[name] = dict(zip(rows.tolist(), own.tolist(), strict=True))
    joined = spreadsheet.with_columns(first, about.mark, columns, rows)
    return joined, JoinedRows(len(columns), places, lines), notes, faults


def _many(rows: Int[np.ndarray, " rows"]) -> str:
    return f"{len(rows)} {'reading' if len(rows) == 1 else 'readings'}"


def _readings(header: Header, names: list[str]) -> Int[np.ndarray, " rows"]:
    """Return the rows of a file that are readings, whole or not."""
    cells, _ = spreadsheet.kept_of(
        header, spreadsheet.plain(dict.fromkeys(names, True))
    )
    ragged = set(header.read(names).location.unread) - {*header.left_out}
    return np.array(sorted({*cells.location.rows(cells.rows).tolist(), *ragged}), int)


# --- The joined recording -------------------------------------------------------------

COUNTS = re.compile(r"(\d+) cells, but the header has (\d+) columns")
"""How the format's reader says that a row is too long or too short."""


@dataclass(frozen=True)
class Joined:
    """Several files as one recording."""

    recording: Recording
    notes: tuple[str, ...]
    clock_notes: tuple[str, ...] = ()


def recording_of(
    path: Path,
    manifest: Mapping[str, Any],
    extras: Extras,
    model: ModelFacts | None,
    names: tuple[str, str],
    faulty: bool = False,
) -> Joined:
    """Read all files and join them, row by row or instant by instant.

    The CSV holds the axes, the others are beside it; `names` are what the user calls
    the CSV and the mapping. Where the mapping has faults, clocks are no matter.

    Returns:
        The recording, notes on columns, and what was said of the clocks.

    Raises:
        Unusable: With all faults of all files; then of all their clocks.
    """
    source, manifest, faults = spreadsheet.as_utf8(
        spreadsheet.source_of(path), manifest
    )
    rows = {n: log for n, log in extras.files.items() if log.join == "rows"}
    source, by_row, notes, found = with_rows_of(
        source, manifest, extras, rows, path.parent
    )
    faults += found
    clocks = {n: log for n, log in extras.files.items() if n not in rows}
    reads, more, found = _read(path.parent, manifest, extras, clocks)
    faults, notes = [*faults, *found], [*notes, *more]
    zeros = {
        f"{name}.{c}": Channel(np.zeros(1), np.zeros((1, 1)))
        for name in clocks
        for c in required_columns_of(name, manifest, extras)[0].columns
    }
    added = len(zeros) + by_row.columns
    bare = None
    try:
        bare = _joined(source, manifest, extras, model, names, zeros, None)
    except Unusable as error:
        said = [COUNTS.sub(lambda m: _fewer(m, added), f) for f in error.faults]
        faults += [by_row.in_own_lines(f) for f in said]
    whole = f"{names[0]} with {names[1]}"
    if bare is None or faults:
        raise Unusable(whole, list(dict.fromkeys(faults)))
    axes, told = bare.recording, []
    notes = [*bare.notes, *notes]
    if not clocks or faulty:
        return Joined(axes, tuple(notes))
    offsets, told, faults = offsets_of(axes, reads, names[1])
    refuse(whole, faults)
    columns: dict[str, Channel] = {}
    covered, stamps = np.full(len(axes.time), True), []
    for read in reads:
        time = read.channel.time + offsets[read.name]
        smooth = without_jumps(read.channel, read.name, read.required_columns, extras)
        for c, values in zip(
            read.required_columns.columns, smooth.values.T, strict=True
        ):
            columns[f"{read.name}.{c}"] = Channel(time, values[:, None])
        covers = Channel(time, smooth.values).covers(axes.time, read.log.gap_s)
        if not covers.any():
            faults.append(_apart(read, time, axes.time, names[0]))
        covered &= covers
        stamps += [time] if read.required_columns.tracked else []
    near = rows_of(axes.time, stamps)
    rows = near[covered[near]]
    if not len(rows) and not faults:
        faults = ["there is no instant that all files cover."]
    refuse(whole, faults)
    joined = _joined(source, manifest, extras, model, names, columns, bare)
    counts = f"{len(rows)} of {len(axes.time)} rows of {names[0]} kept"
    told.append(f"{counts}: covered by all files, one for each reading of the slowest.")
    return Joined(joined.recording.take(rows), tuple(notes), tuple(told))


def _read(
    beside: Path, manifest: Mapping[str, Any], extras: Extras, clocks: Mapping[str, Log]
) -> tuple[list[Read], list[str], list[str]]:
    reads, notes, faults = [], [], []
    for name, log in clocks.items():
        wanted, found = required_columns_of(name, manifest, extras)
        faults += found
        if not wanted.columns or log.time is None:
            continue
        channel, unread, found = log_of(name, log, wanted, beside, manifest)
        faults += found
        notes += [f"{log.file}: column {c!r} {LEFT_ALONE}" for c in unread]
        if channel is not None:
            reads.append(Read(name, log, wanted, channel))
    return reads, notes, faults


def _joined(
    source: bytes,
    manifest: Mapping[str, Any],
    extras: Extras,
    model: ModelFacts | None,
    names: tuple[str, str],
    columns: Mapping[str, Channel],
    bare: spreadsheet.Read | None,
) -> spreadsheet.Read:
    """Read the axes' file with columns of others, zero until clocks are known."""
    about = spreadsheet.csv_of(manifest)
    header, _ = open_csv(source, about, spreadsheet.names_in(manifest))
    if header is not None and columns:
        rows = np.arange(header.source.count(b"\n") - header.location.above)
        time = np.zeros(len(rows))
        if bare is not None:
            rows, time = bare.rows, bare.recording.time
        added = {name: channel.at(time)[:, 0] for name, channel in columns.items()}
        source = spreadsheet.with_columns(header, about.mark, added, rows)
    return spreadsheet.recording_of(source, manifest, extras.targets, model, names)


def _apart(read: Read, time: np.ndarray, axes: np.ndarray, first: str) -> str:
    gap = f"{read.log.gap_s:g} s"
    theirs = f"{axes[0]:.3f} to {axes[-1]:.3f} s"
    own = f"{time[0]:.3f} to {time[-1]:.3f} s on that clock"
    return (
        f"{read.log.file} covers no row of {first}: it has {own}, {first} has {theirs};"
        f" between readings more than {gap} apart nothing is made up (gap_s)."
    )


def _fewer(counts: re.Match[str], added: int) -> str:
    """Count the cells that the user's own file has."""
    cells, columns = (int(c) - added for c in counts.groups())
    return f"{cells} cells, but the header has {columns} columns"
