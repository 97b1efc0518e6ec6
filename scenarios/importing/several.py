"""Several CSV files with clocks of their own become one on the clock of the axes.

The first file holds the axes. Another file's time and a number, its offset, is theirs:
stated, that of a file by the same clock, or found from the motion that both saw.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.errors import Unusable
from bench.format.samples import open_csv
from bench.model_facts import ModelFacts
from bench.recording import Recording
from scenarios.importing import spreadsheet
from scenarios.importing.clocks import Channel, rows_of
from scenarios.importing.logs import log_of, without_jumps
from scenarios.importing.mapping import Extras
from scenarios.importing.offsets import Read, offsets_of
from scenarios.importing.wanted import wanted_of

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
        for c in wanted_of(name, manifest, extras)[0].columns
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
        smooth = without_jumps(read.channel, read.name, read.wanted, extras)
        for c, values in zip(read.wanted.columns, smooth.values.T, strict=True):
            columns[f"{read.name}.{c}"] = Channel(time, values[:, None])
        covers = Channel(time, smooth.values).covers(axes.time, read.log.gap_s)
        if not covers.any():
            faults.append(_apart(read, time, axes.time, names[0]))
        covered &= covers
        stamps += [time] if read.wanted.tracked else []
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
        wanted, found = wanted_of(name, manifest, extras)
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
