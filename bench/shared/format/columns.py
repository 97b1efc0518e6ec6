"""Columns of the samples: names, units, which are required, and their source.

In files, units are those that controllers and trackers export (mm, degrees); in memory,
everything is SI and radians. `Unit` is the only place of conversion.

`layout_of` finds every column of the format in a file. A lab's own file need not be
rewritten: `[columns]` of the manifest maps its columns and units to the format's.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import pi

import numpy as np
from jaxtyping import Float

from bench.shared.format.faults import nearest, nearest_of, quoted
from bench.shared.format.manifest import FILE, UNCLEAR, Manifest, Source

# --- Columns --------------------------------------------------------------------------


@dataclass(frozen=True)
class Unit:
    """Unit of a file; a value in SI is `number * times / over + plus`.

    Two factors, so that 1000 and pi / 180 are each used both ways and a number that
    is written and read again gives the same text.

    Attributes:
        times: Multiplies the number in the file.
        over: Divides it.
        plus: Is added last.
    """

    times: float = 1.0
    over: float = 1.0
    plus: float = 0.0

    def inward(self, number: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
        """Return numbers of a file in SI."""
        si = number * self.times / self.over
        return si + self.plus if self.plus else si

    def outward(self, si: Float[np.ndarray, "*some"]) -> Float[np.ndarray, "*some"]:
        """Return SI values in the unit of the file."""
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
    "force": {
        "N": Unit(),
        "kN": Unit(times=1e3),
        "mN": Unit(over=1e3),
        "kgf": Unit(times=9.80665),  # ISO 80000-4
        "lbf": Unit(times=4.4482216152605),  # 0.45359237 kg times 9.80665 m/s²
    },
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
_SPREAD = re.compile(r"(.+)_std(_[xyz]_mm)")
_AXIS = re.compile(r"a([1-9][0-9]?)_(deg|mm|cmd_deg|link_deg|tau_nm)")
_AXIS_KIND = {
    "deg": "angle",
    "mm": "length",
    "cmd_deg": "angle",
    "link_deg": "angle",
    "tau_nm": "torque",
}


@dataclass(frozen=True)
class Column:
    """Definition of one column in the format.

    Attributes:
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
    """Return the format's definition of a column; None where it has none."""
    if name in _FIXED:
        return Column(name, _FIXED[name])
    if match := _AXIS.fullmatch(name):
        kind = _AXIS_KIND[match[2]]
        return Column(name, kind, match[2] == "link_deg", int(match[1]))
    if name.endswith(COORDINATES) and name[:-5] in markers:
        return Column(name, "length", may_be_blank=True)
    if (match := _SPREAD.fullmatch(name)) and match[1] in markers:
        return Column(name, "length", may_be_blank=True)
    return None


def is_stray_marker(name: str, markers: Collection[str]) -> bool:
    """Return whether a column belongs to a marker that the manifest lacks."""
    stray = name.endswith(COORDINATES[0]) and name[:-5] not in markers
    return stray and column_of(name, markers) is None


def spread_of(marker: str) -> tuple[str, ...]:
    """Return the columns that hold the spread of a marker's readings, 1 sigma."""
    return tuple(f"{marker}_std{c}" for c in COORDINATES)


# --- Layout of a file -----------------------------------------------------------------

ALWAYS = ("time_s", "pose")


@dataclass(frozen=True)
class Held:
    """One column of the format, with its name and unit in this file.

    Attributes:
        source: Its name in the file; of a sum, how it is made up.
        terms: The file's columns that are added, each with its factor; empty: the
            source as it stands.
        unclear: Whether its entry has a fault, so that no reading can be judged.
    """

    column: Column
    source: str
    unit: Unit
    terms: tuple[tuple[str, float], ...] = ()
    unclear: bool = False

    @property
    def sources(self) -> tuple[str, ...]:
        """The columns of the file that it is made of."""
        return tuple(name for name, _ in self.terms) or (self.source,)


