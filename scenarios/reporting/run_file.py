"""A result that nobody can make again is an anecdote: run.json says how it was made."""

import json
import platform
import sys
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

LIBRARIES = ("mujoco", "pin", "numpy", "scipy", "torch", "rerun-sdk")


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
