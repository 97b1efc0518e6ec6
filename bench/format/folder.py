"""A folder is a recording when its two files are whole and agree with each other."""

import os
import stat
from pathlib import Path

import numpy as np

from bench.errors import Unusable
from bench.format.agreement import csv_faults, faults_of, joints_of
from bench.format.assembly import assemble
from bench.format.layout import Layout, layout_of
from bench.format.manifest import FILE, Manifest, parse
from bench.format.plausible import faults_in
from bench.format.samples import (
    CSV_FILE,
    MAX_BYTES,
    PARQUET_FILE,
    Header,
    open_csv,
    open_parquet,
)
from bench.format.values import all_values_of
from bench.model_facts import ModelFacts
from bench.recording import Recording

MAX_MANIFEST_BYTES = 2**20
"""Largest recording.toml (chosen: 5,000 markers)."""
MAX_LINE = 2_000
"""Longest line of it (chosen: a dotted key costs its length squared to read)."""


def faults_or_recording(
    folder: Path, model: ModelFacts | None
) -> tuple[Recording | None, list[str], list[str]]:
    """Read a recording as far as it goes.

    Returns:
        The recording, None where there are faults; notes; and the faults.
    """
    if not folder.is_dir():
        return None, [], ["there is no such folder."]
    manifest, faults = _manifest(folder)
    header, found = _header(folder, manifest)
    faults += found
    if manifest is None:
        return None, [], faults
    joints, found = joints_of(manifest, model)
    faults += found
    axes = len(manifest.model_names.axes or joints or ()) or None
    if header is None:
        return None, [], faults + faults_of(manifest, axes, model)
    layout = layout_of(header.names, manifest, header.place.file, axes)
    faults += faults_of(manifest, layout.axes or None, model)
    faults += layout.faults
    notes = [f"{header.place.file}: column {n!r} left alone." for n in layout.unknown]
    known = (model, joints) if model is not None and joints is not None else None
    values, found = _values(header, layout, manifest, known)
    faults += found
    if faults:
        return None, notes, faults
    try:
        return assemble(folder.name, manifest, layout, values), notes, []
    except Unusable as error:
        return None, notes, list(error.faults)


def _manifest(folder: Path) -> tuple[Manifest | None, list[str]]:
    source, faults = _bytes(folder, FILE, MAX_MANIFEST_BYTES)
    if source is None:
        return None, faults
    try:
        text = source.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = source.count(b"\n", 0, error.start) + 1
        return None, [f"{FILE}, line {line}: not UTF-8 text."]
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > MAX_LINE:
            fault = f"{len(line)} characters; the most is {MAX_LINE}"
            return None, [f"{FILE}, line {number}: {fault}."]
    return parse(text)


def _header(folder: Path, manifest: Manifest | None) -> tuple[Header | None, list[str]]:
    there = [n for n in (CSV_FILE, PARQUET_FILE) if os.path.lexists(folder / n)]
    if not there:
        return None, [f"{CSV_FILE} is missing, or {PARQUET_FILE}."]
    if len(there) > 1:
        return None, [f"{CSV_FILE} and {PARQUET_FILE} are both there; keep one."]
    source, faults = _bytes(folder, there[0], MAX_BYTES)
    if source is None:
        return None, faults
    if not source.strip():
        return None, [f"{there[0]} is empty."]
    if there[0] == PARQUET_FILE:
        return open_parquet(source)
    usable = manifest is not None and not csv_faults(manifest)
    return open_csv(source, manifest.csv.separator if manifest and usable else ",")


def _values(
    header: Header,
    layout: Layout,
    manifest: Manifest,
    model: tuple[ModelFacts, tuple[int, ...]] | None,
) -> tuple[dict[str, np.ndarray], list[str]]:
    """Read every column that is there, and say what is wrong in its rows."""
    wanted = {held.source for held in layout.held.values()} & set(header.names)
    cells = header.read(wanted)
    values, found = all_values_of(layout.held, cells, manifest.csv.mark)
    faults = [*cells.faults, *found]
    if values and not any(len(column) for column in values.values()):
        return {}, [*faults, f"{header.place.file}: there are no rows."]
    relative = manifest.displacement == "relative"
    plateaus = manifest.rows == "plateaus"
    return values, faults + faults_in(
        values, layout, cells.place, relative, plateaus, model
    )


def _bytes(folder: Path, file: str, most: int) -> tuple[bytes | None, list[str]]:
    """Read a file of a recording, and never one that lies elsewhere."""
    path = folder / file
    try:
        if not os.path.lexists(path):
            return None, [f"{file} is missing."]
        if not path.resolve().is_relative_to(folder.resolve()):
            return None, [f"{file} is a link that leaves the folder."]
        about = path.stat()
        if not stat.S_ISREG(about.st_mode):
            return None, [f"{file} is not a file."]
        if about.st_size > most:
            return None, [f"{file} has {about.st_size} bytes; the most is {most}."]
        return path.read_bytes(), []
    except (OSError, RuntimeError) as error:
        return None, [f"{file} cannot be opened: {error}."]
