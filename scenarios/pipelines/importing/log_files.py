"""Joins several CSV files with clocks of their own on the clock of the axes.

A mapping takes a further CSV's columns by NAME.column, for markers or a wrench.

A further CSV of a mapping has a clock of its own and is read by its own rules.

A log's time and its offset is the axes' time: stated, shared, or seen in motion.

Several CSV files with clocks of their own become one on the clock of the axes.

The first file holds the axes. Another file's time and a number, its offset, is theirs:
stated, that of a file by the same clock, or found from the motion that both saw.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bench.shared.errors import Unusable
from bench.shared.format.cells import all_values_of
from bench.shared.format.columns import (
    COORDINATES,
    COUNT,
    UNITS,
    WORD,
    WRENCH,
    Column,
    Held,
    Unit,
    column_of,
)
from bench.shared.format.faults import nearest, quoted
from bench.shared.format.manifest import Source
from bench.shared.format.table import CSV_FILE, Header, open_csv
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording
from scenarios.pipelines.importing import spreadsheet
from scenarios.pipelines.importing.clocks import (
    Channel,
    Lag,
    lag_between,
    lag_text,
    on_one_side,
    rows_of,
    shift_of,
)
from scenarios.pipelines.importing.mapping import Extras, Log
from scenarios.pipelines.importing.spreadsheet import columns_of, marks_of, source_of

# --- Required columns -----------------------------------------------------------------


@dataclass(frozen=True)
class RequiredColumns:
    """What a mapping takes from a file.

    Attributes:
        columns: Which may be blank, by their names there.
        groups: Names of what sees one motion, best first: a marker, a target, a force.
        tracked: Whether markers or targets are among them.
    """

    columns: Mapping[str, bool]
    groups: tuple[tuple[str, ...], ...]
    tracked: bool


def required_columns_of(
    name: str, manifest: Mapping[str, Any], extras: Extras
) -> tuple[RequiredColumns, list[str]]:
    """Find which columns a mapping takes from a file, and what it may not take."""
    columns: dict[str, bool] = {}
    markers: dict[str, list[str]] = {}
    others: dict[str, list[str]] = {}
    faults = []
    start = f"{name}."
    for said, entry in manifest.get("columns", {}).items():
        source = entry.get("from") if isinstance(entry, dict) else entry
        if not isinstance(source, str) or not source.startswith(start):
            continue
        column = column_of(said, manifest.get("markers", {}))
        if column is None:
            continue  # the format's reader says why
        turns = column.axis > 0 and said.endswith(("_deg", "_mm"))
        own = turns and not said.endswith("_link_deg")
        if own or column.kind in (COUNT, WORD, "time"):
            faults.append(
                f"columns.{said}: {source!r} cannot come from [files.{name}]; the axes,"
                " their time, counts and words stand in FILE itself."
            )
            continue
        own_name = source.removeprefix(start)
        columns[own_name] = column.may_be_blank
        if said.endswith(COORDINATES):
            markers.setdefault(said[:-5], []).append(own_name)
        elif said in WRENCH[:3] or column.axis:
            others.setdefault(said[:1] + said[-3:], []).append(own_name)
    for target in extras.targets.values():
        own = [c.removeprefix(start) for c in columns_of(target) if c.startswith(start)]
        columns |= dict.fromkeys(own, True)
        if all(c.startswith(start) for c in target.position):
            markers[f"target {target.position}"] = own[:3]
    if not columns and not faults:
        say = f'no column is taken from it; write from = "{name}.COLUMN".'
        faults.append(f"files.{name}: {say}")
    groups = tuple(tuple(g) for g in (*markers.values(), *others.values()))
    return RequiredColumns(columns, groups, bool(markers)), faults


# --- One log --------------------------------------------------------------------------

TIME = Column("time_s", "time")


def log_of(
    name: str,
    log: Log,
    wanted: RequiredColumns,
    beside: Path,
    manifest: Mapping[str, Any],
) -> tuple[Channel | None, tuple[str, ...], list[str]]:
    """Read a file.

    Args:
        name: Of the file in the mapping.
        log: Where it is and what its time is.
        wanted: Columns, the order of the channel's values.
        beside: The folder that it may not leave.
        manifest: Whose `[csv]` holds unless the file says other.

    Returns:
        Its readings, None where it has faults; columns that nothing reads; its faults.
    """
    path = beside / log.file
    if not path.resolve().is_relative_to(beside.resolve()):
        say = f"{quoted(log.file)} is outside the folder of FILE."
        return None, (), [f"files.{name}.file: {say}"]
    try:
        source = source_of(path)
    except Unusable as error:
        return None, (), [f"files.{name}.file, {log.file}: {f}" for f in error.faults]
    separator, mark = marks_of(manifest)
    header, faults = open_csv(source, (log.separator or separator)[:1] or ",")
    channel = None
    stamp = log.time if isinstance(log.time, str) else log.time.from_ or "time_s"
    if header is not None:
        faults += _missing(header, [stamp, *wanted.columns])
        clock = log.time if isinstance(log.time, Source) else Source()
        if clock.unit not in (None, *UNITS["time"]):
            known = ", ".join(UNITS["time"])
            faults.append(f"its time: {quoted(clock.unit)} is not one of: {known}.")
        if not faults:
            held = Held(TIME, stamp, TIME.unit(clock.unit))
            channel, faults = _readings(header, held, wanted, log.decimal or mark)
    names = header.names if header else ()
    unread = tuple(c for c in names if c and c not in (stamp, *wanted.columns))
    if faults:
        named = [f.replace(CSV_FILE, log.file) for f in faults]
        return None, (), [f if log.file in f else f"{log.file}: {f}" for f in named]
    return channel, unread, []


def _missing(header: Header, names: list[str]) -> list[str]:
    return [
        f"{CSV_FILE}: column {c!r} is missing, which the mapping asks for."
        f"{nearest(c, header.names)}"
        for c in names
        if c not in header.names
    ]


def _readings(
    header: Header, time: Held, wanted: RequiredColumns, mark: str
) -> tuple[Channel, list[str]]:
    cells = header.read({time.source, *wanted.columns})
    held = {
        c: Held(Column(c, "length", may_be_blank=blank), c, Unit())
        for c, blank in wanted.columns.items()
    }
    values, found = all_values_of({**held, "": time}, cells, mark)
    faults = [*cells.faults, *found]
    stamps = values.pop("")
    back = np.flatnonzero(np.diff(stamps) < 0) + 1
    faults += cells.location.at(time.source, back, lambda _: "time runs backwards.")
    if not len(stamps):
        faults.append(f"{CSV_FILE}: it has no rows.")
    read = np.stack([values[c] for c in wanted.columns], axis=1)
    return Channel(stamps, read), faults


def without_jumps(
    channel: Channel, name: str, wanted: RequiredColumns, extras: Extras
) -> Channel:
    """Let turns go on where their numbers jump: lines between them stay turns."""
    values = channel.values.copy()
    order = list(wanted.columns)
    for target in extras.targets.values():
        turn = target.quaternion_wxyz or target.rotation or ()
        own = [c.removeprefix(f"{name}.") for c in turn if c.startswith(f"{name}.")]
        at = [order.index(c) for c in own]
        if len(own) == 4:
            values[:, at] = on_one_side(values[:, at])
        elif len(own) == 3:
            full = 360.0 if target.angle_unit == "deg" else 2.0 * np.pi
            seen = np.isfinite(values[:, at]).all(axis=1)
            for k in at:
                values[seen, k] = np.unwrap(values[seen, k], period=full)
    return Channel(channel.time, values)


# --- Clock offsets of the logs --------------------------------------------------------


@dataclass(frozen=True)
class Read:
    """A file as it was read.

    Attributes:
        name: In the mapping.
        log: What the mapping says of it.
        required_columns: What is taken from it.
        channel: Its readings, by its own clock.
    """

    name: str
    log: Log
    required_columns: RequiredColumns
    channel: Channel

    @property
    def motion(self) -> Channel | None:
        """The marker, or what else, that was read most often; None for none."""
        order, values = list(self.required_columns.columns), self.channel.values
        groups = [
            values[:, [order.index(c) for c in g]] for g in self.required_columns.groups
        ]
        seen = [np.isfinite(v).all(axis=1) for v in groups]
        if not groups:
            return None
        best = max(range(len(groups)), key=lambda k: int(seen[k].sum()))
        return Channel(self.channel.time[seen[best]], groups[best][seen[best]])


def offsets_of(
    axes: Recording, reads: Sequence[Read], mapping: str
) -> tuple[dict[str, float], list[str], list[str]]:
    """Find what to add to each file's time.

    Args:
        axes: By the clock that is wanted.
        reads: The files.
        mapping: What the user calls the mapping, for the faults.

    Returns:
        The offsets in s, what to say of them, and a fault for each that nothing tells.
    """
    offsets: dict[str, float] = {}
    told, faults = [], []
    for read in sorted(reads, key=lambda r: r.log.clock is not None):
        log, motion = read.log, read.motion
        clock = next((r for r in reads if r.name == log.clock), None)
        if log.offset_s is None and clock is None:
            shift: Lag | str = "nothing in it moves with the arm"
            if motion is not None:
                shift = shift_of(axes.time, axes.posture, motion.time, motion.values)
            if isinstance(shift, str):
                say = f"say offset_s or clock in {mapping}, files.{read.name}"
                why = f"its clock cannot be told from the motion: {shift}; {say}."
                faults.append(f"{log.file}: {why}")
                continue
            offsets[read.name] = -shift.seconds
            how = f"found from the motion, {shift.within()}; its own lag is in it"
        elif clock is None:
            offsets[read.name] = log.offset_s or 0.0
            how = "as stated"
        elif clock.name in offsets:
            offsets[read.name] = offsets[clock.name]
            how = f"by the clock of {clock.log.file}"
        else:
            continue  # that file's fault is said
        offset = offsets[read.name]
        told.append(f"{log.file}: its time {offset:+.4f} s is that of the axes, {how}.")
        if motion is not None and (log.offset_s is not None or clock is not None):
            time = motion.time + offset
            lag = lag_between(axes.time, axes.posture, time, motion.values)
            told.append(f"Lag of {log.file} behind the axes: {lag_text(lag)}.")
    return offsets, told, faults


# --- The joined recording -------------------------------------------------------------

COUNTS = re.compile(r"(\d+) cells, but the header has (\d+) columns")
"""How the format's reader says that a row is too long or too short."""


