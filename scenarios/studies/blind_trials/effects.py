"""Draws site and form of the effects of a blind trial, and scales them.

A form is every parameter that is not a magnitude: knee torque, time constant, order,
direction. Forms are drawn around catalogue values, so that no single value can be
learnt. Sites are drawn from all at which the effect can act; a coupling joins
neighbouring axes, in the wrist's gears or between the first axes.

`as_large_as` scales an effect until its visibility is as large as asked. The readings
respond nearly in proportion to its size, and χ² to its square, so two or three
simulations find the size that has a given χ².
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from jaxtyping import Float

from bench.effects.angle_dependent_stiffness import AngleDependentStiffness
from bench.effects.asymmetric_stiffness import AsymmetricStiffness
from bench.effects.base_compliance import BaseCompliance
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.creep import Creep
from bench.effects.drift import Drift
from bench.effects.effect import Effect
from bench.effects.geometry_error import GeometryError
from bench.effects.gravity_compensator import GravityCompensator
from bench.effects.gravity_load import GravityLoad
from bench.effects.hardening import Hardening
from bench.effects.hardening_smooth import SmoothHardening
from bench.effects.link_bending import LinkBending
from bench.effects.lost_motion_smooth import SmoothLostMotion
from bench.effects.marker_slip import MarkerSlip
from bench.effects.out_of_library.axis_crosstalk import AxisCrosstalk
from bench.effects.out_of_library.foot_lift_off import FootLiftOff
from bench.effects.out_of_library.loose_bearing import LooseBearing
from bench.effects.out_of_library.softening import Softening
from bench.effects.out_of_library.warming_gear import WarmingGear
from bench.effects.places import places_for
from bench.effects.reading_lag import ReadingLag
from bench.effects.tracker_misalignment import TrackerMisalignment
from bench.effects.transmission_error import TransmissionError
from bench.effects.wrench_bias import WrenchBias
from bench.effects.wrench_gain import WrenchGain
from bench.effects.wrench_misalignment import WrenchMisalignment
from bench.effects.wrist_coupling import WristCoupling
from bench.kinematic_chain import Anatomy
from bench.rig import Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import BenchError, Unusable
from bench.standard_plans import is_kr10
from bench.study_arm import GEARS
from scenarios.studies.blind_trials.visibility import Visibility

# --- Couplings ------------------------------------------------------------------------


def partners_of(kind: type[Effect], turning: Sequence[str]) -> dict[str, Sequence[str]]:
    """Return a coupling's possible partner axes by its site; empty for no coupling."""
    if kind is WristCoupling:
        first, second, third = turning[-3:]
    elif kind is AxisCrosstalk:
        first, second, third = turning[:3]
    else:
        return {}
    return {second: (first,), third: (first, second)}


def coupled(
    effect: Effect, draw: np.random.Generator, partners: Sequence[str]
) -> Effect:
    """Draw the partner axis and the sign of a coupling."""
    partner = str(draw.choice(partners))
    sign = float(draw.choice([-1.0, 1.0]))
    size = sign * effect.parameters()["compliance_rad_per_nm"]  # type: ignore[operator]
    return replace(effect, with_axis=partner, compliance_rad_per_nm=size)


# --- Forms ----------------------------------------------------------------------------

KNEED = (Hardening, SmoothHardening, Softening, SmoothLostMotion)
"""Effects whose form is a torque that scales with the axis' gear."""
WOUND_UP = 5e-4
"""Wind-up of a gear in rad where it begins to harden: 4 to 6e-4 by the catalogue."""
CLOSED = 0.2
"""Torque that closes a backlash over that of the knee; chosen: some hundredths of the
largest, where makers measure lost motion."""
SHIFT, TURN = ("x_m", "y_m", "z_m"), ("rx_rad", "ry_rad", "rz_rad")


def as_it_is(effect: Effect, draw: np.random.Generator) -> Effect:
    """Return the effect unchanged: it has no form."""
    return effect


def _about(draw: np.random.Generator, size: float, factor: float = 1.5) -> float:
    """Draw a number log-uniformly within a factor of a size, either way."""
    return float(size * factor ** draw.uniform(-1.0, 1.0))


