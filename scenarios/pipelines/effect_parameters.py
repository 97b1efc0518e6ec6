"""Names, units and usual sizes of the parameters of effects, as people read them.

People read parameters in units of their own, and with an interval.

Catalogues say how large an effect usually is; beyond that one looks twice.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from scenarios.pipelines.schema import Interval

# --- Names, units and digits ----------------------------------------------------------

WORDS = {
    "rad": ("µrad", 1e6),
    "rad_per_nm": ("µrad/(N m)", 1e6),
    "m": ("mm", 1e3),
    "m_per_n": ("µm/N", 1e6),
    "m_per_h": ("µm/h", 1e6),
    "rad_per_h": ("µrad/h", 1e6),
    "nm": ("N m", 1.0),
    "nm2": ("kN m²", 1e-3),
    "kg": ("kg", 1.0),
    "n": ("N", 1.0),
    "s": ("s", 1.0),
    "kg_m": ("kg m", 1.0),
}
"""Units for people, by the end of a parameter's name."""
DEGREES = ("°", 180.0 / np.pi)
"""Of where in a turn something is."""
MILLISECONDS = ("ms", 1e3)
"""Of what a channel tells late."""
COUNTS = ("order",)
"""Parameters that are whole numbers in gears."""


NOT_HELD = "(not held by these data)"


def size(name: str, value: float | str | None) -> str:
    """Return a parameter's value as people say it."""
    if value is None:
        return "no bound"
    if isinstance(value, str):
        return value
    unit, factor = unit_of(name)
    return f"{_digits(value * factor)}{' ' + unit if unit else ''}"


def _digits(value: float) -> str:
    """Return three digits, without powers of ten where people need none."""
    small = f"{value:.3g}"
    return f"{value:.0f}" if 1e3 <= abs(float(small)) < 1e6 else small


def span(name: str, interval: Interval) -> str:
    """Return a parameter with its interval."""
    text = size(name, interval.estimate)
    if interval.low is None and interval.high is None:
        return f"{text} {NOT_HELD}"
    if whole := _whole(name, interval):
        return whole
    if isinstance(interval.estimate, str) or interval.low == interval.high:
        return text
    factor = unit_of(name)[1]
    ends = [
        _digits(x * factor) if isinstance(x, float) else "?"
        for x in (interval.low, interval.high)
    ]
    return f"{text} ({ends[0]} to {ends[1]})"


def _whole(name: str, interval: Interval) -> str:
    """Return the one whole number that a count can be; empty where there is none."""
    ends = interval.low, interval.estimate, interval.high
    low, here, high = (x if isinstance(x, float) else np.nan for x in ends)
    if name not in COUNTS or not low <= round(here) <= high or high - low >= 1.0:
        return ""
    return str(round(here))


def chance(probability: float) -> str:
    """Return a probability without digits that nobody can stand for."""
    if probability < 1e-3:
        return "below 0.001"
    return f"{probability:.3f}" if probability <= 0.999 else "above 0.999"


def unit_of(name: str) -> tuple[str, float]:
    """Return the unit of a parameter, and its size in SI units, by its name."""
    if name.startswith("phase"):
        return DEGREES
    if name.startswith("delay"):
        return MILLISECONDS
    for ending in sorted(WORDS, key=len, reverse=True):
        if name.endswith(f"_{ending}"):
            return WORDS[ending]
    return ("", 1.0)


def label(name: str) -> str:
    """Return a parameter's name without its unit."""
    for ending in sorted(WORDS, key=len, reverse=True):
        if name.endswith(f"_{ending}"):
            return name.removesuffix(f"_{ending}").replace("_", " ")
    return name.replace("_", " ")


# --- Usual sizes ----------------------------------------------------------------------

ARCMIN = 2.909e-4
"""In rad."""
CHA = "Harmonic Drive, CHA engineering data 1018854"
CHOSEN = "no source; what is plausible"
KIN = "Slamani et al. 2012, uncalibrated arms"
MAKERS = "makers' data sheets of force sensors"


@dataclass(frozen=True)
class Usual:
    """A range in SI and where it comes from."""

    low: float
    high: float
    source: str


def _all(names: str, low: float, high: float, source: str) -> dict[str, Usual]:
    return {name: Usual(low, high, source) for name in names.split()}


USUAL: Mapping[str, Mapping[str, Usual]] = {
    "joint_compliance": _all(
        "compliance_rad_per_nm", 1e-6, 1e-4, "springs of 10 to 1000 kN m/rad"
    ),
    "hardening": {
        "stiffness_ratio": Usual(1.5, 1.84, f"{CHA}, sizes 14 to 40"),
        "torque_nm": Usual(2.0, 108.0, f"{CHA}, T1 of sizes 14 to 58"),
    },
    "asymmetric_stiffness": _all("ratio", 0.7, 1.4, CHOSEN),
    "lost_motion": _all("width_rad", 0.0, ARCMIN, f"{CHA}: below 1 arcmin"),
    "hysteresis": _all("width_rad", 0.0, ARCMIN, f"{CHA}: below 1 arcmin"),
    "creep": {
        "ratio": Usual(0.01, 0.05, CHOSEN),
        "time_s": Usual(1.0, 600.0, CHOSEN),
    },
    "angle_dependent_stiffness": _all("ratio", 0.03, 0.1, CHOSEN),
    "transmission_error": _all(
        "amplitude_rad", 0.0, ARCMIN, f"{CHA}: 1 arcmin from peak to peak"
    ),
    "bearing_tilt": _all(
        "u_rad_per_nm v_rad_per_nm",
        1.0 / 1800e3,
        1.0 / 44e3,
        "Klimchik 2011 scaled; cross-roller bearings of 44 to 910 kN m/rad",
    ),
    "wrist_coupling": _all("compliance_rad_per_nm", -1e-5, 1e-5, CHOSEN),
    "encoder_offset": _all("offset_rad", -1e-3, 1e-3, KIN),
    "link_bending": _all(
        "bending_nm2 torsion_nm2", 1.8e5, 7e5, "aluminium tubes of a 10 kg arm"
    ),
    "geometry_error": _all("x_m y_m z_m", -5e-4, 5e-4, KIN)
    | _all("rx_rad ry_rad rz_rad", -1e-3, 1e-3, KIN),
    "base_compliance": _all(
        "rx_rad_per_nm ry_rad_per_nm rz_rad_per_nm",
        1e-7,
        1e-6,
        "anchor bolts and pedestals of 1 to 10 MN m/rad",
    ),
    "wrench_gain": _all("fx fy fz tx ty tz", -0.02, 0.02, MAKERS),
    "wrench_misalignment": _all("rx_rad ry_rad rz_rad", -0.0087, 0.0087, CHOSEN)
    | _all("x_m y_m z_m", -1e-3, 1e-3, CHOSEN),
    "pulley_friction": _all("ratio", 0.01, 0.04, "ropemakers: 2 % a sheave"),
    "tracker_scale": _all("ratio", -5e-5, 5e-5, CHOSEN),
    "drift": _all("x_m_per_h y_m_per_h z_m_per_h", -5e-5, 5e-5, CHOSEN),
    "marker_slip": _all("x_m y_m z_m", -2e-5, 2e-5, CHOSEN),
}


def usual(effect: str, parameter: str) -> Usual | None:
    """Return the usual range of a parameter; None where there is none."""
    return USUAL.get(effect, {}).get(parameter)
