"""Scales an effect until its visibility is as large as asked.

The readings answer nearly in proportion to an effect's size, and χ² to its square, so
two or three simulations find the size that shows a given χ².
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from bench.effects.effect import Effect
from bench.shared.errors import BenchError, Unusable
from scenarios.studies.blind_trials.visibility import Visibility
from stiffness.robot.tracker_frame import LARGEST_SCALE

ABOVE = 1.25
"""By how much an effect may exceed the χ² that is asked for; chosen: the bars say at
least, and the smallest are the hardest."""
FEWEST = 20.0
"""Poses that have to contribute, by the rule of the bars."""
TRIES = 7
"""Simulations that may be spent on finding a size; chosen, three are usual."""
FORM = {
    "hardening": ("torque_nm",),
    "creep": ("time_s",),
    "angle_dependent_stiffness": ("order", "phase_rad"),
    "transmission_error": ("order", "phase_rad"),
    "bearing_tilt": ("centre_m",),
    "gravity_load": ("com_x_m", "com_y_m", "com_z_m"),
    "gravity_compensator": ("phase_rad",),
    "marker_slip": ("time_s",),
    "softening": ("torque_nm",),
    "thrust_turn": ("lead_m",),
    "loose_bearing": ("angle_rad",),
    "foot_lift_off": ("angle_rad", "preload_nm"),
    "warming_gear": ("visits",),
}
"""Parameters that are no size; all others grow with it."""
GROWS: dict[str, Callable[[float, float], float]] = {
    "hardening": lambda value, factor: 1.0 + (value - 1.0) * factor,
    "softening": lambda value, factor: 1.0 + (value - 1.0) * factor,
    "asymmetric_stiffness": lambda value, factor: value**factor,
    "link_bending": lambda value, factor: value / factor,
}
"""How sizes grow that are not in proportion to what they do."""
MAX_MAGNITUDES = {
    "hardening": 3.0,
    "asymmetric_stiffness": 3.0,
    "angle_dependent_stiffness": 0.6,
    "creep": 0.5,
    "lost_motion": 2e-3,
    "hysteresis": 2e-3,
    "transmission_error": 3e-3,
    "encoder_offset": 5e-3,
    "geometry_error": 5e-3,
    "gravity_load": 15.0,
    "gravity_compensator": 300.0,
    "pulley_friction": 0.3,
    "wrench_bias": 20.0,
    "wrench_gain": 0.3,
    "wrench_misalignment": 0.1,
    "tracker_scale": LARGEST_SCALE,
    "tracker_misalignment": 2e-2,
    "drift": 1e-2,
    "marker_slip": 1e-3,
    "thrust_turn": 1e-4,
    "warming_gear": 0.5,
}
"""Largest sizes that are still physical, in SI; chosen: several times what catalogues
and calibrations have."""


class OutOfReach(BenchError):
    """An effect that cannot be made as large as is asked at its place."""


def scaled(effect: Effect, factor: float) -> Effect:
    """Return an effect that moves the arm about so many times as far.

    Raises:
        OutOfReach: Where no such size is physical.
    """
    grow = GROWS.get(effect.name, lambda value, factor: value * factor)
    sizes = {
        name: float(grow(value, factor))
        for name, value in effect.parameters().items()
        if name not in FORM.get(effect.name, ()) and not isinstance(value, str)
    }
    largest = max(map(abs, sizes.values()))
    if effect.name == "asymmetric_stiffness":  # either side may be the stiffer one
        largest = max(largest, 1.0 / largest)
    if largest > MAX_MAGNITUDES.get(effect.name, np.inf):
        raise OutOfReach(f"{effect.name} at {effect.where} would have {sizes}.")
    try:
        return replace(effect, **sizes)
    except Unusable as error:
        raise OutOfReach(str(error)) from error


def as_large_as(
    effect: Effect, least: float, weigh: Callable[[Effect], Visibility]
) -> tuple[Effect, Visibility]:
    """Find the size at which an effect shows at least a given χ², and not much more.

    Args:
        effect: Of a catalogue's size.
        least: The χ² that is asked for.
        weigh: Simulates an effect and weighs what it changes.

    Raises:
        OutOfReach: Where no physical size shows as much, or too few poses show it.
        Unusable: Where it cannot be built at its place.
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