@dataclass(frozen=True)
class Layout:
    """Mapping from columns of the format to those of a file.

    Attributes:
        held: Columns by the format's names.
        unknown: Columns of the file that nothing reads.
        faults: Columns that are missing, double or without a marker or axis.
    """

    held: Mapping[str, Held]
    axes: int
    slides: tuple[bool, ...]
    unknown: tuple[str, ...]
    faults: tuple[str, ...]


def layout_of(
    header: Sequence[str],
    manifest: Manifest,
    file: str,
    axes: int | None,
    joints: Sequence[str] = (),
) -> Layout:
    """Find every column of the format in a file.

    The number of axes is None where unknown; `joints` are the model's axes where nobody
    said which of them were recorded.
    """
    held, faults = _mapped(header, manifest, file)
    faults += _read_twice(held, file)
    read = {source for h in held.values() for source in h.sources}
    made = made_by_rule(manifest)
    unclear = {n for n, entry in manifest.columns.items() if entry is UNCLEAR}
    meant = _meant_markers(header, manifest)
    for name in header:
        column = column_of(name, manifest.markers)
        if column and name not in held:
            if name not in {*manifest.columns, *made}:
                held[name] = Held(column, name, column.unit())
        elif column and held[name].source != name and name not in read:
            faults.append(
                f"{file}: columns {name!r} and {held[name].source!r} both stand for "
                f"{name!r}; rename one."
            )
        elif is_stray_marker(name, manifest.markers) and name not in read:
            faults.append(_stray(f"{file}, column {name!r}", name[:-5], manifest))
    numbers = {h.column.axis for h in held.values()} - {0}
    numbers |= {c.axis for n in unclear if (c := column_of(n, ()))} - {0}
    count = max(numbers, default=0) if axes is None else axes
    unread = [n for n in header if n not in held and n not in read]
    there = {*held, *made, *unclear}
    there |= {f"{marker}{c}" for marker in meant.values() for c in COORDINATES}
    if joints and _is_of_another_arm(numbers, count, unread):
        count = max(numbers)
        faults.append(_of_another_arm(count, joints, manifest, file))
    faults += _missing(there, manifest, file, max(count, 1), unread)
    if extra := sorted(n for n in numbers if n > count):
        faults.append(
            f"{file}: columns for a{extra[0]} and up, but there are {count} axes."
        )
    slides = tuple(f"a{k}_mm" in there for k in range(1, count + 1))
    faults += [
        f"{file}: 'a{k}_{end}' is an angle, but a{k} slides."
        for k in np.flatnonzero(slides) + 1
        for end in ("cmd_deg", "link_deg")
        if f"a{k}_{end}" in held
    ]
    unknown = tuple(n or "(no name)" for n in unread if column_of(n, ()) is None)
    return Layout(held, count, slides, unknown, tuple(faults))


def _is_of_another_arm(
    numbers: Collection[int], count: int, unread: Sequence[str]
) -> bool:
    """Return whether all axes up to another number are there, and none misspelt."""
    last = max(numbers, default=0)
    if last in (0, count) or set(numbers) != set(range(1, last + 1)):
        return False
    missing = (
        f"a{k}_{end}" for k in range(last + 1, count + 1) for end in TURN_OR_SLIDE
    )
    return not any(nearest(name, unread) for name in missing)


TURN_OR_SLIDE = ("deg", "mm")


def _of_another_arm(
    count: int, joints: Sequence[str], manifest: Manifest, file: str
) -> str:
    """Say that a recording has more or fewer axes than the model."""
    name = manifest.model_names.name
    whose = f" of {name!r}" if name else ""
    rest = f", which has a{len(joints) + 1} too"
    if count < len(joints):
        missing = " to ".join(f"'a{k}_deg'" for k in sorted({count + 1, len(joints)}))
        rest = f", so {missing} is missing; or say which of these were recorded: "
        rest += "[robot] axes = [...]"
    return (
        f"{file}: recorded on {count} axes{whose}, but this model has {len(joints)} "
        f"axes: {', '.join(joints)}. Give the model of that arm{rest}."
    )


