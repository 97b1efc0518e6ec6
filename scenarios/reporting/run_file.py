"""A result that nobody can make again is an anecdote: run.json says how it was made."""

import json
import platform
import sys
from collections.abc import Mapping
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

LIBRARIES = ("mujoco", "pin", "numpy", "scipy", "torch", "rerun-sdk")


def command(module: str, settings: Any) -> str:
    """Return the command that makes a result again, all its flags written out."""
    given = {f.name: getattr(settings, f.name) for f in fields(settings)}
    out = given.pop("out").as_posix()
    flags = [
        f"--{name.replace('_', '-')}" + ("" if value is True else f" {value}")
        for name, value in given.items()
        if value is not None and value is not False
    ]
    return " ".join([f"python -m {module}", *flags, f"--out {out}"])


def write(folder: Path, command: str, settings: Mapping[str, object], **facts) -> None:
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
