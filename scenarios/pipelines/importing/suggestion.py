"""Suggests a mapping for a lab's own CSV, from the names and units of its columns.

A suggestion is a start to correct: what was guessed says so, what nothing tells is
left for the user to fill in, and columns that nobody understood are listed.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bench.shared.errors import Unusable
from bench.shared.format import toml_text
from bench.shared.format.cells import MISSING
from bench.shared.format.columns import COORDINATES, UNITS, WRENCH, column_of
from bench.shared.format.table import FIRST_LINES, SEPARATORS
from bench.shared.models import ModelFacts
from scenarios.pipelines.importing.spreadsheet import source_of

# --- How the file is written ----------------------------------------------------------

LOOKED_AT = 20_000
"""Rows that are looked at for decimal marks and blanks (chosen)."""


@dataclass(frozen=True)
class Sheet:
    """A CSV as far as it explains itself.

    Attributes:
        decimal: The mark of its numbers.
        skip_rows: Lines that are no rows, as a spreadsheet counts them.
        units: What stands below the names, blank where nothing does.
        rows: The first readings, as text.
    """

    encoding: str
    separator: str
    decimal: str
    names: tuple[str, ...]
    skip_rows: tuple[int, ...]
    units: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def sheet_of(source: bytes) -> Sheet:
    """Find out how a CSV is written.

    Raises:
        Unusable: Where no line looks like a header with numbers below it.
    """
    encoding, text = _decoded(source)
    lines = text.splitlines()[: FIRST_LINES + LOOKED_AT]
    found = (_in_cells(lines, s) for s in (*SEPARATORS, " "))
    best = max(found, key=lambda f: (len(f[1][f[2]]) if f else 0, 0), default=None)
    if best is None:
        say = "no line looks like names of columns with numbers below; is it a CSV? "
        say += "Of a spreadsheet, save the sheet as CSV."
        raise Unusable("This file", [say])
    separator, rows, header = best
    names = tuple(c.strip() for c in rows[header])
    first = header + 1
    while first < len(rows) and not _numbers(rows[first]):
        first += 1
    whole = [r for r in rows[first:] if len(r) == len(names)]
    units = rows[header + 1] if first > header + 1 else []
    units = tuple(u.strip(" []()") for u in [*units, *[""] * len(names)][: len(names)])
    skipped = (*range(1, header + 1), *range(header + 2, first + 1))
    cells = [c for r in whole for c in r]
    commas = sum(re.fullmatch(r"\s*[+-]?\d*,\d+\s*", c) is not None for c in cells)
    points = sum(re.fullmatch(r"\s*[+-]?\d*\.\d+.*", c) is not None for c in cells)
    decimal = "," if separator != "," and commas > points else "."
    readings = tuple(tuple(c.strip() for c in r) for r in whole)
    return Sheet(encoding, separator, decimal, names, skipped, units, readings)


def _decoded(source: bytes) -> tuple[str, str]:
    wide = source.startswith((b"\xff\xfe", b"\xfe\xff"))
    for encoding in (*(["utf-16"] if wide else []), "utf-8", "cp1252", "latin-1"):
        try:
            return encoding, source.decode(encoding).removeprefix("\ufeff")
        except UnicodeError:
            continue
    raise AssertionError("latin-1 reads every byte")


def _in_cells(
    lines: Sequence[str], separator: str
) -> tuple[str, list[list[str]], int] | None:
    """Cut lines into cells, and find the header: None where there is none."""
    rows = [next(csv.reader([line], delimiter=separator), []) for line in lines]
    for k, row in enumerate(rows[:FIRST_LINES]):
        names = [c for c in row if c.strip()]
        below = [r for r in rows[k + 1 : k + 6] if len(r) == len(row) and _numbers(r)]
        if len(names) > 1 and len(names) * 2 > len(row) and not _numbers(row) and below:
            return separator, rows, k
    return None


_NUMBER = re.compile(r"\s*[+-]?[\d.,]*\d[\d.,eE+-]*\s*")


def _numbers(row: Sequence[str]) -> int:
    return sum(_NUMBER.fullmatch(cell) is not None for cell in row)


# --- What the columns are -------------------------------------------------------------

SPELLINGS: dict[str, str] = {
    **{"°": "deg", "degree": "deg", "degrees": "deg", "grad": "deg", "gradc": "degC"},
    **{"radian": "rad", "radians": "rad", "µm": "um", "μm": "um", "micron": "um"},
    **{"inch": "in", "meter": "m", "sec": "s", "seconds": "s", "µs": "us"},
    **{"n·m": "Nm", "n*m": "Nm", "n m": "Nm", "n.m": "Nm", "nmm": "Nmm"},
    **{"kp": "kgf", "kg-f": "kgf", "kgf": "kgf", "lb-f": "lbf"},
    **{"°c": "degC", "c": "degC", "°f": "degF", "min.": "min", "sek": "s"},
}
"""How units are also written."""
_UNIT = re.compile(r"^(.*?)[\s_]*[\[(]([^\])]+)[\])]\s*$")
_AXIS = re.compile(r"(?:j|q|a|ax|axis|joint|achse|angle|theta)[ _.-]*([1-9][0-9]?)")
_SUM = re.compile(rf"{_AXIS.pattern}\s*([+-])\s*{_AXIS.pattern}")
_FORCE = re.compile(r"(?:f|force|kraft)[ _.-]*([xyz])")
_TORQUE = re.compile(r"(?:m|t|mom|moment|torque)[ _.-]*([xyz])")
_SPREAD = re.compile(r"(?:(.*?)[ _.-]*(?:std|sigma|sd|rms)|s)[ _.-]*([xyz])")
_POINT = re.compile(r"(.*?)[ _.-]*([xyz])")
_NUMBERED = re.compile(r"[ _.-]+(?:no|nr|num|number|nummer|#)\.?$")
_WORDS = {
    "time_s": ("time", "t", "zeit", "timestamp", "elapsed"),
    "pose": (
        *("pose", "posture", "pose id", "posenr", "config", "point", "position"),
        *("messpunkt", "punkt", "stellung", "haltung"),
    ),
    "load_kg": (
        *("mass", "load", "payload", "weight"),
        *("masse", "last", "zusatzlast", "traglast", "gewicht", "zuggewicht"),
    ),
    "temperature_c": ("temperature", "temp", "temperatur"),
    "frames": ("frames", "samples averaged"),
}


@dataclass(frozen=True)
class Guess:
    """What the columns of a file probably are.

    Attributes:
        columns: The format's name, to the file's name and its unit; None for the
            format's own.
        sums: The format's name of an axis, to the columns that make it up with their
            factors, and their unit.
    """

    columns: Mapping[str, tuple[str, str | None]] = field(default_factory=dict)
    sums: Mapping[str, tuple[Mapping[str, int], str | None]] = field(
        default_factory=dict
    )
    markers: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()


def guess_of(sheet: Sheet, model: ModelFacts | None = None) -> Guess:
    """Guess what each column is by its name and unit.

    Args:
        sheet: The file.
        model: The robot, whose joints columns may be called after.
    """
    columns: dict[str, tuple[str, str | None]] = {}
    coupled: list[tuple[str, str, re.Match[str]]] = []
    points: dict[str, dict[str, tuple[str, str]]] = {}
    spreads: dict[str, dict[str, tuple[str, str]]] = {}
    for name in sheet.names:
        if not name or sheet.names.count(name) > 1:
            continue
        match, unit = _UNIT.match(name), _unit_beside(sheet, name)
        plain = match[1] if match else name
        plain = plain.strip().casefold()
        if said := _known(name) or _by_word(plain) or _by_joint(plain, model):
            columns.setdefault(said, (name, _unit(said, unit)))
        elif SPELLINGS.get(unit.casefold(), unit) in UNITS["temperature"]:
            columns.setdefault("temperature_c", (name, _unit("temperature_c", unit)))
        elif match := _SUM.fullmatch(plain):
            coupled.append((name, unit, match))
        elif match := _SPREAD.fullmatch(plain):
            spreads.setdefault(match[1] or "", {})[match[2]] = (name, unit)
        elif match := _POINT.fullmatch(plain):
            points.setdefault(match[1], {})[match[2]] = (name, unit)
    markers = [p for p, found in points.items() if len(found) == 3]
    for point in markers:
        marker = re.sub(r"\W+", "_", point).strip("_") or "p"
        spread = spreads.get(point, {})
        if not spread and len(markers) == 1 and len(spreads) == 1:
            (spread,) = spreads.values()
        for end in COORDINATES:
            name, unit = points[point][end[1]]
            columns[marker + end] = (name, _unit("p_x_mm", unit, ("p",)))
            if len(spread) == 3:
                name, unit = spread[end[1]]
                own = _unit("p_x_mm", unit, ("p",))
                columns[f"{marker}_std{end}"] = (name, own)
    sums = dict(_sums(coupled, columns))
    read = {source for source, _ in columns.values()}
    read |= {source for terms, _ in sums.values() for source in terms}
    names = tuple(re.sub(r"\W+", "_", p).strip("_") or "p" for p in markers)
    unknown = tuple(n for n in sheet.names if n and n not in read)
    return Guess(columns, sums, names, unknown)


def _sums(
    coupled: Sequence[tuple[str, str, re.Match[str]]],
    columns: Mapping[str, tuple[str, str | None]],
) -> Iterator[tuple[str, tuple[dict[str, int], str | None]]]:
    """Yield the axis that each sum of two holds beside one that is known."""
    for name, unit, match in coupled:
        one, sign, other = match.groups()
        axes = {f"a{one}_deg": 1, f"a{other}_deg": 1 if sign == "+" else -1}
        known = [axis for axis in axes if axis in columns]
        if len(axes) == 2 and len(known) == 1:
            (asked,) = axes.keys() - known
            beside = -axes[asked] * axes[known[0]]
            terms = {name: axes[asked], columns[known[0]][0]: beside}
            yield asked, (terms, _unit(asked, unit))


def _known(name: str) -> str | None:
    return name if column_of(name, ()) else None


def _by_word(plain: str) -> str | None:
    """Return the column that a name says in so many words."""
    for said, words in _WORDS.items():
        if plain in words or _NUMBERED.sub("", plain) in words:
            return said
    if match := _AXIS.fullmatch(plain):
        return f"a{match[1]}_deg"
    if match := _FORCE.fullmatch(plain):
        return f"f{match[1]}_n"
    if match := _TORQUE.fullmatch(plain):
        return f"t{match[1]}_nm"
    return None


def _by_joint(plain: str, model: ModelFacts | None) -> str | None:
    """Return the column of the one joint in whose name all words of a name are."""
    words = set(re.findall(r"[a-z]+|[0-9]+", plain)) - {"deg", "rad", "pos", "mm"}
    if model is None or not words:
        return None
    parts = [re.findall(r"[a-z]+|[0-9]+", name.casefold()) for name in model.axes]
    found = [k for k, own in enumerate(parts) if words <= set(own)]
    if len(found) != 1:
        return None
    slides = model.slides[model.joints.index(model.axes[found[0]])]
    return f"a{found[0] + 1}_{'mm' if slides else 'deg'}"


def _unit(said: str, unit: str, markers: tuple[str, ...] = ()) -> str | None:
    """Return a unit as `[columns]` calls it; None for the format's own or none."""
    known = _units_of(said, markers)
    unit = _spelt(unit, known)
    return unit if unit and unit != next(iter(known), "") else None