def made_by_rule(manifest: Manifest) -> tuple[str, ...]:
    """Return the columns that a rule of rows makes, so that the file need not."""
    rules = {"pose": manifest.number_rows, "time_s": manifest.interval_s is not None}
    return tuple(name for name, holds in rules.items() if holds)


_OF_MARKER = re.compile(r"(.+?)(_std)?(_[xyz]_mm)")


def _marker_of(name: str, manifest: Manifest) -> str:
    """Return the marker that an entry names and the manifest lacks; else empty."""
    match = _OF_MARKER.fullmatch(name)
    stray = match and column_of(name, manifest.markers) is None
    return match[1] if match and stray and match[1] not in manifest.markers else ""


def _meant_markers(header: Sequence[str], manifest: Manifest) -> dict[str, str]:
    """Return which marker each misspelt one probably is: the nearest without columns.

    Where one has no columns and one name no marker, they belong together.
    """
    said = [*manifest.columns, *(n for n in header if n.endswith(COORDINATES[0]))]
    strays = {_marker_of(n, manifest) for n in said} - {""}
    free = [m for m in manifest.markers if f"{m}{COORDINATES[0]}" not in said]
    if len(strays) == len(free) == 1:
        return {strays.pop(): free[0]}
    meant = {n: nearest_of(n, free) for n in sorted(strays)}
    return {n: m for n, m in meant.items() if m is not None}


def _mapped(
    header: Sequence[str], manifest: Manifest, file: str
) -> tuple[dict[str, Held], list[str]]:
    held: dict[str, Held] = {}
    faults: list[str] = []
    meant, strays = _meant_markers(header, manifest), set[str]()
    for said, entry in manifest.columns.items():
        name, place = said, f"{FILE}, columns.{said}"
        source = Source(from_=entry) if isinstance(entry, str) else entry
        if source is UNCLEAR:
            continue
        if marker := _marker_of(name, manifest):
            if marker not in strays:
                faults.append(_stray(place, marker, manifest))
            strays.add(marker)
            if marker not in meant:
                continue
            name = meant[marker] + name.removeprefix(marker)
        column = column_of(name, manifest.markers)
        if column is None:
            known = expected(6, manifest.markers)
            faults.append(
                f"{place}: the format has no such column.{nearest(name, known)}"
            )
            name = _meant(name, header, manifest)
            if not name or not (column := column_of(name, manifest.markers)):
                continue
        if name in made_by_rule(manifest):
            rule = "number_rows" if name == "pose" else "interval_s"
            faults.append(f"{place}: {rule} makes it already; keep one of the two.")
        unit, before = source.unit, len(faults)
        allowed = () if column.kind in (COUNT, WORD) else tuple(UNITS[column.kind])
        if unit is not None and unit not in allowed:
            kinds = ", ".join(allowed) or "none, it has no unit"
            faults.append(f"{place}: unit {quoted(unit)} is not one of: {kinds}.")
            unit = None
        terms, fault = _terms(source, column)
        faults += [f"{place}: {fault}"] if fault else []
        shown = _formula(terms) if terms else source.from_ or name
        unclear = len(faults) > before
        held[name] = Held(column, str(shown), column.unit(unit), terms, unclear)
        faults += [
            f"{file}: column {one!r} is missing, which "
            f"{place} asks for.{nearest(one, header)}"
            for one in held[name].sources
            if one not in header
        ]
    return held, faults


MEASURED = ("angle", "length", "force", "torque")
"""Kinds of column of which no two are the same readings."""


def _read_twice(held: Mapping[str, Held], file: str) -> list[str]:
    """Return faults where axes, marks or directions are read from one column alike.

    What was commanded and what was reported of one axis may be the same, as may the
    spreads of a mark's coordinates; one of two linked axes is minus the other.
    """
    readers: dict[tuple[object, ...], list[str]] = {}
    for name, found in held.items():
        terms = found.terms or ((found.source, 1.0),)
        spread = _SPREAD.fullmatch(name) is not None
        if found.column.kind in MEASURED and len(terms) == 1 and not spread:
            end = name.partition("_")[2] if found.column.axis else ""
            readers.setdefault((*terms[0], end), []).append(repr(name))
    return [
        f"{file}: {' and '.join(names)} are read from the same column, {source!r}; "
        "each has its own, or factor = 0 where a force or torque is zero."
        for (source, factor, _), names in readers.items()
        if len(names) > 1 and factor
    ]


