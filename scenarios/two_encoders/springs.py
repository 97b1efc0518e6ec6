"""A spring that a model has is nominal: it is fitted silently within a decade."""

import numpy as np
from jaxtyping import Float

from scenarios.two_encoders.axis import DECADE
from stiffness.two_encoders.fitting import columns, fitted
from stiffness.two_encoders.found import Between
from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.terms import FRICTION, WOUND, plain_terms


def give_of(motions: tuple[Motion, ...], found: Between) -> tuple[float, float] | None:
    """Return an axis' compliance with half its interval, believed or not."""
    terms = list(found.terms)
    if not any(t.effect == WOUND for t in terms):
        terms += [t for t in plain_terms(motions) if t.effect == WOUND]
    names = [t.effect for t in terms for _ in t.parameters]
    if WOUND not in names:
        return None
    x, half = fitted(terms, [found.then(m) for m in motions])
    i = names.index(WOUND)
    return float(x[i]), float(half[i])


def nominal_left(
    motion: Motion, found: Between, model_give: float, give: tuple[float, float] | None
) -> Float[np.ndarray, " rows"]:
    """Return what the model leaves of a motion, its springs fitted within a decade."""
    if model_give == 0.0 or give is None or motion.torque is None:
        return motion.apart
    own = float(np.clip(give[0], model_give / DECADE, model_give * DECADE))
    torque = motion.torque
    if give[0] > 0.0:  # the friction in it winds up nothing
        lost = [t for t in found.terms if t.effect == FRICTION]
        sizes = [x for e, _, x in found.known() if e == FRICTION]
        torque = torque - columns(lost, motion) @ np.array(sizes) / give[0]
    left = motion.apart + own * torque
    return left - left.mean()
