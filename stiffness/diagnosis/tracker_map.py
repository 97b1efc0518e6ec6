"""What a levelled tracker does wrong lies along its two circles and its beam.

==========  ==========================================================================
Equation    error = e_a (1, r, h cos na, h sin na) + e_e (1, r cos 2a, r sin 2a, r cos
            ne, r sin ne) + e_r (1, r, r²) + e_z r², n = 1, 2; a azimuth, e elevation, r
            range and h its level part, seen from the tracker, z against gravity
Source      Muralikrishnan, Phillips, Sawyer 2016, "Laser trackers for large-scale
            dimensional metrology: a review", section 4: circles off their centres, axes
            and beam beside each other and askew; e_z r²: a beam that sags
Valid       a tracker that stands upright, at the origin of its readings' frame
Ignores     a target that turns away from the beam
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.hypotheses.axes import absolute
from stiffness.diagnosis.hypotheses.bodies import marked_point
from stiffness.diagnosis.signature import NOTHING, Shift, Signature
from stiffness.diagnosis.situation import Situation

COLUMNS = 17
NEAREST = 0.3
"""Level distance from the base's origin in m at which no tracker stands: readings were
turned to the base's frame; chosen."""
LEAST = 1e-3
"""Level distance in m below which a target has no azimuth; chosen."""


def errors_of_tracker(situation: Situation) -> Signature:
    """Return how each marker would be seen beside its place; nothing where it cancels.

    A marker of unknown place is taken at its body's origin.
    """
    gravity, frame = situation.arm.chain.gravity, situation.tracker
    if frame is None or not absolute(situation) or not gravity.any():
        return NOTHING
    axes, stand = upright(-gravity), frame[:3, 3]
    if np.hypot(*(stand @ axes)[:2]) < NEAREST:
        return NOTHING
    parts = []
    for m in range(len(situation.recording.markers)):
        away = (marked_point(situation, m) - stand) @ axes
        parts.append(Shift(m, axes @ along_circles(away)))
    return Signature(COLUMNS, tuple(parts)) if parts else NOTHING


def upright(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Return axes as columns, the third along a direction."""
    z = up / np.linalg.norm(up)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def along_circles(away: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3 17"]:
    """Return the errors per unit of each, along upright axes.

    Args:
        away: Targets seen from the tracker along these axes, in m.
    """
    level = np.maximum(np.hypot(away[:, 0], away[:, 1]), LEAST)
    far = np.hypot(level, away[:, 2])
    a, e = np.arctan2(away[:, 1], away[:, 0]), np.arctan2(away[:, 2], level)
    none, one = np.zeros_like(a), np.ones_like(a)
    beam = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    side = np.stack([-np.sin(a), np.cos(a), none], axis=1)
    up, fall = np.cross(beam, side), np.stack([none, none, one], axis=1)
    waves = [f(n * x) for x in (a, e) for n in (1, 2) for f in (np.cos, np.sin)]
    parts = [
        (side, [one, far, *(level * w for w in waves[:4])]),
        (up, [one, *(far * w for w in waves[2:])]),
        (beam, [one, far, far**2]),
        (fall, [far**2]),
    ]
    columns = [along * size[:, None] for along, sizes in parts for size in sizes]
    return np.stack(columns, axis=2)