def _units_of(said: str, markers: Sequence[str]) -> list[str]:
    """Return the units that a column may have, the format's own first."""
    column = column_of(said, markers)
    return list(UNITS.get(column.kind, {})) if column else []


def _spelt(unit: str, known: Sequence[str]) -> str:
    """Return a unit as it is spelt here; empty where it is none of these."""
    unit = SPELLINGS.get(unit.strip().casefold(), unit.strip())
    return (
        unit
        if unit in known
        else {k.casefold(): k for k in known}.get(unit.casefold(), "")
    )


def _unit_beside(sheet: Sheet, name: str) -> str:
    """Return what stands in brackets in a column's name, or below it."""
    match = _UNIT.match(name)
    return (match[2] if match else sheet.units[sheet.names.index(name)]).strip()


def _remark(sheet: Sheet, name: str, known: Sequence[str]) -> str:
    """Return what is said behind a column whose unit is none that is known."""
    unit = _unit_beside(sheet, name)
    if not unit or not known or _spelt(unit, known):
        return ""
    none = f"{toml_text(unit)} is none of {', '.join(known)}"
    return f"  # {none}: if it is a unit, a factor"


# --- The mapping ----------------------------------------------------------------------


def suggested(path: Path, model: ModelFacts | None = None) -> str:
    """Return a mapping for a CSV, as TOML with remarks on what to correct.

    A marker is on the body that its name begins with, one of the robot's or a usual
    one; an axis' column is called after its number, or after the robot's joint.

    Raises:
        Unusable: Where there is no such file, or nothing in it looks like a table.
    """
    try:
        sheet = sheet_of(source_of(path))
    except Unusable as error:
        raise Unusable(f"File {str(path)!r}", error.faults) from None
    bodies = () if model is None else model.bodies
    return "\n".join(_lines(sheet, guess_of(sheet, model), path, bodies)) + "\n"


