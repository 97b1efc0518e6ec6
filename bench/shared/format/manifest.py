"""Manifest recording.toml: robot, sensors, frames, markers, and how it is parsed.

`fill` reads a section field by field, so that every fault in it is found.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from types import UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import msgspec
from msgspec import UNSET, Struct, UnsetType, field

from bench.shared.format.faults import first_line, nearest, nearest_of, quoted

# --- Sections -------------------------------------------------------------------------


def fill(kind: Any, value: Any, where: str) -> tuple[Any, list[str]]:
    """Return a value of a type that msgspec knows, continuing after the first fault.

    Returns:
        The value, None where it cannot be built, and the faults. A key that nothing
        knows is a fault and is read as the nearest one that is not there; what cannot
        be meant is a fault and left at its default, or at the section's placeholder.
        So the rest can still be checked, and a misspelt key is one fault.
    """
    section = next((c for c in _choices(kind) if _is_section(c)), None)
    if isinstance(value, Mapping) and section:
        return _fill_section(section, value, where)
    if isinstance(value, Mapping) and get_origin(kind) is dict:
        item = get_args(kind)[1]
        filled = {k: fill(item, v, _join(where, k)) for k, v in value.items()}
        faults = [fault for _, found in filled.values() for fault in found]
        instead = next((INSTEAD[c] for c in _choices(item) if c in INSTEAD), None)
        kept = {k: v if v is not None else instead for k, (v, _) in filled.items()}
        return {k: v for k, v in kept.items() if v is not None}, faults
    numbers = value if isinstance(value, list) else [value]
    if any(isinstance(n, float) and not math.isfinite(n) for n in numbers):
        return None, [f"{where}: {quoted(value)} is not a finite number."]
    try:
        built = msgspec.convert(value, kind)
    except (msgspec.ValidationError, OverflowError, RecursionError) as error:
        return None, [f"{where}: {quoted(value)} — {_expected(kind, error)}."]
    return built, []


IN_WORDS = {
    **{"float": "a number", "int": "a whole number", "bool": "true or false"},
    **{"str": "a text", "array": "a list", "object": "a table", "null": "nothing"},
}
"""Types of a value as a user calls them."""


def _expected(kind: Any, error: Exception) -> str:
    """Return what is allowed in place of a value that cannot be meant."""
    words = [w for c in _choices(kind) if get_origin(c) is Literal for w in get_args(c)]
    if words and "enum" in str(error):
        return f"not one of: {', '.join(map(str, words))}"
    said = first_line(error)
    for types in re.findall("`([a-z |]+)`", said):
        names = [IN_WORDS.get(name) or name for name in types.split(" | ")]
        said = said.replace(f"`{types}`", " or ".join(names))
    return said


def _fill_section(
    kind: type[Struct], table: Mapping[str, Any], where: str
) -> tuple[Struct | None, list[str]]:
    fields = {f.encode_name: f for f in msgspec.structs.fields(kind)}
    types = get_type_hints(kind, include_extras=True)
    faults, said = [], {key: key for key in table if key in fields}
    for key in table:
        if key not in fields:
            meant = nearest_of(key, [name for name in fields if name not in said])
            faults.append(
                f"{_join(where, key)}: nothing is called so."
                f"{nearest(key, [meant] if meant else list(fields))} "
                f"Known here: {', '.join(fields)}."
            )
            if meant:
                said[meant] = key
    stand_ins = getattr(kind, "PLACEHOLDERS", {})
    strict = getattr(kind, "STRICT", False)
    values, whole = {}, len(said) == len(table) or not strict
    for name, known in fields.items():
        filled, found = None, []
        if name in said:
            key = said[name]
            filled, found = fill(types[known.name], table[key], _join(where, key))
            if key == name or isinstance(filled, Struct):
                faults += found  # whether a word for another one fits, nobody asked
        elif known.required:
            faults.append(f"{_join(where, name)}: missing.")
        if name in said and not (filled is None and found):
            values[known.name] = filled
        elif name in said and strict:
            whole = False
        elif name in stand_ins:
            values[known.name] = stand_ins[name]
        elif known.required:
            whole = False
    return (kind(**values) if whole else None), faults


def _choices(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _is_section(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, Struct)


def _join(where: str, key: str) -> str:
    plain = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    shown = key if plain and len(key) <= 60 else quoted(key)
    return f"{where}.{shown}" if where else shown


# --- Manifest -------------------------------------------------------------------------

FILE = "recording.toml"
MAX_NUMBER = 1e6
"""Largest number of a manifest, in its units; chosen: a kilometre, a thousand tons."""
Number = Annotated[float, msgspec.Meta(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[float, float, float, float]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=MAX_NUMBER)]
AboveZero = Annotated[float, msgspec.Meta(gt=0.0, le=MAX_NUMBER)]


class Entry(Struct, frozen=True, forbid_unknown_fields=True):
    """A section of the manifest; unknown keys are faults.

    `PLACEHOLDERS` stand for entries that are required and at fault, so that a section
    stays; one that is `STRICT` is not used where any of its entries is at fault.
    """


class Tracker(Entry, frozen=True):
    """`[sensors.tracker]`; without a repeatability where it is not known."""

    repeatability_mm: float | tuple[float, float, float] | None = None
    # its size is checked in `checks`: msgspec 0.22 aborts on a union of a bounded
    # float and a tuple
    volumetric_mm: NotNegative | None = None


class Wrench(Entry, frozen=True):
    """`[sensors.wrench]`; without `accuracy_nm` where no torque is read."""

    PLACEHOLDERS: ClassVar[Mapping[str, Any]] = {"accuracy_n": 0.0, "accuracy_nm": 0.0}
    accuracy_n: NotNegative
    accuracy_nm: NotNegative | None = None
    body: str = "flange"
    position_mm: Vector = (0.0, 0.0, 0.0)
    quaternion_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    frame: Literal["sensor", "base"] = "sensor"
    includes_tool_weight: bool = False


class Encoder(Entry, frozen=True):
    """`[sensors.encoder]`."""

    PLACEHOLDERS: ClassVar[Mapping[str, Any]] = {"repeatability_deg": 0.0}
    repeatability_deg: NotNegative


class Torque(Entry, frozen=True):
    """`[sensors.torque]`."""

    accuracy_nm: NotNegative


class Sensors(Entry, frozen=True):
    """`[sensors]`: what each instrument states of itself."""

    tracker: Tracker | None = None
    wrench: Wrench | None = None
    encoder: Encoder | None = None
    torque: Torque | None = None


class Tool(Entry, frozen=True):
    """`[tool]`: what is mounted beyond the model's last body."""

    mass_kg: NotNegative = 0.0
    com_mm: Vector = (0.0, 0.0, 0.0)


