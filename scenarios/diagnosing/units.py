"""People read parameters in units of their own, and with an interval."""

from scenarios.diagnosing.schema import Interval

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


def size(name: str, value: float | str | None) -> str:
    """Return a parameter's value as people say it."""
    if value is None:
        return "no bound"
    if isinstance(value, str):
        return value
    unit, factor = unit_of(name)
    return f"{value * factor:.3g}{' ' + unit if unit else ''}"


def span(name: str, interval: Interval) -> str:
    """Return a parameter with its interval."""
    text = size(name, interval.estimate)
    if isinstance(interval.estimate, str) or interval.low == interval.high:
        return text
    factor = unit_of(name)[1]
    ends = [
        f"{x * factor:.3g}" if isinstance(x, float) else "?"
        for x in (interval.low, interval.high)
    ]
    return f"{text} ({ends[0]} to {ends[1]})"


def unit_of(name: str) -> tuple[str, float]:
    """Return the unit of a parameter, and its size in SI units, by its name."""
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
