"""Shared by both sides: recordings, their format, plans, errors; no physics.

`lazy_names` lets a package offer public names that are imported when they are used
first (PEP 562): `import bench` brings no simulator along, `--help` no library at all.
`replaced_whole` writes any file so that a failure leaves the one before.
"""

import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory


def lazy_names(package: str, homes: Mapping[str, str]) -> Callable[[str], object]:
    """Return the `__getattr__` of a package.

    Each name has the module in which it is defined; a name whose home is the package
    with it appended is that module itself.
    """

    def imported(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home = import_module(homes[name])
        return home if homes[name] == f"{package}.{name}" else getattr(home, name)

    return imported


@contextmanager
def replaced_whole(file: Path) -> Iterator[Path]:
    """Give a path to write, which replaces a file once it is whole.

    It has the file's name, in a folder of its own beside it. A failure leaves the file
    as it was, and nothing beside it.
    """
    with TemporaryDirectory(prefix=".writing-", dir=file.parent) as folder:
        beside = Path(folder) / file.name
        yield beside
        os.replace(beside, file)
