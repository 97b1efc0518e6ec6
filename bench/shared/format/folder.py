"""Folder of a recording on disk: reads it with all its faults, writes it atomically.

A recording on disk is a folder with two files, a manifest and a table of samples, that
must be complete and agree with each other. `read` accepts every folder that follows the
format and names all faults of one that does not; `write` leaves a complete recording or
none.
"""

import os
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
from jaxtyping import Int

from bench.shared.errors import Unusable
from bench.shared.format.assembly import assemble, manifest_text, samples_table
from bench.shared.format.cells import all_values_of, readings_of
from bench.shared.format.checks import (
    SAME_MARK,
    faults_in,
    faults_of,
    faults_of_rules,
    joints_of,
)
from bench.shared.format.columns import Layout, expected, layout_of
from bench.shared.format.faults import SHOWN, Place, quoted
from bench.shared.format.manifest import FILE, Manifest, parse
from bench.shared.format.table import (
    CSV_FILE,
    MAX_BYTES,
    PARQUET_FILE,
    Cells,
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


NO_FOLDER = "there is no such folder."
IMPORT = (
    "it is a file, and a recording is a folder. A CSV or a bag becomes one first: "
    "python -m scenarios.import_recording FILE --mapping MAPPING.toml --out DIR; "
    "--suggest FILE.csv writes a mapping to correct."
)
"""What is said of a lab's own file in place of a recording."""
LEFT_ALONE = "left alone."
"""How a note ends on a column that nothing reads."""


@dataclass(frozen=True)
class FolderRead:
    """A folder as far as it can be read.

    Attributes:
        recording: None where there are faults.
        notes: What was seen, one for each column that was left alone.
        location: Where the recording's rows are in the file.
        rows: Which rows of the file they are, from 0 below the header; of pulled poses
            each stands twice.
    """

    recording: Recording | None
    notes: Sequence[str]
    faults: Sequence[str]
    location: Place = field(default_factory=lambda: Place(CSV_FILE, True))
    rows: Int[np.ndarray, " rows"] = field(
        default_factory=lambda: np.zeros(0, dtype=int)
    )


def read_as_far_as_possible(folder: Path, model: ModelFacts | None) -> FolderRead:
    """Return what can be read of a recording in a folder, with all faults."""
    if not folder.is_dir():
        return FolderRead(None, [], [IMPORT if folder.is_file() else NO_FOLDER])
    manifest, faults = _manifest(folder)
    header, found = _header(folder, manifest)
    return joined(folder.name, manifest, header, [*faults, *found], model)


def joined(
    name: str,
    manifest: Manifest | None,
    header: Header | None,
    faults: list[str],
    model: ModelFacts | None,
) -> FolderRead:
    """Return what a manifest makes of a table, with the faults that both have already.

    The name is that of a recording whose manifest has none; what could not be read is
    None.
    """
    if manifest is None:
        return FolderRead(None, [], faults)
    joints, found = joints_of(manifest, model)
    faults += found
    axes = len(manifest.model_names.axes or joints or ()) or None
    if header is None:
        return FolderRead(None, [], faults + faults_of(manifest, axes, model))
    unsaid = () if model is None or manifest.model_names.axes else model.axes
    layout = layout_of(header.names, manifest, header.location.file, axes, unsaid)
    found = faults_of(manifest, layout.axes or None, model)
    if header.separator != manifest.csv.separator:
        found = [f for f in found if not f.endswith(SAME_MARK)]  # that is said
    faults += found
    faults += [*layout.faults, *faults_of_rules(manifest, layout)]
    file = header.location.file
    notes = [f"{file}: column {n!r} {LEFT_ALONE}" for n in layout.unknown]
    known = (model, joints) if model is not None and joints is not None else None
    known = None if axes not in (None, layout.axes) else known  # of another arm
    values, cells, more, found = _values(header, layout, manifest, known)
    faults += found
    if faults:
        return FolderRead(None, notes, faults)
    try:
        recording, said = assemble(name, manifest, layout, values)
    except Unusable as error:
        return FolderRead(None, notes, error.faults)
    rows = np.repeat(cells.location.rows(cells.rows), 2 if manifest.pulled else 1)
    location = replace(cells.location, twice=manifest.pulled)
    return FolderRead(recording, [*notes, *more, *said], [], location, rows)


def counted(notes: Sequence[str]) -> tuple[str, ...]:
    """Say once how many columns of a file were left alone, whatever else is noted."""
    files: dict[str, list[str]] = {}
    for note in notes:
        if note.endswith(LEFT_ALONE):
            file, _, rest = note.partition(": column ")
            files.setdefault(file, []).append(rest.removesuffix(f" {LEFT_ALONE}"))
    said = []
    for file, names in files.items():
        if len(names) == 1:
            said.append(f"{file}: column {names[0]} {LEFT_ALONE}")
            continue
        shown = ", ".join(names[:SHOWN])
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        said.append(f"{file}: {len(names)} columns left alone: {shown}{more}.")
    return (*said, *(n for n in notes if not n.endswith(LEFT_ALONE)))


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
    return open_as_said(source, manifest)


def open_as_said(
    source: bytes, manifest: Manifest | None
) -> tuple[Header | None, list[str]]:
    """Read the header of a CSV file as its manifest says, where that is known."""
    if manifest is None:
        return open_csv(source)
    wanted = {*expected(12, manifest.markers)}
    for name, entry in manifest.columns.items():
        names = entry if isinstance(entry, str) else entry.from_ or name
        wanted |= {names} if isinstance(names, str) else {*names}
    return open_csv(source, manifest.csv, wanted)


def _values(
    header: Header,
    layout: Layout,
    manifest: Manifest,
    model: tuple[ModelFacts, tuple[int, ...]] | None,
) -> tuple[dict[str, np.ndarray], Cells, list[str], list[str]]:
    """Read every column that is there; what to note; and what is wrong in its rows."""
    wanted = {source for held in layout.held.values() for source in held.sources}
    cells = header.read(wanted & set(header.names))
    mark = manifest.csv.mark
    cells, rows, notes, faults = readings_of(header, cells, layout, manifest.csv)
    values, found = all_values_of(layout.held, cells, mark)
    faults = [*cells.faults, *faults, *found]
    if values and not any(len(column) for column in values.values()):
        none = f"{header.location.file}: there are no rows."
        said = [] if cells.faults else [*notes, none]  # rows of another length are rows
        return {}, cells, notes, [*faults, *said]
    if manifest.number_rows:
        values["pose"] = rows + 1.0
    if manifest.interval_s is not None:
        values["time_s"] = rows * manifest.interval_s
    judged = {
        n: v
        for n, v in values.items()
        if n not in layout.held or not layout.held[n].unclear
    }
    alone = manifest.pulled or manifest.number_rows
    relative = manifest.displacement == "relative" and not alone
    plateaus = manifest.rows == "plateaus"
    faults += faults_in(judged, layout, cells.location, relative, plateaus, model)
    return values, cells, notes, faults


def _bytes(folder: Path, file: str, most: int) -> tuple[bytes | None, list[str]]:
    """Return the bytes of a file of a recording; never of one that lies elsewhere."""
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
    """Return the recording of a folder, or raise all its faults.

    Args:
        folder: The folder.
        model: Names and limits to check it against; None checks neither.

    Returns:
        The recording in SI, and notes: content that was recognised but not used.

    Raises:
        Unusable: With every fault, each with file, row and column.
    """
    folder = Path(folder)
    found = read_as_far_as_possible(folder, model)
    recording, notes, faults = found.recording, found.notes, list(found.faults)
    if recording is None or faults:
        if len(faults) > MAX_FAULTS:
            more = len(faults) - MAX_FAULTS
            faults = [*faults[:MAX_FAULTS], f"and {more} more faults."]
        raise Unusable(f"Recording {str(folder)!r}", faults)
    return recording, counted(notes)


def write(folder: Path | str, recording: Recording) -> None:
    """Write a recording atomically: a failure leaves everything as it was.

    It is written beside its place, read back, and only then moved there.

    Args:
        folder: The folder. A recording in it is replaced.
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
        foreign = [p.name for p in held if p.name not in ours or not p.is_file()]
        if foreign:
            shown = ", ".join(quoted(name) for name in foreign[:5])
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
    """Move a folder into its place; on failure the old content stays."""
    if folder.exists():
        os.rename(folder, old)
    try:
        os.rename(fresh, folder)
    except BaseException:
        if old.exists():
            os.rename(old, folder)
        raise
