"""The truth of a synthetic experiment is kept apart from what was seen of it."""

import os
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from tempfile import mkstemp

import msgspec
import numpy as np

from bench.effects.effect import Effect
from bench.errors import Unusable
from bench.instruments import Instruments
from bench.rig import RIGID, Rig


def truth_text(rig: Rig, name: str, seed: int, instruments: Instruments) -> str:
    """Write what is true of a rig as JSON, in SI.

    Args:
        rig: The arm.
        name: Of the recording.
        seed: Of the recording.
        instruments: What watched, before the faults among the effects.

    Returns:
        `schema`, `recording`, `robot`, `seed`, `effects`, and `stiffness` of each axis
        in N m/rad, null where it is rigid. An effect has `effect`, `where`,
        `parameters` under the names of the diagnosis' vocabulary, its `mechanism`,
        since one name can have several, and everything that was `set`; the fields of
        `instruments` are those of `bench.instruments`.
    """
    springs = zip(rig.anatomy.axes, rig.springs, strict=True)
    truth = {
        "schema": 1,
        "recording": name,
        "robot": Path(rig.arm_file).stem,
        "seed": seed,
        "effects": [_entry(effect) for effect in rig.effects],
        "stiffness": {
            axis: None if stiffness >= RIGID else float(stiffness)
            for axis, stiffness in springs
        },
        "instruments": msgspec.to_builtins(instruments),
    }
    return msgspec.json.format(msgspec.json.encode(truth), indent=2).decode() + "\n"


def refuse_inside(folder: Path, truth_file: Path | None) -> None:
    """Refuse a truth file inside a recording's folder.

    Raises:
        Unusable: Where it lies there, also through links.
    """
    if truth_file is None:
        return
    if os.path.lexists(truth_file) and not truth_file.is_file():
        fault = "it is there and is no file; give another name."
        raise Unusable("Truth file", [f"--truth-file {str(truth_file)!r}: {fault}"])
    inside = truth_file.resolve().is_relative_to(folder.resolve())
    if inside or folder.resolve().is_relative_to(truth_file.resolve()):
        fault = (
            f"it lies inside {str(folder)!r}, or that inside it; put it elsewhere, for "
            "a recording holds no truth."
        )
        raise Unusable("Truth file", [f"--truth-file {str(truth_file)!r}: {fault}"])


def written_with(truth_file: Path, truth: str, write: Callable[[], None]) -> None:
    """Write the truth and, while it waits beside its place, what belongs to it.

    Args:
        truth_file: Where the truth goes; one that is there is replaced.
        truth: What it says.
        write: Writes the rest, or raises.

    Raises:
        Unusable: Where the truth cannot be written; then nothing is.
    """
    waiting = None
    try:
        truth_file.parent.mkdir(parents=True, exist_ok=True)
        if truth_file.is_dir():
            raise IsADirectoryError(f"{str(truth_file)!r} is a folder")
        handle, waiting = mkstemp(prefix=".truth-", dir=truth_file.parent)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(truth)
        write()
        os.replace(waiting, truth_file)
    except OSError as error:
        fault = f"it cannot be written: {error}."
        raise Unusable(f"Truth file {str(truth_file)!r}", [fault]) from error
    finally:
        if waiting is not None:
            Path(waiting).unlink(missing_ok=True)


def _entry(effect: Effect) -> dict[str, object]:
    return {
        "effect": effect.name,
        "where": effect.where,
        "parameters": _plain(effect.parameters()),
        "mechanism": type(effect).__name__,
        "set": _plain(
            {
                f.name: getattr(effect, f.name)
                for f in fields(effect)
                if f.name != "where"
            }
        ),
    }


def _plain(values) -> dict[str, object]:
    return {k: v.item() if isinstance(v, np.generic) else v for k, v in values.items()}
