"""Folder of a recording on disk: reads it with all its faults, writes it atomically.

A folder is a recording when its two files are whole and agree with each other.

A recording on disk is a folder: a manifest and a table of samples, nothing else.

`read` takes every folder that follows the format and names all faults of one that
does not; `write` leaves a whole recording or none.
"""

import os
import stat
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa

from bench.shared.errors import Unusable
from bench.shared.format.assembly import assemble, manifest_text, samples_table
from bench.shared.format.cells import all_values_of
from bench.shared.format.checks import csv_faults, faults_in, faults_of, joints_of
from bench.shared.format.columns import Layout, layout_of
from bench.shared.format.faults import quoted
from bench.shared.format.manifest import FILE, Manifest, parse
from bench.shared.format.table import (
    CSV_FILE,
    MAX_BYTES,
    PARQUET_FILE,
    Header,
    open_csv,
    open_parquet,
)
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording

# --- Faults of a folder ---------------------------------------------------------------

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
    layout = layout_of(header.names, manifest, header.location.file, axes)
    faults += faults_of(manifest, layout.axes or None, model)
    faults += layout.faults
    notes = [
        f"{header.location.file}: column {n!r} left alone." for n in layout.unknown
    ]
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
        return {}, [*faults, f"{header.location.file}: there are no rows."]
    relative = manifest.displacement == "relative"
    plateaus = manifest.rows == "plateaus"
    return values, faults + faults_in(
        values, layout, cells.location, relative, plateaus, model
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


# --- Reading and writing --------------------------------------------------------------

MAX_FAULTS = 200
"""Faults that one message lists (chosen: what a terminal keeps)."""


def read(
    folder: Path | str, model: ModelFacts | None = None
) -> tuple[Recording, tuple[str, ...]]:
    """Read a recording, or say everything that is wrong with it.

    Args:
        folder: Where it is.
        model: Names and limits to check it against; None checks neither.

    Returns:
        The recording in SI, and notes: what was seen and left alone.

    Raises:
        Unusable: With every fault, each with file, row and column.
    """
    folder = Path(folder)
    recording, notes, faults = faults_or_recording(folder, model)
    if recording is None or faults:
        if len(faults) > MAX_FAULTS:
            more = len(faults) - MAX_FAULTS
            faults = [*faults[:MAX_FAULTS], f"and {more} more faults."]
        raise Unusable(f"Recording {str(folder)!r}", faults)
    return recording, tuple(notes)


def write(folder: Path | str, recording: Recording) -> None:
    """Write a recording whole, or leave everything as it was.

    It is written beside its place, read back, and only then moved there.

    Args:
        folder: Where to. A recording that is there is replaced.
        recording: What to write; only columns that it has are written.

    Raises:
        Unusable: Where the folder holds anything else, cannot be written, or the
            recording could not be read back.
    """
    folder = Path(folder).absolute()
    what = f"Folder {str(folder)!r}"
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise Unusable(what, ["it is not a folder; give another name."])
    try:
        held = sorted(folder.iterdir()) if folder.exists() else []
        ours = {FILE, CSV_FILE, PARQUET_FILE}
        strangers = [p.name for p in held if p.name not in ours or not p.is_file()]
        if strangers:
            shown = ", ".join(quoted(name) for name in strangers[:5])
            fault = f"it holds more than a recording ({shown}); give another name."
            raise Unusable(what, [fault])
        if held and not (folder / FILE).is_file():
            fault = f"it holds samples but no {FILE}; give another name."
            raise Unusable(what, [fault])
        folder.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(prefix=".recording-", dir=folder.parent) as beside:
            fresh = Path(beside) / "new"
            fresh.mkdir()
            (fresh / FILE).write_text(manifest_text(recording), encoding="utf-8")
            samples_table(recording, fresh / CSV_FILE)
            read(fresh)
            _swap(fresh, folder, Path(beside) / "old")
    except (OSError, UnicodeEncodeError, pa.ArrowException) as error:
        raise Unusable(what, [f"it cannot be written: {error}."]) from error


def _swap(fresh: Path, folder: Path, old: Path) -> None:
    """Move a folder into its place; what was there stays there if that fails."""
    if folder.exists():
        os.rename(folder, old)
    try:
        os.rename(fresh, folder)
    except BaseException:
        if old.exists():
            os.rename(old, folder)
        raise
