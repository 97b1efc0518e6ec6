"""An interval is good if it holds the true parameter as often as it says.

Only parameters of names that were given as they are true count, and only where the
mechanism has the parameter: another law of the same name has another meaning of it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi

from bench.effects import OTHER_LAWS

OTHER = {kind.__name__ for kind in OTHER_LAWS}
SIGNED = {"torque_nm", "amplitude_rad", "ratio"}
"""Sizes of waves: turned round, the phase moves by half a turn."""


@dataclass(frozen=True)
class Covered:
    """A parameter, its interval, and whether it holds the truth.

    Attributes:
        parameter: `effect.parameter`.
        true: Its true value, in SI.
        low: Lower end.
        high: Upper end.
        holds: Whether the true value lies between them.
    """

    parameter: str
    true: float
    low: float
    high: float
    holds: bool


def covered_by(named: Sequence[Mapping], effect: Mapping) -> list[Covered]:
    """Return the intervals that an answer states for one true effect.

    Args:
        named: Names that were given.
        effect: What is true.
    """
    same = [
        one["parameters"]
        for one in named
        if (one["effect"], one["where"]) == (effect["effect"], effect["where"])
    ]
    if not same or effect["mechanism"] in OTHER:
        return []
    true = _true(effect)
    stated = {name: p for name, p in same[0].items() if _is_interval(p)}
    if "phase_rad" in true:
        true = _turned(true, stated)
    found = []
    for name, p in stated.items():
        if name in true:
            value, low, high = true[name], p["low"], p["high"]
            found.append(
                Covered(
                    f"{effect['effect']}.{name}", value, low, high, low <= value <= high
                )
            )
    return found


def _is_interval(parameter: Mapping) -> bool:
    """Return whether both ends are numbers and differ: an order has no interval."""
    ends = (parameter["low"], parameter["high"])
    return all(isinstance(e, int | float) for e in ends) and ends[0] < ends[1]


def _true(effect: Mapping) -> dict[str, float]:
    numbers = effect["parameters"].items()
    true = {k: float(v) for k, v in numbers if isinstance(v, int | float)}
    if "mass_kg" in true:  # where a mass does not show, its moment does
        for axis in "xyz":
            true[f"moment_{axis}_kg_m"] = true["mass_kg"] * true[f"com_{axis}_m"]
    return true


def _turned(true: dict[str, float], stated: Mapping) -> dict[str, float]:
    """Write a wave with the sign and the turn of the phase that was stated."""
    true = dict(true)
    for name in SIGNED & true.keys() & stated.keys():
        if true[name] * (stated[name]["low"] + stated[name]["high"]) < 0.0:
            true[name], true["phase_rad"] = -true[name], true["phase_rad"] + pi
    if "phase_rad" in stated:
        middle = (stated["phase_rad"]["low"] + stated["phase_rad"]["high"]) / 2
        turns = round((middle - true["phase_rad"]) / (2 * pi))
        true["phase_rad"] += 2 * pi * turns
    return true
