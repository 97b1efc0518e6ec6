"""A training that was written down goes on where it stopped, or is known to be another.

A file is a plain archive of arrays (`numpy.savez`): whose training it is, how many
steps are done, weights, the optimiser's moments, losses. It holds no code.
"""

import os
from pathlib import Path
from tempfile import NamedTemporaryFile
from zipfile import BadZipFile

import numpy as np

from bench.errors import Unusable
from stiffness.networks.progress import Progress

WEIGHTS, MOMENTS = "weights/", "moments/"


def write_progress(file: Path, key: str, progress: Progress) -> None:
    """Write a training whole, or leave what was there.

    Args:
        file: Where to; the name should end in `.npz`.
        key: What tells this training from every other.
        progress: The training.

    Raises:
        Unusable: Where the file cannot be written.
    """
    arrays = {"key": np.array(key), "loss": progress.loss}
    arrays |= {WEIGHTS + name: value for name, value in progress.weights.items()}
    arrays |= {MOMENTS + name: value for name, value in progress.moments.items()}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with NamedTemporaryFile(dir=file.parent, suffix=".npz", delete=False) as beside:
            try:
                np.savez(beside, **arrays)  # pyright: ignore[reportArgumentType]
                beside.close()
                os.replace(beside.name, file)
            except BaseException:
                Path(beside.name).unlink(missing_ok=True)
                raise
    except OSError as error:
        fault = f"it cannot be written: {error}."
        raise Unusable(f"Training {str(file)!r}", [fault]) from error


def begun_or_none(file: Path, key: str) -> Progress | None:
    """Read a training of this key; None where there is none or it is of another key.

    Raises:
        Unusable: Where the file is there but no training.
    """
    if not file.exists():
        return None
    try:
        with file.open("rb") as data, np.load(data, allow_pickle=False) as archive:
            if str(archive["key"]) != key:
                return None
            loss = archive["loss"]
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        fault = "it is no training, or damaged; delete it to begin anew."
        raise Unusable(f"Training {str(file)!r}", [fault]) from error
    weights, moments = (
        {name.removeprefix(p): a for name, a in arrays.items() if name.startswith(p)}
        for p in (WEIGHTS, MOMENTS)
    )
    return Progress(len(loss), weights, moments, loss)
