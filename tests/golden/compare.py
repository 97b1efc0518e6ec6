"""Two folders of results, compared file by file to the last digit.

Every file is read as lines: numbers of JSON are written out in hexadecimal, pictures
count by their pixels, tables by their contents, all else is text. What differs from run
to run by its nature is left out: `VOLATILE` to `CACHE`.
"""

import csv
import hashlib
import json
import re
from collections.abc import Iterator
from itertools import takewhile, zip_longest
from operator import eq
from pathlib import Path

from matplotlib.image import imread
from pyarrow import parquet

VOLATILE = re.compile(r"(\w+_)?seconds|\w+_sha256")
"""Fields of JSON and columns of CSV: durations; hashes of code or of durations."""
SPEED = "answers within 3 s"
"""A bar of the blind trials that depends on the computer; its line is left out."""
TIMED = re.compile(r"It took [\d.]+ s|\d+ of \d+ bars are met")
"""Parts of texts that tell a duration, or count that bar."""
UNREAD = ".rrd"
"""Files that only have to be there: the time of writing is all over them."""
CACHE = "cells"
"""A folder that is left out: its files are called after classes of Python."""
SHOWN, WIDTH = 3, 100
"""Differences of a file that are printed, and letters of each."""


def lines_of(file: Path) -> list[str]:
    """Return what is compared of a file."""
    kind = file.suffix
    if kind == UNREAD:
        return []
    if kind == ".png":
        picture = imread(file)
        return [f"{picture.shape} {hashlib.sha256(picture.tobytes()).hexdigest()}"]
    if kind == ".parquet":
        table = parquet.read_table(file)
        return [f"{name}: {table[name].to_pylist()}" for name in table.column_names]
    content = file.read_bytes()
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError:  # a mesh
        return [hashlib.sha256(content).hexdigest()]
    lines = text.splitlines()
    if kind == ".json":
        lines = list(leaves(json.loads(text)))
    elif kind == ".csv":
        rows = list(csv.reader(lines))
        kept = [k for k, name in enumerate(rows[0]) if not VOLATILE.fullmatch(name)]
        lines = [",".join(row[k] for k in kept) for row in rows]
    return [TIMED.sub("…", line) for line in lines if SPEED not in line]


def leaves(value: object, path: str = "") -> Iterator[str]:
    """Yield what JSON holds in its order, each value after its path."""
    if isinstance(value, dict) and value:
        inner = [] if SPEED in value.values() else value.items()
        for key, one in inner:
            if not VOLATILE.fullmatch(key):
                yield from leaves(one, f"{path}.{key}")
    elif isinstance(value, list) and value:
        for number, one in enumerate(value):
            yield from leaves(one, f"{path}.{number}")
    else:
        shown = value.hex() if isinstance(value, float) else repr(value)
        yield f"{path.removeprefix('.')} = {shown}"


def differences(old: list[str], new: list[str]) -> Iterator[str]:
    """Yield the lines that are not the same, from shortly before they part."""
    for number, (a, b) in enumerate(zip_longest(old, new, fillvalue=""), start=1):
        if a != b:
            alike = takewhile(bool, map(eq, a, b))
            start = max(0, sum(alike) - 3 * WIDTH // 4)
            shown = slice(start, start + WIDTH)
            yield f"line {number}: {a[shown]}\n       is now: {b[shown]}"


def files(folder: Path) -> dict[str, Path]:
    """Return the files below a folder by their path in it, finished cells left out."""
    found = sorted(folder.rglob("*"))
    kept = (path for path in found if path.is_file() and path.parent.name != CACHE)
    return {path.relative_to(folder).as_posix(): path for path in kept}


def compare(old: Path, new: Path) -> bool:
    """Print what differs between two folders and return whether anything does."""
    before, after = files(old), files(new)
    names, count = sorted(before.keys() | after.keys()), 0
    for name in names:
        a, b = before.get(name), after.get(name)
        found = [f"only in the {'old' if a else 'new'} tree's results"]
        if a and b:
            found = list(differences(lines_of(a), lines_of(b)))
        if found:
            count += 1
            print(f"{name}: {len(found)} differences", *found[:SHOWN], sep="\n    ")
    print(f"{len(names)} files of results, {count} differ.")
    return count > 0