class Model(Entry, frozen=True):
    """`[model]`: how true the model's drawing is taken to be, 1 sigma."""

    length_mm: AboveZero | None = None
    angle_deg: AboveZero | None = None
    offset_deg: AboveZero | None = None
    mass_ratio: AboveZero | None = None


class Robot(Entry, frozen=True):
    """`[robot]`: the model's names, where they are not those of the format."""

    name: str = ""
    axes: tuple[str, ...] = ()
    bodies: dict[str, str] = field(default_factory=dict)


class Frame(Entry, frozen=True):
    """`[frames.tracker]`: p_base = R(quaternion) p_tracker + position."""

    position_mm: Vector
    quaternion_wxyz: Quaternion


class Frames(Entry, frozen=True):
    """`[frames]`."""

    tracker: Frame | None = None


class MarkerEntry(Entry, frozen=True):
    """`[markers.NAME]`."""

    PLACEHOLDERS: ClassVar[Mapping[str, Any]] = {"body": "base"}
    body: str
    position_mm: Vector | None = None
    target: str | None = None


class Source(Entry, frozen=True):
    """`[columns]`: where a column of the format is in a lab's own file.

    Attributes:
        from_: Its name there, or the names of those that are added.
        unit: The unit there; None for the format's own.
        factor: What its numbers are multiplied by, such as -1 for another sign.
        sum: One factor for each of several columns.
    """

    STRICT: ClassVar[bool] = True  # half an entry would be another column
    from_: str | tuple[str, ...] | None = field(default=None, name="from")
    unit: str | None = None
    factor: Number | None = None
    sum: tuple[Number, ...] | None = None


