"""Scales an effect until its visibility is as large as asked.

The readings respond nearly in proportion to an effect's size, and χ² to its square, so
two or three simulations find the size that has a given χ².
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bench.effects.effect import Effect
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import BenchError, Unusable
from scenarios.studies.blind_trials.visibility import Visibility

ABOVE = 1.25
"""Factor by which an effect may exceed the χ² that is asked for; chosen: the bars give
the least, and the smallest effects are the hardest."""
FEWEST = 20.0
"""Least number of poses that contribute, by the rule of the bars."""
TRIES = 7
"""Most simulations to find a size; chosen, three are usual."""
OUT_OF_LIBRARY_SHAPES = {
    "softening": ("torque_nm",),
    "thrust_turn": ("lead_m",),
    "loose_bearing": ("angle_rad",),
    "foot_lift_off": ("angle_rad", "preload_nm"),
    "warming_gear": ("visits",),
}
"""Parameters that are not magnitudes, of effects that are not in the catalogue."""
GROWS: dict[str, Callable[[float, float], float]] = {
    "hardening": lambda value, factor: 1.0 + (value - 1.0) * factor,
    "softening": lambda value, factor: 1.0 + (value - 1.0) * factor,
    "asymmetric_stiffness": lambda value, factor: value**factor,
    "link_bending": lambda value, factor: value / factor,
}
"""How parameters scale that are not in proportion to the displacement they cause."""
OUT_OF_LIBRARY_LARGEST = {"thrust_turn": 1e-4, "warming_gear": 0.5}
"""Largest physical sizes of effects that are not in the catalogue, in SI; chosen."""


class OutOfReach(BenchError):
    """An effect that cannot be made as large as is asked at its site."""


def scaled(effect: Effect, factor: float) -> Effect:
    """Return an effect whose displacements are larger by about a factor.

    Raises:
        OutOfReach: Where no such size is physical.
    """
    grow = GROWS.get(effect.name, lambda value, factor: value * factor)
    sizes = {
        name: float(grow(value, factor))
        for name, value in effect.parameters().items()
        if name not in _shapes(effect) and not isinstance(value, str)
    }
    largest = max(map(abs, sizes.values()))
    if effect.name == "asymmetric_stiffness":  # either side may be the stiffer one
        largest = max(largest, 1.0 / largest)
    if largest > _largest(effect):
        raise OutOfReach(f"{effect.name} at {effect.where} would have {sizes}.")
    try:
        return replace(effect, **sizes)
    except Unusable as error:
        raise OutOfReach(str(error)) from error


def _shapes(effect: Effect) -> tuple[str, ...]:
    if effect.name in CATALOGUE:
        return CATALOGUE[effect.name].shapes
    return OUT_OF_LIBRARY_SHAPES.get(effect.name, ())


def _largest(effect: Effect) -> float:
    if effect.name in CATALOGUE:
        largest = CATALOGUE[effect.name].largest
    else:
        largest = OUT_OF_LIBRARY_LARGEST.get(effect.name)
    return np.inf if largest is None else largest


def as_large_as(
    effect: Effect, least: float, weigh: Callable[[Effect], Visibility]
) -> tuple[Effect, Visibility]:
    """Find the size at which an effect has at least a given χ², and not much more.

    Args:
        effect: Of a catalogue's size.
        least: The χ² that is asked for.
        weigh: Simulates an effect and returns its visibility.

    Raises:
        OutOfReach: Where no physical size has this χ², or too few poses contribute.
        Unusable: Where it cannot be built at its site.
    """
    wanted = least * np.sqrt(ABOVE)
    factor, known = 1.0, []
    for _ in range(TRIES):
        tried = scaled(effect, factor)
        weight = weigh(tried)
        if least <= weight.chi2 <= ABOVE * least:
            if weight.poses < FEWEST:
                fault = f"{weight.poses:.0f} poses show {effect.name}@{effect.where}."
                raise OutOfReach(fault)
            return tried, weight
        if not weight.chi2 > 0.0:
            break
        known.append((np.log(factor), np.log(weight.chi2)))
        power = 2.0
        if len(known) > 1:
            (x0, y0), (x1, y1) = known[-2:]
            power = float(np.clip((y1 - y0) / (x1 - x0), 0.5, 4.0))
        step = (np.log(wanted) - known[-1][1]) / power
        factor = float(np.clip(np.exp(known[-1][0] + step), 1e-6, 1e3))
    raise OutOfReach(f"No size of {effect.name} at {effect.where} shows {least:g}.")
