"""Columns of the samples: names, units, which are required, and their source.

A column of a recording has a name, a unit, and sometimes the right to a blank.

Outside, units are those that controllers and trackers export (mm, degrees); inside,
everything is SI and radians. `Unit` is the only place where the two meet.

Every column of the format is in one column of the file, under its own name or not.

A lab's own file need not be rewritten: `[columns]` says which of its columns stands
for which of ours, and in which unit.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from jaxtyping import Float

from bench.shared.format.faults import nearest, quoted
from bench.shared.format.manifest import FILE, Manifest, Source

# --- Columns --------------------------------------------------------------------------


@dataclass(frozen=True)
class Unit:
    """A value in SI is `number * times / over + plus`.

    Two factors, so that 1000 and pi / 180 are each used both ways and a number that
    went out and in again comes out as the same text.

    Attributes:
        times: Multiplies the number in the file.
        over: Divides it.
        plus: Is added last.
    """

    times: float = 1.0
    over: float = 1.0
    plus: float = 0.0

    def inward(self, number: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """Turn numbers of a file into SI."""
        si = number * self.times / self.over
        return si + self.plus if self.plus else si

    def outward(self, si: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """Turn SI into numbers of a file."""
        return (si - self.plus) * self.over / self.times


DEGREE, MILLIMETRE = Unit(times=pi / 180.0), Unit(over=1000.0)

UNITS: dict[str, dict[str, Unit]] = {
    "angle": {
        "deg": DEGREE,
        "rad": Unit(),
        "mrad": Unit(over=1e3),
        "urad": Unit(over=1e6),
        "arcmin": Unit(times=pi / 180.0, over=60.0),
        "arcsec": Unit(times=pi / 180.0, over=3600.0),
    },
    "length": {
        "mm": MILLIMETRE,
        "m": Unit(),
        "cm": Unit(over=1e2),
        "um": Unit(over=1e6),
        "in": Unit(times=25.4, over=1e3),
    },
    "force": {"N": Unit(), "kN": Unit(times=1e3), "mN": Unit(over=1e3)},
    "torque": {
        "Nm": Unit(),
        "kNm": Unit(times=1e3),
        "mNm": Unit(over=1e3),
        "Nmm": Unit(over=1e3),
    },
    "time": {
        "s": Unit(),
        "ms": Unit(over=1e3),
        "us": Unit(over=1e6),
        "ns": Unit(over=1e9),
        "min": Unit(times=60.0),
        "h": Unit(times=3600.0),
    },
    "mass": {"kg": Unit(), "g": Unit(over=1e3)},
    "temperature": {
        "degC": Unit(),
        "K": Unit(plus=-273.15),
        "degF": Unit(times=5.0, over=9.0, plus=-160.0 / 9.0),
    },
}
"""For each dimension the units that `[columns]` may name; the first is the format's.
Temperatures stay in °C inside."""

COUNT, WORD = "count", "word"
"""Kinds of column that have no unit: an integer, and a word."""

WRENCH: tuple[str, ...] = ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")
COORDINATES = ("_x_mm", "_y_mm", "_z_mm")

_FIXED = {
    "time_s": "time",
    "load_time_s": "time",
    "pose": COUNT,
    "visit": COUNT,
    "stage": WORD,
    "load_kg": "mass",
    "temperature_c": "temperature",
    "frames": COUNT,
    **dict.fromkeys(WRENCH[:3], "force"),
    **dict.fromkeys(WRENCH[3:], "torque"),
}
_AXIS = re.compile(r"a([1-9][0-9]?)_(deg|mm|link_deg|tau_nm)")
_AXIS_KIND = {
    "deg": "angle",
    "mm": "length",
    "link_deg": "angle",
    "tau_nm": "torque",
}


@dataclass(frozen=True)
class Column:
    """What the format says of one column.

    Attributes:
        name: As the format calls it.
        kind: Its dimension, a key of `UNITS`; or `COUNT` or `WORD`.
        may_be_blank: Whether an empty cell means "not seen".
        axis: The axis it belongs to, from 1; 0 for the others.
    """

    name: str
    kind: str
    may_be_blank: bool = False
    axis: int = 0

    def unit(self, name: str | None = None) -> Unit:
        """Return the unit of that name, or the format's own."""
        if self.kind in (COUNT, WORD):
            return Unit()
        units = UNITS[self.kind]
        return units[name or next(iter(units))]


def column_of(name: str, markers: Collection[str]) -> Column | None:
    """Return what the format says of a column; None where it does not know it."""
    if name in _FIXED:
        return Column(name, _FIXED[name])
    if match := _AXIS.fullmatch(name):
        kind = _AXIS_KIND[match[2]]
        return Column(name, kind, match[2] == "link_deg", int(match[1]))
    if name.endswith(COORDINATES) and name[:-5] in markers:
        return Column(name, "length", may_be_blank=True)
    return None


def is_stray_marker(name: str, markers: Collection[str]) -> bool:
    """Tell whether a column claims to be of a marker that the manifest lacks."""
    return name.endswith(COORDINATES[0]) and name[:-5] not in markers


# --- Layout of a file -----------------------------------------------------------------

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