UNCLEAR = Source(unit="?")
"""Stands for a column whose entry cannot be meant: it is there, and is not read."""
INSTEAD: dict[Any, Struct] = {Source: UNCLEAR, MarkerEntry: MarkerEntry(body="base")}
"""What stands for an entry of a named table that cannot be meant."""


class Csv(Entry, frozen=True):
    """`[csv]`: how a lab's own file is written.

    Attributes:
        separator: Between cells.
        decimal_mark: The same as `decimal`, under another name.
        skip_rows: How many rows below the header are no readings, such as one of units;
            or a list of lines, above the header too, as a spreadsheet counts them.
        skip_incomplete: Whether rows are left out in which a required cell is blank.
    """

    separator: str = ","
    decimal: str | UnsetType = UNSET
    decimal_mark: str | UnsetType = UNSET
    encoding: str = "utf-8"
    skip_rows: int | tuple[int, ...] = 0
    # its size is checked in `csv_faults`, as the tracker's
    skip_incomplete: bool = False

    @property
    def mark(self) -> str:
        """The decimal mark, under either of its names."""
        for given in (self.decimal, self.decimal_mark):
            if isinstance(given, str):
                return given
        return "."


class Manifest(Entry, frozen=True):
    """The whole manifest.

    `number_rows` makes each row a pose, `interval_s` the time where there is no column
    of it; `pulled`: each row is a pulled pose whose unloaded reading is zero by
    definition. These three may stand in `[csv]` as well.
    """

    PLACEHOLDERS: ClassVar[Mapping[str, Any]] = {"format": 1, "rows": "plateaus"}
    format: Literal[1]
    rows: Literal["plateaus", "stream"]
    number_rows: bool = False
    interval_s: AboveZero | None = None
    pulled: bool = False
    name: str = ""
    robot: str | Robot = ""
    displacement: Literal["absolute", "relative"] = "absolute"
    sensors: Sensors = Sensors()
    tool: Tool | None = None
    model: Model = Model()
    frames: Frames = Frames()
    markers: dict[str, MarkerEntry] = field(default_factory=dict)
    columns: dict[str, str | Source] = field(default_factory=dict)
    csv: Csv = Csv()

    @property
    def model_names(self) -> Robot:
        """The model's names, whether or not there is a `[robot]`."""
        return self.robot if isinstance(self.robot, Robot) else Robot(name=self.robot)


def parse(text: str) -> tuple[Manifest | None, list[str]]:
    """Read the manifest; None, and all faults, where it cannot be understood."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        return None, [f"{FILE} is not TOML: {first_line(error)}.{twice(text)}"]
    return manifest_of(table)


def manifest_of(table: dict[str, Any]) -> tuple[Manifest | None, list[str]]:
    """Read the manifest that a table is; None, and all faults, as in `parse`."""
    manifest, faults = fill(Manifest, _lifted(table), "")
    tables = (table.get(name, {}) for name in ("columns", "markers", "csv"))
    if not all(isinstance(t, dict) for t in tables):
        manifest = None  # nothing tells what the samples should be
    return manifest, [f"{FILE}, {fault}" for fault in faults]


ROW_RULES = ("number_rows", "interval_s", "pulled")
"""What a row is, where no column says so."""


def _lifted(table: dict[str, Any]) -> dict[str, Any]:
    """Take the rules of rows out of `[csv]`, where they may stand as well."""
    about = table.get("csv")
    if not isinstance(about, dict):
        return table
    rules = {k: about[k] for k in ROW_RULES if k in about and k not in table}
    return {**table, **rules, "csv": {k: about[k] for k in about if k not in rules}}


def twice(text: str) -> str:
    """Return a hint where a robot is both a word and a table; else nothing."""
    lines = [line.strip() for line in text.splitlines()]
    if "[robot]" in lines and any(line.startswith("robot ") for line in lines):
        return ' Inside [robot], the robot\'s own name is `name = "…"`.'
    return ""
