"""Draws arms of other builds, and all effects of a whole arm.

Arms have six or seven axes, or six axes on a lift column. Lengths, offsets, masses and
springs are drawn about those of arms that carry 5 to 20 kg. Axes deviate from right
angles, so that no closed-form kinematics fits.

Effects are drawn until there are as many as the stratum asks for: a kind that sits in
axes or links as often as there are axes, any other once, so that gears and bearings
prevail as in real arms. An arm that has all effects is not drawn: every rotary axis
hardens, holds back wind-up, creeps, ripples and tilts, links bend, the foot gives. Of
the study's arm sizes are drawn alone.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.drift import Drift
from bench.effects.effect import Effect
from bench.effects.gravity_compensator import GravityCompensator
from bench.shared.effect_catalogue import CATALOGUE, Parameter, Range
from bench.study_arm import default_truth
from scenarios.pipelines.synthetic_recording import KR10
from scenarios.studies.blind_trials.effects import (
    BETWEEN_AXES,
    PERIODIC,
    WOUND_UP,
    Ground,
    OutOfReach,
    draw_site_and_form,
)
from scenarios.studies.blind_trials.strata import ALL, EVERY_AXIS, STUDY, Stratum

# --- Other builds ---------------------------------------------------------------------

YAW, PITCH, ROLL, LIFT = "yaw", "pitch", "roll", "lift"
BUILDS: dict[str, tuple[str, ...]] = {
    "six": (YAW, PITCH, PITCH, ROLL, PITCH, ROLL),
    "seven": (YAW, PITCH, YAW, PITCH, ROLL, PITCH, ROLL),
    "column": (LIFT, YAW, PITCH, PITCH, ROLL, PITCH, ROLL),
}
"""Kinds of axes from the base to the tool; the arm is upright at zero."""
DIRECTION = {YAW: (0, 0, 1), PITCH: (0, 1, 0), ROLL: (0, 0, 1), LIFT: (0, 0, 1)}
RANGE = {YAW: 2.8, PITCH: 1.7, ROLL: 2.8}
LOAD, WEIGHT = 100.0, 120.0
"""The heaviest load in N, and weight of an arm in N per metre of its reach; chosen."""
LARGEST_WIND_UP = 2.5e-3
"""Largest wind-up of a gear in rad; a KR10 has 1.5 to 4e-3 under 100 N."""
OFF = 0.1
"""One sigma of an axis' direction, in rad; chosen."""


@dataclass(frozen=True)
class Arm:
    """The model file of an arm of the trials, and its number of axes."""

    file: Path
    axes: int


THE_KR10 = Arm(KR10, 6)


def arm_of(name: str, seed: int, folder: Path) -> Arm:
    """Return the KR10, or write the model of another arm."""
    if name == "kr10":
        return THE_KR10
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{name}_{seed}.xml"
    text = arm_text(BUILDS[name], f"{name} {seed}", seed)
    file.write_text(text, encoding="utf-8")
    return Arm(file, len(BUILDS[name]))


def arm_text(build: Sequence[str], name: str, seed: int) -> str:
    """Return the model of an arm as MJCF.

    Kinds of axes run from the base to the tool; the seed draws all else.
    """
    draw = np.random.default_rng(seed)
    turning = [kind for kind in build if kind != LIFT]
    lengths = _lengths(draw, len(turning))
    begins, ends = [], []
    reach = float(sum(lengths))
    at = draw.uniform(0.15, 0.3)
    for k, kind in enumerate(build, start=1):
        along = np.array(DIRECTION[kind]) + OFF * draw.normal(size=3)
        aside = 0.04 * draw.normal(size=2)
        length = 0.15 if kind == LIFT else lengths.pop(0)
        mass = 4.0 + 30.0 * (reach / 1.3) * max(reach - at, 0.1) / reach
        thick = 0.03 + 0.05 * max(reach - at, 0.1) / reach
        begins.append(
            f'<body name="link_{k}" pos="{_row(aside[0], aside[1], at)}">'
            f'<inertial mass="{mass:.4f}" pos="0 0 {length / 2:.4f}"'
            f' diaginertia="{_row(*_inertia(mass, length, thick))}"/>'
            + _joint(k, kind, along, max(reach - 0.5 * at, 0.2), draw)
            + f'<geom type="capsule" size="{thick:.4f}"'
            f' fromto="0 0 0 0 0 {max(length, 0.02):.4f}" mass="0"'
            ' contype="0" conaffinity="0"/>'
        )
        ends.append("</body>")
        at = length
        reach = max(reach - length, 0.1)
    flange = f'<body name="flange" pos="{_row(0, 0, at)}"/>'
    return (
        f'<mujoco model="{name}"><compiler angle="radian" autolimits="true"/>'
        '<worldbody><body name="base"><inertial mass="30" pos="0 0 0.1"'
        ' diaginertia="0.5 0.5 0.5"/><geom type="cylinder" size="0.12 0.1"'
        ' pos="0 0 0.1" mass="0" contype="0" conaffinity="0"/>'
        f"{''.join(begins)}{flange}{''.join(ends)}"
        "</body></worldbody></mujoco>\n"
    )


