"""Parser of effects written as text, such as `hysteresis@a2,width_rad=2e-4`."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace

import mujoco

from bench.effects import EFFECTS
from bench.effects.effect import Effect
from bench.effects.places import misplaced
from bench.kinematic_chain import anatomy
from bench.shared.effect_catalogue import on_slide
from bench.shared.errors import EFFECTS as LIST
from bench.shared.errors import BenchError, UnknownName, Unusable, refuse


def parse(text: str, model: mujoco.MjModel) -> Effect:
    """Read `NAME@WHERE[,parameter=value…]`.

    Parameters have the vocabulary's names and SI units. Those left out keep the size of
    a catalogue; where all are components of one thing (shifts and turns, a bias),
    components left out beside others are zero.

    Raises:
        UnknownName: Where no effect has that name.
        Unusable: Where the place or a parameter does not exist or a value cannot be;
            all faults at once.
    """
    head, *settings = (part.strip() for part in text.split(","))
    name, at, where = (part.strip() for part in head.partition("@"))
    kinds = {effect.name: effect for effect in EFFECTS}
    if name not in kinds:
        raise UnknownName("effect", name, kinds)
    kind = kinds[name]
    faults = [] if at else [f"{head!r} has no place; write {name}@WHERE."]
    values = {}
    for setting in settings:
        try:
            parameter, value = _setting(kind, setting)
        except BenchError as error:
            faults.append(str(error))
            continue
        if parameter in values:
            faults.append(f"{parameter} is given twice.")
        values[parameter] = value
    try:
        effect = replace(_without_other_components(kind(where=where), values), **values)
    except Unusable as error:
        effect = kind(where=where)
        faults += error.faults
    if at:
        faults += misplaced(effect, anatomy(model))
    refuse(f"Effect {text!r}", faults)
    return effect


def parse_all(texts: Iterable[str], model: mujoco.MjModel) -> tuple[Effect, ...]:
    """Read several effects, as `parse` does, in their order.

    Raises:
        Unusable: All faults of all effects.
    """
    effects, faults = [], []
    for text in texts:
        try:
            effects.append(parse(text, model))
        except Unusable as error:
            faults += [f"{text!r}: {fault}" for fault in error.faults]
        except UnknownName as error:
            faults.append(str(error))
    refuse(LIST, faults)
    return tuple(effects)


def _without_other_components(effect: Effect, values: Mapping[str, object]) -> Effect:
    """Return the effect with the components left out set to zero."""
    none = effect.off()
    sizes = none.parameters().values()
    components = len(sizes) > 1 and all(size == 0.0 for size in sizes)
    return none if components and values else effect


def _setting(kind: type[Effect], setting: str) -> tuple[str, float | int | str]:
    """Return the name of a field and its value."""
    written, _, text = (part.strip() for part in setting.partition("="))
    known = {f.name.removesuffix("_axis"): f for f in fields(kind) if f.name != "where"}
    along = {on_slide(kind.name, name): name for name in known}
    written = along.get(written, written)  # metres and newtons, where the axis slides
    if written not in known:
        raise UnknownName(f"parameter of {kind.name!r}", written, known)
    field = known[written]
    if isinstance(field.default, str):
        return field.name, text
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    whole = isinstance(field.default, int)
    if not math.isfinite(value) or (whole and value != int(value)):
        number = "a whole number" if whole else "a finite number"
        raise BenchError(f"{written} is {text!r}, expected {number}.")
    return field.name, int(value) if whole else value