def _meant(name: str, header: Sequence[str], manifest: Manifest) -> str:
    """Return the column that a misspelt entry is for; empty where none is missing."""
    free = [
        n
        for n in expected(6, manifest.markers)
        if n not in manifest.columns and n not in header
    ]
    return nearest_of(name, free) or ""


def _terms(source: Source, column: Column) -> tuple[tuple[tuple[str, float], ...], str]:
    """Return what a column is the sum of, and what is wrong with that."""
    names = source.from_
    if source.factor is None and source.sum is None and not isinstance(names, tuple):
        return (), ""
    if isinstance(names, str):
        names = (names,)
    names, factors = names or (column.name,), source.sum
    fault = ""
    if len(names) > 1 and source.factor is not None:
        fault = "give the factors of several columns in sum, one for each."
    elif source.sum is not None and source.factor is not None:
        fault = "give factor or sum, not both."
    elif source.factor is not None:
        factors = (source.factor,)
    if not fault and (factors is None or len(factors) != len(names)):
        ones = ", ".join(["1"] * len(names))
        fault = f"sum needs one factor for each column, as in sum = [{ones}]."
    elif not fault and not all(factors or ()) and column.name not in WRENCH:
        fault = "a factor is 0; leave the column out."
    elif not fault and column.kind in (COUNT, WORD):
        fault = "it counts or names; it has no factor and is no sum."
    if fault or factors is None:
        factors = (1.0,) * len(names)
    return tuple(zip(names, factors, strict=True)), fault


def _formula(terms: Sequence[tuple[str, float]]) -> str:
    """Write a sum as a person would."""
    shown = ""
    for name, factor in terms:
        size = "" if abs(factor) == 1.0 else f"{abs(factor):g} * "
        sign = "-" if factor < 0 else "+"
        shown += f" {sign} {size}{name}"
    return shown.removeprefix(" + ").lstrip()


_ZERO = " Where it is zero, as beside a weight: {} = {{ from = a column, factor = 0 }}."
_INSTEAD_OF = {
    **{name: _ZERO.format(name) for name in WRENCH},
    "time_s": " Rows at even times need none: interval_s = N, in s.",
    "pose": " Where each row is a pose of its own: number_rows = true.",
}


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
        torque = any(name in held for name in WRENCH[3:])
        needed += WRENCH if torque else WRENCH[:3]  # else a pure force
    needed += [m + suffix for m in manifest.markers for suffix in COORDINATES]
    for marker in manifest.markers:
        if any(name in held for name in spread_of(marker)):
            needed += spread_of(marker)
    unmapped = ", and nothing in [columns] is mapped to it" * bool(manifest.columns)
    return faults + [
        f"{file}: column {name!r} is missing{unmapped}.{nearest(name, unread)}"
        f"{_INSTEAD_OF.get(name, '')}"
        for name in needed
        if name not in held
    ]


def expected(axes: int, markers: Collection[str]) -> list[str]:
    """Return the format's columns for a number of axes and these markers."""
    ends = ("deg", "mm", "cmd_deg", "link_deg", "tau_nm")
    each = [f"a{k}_{end}" for k in range(1, axes + 1) for end in ends]
    others = ["visit", "stage", "load_time_s", "load_kg", "temperature_c", "frames"]
    points = [m + suffix for m in markers for suffix in COORDINATES]
    spreads = [name for m in markers for name in spread_of(m)]
    return [*ALWAYS, *others, *each, *WRENCH, *points, *spreads]


def _stray(place: str, marker: str, manifest: Manifest) -> str:
    known = list(manifest.markers)
    listed = ", ".join(sorted(known)[:12]) or "none"
    return (
        f"{place}: no marker is called {marker!r} in {FILE}."
        f"{nearest(marker, known)} Known: {listed}."
    )
