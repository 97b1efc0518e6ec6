"""A further CSV of a mapping has a clock of its own and is read by its own rules."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import Unusable
from bench.format.columns import UNITS, Column, Unit
from bench.format.faults import nearest, quoted
from bench.format.layout import Held
from bench.format.manifest import Source
from bench.format.samples import CSV_FILE, Header, open_csv
from bench.format.values import all_values_of
from scenarios.importing.clocks import Channel, on_one_side
from scenarios.importing.mapping import Extras, Log
from scenarios.importing.spreadsheet import marks_of, source_of
from scenarios.importing.wanted import Wanted

TIME = Column("time_s", "time")


def log_of(
    name: str, log: Log, wanted: Wanted, beside: Path, manifest: Mapping[str, Any]
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
    header: Header, time: Held, wanted: Wanted, mark: str
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
    faults += cells.place.at(time.source, back, lambda _: "time runs backwards.")
    if not len(stamps):
        faults.append(f"{CSV_FILE}: it has no rows.")
    read = np.stack([values[c] for c in wanted.columns], axis=1)
    return Channel(stamps, read), faults


def without_jumps(
    channel: Channel, name: str, wanted: Wanted, extras: Extras
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
