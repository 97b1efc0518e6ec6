"""A column of a recording has a name, a unit, and sometimes the right to a blank.

Outside, units are those that controllers and trackers export (mm, degrees); inside,
everything is SI and radians. `Unit` is the only place where the two meet.
"""

import re
from collections.abc import Collection
from dataclasses import dataclass
from math import pi

import numpy as np
from jaxtyping import Float


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
