"""Marks of one body keep their distances in all poses; what they do not keep is noise.

==========  ==========================================================================
Equation    as `rigid`, all rows as one visit, along the body's axes; without one
            mark where that leaves clearly less
Source      as `rigid`
Valid       bodies with three marks or more; with four, of which one may sag
Ignores     that a tracker may be worse along one of its axes
==========  ==========================================================================
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.blocks import Residuals
from stiffness.diagnosis.outliers import ENOUGH, Checked
from stiffness.diagnosis.rigid import rigid_motion
from stiffness.diagnosis.situation import Situation

SAGS = 0.9
"""Noise without one mark over that with it, below which the mark moves on its body;
chosen."""


def with_shapes(
    check: Checked,
    situation: Situation,
    readings: Residuals,
    place: Float[np.ndarray, "markers 3"],
    body: Int[np.ndarray, " markers"],
) -> Checked:
    """Return the same with noise measured between poses, where it was not within.

    Args:
        check: What readings within visits say of it.
        situation: Where the arm stood.
        readings: With their noise as stated.
        place: Of markers in their bodies' frames, in m.
        body: Index of each marker's body.
    """
    if check.freedom:
        return check
    standing = situation.arm.at(situation.rest)
    markers = situation.recording.markers
    turn = np.stack([standing.turn(m.body) for m in markers], axis=1)
    values = np.einsum("rmij,rmi->rmj", turn, np.nan_to_num(readings.value))[None]
    own, alike = check.weight[None], np.eye(3) * np.trace(readings.inverse) / 3.0
    groups = [body]
    for mark in range(len(body)):  # as if it were a body of its own
        groups.append(np.where(np.arange(len(body)) == mark, -1, body))
    found = [_noise(values, own, alike, place[None], group) for group in groups]
    noise, freedom = found[0]
    least = min((n for n, free in found if free >= ENOUGH), default=noise)
    if freedom < ENOUGH:
        return check
    noise = least if least < SAGS * noise else noise
    return replace(check, noise=noise, freedom=int(freedom))


def _noise(values, weight, inverse, place, body) -> tuple[float, float]:
    """Return measured noise over the stated one, and degrees of freedom."""
    fitted, enough, freedom = rigid_motion(values, weight, inverse, place, body)
    square = np.sum((values - fitted) ** 2, axis=3) * weight * inverse[0, 0]
    whole = float(np.sum(np.where(enough, square, 0.0)))
    return float(np.sqrt(whole / max(freedom, 1.0))), freedom