def recording_of(
    path: Path,
    manifest: Mapping[str, Any],
    extras: Extras,
    model: ModelFacts | None,
    names: tuple[str, str],
) -> tuple[Recording, tuple[str, ...], list[str]]:
    """Read all files and join them instant by instant.

    Args:
        path: The CSV that holds the axes; the others are beside it.
        manifest: What the format's manifest says.
        extras: With `[files]`.
        model: Names and limits of the robot; None checks neither.
        names: What the user calls the CSV and the mapping, for the faults.

    Returns:
        The stream, notes on columns, and what was said of the clocks.

    Raises:
        Unusable: With all faults of all files; then of all their clocks.
    """
    source = spreadsheet.source_of(path)
    reads, notes, faults = _read(path.parent, manifest, extras)
    zeros = {
        f"{name}.{c}": Channel(np.zeros(1), np.zeros((1, 1)))
        for name in extras.files
        for c in required_columns_of(name, manifest, extras)[0].columns
    }
    try:
        bare = _joined(source, manifest, extras, model, names, zeros, np.zeros(1))
    except Unusable as error:
        faults += [COUNTS.sub(lambda m: _fewer(m, len(zeros)), f) for f in error.faults]
        bare = None
    whole = f"{names[0]} with {names[1]}"
    if bare is None or faults:
        raise Unusable(whole, faults)
    axes, more = bare
    notes = (*more, *notes)
    offsets, told, faults = offsets_of(axes, reads, names[1])
    if faults:
        raise Unusable(whole, faults)
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
    if faults:
        raise Unusable(whole, faults)
    joined, _ = _joined(source, manifest, extras, model, names, columns, axes.time)
    counts = f"{len(rows)} of {len(axes.time)} rows of {names[0]} kept"
    told.append(f"{counts}: covered by all files, one for each reading of the slowest.")
    return joined.take(rows), notes, told


def _read(
    beside: Path, manifest: Mapping[str, Any], extras: Extras
) -> tuple[list[Read], tuple[str, ...], list[str]]:
    reads, notes, faults = [], [], []
    for name, log in extras.files.items():
        wanted, found = required_columns_of(name, manifest, extras)
        faults += found
        if not wanted.columns:
            continue
        channel, unread, found = log_of(name, log, wanted, beside, manifest)
        faults += found
        notes += [f"{log.file}: column {c!r} left alone." for c in unread]
        if channel is not None:
            reads.append(Read(name, log, wanted, channel))
    return reads, tuple(notes), faults


def _joined(
    source: bytes,
    manifest: Mapping[str, Any],
    extras: Extras,
    model: ModelFacts | None,
    names: tuple[str, str],
    columns: Mapping[str, Channel],
    time: np.ndarray,
) -> spreadsheet.Read:
    separator, mark = spreadsheet.marks_of(manifest)
    header, _ = open_csv(source, separator)
    if header is not None:
        rows = source.count(b"\n") + 1
        added = {
            name: channel.at(time if len(time) > 1 else np.zeros(rows))[:, 0]
            for name, channel in columns.items()
        }
        source = spreadsheet.with_columns(source, header.separator, mark, added)
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
