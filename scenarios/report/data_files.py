"""Output folder: written whole or not at all, with tidy tables as CSV and run.json.

All files are made in a folder beside it and moved there at the end, one by one; files
of an earlier answer that the new one does not have are removed.

A tidy table has one number a row; its other columns say what the number is. run.json
holds the command, settings and versions that make a result again.
"""

from __future__ import annotations

import csv
import json
import math
import os
import platform
import re
import shutil
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import unescape

from bench.shared.errors import Unusable, refuse
from bench.user_model import ASSETS

if TYPE_CHECKING:
    from stiffness.diagnosis.result import Decision

# --- Tidy tables ----------------------------------------------------------------------


def write_table(file: Path, rows: Sequence[dict[str, object]]) -> None:
    """Write rows of the same columns as csv; floats keep seven digits, NaN is blank."""
    with file.open("w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({name: _cell(value) for name, value in row.items()})


def read_table(file: Path) -> list[dict[str, str]]:
    """Read a table that `write_table` wrote; all cells are text."""
    with file.open(newline="", encoding="utf-8") as source:
        return list(csv.DictReader(source))


def write_decisions(file: Path, decisions: Sequence[Decision]) -> None:
    """Write each gate's verdict on each candidate; no file where there is none."""
    rows = [
        {
            "effect": d.candidate[0],
            "where": d.candidate[1],
            "gate": d.gate,
            "accepted": d.accepted,
            "statistic": d.statistic,
            "threshold": d.threshold,
            "reason": d.reason,
        }
        for d in decisions
    ]
    if rows:
        write_table(file, rows)


def _cell(value: object) -> object:
    if not isinstance(value, float):
        return value
    return "" if math.isnan(value) else f"{value:.7g}"


# --- How a result was made ------------------------------------------------------------

LIBRARIES = ("mujoco", "pin", "numpy", "scipy", "torch", "rerun-sdk")


def command_of(module: str, settings: Any) -> str:
    """Return the command that reproduces a result: all flags that are not as usual."""
    usual = {
        f.name: f.default_factory() if callable(f.default_factory) else f.default
        for f in fields(settings)
    }
    out = settings.out.as_posix()
    return " ".join([f"python -m {module}", *_flags(settings, usual), f"--out {out}"])


def _flags(settings: Any, usual: Mapping[str, Any], above: str = "") -> Iterator[str]:
    for name, value in vars(settings).items():
        flag = f"--{above}{name}".replace("_", "-")
        if name == "out" or value == usual[name]:
            continue
        if is_dataclass(value):
            yield from _flags(value, vars(usual[name]), f"{above}{name}.")
        elif isinstance(value, bool):
            yield flag if value else f"--{above}no-{name}".replace("_", "-")
        else:
            words = value if isinstance(value, tuple) else (value,)
            yield " ".join([flag, *map(str, words)])


def write_run_file(
    folder: Path, command: str, settings: Mapping[str, object], **facts
) -> None:
    """Write run.json: command, settings, versions and facts of one run."""
    content = {
        "command": command,
        "settings": settings,
        "python": sys.version.split()[0],
        "platform": platform.machine(),
        "libraries": {name: version(name) for name in LIBRARIES},
        **facts,
    }
    text = json.dumps(content, indent=2, default=str)
    (folder / "run.json").write_text(text + "\n", encoding="utf-8")


# --- The folder -----------------------------------------------------------------------

FILES = (
    "diagnosis.json", "report.html", "picture.png", "diagnosis.rrd", "model.xml",
    "patch.json", "controller.csv",
)  # fmt: skip
"""Files of a diagnosis; its pictures are inside the report."""
DECISIONS = "decisions.csv"
"""Each gate's verdict on each candidate, where the gates have left any."""
ANSWERS = frozenset(
    {
        *FILES,
        DECISIONS,
        "proof.json",
        "report.md",
        "before_after.png",
        "gears.png",
        "residual_map.png",
    }
    | {"looks_like.png"}
)
"""Files of an answer of any engine; all others in the folder are not touched."""


MARKS = ("diagnosis.json", "proof.json")
"""Files of which an answer has one: what tells it from a folder of somebody else."""


def refuse_folder(
    folder: Path, recording: Path, robot: Path, patch: Path | None = None
) -> None:
    """Refuse a folder that cannot hold an answer, before anything is computed.

    Raises:
        Unusable: Where it is a file, leads elsewhere, is one of the other folders, or
            has files that an answer would replace and that are none.
    """
    what, faults = f"Folder {str(folder)!r}", _astray(folder)
    if robot.resolve() in [(folder / name).resolve() for name in ANSWERS]:
        faults.append(f"{robot.name} in it is the robot's model; give another --out.")
    if folder.resolve() == recording.resolve():
        faults.append("it is the recording itself; give another --out.")
    if patch is not None and folder.resolve() == patch.resolve():
        faults.append("it is the folder of the patch itself; give another --out.")
    refuse(what, faults)


def _astray(folder: Path) -> list[str]:
    """Name what keeps an answer from being in this folder: a file, a symbolic link."""
    if folder.is_symlink():
        return ["it is a symbolic link; give the folder itself, or another --out."]
    if folder.exists() and not folder.is_dir():
        return ["it is not a folder; give another --out."]
    if not any((folder / name).exists() for name in MARKS):
        if there := ", ".join(n for n in sorted(ANSWERS) if (folder / n).exists()):
            return [f"it holds {there}, and no answer of ours; give another --out."]
    inside = [folder / ASSETS, *sorted((folder / ASSETS).rglob("*"))]
    return [
        f"{path.relative_to(folder).as_posix()} in it is a symbolic link to another "
        "folder; remove it, or give another --out."
        for path in inside
        if path.is_symlink() and not path.is_file()
    ]


def write_folder(
    folder: Path, make: Callable[[Path], None], kept: Collection[str] = ANSWERS
) -> None:
    """Make an answer beside a folder and move it there whole.

    Of what `make` writes into the folder that it is given, only files that are kept are
    moved; others were needed on the way.

    Raises:
        Unusable: Where nothing can be written; then nothing is.
    """
    refuse(f"Folder {str(folder)!r}", _astray(folder))
    waiting: Path | None = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        waiting = Path(mkdtemp(prefix=".answer-", dir=folder.parent))
        make(waiting)
        folder.mkdir(exist_ok=True)
        stale = _assets_named(folder / "model.xml")
        for name in (*MARKS, *sorted(ANSWERS - {*MARKS})):
            if name in kept and (waiting / name).exists():
                os.replace(waiting / name, folder / name)
            else:
                (folder / name).unlink(missing_ok=True)
        for name in stale:
            (folder / ASSETS / name).unlink(missing_ok=True)
        if (waiting / ASSETS).is_dir():
            move_into(waiting / ASSETS, folder / ASSETS)
        elif stale and not any((folder / ASSETS).iterdir()):
            (folder / ASSETS).rmdir()
    except OSError as error:
        fault = f"it cannot be written: {error}."
        raise Unusable(f"Folder {str(folder)!r}", [fault]) from error
    finally:
        if waiting is not None:
            shutil.rmtree(waiting, ignore_errors=True)


def _assets_named(model: Path) -> set[str]:
    """Return the meshes and pictures in `ASSETS` that the model of an answer names."""
    if not (model.is_file() and (model.parent / ASSETS).is_dir()):
        return set()
    text = model.read_text(encoding="utf-8", errors="replace")
    named = re.findall(rf'="{ASSETS}/([^"]+)"', text)
    return {unescape(name) for name in named} & set(os.listdir(model.parent / ASSETS))


def move_into(waiting: Path, folder: Path) -> None:
    """Move all that is in one folder into another, whose other files stay."""
    folder.mkdir(exist_ok=True)
    for part in sorted(waiting.iterdir()):
        if part.is_dir():
            move_into(part, folder / part.name)
        else:
            os.replace(part, folder / part.name)
