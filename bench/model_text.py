"""A model from a stranger is text that is looked at before anything is built from it.

A few lines of it can ask for a gigabyte, or name a file that lies elsewhere or never
ends. What is found is said; nothing is compiled and no other file is opened.
"""

import os
import stat
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from bench.format.faults import quoted

LARGEST_MODEL = 20_000_000
"""Bytes of a file that are still read; chosen: a hundred times an arm's file."""
MOST_PARTS = 20_000
"""Parts that a model may unfold to; chosen: a hundred times an arm's."""
MOST_CELLS = 10_000_000
"""Cells of a picture or a field of heights; chosen: three million pixels."""
FOLDERS = ("meshdir", "texturedir", "assetdir")


def faults_of(main: Path) -> list[str]:
    """Say why a model file and those that it includes must not be compiled.

    Args:
        main: An MJCF or URDF file.

    Returns:
        Sentences; none where it may be compiled.
    """
    faults: list[str] = []
    folders, parts = {main.parent}, 0
    waiting, seen = [(main, 1)], set()
    while waiting:
        path, copies = waiting.pop()
        if path in seen:
            continue
        seen.add(path)
        root = _parsed(path, faults)
        if root is None:
            continue
        for compiler in root.iter("compiler"):
            given = (compiler.get(name, "") for name in FOLDERS)
            folders |= {main.parent / name for name in given if name}
        for element, many in _unfolded(root, copies):
            parts += many
            faults += _too_large(element)
            name = element.get("file", "")
            if not name or root.tag == "robot":
                continue
            places = [folder / name for folder in (*sorted(folders), path.parent)]
            there = [place for place in places if os.path.lexists(place)]
            faults += _elsewhere(there, main.parent.resolve(), name)
            if element.tag in ("include", "model") and not faults:
                waiting += [(place, many) for place in there[:1]]
    if parts > MOST_PARTS:
        faults.append(f"it unfolds to {parts:.3g} parts; the most is {MOST_PARTS}.")
    return list(dict.fromkeys(faults))


def _parsed(path: Path, faults: list[str]) -> ElementTree.Element | None:
    if not stat.S_ISREG(path.stat().st_mode):
        faults.append(f"{quoted(path.name)} is not a file.")
    elif path.stat().st_size > LARGEST_MODEL:
        faults.append(f"{quoted(path.name)} is larger than {LARGEST_MODEL} bytes.")
    else:
        source = path.read_bytes()
        if b"<!ENTITY" in source:
            fault = "declares XML entities; write them out."
            faults.append(f"{quoted(path.name)} {fault}")
            return None
        try:
            return ElementTree.fromstring(source)
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            faults.append(f"{quoted(path.name)} is no XML: {error}.")
    return None


def _unfolded(
    element: ElementTree.Element, copies: int
) -> Iterator[tuple[ElementTree.Element, int]]:
    """Walk through all elements, each with how many of it there will be."""
    waiting = [(element, copies)]
    while waiting:
        node, many = waiting.pop()
        if node.tag in ("replicate", "composite", "flexcomp"):
            for count in node.get("count", "1").split():
                many *= max(int(count), 1) if count.isdigit() else 1
        yield node, many
        waiting += [(child, many) for child in node]


def _too_large(element: ElementTree.Element) -> list[str]:
    cells = 1
    for name in ("nrow", "ncol", "width", "height"):
        size = element.get(name, "1")
        cells *= int(size) if size.isdigit() else 1
    if cells <= MOST_CELLS:
        return []
    return [f"its {element.tag} has {cells:.3g} cells; the most is {MOST_CELLS}."]


def _elsewhere(there: list[Path], home: Path, name: str) -> list[str]:
    faults = []
    for place in there:
        if not place.is_file():
            faults.append(f"{quoted(name)} is not a file.")
        elif not place.resolve().is_relative_to(home):
            faults.append(f"{quoted(name)} leaves the model's folder; put it inside.")
        elif place.stat().st_size > LARGEST_MODEL:
            faults.append(f"{quoted(name)} is larger than {LARGEST_MODEL} bytes.")
    return faults
