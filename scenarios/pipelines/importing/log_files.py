"""Reads further CSV files of a mapping, and finds the offsets of their clocks.

The first file holds the axes. A mapping takes the columns of another, for markers or a
wrench, by NAME.column. That file is read by its own rules; its time and a number, its
offset, is the axes' time: stated, that of a file by the same clock, or found from the
motion that both saw.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from bench.shared.errors import Unusable
from bench.shared.format.columns import (
    COORDINATES,
    COUNT,
    UNITS,
    WORD,
    WRENCH,
    Column,
    Held,
    column_of,
)
from bench.shared.format.faults import nearest, quoted
from bench.shared.format.manifest import Source
from bench.shared.format.table import CSV_FILE, ENCODINGS, Header, is_encoding, open_csv
from bench.shared.recording import Recording
from scenarios.pipelines.importing import spreadsheet
from scenarios.pipelines.importing.clocks import (
    Channel,
    Lag,
    lag_between,
    lag_text,
    on_one_side,
    shift_of,
)
from scenarios.pipelines.importing.mapping import Extras, Log
from scenarios.pipelines.importing.spreadsheet import columns_of, source_of

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
    log = extras.files.get(name)
    by_row = log is not None and log.join == "rows"
    for said, entry in manifest.get("columns", {}).items():
        source = entry.get("from") if isinstance(entry, dict) else entry
        sources = source if isinstance(source, list) else [source]
        sources = [s for s in sources if isinstance(s, str) and s.startswith(start)]
        column = column_of(said, manifest.get("markers", {}))
        if column is None or not sources:
            continue  # the format's reader says why
        turns = column.axis > 0 and said.endswith(("_deg", "_mm"))
        own = turns and not said.endswith("_link_deg")
        if column.kind == WORD or (
            not by_row and (own or column.kind in (COUNT, "time"))
        ):
            which = "words" if by_row else "the axes, their time, counts and words"
            faults.append(
                f"columns.{said}: {sources[0]!r} cannot come from [files.{name}]; "
                f"{which} stand in FILE itself."
            )
            continue
        for own_name in (s.removeprefix(start) for s in sources):
            columns[own_name] = columns.get(own_name, True) and column.may_be_blank
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
    """Read a file beside the axes', whose own `[csv]` holds before the manifest's.

    Returns:
        Its readings, None where it has faults; columns that nothing reads; its faults.
    """
    header, faults = header_of(name, log, wanted, beside, manifest)
    if header is None:
        return None, (), faults
    channel = None
    said = log.time or "time_s"
    stamp = said if isinstance(said, str) else str(said.from_ or "time_s")
    faults += missing_of(header, [stamp, *wanted.columns])
    clock = said if isinstance(said, Source) else Source()
    if clock.unit not in (None, *UNITS["time"]):
        known = ", ".join(UNITS["time"])
        faults.append(f"its time: {quoted(clock.unit)} is not one of: {known}.")
    if not faults:
        held = Held(TIME, stamp, TIME.unit(clock.unit))
        mark = log.decimal or spreadsheet.csv_of(manifest).mark
        channel, faults = _readings(header, held, wanted, mark)
    unread = unread_of(header, [stamp, *wanted.columns])
    if faults:
        return None, (), in_names_of(log, faults)
    return channel, unread, []


def header_of(
    name: str,
    log: Log,
    wanted: RequiredColumns,
    beside: Path,
    manifest: Mapping[str, Any],
) -> tuple[Header | None, list[str]]:
    """Open a further file; None, with all faults named in full, where it cannot be."""
    path = beside / log.file
    if not path.resolve().is_relative_to(beside.resolve()):
        say = f"{quoted(log.file)} is outside the folder of FILE."
        return None, [f"files.{name}.file: {say}"]
    try:
        source = source_of(path)
    except Unusable as error:
        return None, [f"files.{name}.file, {log.file}: {f}" for f in error.faults]
    about = msgspec.structs.replace(
        spreadsheet.csv_of(manifest), skip_rows=log.skip_rows, skip_incomplete=False
    )
    for own in ("separator", "encoding"):
        if (value := getattr(log, own)) is not None:
            about = msgspec.structs.replace(about, **{own: value})
    if not is_encoding(about.encoding):
        known = ", ".join(ENCODINGS)
        say = f"{quoted(about.encoding)} is not one of: {known}."
        return None, [f"files.{name}.encoding: {say}"]
    header, faults = open_csv(source, about, wanted.columns)
    return header, faults if header else in_names_of(log, faults)


def unread_of(header: Header, read: Collection[str]) -> tuple[str, ...]:
    """Return the columns of a file that nothing reads."""
    return tuple(c for c in header.names if c and c not in read)


def in_names_of(log: Log, faults: Iterable[str]) -> list[str]:
    """Say faults of a file with its own name."""
    named = [f.replace(CSV_FILE, log.file) for f in faults]
    return [f if log.file in f else f"{log.file}: {f}" for f in named]


def missing_of(header: Header, names: list[str]) -> list[str]:
    """Name the columns that a file lacks."""
    return [
        f"{CSV_FILE}: column {c!r} is missing, which the mapping asks for."
        f"{nearest(c, header.names)}"
        for c in names
        if c not in header.names
    ]


def _readings(
    header: Header, time: Held, wanted: RequiredColumns, mark: str
) -> tuple[Channel, list[str]]:
    held = {**spreadsheet.plain(wanted.columns), "": time}
    values, cells, faults = spreadsheet.numbers_of(header, held, mark)
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
