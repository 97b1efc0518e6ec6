"""Units, labels and number formats of effects' parameters, for reports and terminal.

`size` and `span` print a parameter without and with its interval, `chance` a
probability; `unit_of` and `label` split a parameter's name into unit and plain words.
"""

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
"""Display unit and its number per SI unit, by the ending of a parameter's name."""
DEGREES = ("°", 180.0 / np.pi)
"""Display unit of a phase."""
MILLISECONDS = ("ms", 1e3)
"""Display unit of a channel's delay."""
COUNTS = ("order",)
"""Parameters that are whole numbers in gears, such as the order of a harmonic."""


NOT_HELD = "(not held by these data)"


def size(name: str, value: float | str | None) -> str:
    """Return a parameter's value in its display unit, with three digits."""
    if value is None:
        return "no bound"
    if isinstance(value, str):
        return value
    unit, factor = unit_of(name)
    return f"{_digits(value * factor)}{' ' + unit if unit else ''}"


def _digits(value: float) -> str:
    """Return three digits, without a power of ten below a million."""
    small = f"{value:.3g}"
    return f"{value:.0f}" if 1e3 <= abs(float(small)) < 1e6 else small


def span(name: str, interval: Interval) -> str:
    """Return a parameter's value and its interval in its display unit."""
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
    """Return the only whole number in a count's interval; empty: none, or several."""
    ends = interval.low, interval.estimate, interval.high
    low, here, high = (x if isinstance(x, float) else np.nan for x in ends)
    if name not in COUNTS or not low <= round(here) <= high or high - low >= 1.0:
        return ""
    return str(round(here))


def chance(probability: float) -> str:
    """Return a probability with three digits, bounded at 0.001 and 0.999."""
    if probability < 1e-3:
        return "below 0.001"
    return f"{probability:.3f}" if probability <= 0.999 else "above 0.999"


def unit_of(name: str) -> tuple[str, float]:
    """Return a parameter's display unit and the factor from SI to it, by its name."""
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