def _phase(draw: np.random.Generator) -> float:
    return float(draw.uniform(-pi, pi))


def _parts(*sizes: tuple[float, tuple[str, ...]], least: float = -1.0) -> Callable:
    """Return a form that draws components uniformly from least to 1 times a size."""

    def form(effect: Effect, draw: np.random.Generator) -> Effect:
        values = {
            name: size * float(draw.uniform(least, 1.0))
            for size, names in sizes
            for name in names
        }
        return replace(effect, **values)

    return form


def knees_of(rig: Rig) -> dict[str, float]:
    """Return the torque at which each axis' gear begins to harden.

    A KR10's by its catalogue gears; any other arm's at the same wind-up, `WOUND_UP`.
    """
    if is_kr10(rig):
        return {axis: torques[0] for axis, (_, torques) in GEARS.items()}
    stiffness = rig.nominal.jnt_stiffness
    return {f"a{n}": WOUND_UP * float(k) for n, k in enumerate(stiffness, start=1)}


def bent(effect: Effect, draw: np.random.Generator, knee: float) -> Effect:
    """Draw a knee torque about the gear's, or a closing torque about a fifth of it."""
    if isinstance(effect, SmoothLostMotion):
        return replace(effect, closing_nm=_about(draw, CLOSED * knee))
    return replace(effect, torque_nm=_about(draw, knee))  # type: ignore[call-arg]


FORMS: dict[type[Effect], Callable[[Effect, np.random.Generator], Effect]] = {
    AsymmetricStiffness: lambda e, d: replace(e, ratio=1.2 ** float(d.choice([-1, 1]))),
    Creep: lambda e, d: replace(e, time_s=_about(d, 25.0, 2.0)),
    AngleDependentStiffness: lambda e, d: replace(
        e, order=float(d.integers(1, 4)), phase_rad=_phase(d)
    ),
    TransmissionError: lambda e, d: replace(
        e, order=float(d.integers(1, 4)), phase_rad=_phase(d)
    ),
    ReadingLag: lambda e, d: replace(
        e, lag_rad=float(e.parameters()["lag_rad"]) * float(d.choice([-1, 1]))
    ),
    BearingTilt: lambda e, d: replace(
        e,
        u_rad_per_nm=2e-6 * float(d.uniform(0.2, 1.0)),
        v_rad_per_nm=2e-6 * float(d.uniform(0.2, 1.0)),
        centre_m=float(d.uniform(-0.05, 0.05)),
    ),
    BaseCompliance: _parts(
        (5e-7, ("rx_rad_per_nm", "ry_rad_per_nm")),
        (1e-8, ("x_m_per_n", "y_m_per_n", "z_m_per_n")),
        least=0.2,
    ),
    GravityLoad: lambda e, d: replace(
        e, **{f"com_{i}_m": float(d.uniform(-0.15, 0.15)) for i in "xyz"}
    ),
    GravityCompensator: lambda e, d: replace(e, phase_rad=_phase(d)),
    GeometryError: _parts((3e-4, SHIFT), (5e-4, TURN)),
    WrenchBias: _parts(
        (0.5, ("fx_n", "fy_n", "fz_n")), (0.05, ("tx_nm", "ty_nm", "tz_nm"))
    ),
    WrenchGain: _parts((0.01, ("fx", "fy", "fz", "tx", "ty", "tz"))),
    WrenchMisalignment: _parts((0.0087, TURN)),
    TrackerMisalignment: _parts((5e-4, SHIFT), (1e-3, TURN)),
    Drift: _parts(
        (3e-5, ("x_m_per_h", "y_m_per_h", "z_m_per_h")),
        (3e-5, ("rx_rad_per_h", "ry_rad_per_h", "rz_rad_per_h")),
    ),
    MarkerSlip: _parts((5e-5, SHIFT)),
    LooseBearing: lambda e, d: replace(e, angle_rad=_phase(d)),
    FootLiftOff: lambda e, d: replace(
        e, angle_rad=_phase(d), preload_nm=_about(d, 5.0, 3.0)
    ),
    WarmingGear: lambda e, d: replace(e, visits=_about(d, 50.0, 2.0)),
}
"""How forms are drawn, by kind of effect; kinds that are not listed have none."""


