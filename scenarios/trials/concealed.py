"""Where an effect is concealed is drawn from all the places where it can sit."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bench.anatomy import Anatomy
from bench.effects.effect import Effect
from bench.effects.geometry_error import GeometryError
from bench.effects.link_bending import LinkBending
from bench.effects.marker_slip import MarkerSlip
from bench.effects.places import places_for
from scenarios.trials.forms import FORMS, PARTNERS, as_it_is

BETWEEN_AXES = (GeometryError, LinkBending)
"""What a link does to the axis after it; the vocabulary's links end with an axis, and
what is beyond the last one are markers' places and a sensor's mounting."""


def drawn(
    kind: type[Effect],
    draw: np.random.Generator,
    arm: Anatomy,
    bodies: Sequence[str],
    markers: Sequence[str],
    lasts: float,
) -> Effect:
    """Draw a place and a form for an effect of about a catalogue's size.

    Args:
        kind: Which effect.
        draw: Where the draws come from.
        arm: The names of the arm's parts.
        bodies: The names of the arm's bodies.
        markers: The names of the marks that are followed.
        lasts: How long the experiment lasts, in s.
    """
    known = [
        place for place in places_for(kind.places, arm, bodies) if ":" not in place
    ]
    if "marker" in kind.places:
        known += [f"marker:{name}" for name in markers]
    if kind in BETWEEN_AXES:
        known.remove(arm.links[-1])
    known = list(PARTNERS.get(kind, known))
    effect = kind(where=str(draw.choice(known)))
    effect = FORMS.get(kind, as_it_is)(effect, draw)
    if isinstance(effect, MarkerSlip):
        effect = replace(effect, time_s=lasts * float(draw.uniform(0.25, 0.75)))
    return effect
