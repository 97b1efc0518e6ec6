"""A recording on disk is a folder: a manifest and a table of samples, nothing else.

`read` takes every folder that follows the format and names all faults of one that
does not; `write` leaves a whole recording or none.
"""

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import pyarrow as pa

from bench.errors import Unusable
from bench.format.disassembly import manifest_text, samples_table
from bench.format.faults import quoted
from bench.format.folder import faults_or_recording
from bench.format.manifest import FILE
from bench.format.samples import CSV_FILE, PARQUET_FILE
from bench.model_facts import ModelFacts
from bench.recording import Recording

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