def _lengths(draw: np.random.Generator, axes: int) -> list[float]:
    """Return the links' lengths in m: shoulder, two long links, others, wrist."""
    between = [float(draw.uniform(0.05, 0.15)) for _ in range(axes - 3)]
    long = [float(draw.uniform(0.35, 0.6)) for _ in range(2)]
    return [between[0], long[0], *between[1:-2], long[1], *between[-2:], 0.1][:axes]


def _joint(
    k: int, kind: str, along: np.ndarray, reach: float, draw: np.random.Generator
) -> str:
    """Return a joint in MJCF with a spring that its load winds up by some 2.5 mrad."""
    axis = _row(*(along / np.linalg.norm(along)))
    if kind == LIFT:
        stiffness = 1e6 * 2.0 ** draw.uniform(-1, 1)
        return (
            f'<joint name="a{k}" type="slide" axis="{axis}" range="0 0.6"'
            f' stiffness="{stiffness:.1f}"/>'
        )
    stiffness = (
        reach * (LOAD + WEIGHT * reach) / LARGEST_WIND_UP * 2.0 ** draw.uniform(-1, 1)
    )
    limit = RANGE[kind]
    return (
        f'<joint name="a{k}" axis="{axis}" range="{-limit} {limit}"'
        f' stiffness="{stiffness:.1f}"/>'
    )


def _inertia(mass: float, length: float, thick: float) -> tuple[float, float, float]:
    """Return a cylinder's moments of inertia: m (3 r² + h²) / 12 twice and m r² / 2."""
    across = mass * (3 * thick**2 + length**2) / 12
    return across, across, mass * thick**2 / 2


def _row(*numbers: float) -> str:
    return " ".join(f"{number:.6f}" for number in numbers)


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
    """
    sizes = {}
    for parameter, value in _magnitudes_of(effect):
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


def _magnitudes_of(effect: Effect) -> list[tuple[Parameter, float]]:
    """Return the magnitudes that an effect of the simulator has."""
    now = effect.parameters()
    every = ((p, now.get(p.name)) for p in CATALOGUE[effect.name].parameters)
    return [
        (p, float(value))
        for p, value in every
        if p.role == "magnitude" and isinstance(value, float | int)
    ]


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

    Raises:
        OutOfReach: Where the arm has not that many places.
    """
    if stratum.effects == STUDY:
        return [_about(effect, draw) for effect in default_truth().effects]
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


ABOUT = 0.3
"""Share by which sizes of the study's arm are drawn about their own; the plan's."""


def springs_about(draw: np.random.Generator) -> Float[np.ndarray, " axes"]:
    """Return the stiffness of the study's arm, each axis' drawn about its own."""
    own = default_truth().stiffness
    return own * draw.uniform(1.0 - ABOUT, 1.0 + ABOUT, len(own))


def _about(effect: Effect, draw: np.random.Generator) -> Effect:
    """Return an effect with magnitudes drawn about its own."""
    low, high = 1.0 - ABOUT, 1.0 + ABOUT
    every = _magnitudes_of(effect)
    return replace(effect, **{p.name: v * draw.uniform(low, high) for p, v in every})


WARMED_UP = 0.2
"""Time constant of a drift over the recording's length, of other laws; chosen: it has
come to rest at the end."""


def with_other_laws(effects: Sequence[Effect], seconds: float) -> tuple[Effect, ...]:
    """Return effects of the same names and sizes whose laws have other forms.

    What grew in steps grows smoothly, a loop has many contacts, and a drift comes to
    rest. What has no other form stays.
    """
    other = {kind.name: kind for kind in OTHER_LAWS}

    def changed(effect: Effect) -> Effect:
        if isinstance(effect, Drift):
            return replace(effect, time_s=WARMED_UP * seconds)
        if effect.name in other:
            return other[effect.name](effect.where, **effect.parameters())
        return effect

    return tuple(changed(effect) for effect in effects)


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

    Its kind is drift, gravity load or bearing tilt.

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
