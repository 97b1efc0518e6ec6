"""`recording.toml` says what was measured, with what, and in which frames."""

import tomllib
from typing import Annotated, Literal

import msgspec
from msgspec import UNSET, Struct, UnsetType, field

from bench.format.sections import fill, first_line

FILE = "recording.toml"
LARGEST = 1e6
"""Largest number of a manifest, in its units; chosen: a kilometre, a thousand tons."""
Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[float, float, float, float]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST)]


class Entry(Struct, frozen=True, forbid_unknown_fields=True):
    """A section of the manifest; what it does not know is a fault."""


class Tracker(Entry, frozen=True):
    """`[sensors.tracker]`."""

    repeatability_mm: float | tuple[float, float, float]
    # its size is checked in `agreement`: msgspec 0.22 aborts on a union of a bounded
    # float and a tuple
    volumetric_mm: NotNegative | None = None


class Wrench(Entry, frozen=True):
    """`[sensors.wrench]`."""

    accuracy_n: NotNegative
    accuracy_nm: NotNegative
    body: str = "flange"
    position_mm: Vector = (0.0, 0.0, 0.0)
    quaternion_wxyz: Quaternion = (1.0, 0.0, 0.0, 0.0)
    frame: Literal["sensor", "base"] = "sensor"
    includes_tool_weight: bool = False


class Encoder(Entry, frozen=True):
    """`[sensors.encoder]`."""

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

    body: str
    position_mm: Vector | None = None
    target: str | None = None


class Source(Entry, frozen=True):
    """`[columns]`: where a column of the format is in a lab's own file."""

    from_: str | None = field(default=None, name="from")
    unit: str | None = None


class Csv(Entry, frozen=True):
    """`[csv]`: how a lab's own file is written."""

    separator: str = ","
    decimal: str | UnsetType = UNSET
    decimal_mark: str | UnsetType = UNSET

    @property
    def mark(self) -> str:
        """The decimal mark, under either of its names."""
        for given in (self.decimal, self.decimal_mark):
            if isinstance(given, str):
                return given
        return "."


class Manifest(Entry, frozen=True):
    """The whole file."""

    format: Literal[1]
    rows: Literal["plateaus", "stream"]
    name: str = ""
    robot: str | Robot = ""
    displacement: Literal["absolute", "relative"] = "absolute"
    sensors: Sensors = Sensors()
    tool: Tool | None = None
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
    manifest, faults = fill(Manifest, table, "")
    return manifest, [f"{FILE}, {fault}" for fault in faults]


def twice(text: str) -> str:
    """Return a hint where a robot is both a word and a table; else nothing."""
    lines = [line.strip() for line in text.splitlines()]
    if "[robot]" in lines and any(line.startswith("robot ") for line in lines):
        return ' Inside [robot], the robot\'s own name is `name = "…"`.'
    return ""
