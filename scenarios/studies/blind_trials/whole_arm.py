"""Draws the effects of a whole arm, with sizes of catalogues, and twins of effects.

Effects are drawn until there are as many as the stratum asks for: a kind that sits in
axes or links as often as there are axes, any other once, so that gears and bearings
prevail as in real arms. An arm that has all effects is not drawn: every rotary axis
hardens, holds back wind-up, creeps, ripples and tilts, links bend, the foot gives.

==========  ==========================================================================
Equation    size log-uniform in the catalogue's usual range, uniform where that reaches
            zero; a bearing's compliance that of its axis' spring over 6 to 33; a
            compensator's torque within a factor of two of that at which its gear
            hardens; other sizes without a range within that factor of their default
Source      `bench.shared.effect_catalogue`; ratios of tilt to spring: `bench.study_arm`
Valid       arms whose springs wind up by some milliradians
Ignores     that sizes of one arm go together: bearings of one maker, links of one tube
==========  ==========================================================================
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from bench.effects import EFFECTS
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.effect import Effect
from bench.effects.gravity_compensator import GravityCompensator
from bench.shared.effect_catalogue import CATALOGUE, Range
from scenarios.studies.blind_trials.effects import (
    BETWEEN_AXES,
    PERIODIC,
    WOUND_UP,
    Ground,
    draw_site_and_form,
)
from scenarios.studies.blind_trials.magnitudes import OutOfReach
from scenarios.studies.blind_trials.strata import ALL, EVERY_AXIS, Stratum

# --- Sizes ----------------------------------------------------------------------------

OVER_SPRING = (6.0, 33.0)
"""Stiffness of a bearing over that of its axis' gear on the study's arm."""
UNKNOWN = 2.0
"""Factor about the default of a size without a usual range; chosen."""


def of_catalogue_size(
    effect: Effect, draw: np.random.Generator, ground: Ground
) -> Effect:
    """Return an effect with magnitudes from usual ranges; its form stays.

    Components that its form leaves at zero stay there.

    Args:
        effect: An effect at its site, with its form.
        draw: Random numbers.
        ground: The arm and plan of the trial.
    """
    now, sizes = effect.parameters(), {}
    for parameter in CATALOGUE[effect.name].parameters:
        value = now.get(parameter.name)
        if parameter.role != "magnitude" or not isinstance(value, float | int):
            continue
        usual = parameter.usual
        if isinstance(effect, BearingTilt):
            spring = WOUND_UP / ground.knees[effect.where]
            over = _log_uniform(draw, *OVER_SPRING)
            sizes[parameter.name] = float(_within(spring / over, usual))
        elif isinstance(effect, GravityCompensator):
            about = ground.knees[effect.where]
            sizes[parameter.name] = about * _log_uniform(draw, 1 / UNKNOWN, UNKNOWN)
        elif usual is None:
            sizes[parameter.name] = value * _log_uniform(draw, 1 / UNKNOWN, UNKNOWN)
        elif value != 0.0 and usual.low > 0.0:
            sizes[parameter.name] = _log_uniform(draw, usual.low, usual.high)
        elif value != 0.0:
            sizes[parameter.name] = float(draw.uniform(usual.low, usual.high))
    return replace(effect, **sizes)


def _log_uniform(draw: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** draw.uniform(0.0, 1.0))


def _within(value: float, usual: Range | None) -> float:
    return value if usual is None else float(np.clip(value, usual.low, usual.high))


# --- Whole arms -----------------------------------------------------------------------

BY_NAME = {kind.name: kind for kind in EFFECTS}
MOST_DRAWS = 1000
"""Draws after which an arm has no more places; chosen."""


def draw_whole_arm(
    stratum: Stratum, draw: np.random.Generator, ground: Ground
) -> list[Effect]:
    """Draw the effects of a whole arm, no two alike at one place.

    Args:
        stratum: How many, and of which kinds.
        draw: Random numbers.
        ground: The arm and plan of the trial.

    Raises:
        OutOfReach: Where the arm has not that many places.
    """
    if stratum.effects == ALL:
        return [of_catalogue_size(e, draw, ground) for e in _everywhere(draw, ground)]
    kinds = [BY_NAME[name] for name in stratum.pool]
    parts = [bool({"axis", "link"} & {*kind.places}) for kind in kinds]
    odds = np.where(parts, len(ground.arm.axes), 1)
    found: dict[tuple[str, str], Effect] = {}
    for _ in range(MOST_DRAWS):
        kind = kinds[int(draw.choice(len(kinds), p=odds / odds.sum()))]
        effect = draw_site_and_form(kind, draw, ground)
        effect = of_catalogue_size(effect, draw, ground)
        found.setdefault((effect.name, effect.where), effect)
        if len(found) == stratum.effects:
            return list(found.values())
    raise OutOfReach(f"The arm has no places for {stratum.effects} effects.")


def _everywhere(draw: np.random.Generator, ground: Ground) -> list[Effect]:
    """Return every effect that all arms have, at every place, with forms drawn."""
    arm = ground.arm
    hinges = [a for a, slides in zip(arm.axes, arm.slides, strict=True) if not slides]
    places = [(name, axis) for axis in hinges for name in EVERY_AXIS]
    places += [("link_bending", link) for link in arm.links[:-1]]
    places.append(("base_compliance", "base"))
    found = []
    for name, where in places:
        kind = BY_NAME[name]
        if kind not in PERIODIC or where in ground.turning:
            found.append(draw_site_and_form(kind, draw, ground, where))
    return found


# --- Twins ----------------------------------------------------------------------------

MASSES = ("link_3", "link_4")
"""Sites of the mass in trials of twins."""


def draw_twins(
    kind: type[Effect], draw: np.random.Generator, ground: Ground
) -> tuple[Effect, str]:
    """Draw an effect that has a twin, and the place of the twin.

    Args:
        kind: Drift, gravity load or bearing tilt.
        draw: Random numbers.
        ground: The arm and plan of the trial.

    Returns:
        The effect, and the place where another of its kind looks nearly the same: the
        tracker for the base, the other of two links, a neighbouring axis.
    """
    if kind in BETWEEN_AXES:
        pairs = [MASSES]
    elif "axis" in kind.places:
        pairs = list(pairwise(ground.arm.axes))
    else:
        pairs = [("base", "tracker")]
    pair = list(pairs[int(draw.integers(len(pairs)))])
    where, twin = draw.permutation(pair)
    return draw_site_and_form(kind, draw, ground, str(where)), str(twin)
