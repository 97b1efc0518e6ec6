"""Where an effect is concealed is drawn from all the places where it can sit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.anatomy import Anatomy
from bench.effects.angle_dependent_stiffness import AngleDependentStiffness
from bench.effects.effect import Effect
from bench.effects.geometry_error import GeometryError
from bench.effects.gravity_compensator import GravityCompensator
from bench.effects.gravity_load import GravityLoad
from bench.effects.link_bending import LinkBending
from bench.effects.marker_slip import MarkerSlip
from bench.effects.places import places_for
from bench.effects.transmission_error import TransmissionError
from scenarios.trials.couplings import coupled, partners_of
from scenarios.trials.forms import FORMS, KNEED, as_it_is, bent

BETWEEN_AXES = (GeometryError, GravityLoad, LinkBending)
"""Effects of links: the vocabulary's end with an axis. What is beyond the last one are
markers' places and a sensor's mounting, and weights that it calls the tool's."""


@dataclass(frozen=True)
class Ground:
    """Where effects can sit.

    Attributes:
        arm: The names of the arm's parts.
        markers: The names of the marks that are followed.
        lasts: How long the experiment lasts, in s.
        knees: Torque in N m at which each axis' gear begins to harden.
        turning: The axes that turn far in this experiment.
    """

    arm: Anatomy
    markers: Sequence[str]
    lasts: float
    knees: Mapping[str, float]
    turning: Sequence[str]


PERIODIC = (AngleDependentStiffness, GravityCompensator, TransmissionError)
"""What comes again turn after turn; an axis that does not turn shows nothing of it."""
TURNS = 1.0
"""Angle in rad that an axis goes through to be called turning; chosen: a sixth of a
period of the slowest."""


def drawn(kind: type[Effect], draw: np.random.Generator, ground: Ground) -> Effect:
    """Draw a place and a form for an effect of about a catalogue's size.

    Args:
        kind: Which effect.
        draw: Where the draws come from.
        ground: Where it can sit.
    """
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
    effect = kind(where=str(draw.choice(list(partners or known))))
    if partners:
        return coupled(effect, draw, partners[effect.where])
    if kind in KNEED:
        return bent(effect, draw, ground.knees[effect.where])
    effect = FORMS.get(kind, as_it_is)(effect, draw)
    if isinstance(effect, MarkerSlip):
        effect = replace(effect, time_s=ground.lasts * float(draw.uniform(0.25, 0.75)))
    return effect


def turning(arm: Anatomy, posture: Float[np.ndarray, "visits axes"]) -> tuple[str, ...]:
    """Return the hinges that go through more than a small part of a turn.

    Args:
        arm: The names of the arm's parts.
        posture: Where the experiment goes, in rad.
    """
    far = np.ptp(posture, axis=0) >= TURNS
    return tuple(
        a for a, s, f in zip(arm.axes, arm.slides, far, strict=True) if f and not s
    )
