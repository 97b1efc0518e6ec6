"""Every column of the format is in one column of the file, under its own name or not.

A lab's own file need not be rewritten: `[columns]` says which of its columns stands
for which of ours, and in which unit.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bench.format.columns import (
    COORDINATES,
    COUNT,
    UNITS,
    WORD,
    WRENCH,
    Column,
    Unit,
    column_of,
    is_stray_marker,
)
from bench.format.faults import nearest, quoted
from bench.format.manifest import FILE, Manifest, Source

ALWAYS = ("time_s", "pose")


@dataclass(frozen=True)
class Held:
    """One column of the format, as this file holds it.

    Attributes:
        column: What the format says of it.
        source: Its name in the file.
        unit: Its unit in the file.
    """

    column: Column
    source: str
    unit: Unit


@dataclass(frozen=True)
class Layout:
    """Where the file holds what.

    Attributes:
        held: By the format's names.
        axes: How many axes the recording has.
        slides: Whether each of them slides.
        unknown: Columns of the file that nothing reads.
        faults: Columns that are missing, double or of nothing.
    """

    held: Mapping[str, Held]
    axes: int
    slides: tuple[bool, ...]
    unknown: tuple[str, ...]
    faults: tuple[str, ...]


def layout_of(
    header: Sequence[str], manifest: Manifest, file: str, axes: int | None
) -> Layout:
    """Find every column of the format in a file.

    Args:
        header: The columns of the file.
        manifest: Whose `[columns]` and `[markers]` say what to look for.
        file: Its name, for the faults.
        axes: How many axes there must be; None where nothing says.
    """
    held, faults = _mapped(header, manifest, file)
    read = {h.source for h in held.values()}
    for name in header:
        column = column_of(name, manifest.markers)
        if column and name not in held:
            if name not in manifest.columns:
                held[name] = Held(column, name, column.unit())
        elif column and held[name].source != name and name not in read:
            faults.append(
                f"{file}: columns {name!r} and {held[name].source!r} both stand for "
                f"{name!r}; rename one."
            )
        elif is_stray_marker(name, manifest.markers) and name not in read:
            faults.append(_stray(f"{file}, column {name!r}", name, manifest))
    numbers = {h.column.axis for h in held.values()} - {0}
    count = max(numbers, default=0) if axes is None else axes
    unread = [n for n in header if n not in held and n not in read]
    faults += _missing(held, manifest, file, max(count, 1), unread)
    if extra := sorted(n for n in numbers if n > count):
        faults.append(
            f"{file}: columns for a{extra[0]} and up, but there are {count} axes."
        )
    slides = tuple(f"a{k}_mm" in held for k in range(1, count + 1))
    faults += [
        f"{file}: 'a{k}_link_deg' is an angle, but a{k} slides."
        for k in np.flatnonzero(slides) + 1
        if f"a{k}_link_deg" in held
    ]
    unknown = tuple(n or "(no name)" for n in unread if column_of(n, ()) is None)
    return Layout(held, count, slides, unknown, tuple(faults))


def _mapped(
    header: Sequence[str], manifest: Manifest, file: str
) -> tuple[dict[str, Held], list[str]]:
    held: dict[str, Held] = {}
    faults: list[str] = []
    for name, entry in manifest.columns.items():
        place = f"{FILE}, columns.{name}"
        source = Source(from_=entry) if isinstance(entry, str) else entry
        column = column_of(name, manifest.markers)
        if column is None:
            if is_stray_marker(name, manifest.markers):
                faults.append(_stray(place, name, manifest))
            else:
                known = expected(6, manifest.markers)
                faults.append(
                    f"{place}: the format has no such column.{nearest(name, known)}"
                )
            continue
        unit = source.unit
        allowed = () if column.kind in (COUNT, WORD) else tuple(UNITS[column.kind])
        if unit is not None and unit not in allowed:
            kinds = ", ".join(allowed) or "none, it has no unit"
            faults.append(f"{place}: unit {quoted(unit)} is not one of: {kinds}.")
            unit = None
        held[name] = Held(column, source.from_ or name, column.unit(unit))
        if held[name].source not in header:
            faults.append(
                f"{file}: column {held[name].source!r} is missing, which "
                f"{place} asks for.{nearest(held[name].source, header)}"
            )
    return held, faults


def _missing(
    held: Collection[str], manifest: Manifest, file: str, axes: int, unread: list[str]
) -> list[str]:
    needed: list[str] = list(ALWAYS)
    faults = []
    for k in range(1, axes + 1):
        turn, slide = f"a{k}_deg", f"a{k}_mm"
        if turn in held and slide in held:
            faults.append(
                f"{file}: {turn!r} and {slide!r} are both there; a{k} is one."
            )
        if slide not in held:
            needed.append(turn)
    if any(name in held for name in WRENCH):
        needed += WRENCH
    needed += [m + suffix for m in manifest.markers for suffix in COORDINATES]
    return faults + [
        f"{file}: column {name!r} is missing.{nearest(name, unread)}"
        for name in needed
        if name not in held
    ]


def expected(axes: int, markers: Collection[str]) -> list[str]:
    """List the format's columns for so many axes and these markers."""
    ends = ("deg", "mm", "link_deg", "tau_nm")
    each = [f"a{k}_{end}" for k in range(1, axes + 1) for end in ends]
    others = ["visit", "stage", "load_time_s", "load_kg", "temperature_c", "frames"]
    points = [m + suffix for m in markers for suffix in COORDINATES]
    return [*ALWAYS, *others, *each, *WRENCH, *points]


def _stray(place: str, name: str, manifest: Manifest) -> str:
    known = Counter(manifest.markers)
    listed = ", ".join(sorted(known)[:12]) or "none"
    return (
        f"{place}: no marker is called {name[:-5]!r} in {FILE}."
        f"{nearest(name[:-5], list(known))} Known: {listed}."
    )