def write_suggestion(
    path: Path, mapping: Path | None = None, model: ModelFacts | None = None
) -> Path:
    """Write a mapping for a CSV, beside it unless told where; never over another file.

    Raises:
        Unusable: Where nothing can be suggested, or the mapping is there already.
    """
    mapping = mapping or path.with_suffix(".toml")
    text = suggested(path, model)
    try:
        with mapping.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        say = "it is there already; give another name with --mapping."
        raise Unusable(f"Mapping {str(mapping)!r}", [say]) from None
    except OSError as error:
        say = f"it cannot be written: {error}."
        raise Unusable(f"Mapping {str(mapping)!r}", [say]) from None
    return mapping


def _lines(
    sheet: Sheet, guess: Guess, path: Path, bodies: Sequence[str]
) -> Iterator[str]:
    columns = guess.columns
    yield f"# Suggested from the names and units in {toml_text(path.name)}: correct it."
    yield "format = 1"
    yield f"name = {toml_text(path.stem)}"
    yield 'rows = "plateaus"  # each line is a reading at rest; or "stream"'
    if "pose" not in columns:
        yield "number_rows = true  # each row is a pose of its own: is it so?"
    if "time_s" not in columns:
        yield "interval_s = 20  # nothing tells the time: one row every N s"
    yield "# pulled = true  # each row is a deflection from the unloaded arm"
    yield from ["", "[csv]", f"separator = {toml_text(sheet.separator)}"]
    yield f"decimal = {toml_text(sheet.decimal)}"
    if sheet.encoding != "utf-8":
        yield f"encoding = {toml_text(sheet.encoding)}"
    if sheet.skip_rows:
        said = list(sheet.skip_rows)
        yield f"skip_rows = {said if said != [2] else 1}"
    if _incomplete(sheet, columns):
        yield "skip_incomplete = true  # some rows have blanks; they are counted"
    yield from ["", "[columns]"]
    for said, (source, unit) in columns.items():
        entry = toml_text(source)
        if unit:
            entry = f"{{ from = {entry}, unit = {toml_text(unit)} }}"
        plain = re.fullmatch(r"[A-Za-z0-9_-]+", said)
        if said == WRENCH[0]:
            yield "# what the world exerts on the robot: pulled along +x, fx_n is above"
            yield "# 0; of the other sign: factor = -1.0 beside unit, in all six"
        remark = _remark(sheet, source, _units_of(said, guess.markers))
        yield f"{said if plain else toml_text(said)} = {entry}{remark}"
    for said, (terms, unit) in guess.sums.items():
        sources = ", ".join(map(toml_text, terms))
        own = f", unit = {toml_text(unit)}" if unit else ""
        entry = f"{{ from = [{sources}], sum = {list(terms.values())}{own} }}"
        yield f"{said} = {entry}  # by its name: is it so?"
    if not any(said in columns for said in ("a1_deg", "a1_mm")):
        yield '# a1_deg = "?"  # which columns are the axes\' angles?'
    if guess.unknown:
        yield f"# not understood: {', '.join(map(toml_text, guess.unknown))}"
    yield from _sensors(guess, bodies)