def by_share(lag: ReadingLag) -> ReadingLag:
    """Return a lag of the same size in proportion to the axis' share of the move."""
    return replace(lag, lag_rad=0.0, share_lag_rad=lag.lag_rad)


# --- Sites ----------------------------------------------------------------------------

BETWEEN_AXES = (GeometryError, GravityLoad, LinkBending)
"""Effects of links that never sit on the last one: beyond the last axis, the vocabulary
has marker positions, the sensor's mounting and the tool's weight instead."""


@dataclass(frozen=True)
class Ground:
    """The arm and plan of a trial, as far as sites and forms depend on them.

    Attributes:
        lasts: How long the experiment lasts, in s.
        knees: Torque in N m at which each axis' gear begins to harden.
        turning: The rotary axes that cover a large enough angle; see `turning`.
    """

    arm: Anatomy
    markers: Sequence[str]
    lasts: float
    knees: Mapping[str, float]
    turning: Sequence[str]


PERIODIC = (AngleDependentStiffness, GravityCompensator, TransmissionError)
"""Effects periodic in the joint angle, drawn only at axes that cover enough of it."""
TURNS = 1.0
"""Least range of angle in rad of a site of a periodic effect; chosen: a sixth of a
period of the slowest."""


def draw_site_and_form(
    kind: type[Effect], draw: np.random.Generator, ground: Ground, where: str = ""
) -> Effect:
    """Draw a site and a form for an effect of about a catalogue's size."""
    arm = ground.arm
    every = places_for(kind.places, arm)
    known = [place for place in every if ":" not in place]
    if "marker" in kind.places:
        known += [f"marker:{name}" for name in ground.markers]
    if kind in BETWEEN_AXES:
        known.remove(arm.links[-1])
    hinges = [a for a, slides in zip(arm.axes, arm.slides, strict=True) if not slides]
    if kind in PERIODIC:
        known = [place for place in known if place in ground.turning]
    partners = partners_of(kind, hinges)
    effect = kind(where=where or str(draw.choice(list(partners or known))))
    if partners:
        return coupled(effect, draw, partners[effect.where])
    if kind in KNEED:
        return bent(effect, draw, ground.knees[effect.where])
    effect = FORMS.get(kind, as_it_is)(effect, draw)
    if isinstance(effect, MarkerSlip):
        effect = replace(effect, time_s=ground.lasts * float(draw.uniform(0.25, 0.75)))
    return effect


def turning(arm: Anatomy, posture: Float[np.ndarray, "visits axes"]) -> tuple[str, ...]:
    """Return the rotary axes whose range of angle is `TURNS` or more.

    The experiment's postures are in rad.
    """
    far = np.ptp(posture, axis=0) >= TURNS
    return tuple(
        a for a, s, f in zip(arm.axes, arm.slides, far, strict=True) if f and not s
    )


# --- Magnitudes -----------------------------------------------------------------------

ABOVE = 1.25
"""Factor by which an effect may exceed the χ² that is asked for; chosen: the bars give
the least, and the smallest effects are the hardest."""
FEWEST = 20.0
"""Least number of poses that contribute, by the rule of the bars; of less than 80 poses
a quarter."""
TRIES = 7
"""Most simulations to find a size; chosen, three are usual."""
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
        if name not in effect.shapes() and not isinstance(value, str)
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


def _largest(effect: Effect) -> float:
    known = CATALOGUE.get(effect.name)
    largest = known.largest if known else OUT_OF_LIBRARY_LARGEST.get(effect.name)
    return np.inf if largest is None else largest


def as_large_as(
    effect: Effect,
    least: float,
    weigh: Callable[[Effect], Visibility],
    fewest: float | None = None,
) -> tuple[Effect, Visibility]:
    """Find the size at which an effect has at least a given χ², and not much more.

    `weigh` simulates an effect and returns its visibility.

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
            if weight.poses < (FEWEST if fewest is None else fewest):
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
