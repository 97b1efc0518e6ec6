"""Data files beside a report: tidy tables as CSV, and run.json.

A tidy table has one number a row; its other columns say what the number is. run.json
holds the command, settings and versions that make a result again.
"""

from __future__ import annotations

import csv
import json
import math
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
    """Return the command that reproduces a result, with all its flags."""
    given = {f.name: getattr(settings, f.name) for f in fields(settings)}
    out = given.pop("out").as_posix()
    flags = [
        f"--{name.replace('_', '-')}" + ("" if value is True else f" {value}")
        for name, value in given.items()
        if value is not None and value is not False
    ]
    return " ".join([f"python -m {module}", *flags, f"--out {out}"])


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
