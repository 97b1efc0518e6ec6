"""A command of a tree, run with hashes taken of the arrays at points of its engine.

`python watched.py FILE MODULE FLAGS…` is `python -m MODULE FLAGS…` with the tree on
PYTHONPATH, but each function of points.toml adds a line to FILE when it returns: the
point, and one SHA-256 of all arrays that it returned, whatever their names and order.
"""

import hashlib
import runpy
import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import wraps
from importlib import import_module
from pathlib import Path

import numpy as np

LIST = Path(__file__).with_name("points.toml")
POINTS: dict[str, list[str]] = tomllib.loads(LIST.read_text("utf-8"))


def digests(value: object) -> set[str]:
    """Return the SHA-256 of every array in dataclasses, mappings, lists and tuples."""
    if isinstance(value, np.ndarray):
        kind = f"{value.dtype.str} {value.shape} ".encode()
        return {hashlib.sha256(kind + value.tobytes()).hexdigest()}
    if is_dataclass(value) and not isinstance(value, type):
        value = [getattr(value, field.name) for field in fields(value)]
    if isinstance(value, Mapping):
        value = list(value.values())
    inner = value if isinstance(value, list | tuple) else ()
    return set().union(*map(digests, inner))


def found(point: str) -> Callable[..., object]:
    """Return the first function of a point that the tree has, or end the program."""
    for module, _, name in (candidate.partition(":") for candidate in POINTS[point]):
        try:
            return getattr(import_module(module), name)
        except (ModuleNotFoundError, AttributeError):
            continue
    sys.exit(f"points.toml: the tree has none of {POINTS[point]} for {point}.")


def watch(point: str, function: Callable[..., object], file: Path) -> None:
    """Take the hash of what a function returns, whoever has imported it."""

    @wraps(function)
    def hashed(*args: object, **kwargs: object) -> object:
        result = function(*args, **kwargs)
        total = hashlib.sha256(" ".join(sorted(digests(result))).encode())
        with file.open("a", encoding="utf-8") as lines:
            lines.write(f"{point} {total.hexdigest()}\n")
        return result

    for module in list(sys.modules.values()):
        for name, value in list(vars(module).items()):
            if value is function:
                setattr(module, name, hashed)


if __name__ == "__main__":
    sys.path.pop(0)  # the folder of this file, which `python -m` would not know
    target, module = Path(sys.argv[1]).resolve(), sys.argv[2]
    target.touch()
    for point in POINTS:
        watch(point, found(point), target)
    sys.argv = sys.argv[2:]
    runpy.run_module(module, run_name="__main__", alter_sys=True)
