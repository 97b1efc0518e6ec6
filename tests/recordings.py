"""A small valid recording in the format's files, and functions that damage it."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from bench.shared.models import ModelFacts

DEGREES = np.array(
    [[-170, 170], [-190, 45], [-120, 156], [-185, 185], [-120, 120], [-350, 350]]
)
ARM = ModelFacts(
    joints=("a1", "a2", "a3", "a4", "a5", "a6"),
    slides=(False,) * 6,
    lower=np.radians(DEGREES[:, 0]),
    upper=np.radians(DEGREES[:, 1]),
    bodies=("base", *(f"link_{k}" for k in range(1, 7)), "flange", "tool"),
)

MANIFEST = """format = 1
name = "a small one"
rows = "plateaus"
displacement = "absolute"

[sensors.tracker]
repeatability_mm = 0.010
[sensors.wrench]
accuracy_n = 0.04
accuracy_nm = 0.002

[frames.tracker]
position_mm = [100, 0, 0]
quaternion_wxyz = [1, 0, 0, 0]

[markers.p1]
body = "flange"
position_mm = [10, 20, 30]
[markers.p2]
body = "link_3"
"""
LOADS = (0.0, 5.0, 10.0, 5.0, 0.0)


def write_good(folder: Path) -> Path:
    """Write four visits of five plateaus each, the first pose visited twice."""
    folder.mkdir(parents=True)
    (folder / "recording.toml").write_text(MANIFEST)
    rows: list[dict[str, float]] = []
    for visit, pose in enumerate((1, 2, 3, 1)):
        for step, load in enumerate(LOADS):
            row = {"time_s": 60.0 * visit + 10.0 * step, "pose": pose}
            row |= {f"a{k}_deg": 5.0 * pose + k for k in range(1, 7)}
            row |= dict({"fx_n": 0.0, "fy_n": 1.0, "fz_n": -9.8 * load}.items())
            row |= dict.fromkeys(("tx_nm", "ty_nm", "tz_nm"), 0.25 * load)
            row |= {"load_kg": load}
            for marker, offset in (("p1", 0.0), ("p2", 400.0)):
                for axis, name in enumerate("xyz"):
                    place = offset + 100.0 * pose + 7.0 * axis - 0.01 * load
                    row[f"{marker}_{name}_mm"] = place
            rows.append(row)
    save(folder, [list(rows[0]), *([str(v) for v in row.values()] for row in rows)])
    return folder


def table(folder: Path) -> list[list[str]]:
    """Read the samples as text, header first."""
    with (folder / "samples.csv").open(newline="") as file:
        return list(csv.reader(file))


def save(folder: Path, rows: Sequence[Sequence[str]]) -> None:
    """Write the samples as text, header first."""
    with (folder / "samples.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


Damage = Callable[[Path], object]


def cell(row: int, column: str, text: str) -> Damage:
    """Return a damage that puts a text into a column's row, counted from one."""

    def damage(folder: Path) -> None:
        rows = table(folder)
        rows[row][rows[0].index(column)] = text
        save(folder, rows)

    return damage


def every(column: str, change: Callable[[str], str]) -> Damage:
    """Return a damage that changes every cell of a column."""

    def damage(folder: Path) -> None:
        rows = table(folder)
        at = rows[0].index(column)
        for row in rows[1:]:
            row[at] = change(row[at])
        save(folder, rows)

    return damage


def renamed(column: str, name: str) -> Damage:
    """Return a damage that renames a column."""

    def damage(folder: Path) -> None:
        rows = table(folder)
        rows[0][rows[0].index(column)] = name
        save(folder, rows)

    return damage


def without(*columns: str) -> Damage:
    """Return a damage that removes columns."""

    def damage(folder: Path) -> None:
        rows = table(folder)
        keep = [i for i, name in enumerate(rows[0]) if name not in columns]
        save(folder, [[row[i] for i in keep] for row in rows])

    return damage


def added(column: str, text: str) -> Damage:
    """Return a damage that adds a column with the same text in every row."""

    def damage(folder: Path) -> None:
        rows = table(folder)
        save(folder, [[*rows[0], column], *([*row, text] for row in rows[1:])])

    return damage


def said(old: str, new: str) -> Damage:
    """Return a damage that replaces a text of the manifest."""

    def damage(folder: Path) -> None:
        path = folder / "recording.toml"
        text = path.read_text()
        assert old in text
        path.write_text(text.replace(old, new, 1))

    return damage


def more(text: str) -> Damage:
    """Return a damage that appends a text to the manifest."""

    def damage(folder: Path) -> None:
        path = folder / "recording.toml"
        path.write_text(path.read_text() + text)

    return damage


def both(*damages: Damage) -> Damage:
    """Return a damage that does several, one after the other."""

    def damage(folder: Path) -> None:
        for each in damages:
            each(folder)

    return damage


def assert_same(mine, theirs, rtol: float = 0.0) -> None:
    """Compare two dataclasses field by field, to the last bit by default."""
    for part in fields(mine):
        a, b = getattr(mine, part.name), getattr(theirs, part.name)
        if isinstance(a, np.ndarray) and a.dtype.kind == "f":
            np.testing.assert_allclose(a, b, rtol=rtol, atol=0.0, err_msg=part.name)
        elif isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b, err_msg=part.name)
        elif part.name == "markers":
            assert len(a) == len(b)
            for one, other in zip(a, b, strict=True):
                assert_same(one, other, rtol)
        elif hasattr(a, "__dataclass_fields__"):
            assert_same(a, b, rtol)
        elif isinstance(a, float):
            assert a == pytest.approx(b, rel=max(rtol, 1e-300), abs=0.0)
        else:
            assert a == b, part.name
