"""An effect that was named is a mechanism again: its parameters build it.

This is the inverse of `Effect.parameters`: names of the vocabulary in SI go in, the
mechanism comes out. What no mechanism can have, such as a compliance below zero, is
taken as its bound: a spring cannot push back.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

from bench.effects import EFFECTS
from bench.effects.effect import Effect
from bench.errors import UnknownName, Unusable

LIGHT = 1e-3
"""Mass in kg that stands for a first moment where the mass itself does not show;
chosen: too light to be felt by itself."""

Value = float | str | None
"""A parameter as written: a number, a name, or null for one without end."""


@dataclass(frozen=True)
class Named:
    """One effect with its place and its parameters.

    Attributes:
        effect: Its name in the vocabulary.
        where: Its place.
        parameters: By the vocabulary's names, in SI; null is infinite.
        settings: What the mechanism needs beyond them, by its own names.
    """

    effect: str
    where: str
    parameters: dict[str, Value] = field(default_factory=dict)
    settings: dict[str, Value] = field(default_factory=dict)


def named(effect: Effect) -> Named:
    """Return an effect as it is written down, to the last bit."""
    known = dict(effect.parameters())
    inside = {f.name for f in fields(effect)} - {"where"}
    own = {_field(name) for name in known}
    settings = {name: getattr(effect, name) for name in sorted(inside - own)}
    return Named(effect.name, effect.where, _written(known), _written(settings))


def can_build(name: str) -> bool:
    """Return whether there is a mechanism of that name."""
    return any(kind.name == name for kind in EFFECTS)


def effect_of(found: Named) -> Effect:
    """Build the mechanism of a named effect; sizes that are not given are zero.

    Raises:
        UnknownName: Where no effect has that name.
        Unusable: Where a parameter is none of the effect's.
    """
    kinds = {kind.name: kind for kind in EFFECTS}
    if found.effect not in kinds:
        raise UnknownName("effect with a mechanism", found.effect, kinds)
    kind = kinds[found.effect]
    wanted = _read(found.parameters) | _read(found.settings)
    if found.effect == "gravity_load":
        wanted = _from_moments(wanted)
    known = {f.name: f for f in fields(kind) if f.name != "where"}
    values, faults = {}, []
    for name, value in wanted.items():
        own = _field(name)
        if own not in known:
            faults.append(str(UnknownName(f"parameter of {kind.name!r}", name, known)))
        elif isinstance(known[own].default, str):
            values[own] = value if isinstance(value, str) else f"a{round(value)}"
        elif isinstance(value, str):
            faults.append(f"{name} is {value!r}, expected a number.")
        else:
            values[own] = _possible(kind, own, value, known[own].default)
    if faults:
        raise Unusable(f"Effect {found.effect!r} at {found.where!r}", faults)
    return replace(kind(where=found.where).off(), **values)


def _field(name: str) -> str:
    return "with_axis" if name == "with" else name


def _possible(kind: type[Effect], name: str, value: float, usual: object) -> object:
    """Return the nearest value that the mechanism can have."""
    if isinstance(usual, int):
        value = round(value)
    least = kind.at_least.get(name, -math.inf)
    if value >= least:
        return type(value)(min(value, kind.at_most.get(name, math.inf)))
    # a beam of less than no stiffness is one whose compliance came out below zero
    return math.inf if name.endswith("_nm2") else type(value)(least)


def _from_moments(wanted: Mapping[str, float | str]) -> dict[str, float | str]:
    """Turn first moments into a light mass far out, which pulls the same."""
    moment = {
        name.replace("moment", "com").replace("_kg_m", "_m"): value
        for name, value in wanted.items()
        if name.startswith("moment_") and not isinstance(value, str)
    }
    rest = {k: v for k, v in wanted.items() if not k.startswith("moment_")}
    if not moment:
        return rest
    zero = {"com_x_m": 0.0, "com_y_m": 0.0, "com_z_m": 0.0}
    far = {name: value / LIGHT for name, value in moment.items()}
    return {**zero, **far, "mass_kg": LIGHT}


def _written(values: Mapping[str, object]) -> dict[str, Value]:
    return {name: _plain(value) for name, value in values.items()}


def _plain(value: object) -> Value:
    if isinstance(value, str):
        return value
    number = float(value)  # type: ignore[arg-type]
    return None if math.isinf(number) else number


def _read(values: Mapping[str, Value]) -> dict[str, float | str]:
    return {k: math.inf if v is None else v for k, v in values.items()}