def _sensors(guess: Guess, bodies: Sequence[str]) -> Iterator[str]:
    spreads = any("_std_" in said for said in guess.columns)
    if guess.markers and not spreads:
        yield from ["", "[sensors.tracker]"]
        yield "repeatability_mm = 0.02  # one sigma of one reading: say yours"
    if any(said in guess.columns for said in WRENCH):
        yield from ["", "[sensors.wrench]"]
        yield "accuracy_n = 0.5  # one sigma of one reading: say yours"
        if any(said in guess.columns for said in WRENCH[3:]):
            yield "accuracy_nm = 0.05"
        yield 'body = "flange"  # what the sensor is mounted on'
        yield "position_mm = [0, 0, 0]  # its origin in that body"
        yield from [
            "",
            "# [tool]  # what the flange carries beside the model, sensor too",
        ]
        yield from ["# mass_kg = 0.5", "# com_mm = [0, 0, 25]  # in the flange's frame"]
    if bodies and not all(_body_of(marker, bodies) for marker in guess.markers):
        yield from ["", f"# this robot's bodies: {', '.join(bodies)}"]
    for marker in guess.markers:
        yield from ["", f"[markers.{toml_text(marker)}]"]
        body = _body_of(marker, bodies)
        if body:
            yield f"body = {toml_text(body)}  # by the marker's name: is it so?"
        else:
            yield '# body = "?"  # which body is it stuck to? no import without'


_BODY = re.compile(r"(base|flange|tool|tcp|link)[ _.-]?([1-9][0-9]?)?(?![a-z0-9])")


def _body_of(marker: str, bodies: Sequence[str]) -> str:
    """Return the body that a marker's name begins with; empty: none."""
    plain = marker.casefold()
    for body in sorted(bodies, key=len, reverse=True):
        rest = plain.removeprefix(body.casefold())
        if rest != plain and not rest[:1].isalnum():
            return body
    match = _BODY.match(plain)
    if match is None:
        return ""
    word, number = match.groups()
    if word == "link":
        return f"link_{number}" if number else ""
    return "base" if word == "base" else "flange"


def _incomplete(sheet: Sheet, columns: Mapping[str, tuple[str, str | None]]) -> bool:
    required = {
        sheet.names.index(source)
        for said, (source, _) in columns.items()
        if column_of(said, ()) and not said.endswith("_link_deg")
    }
    cells = (row[k].casefold() for row in sheet.rows for k in required)
    return any(cell in MISSING for cell in cells)
