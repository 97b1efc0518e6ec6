"""What a tracker could do wrong lies along its two circles and its beam.

==========  ==========================================================================
Equation    error = h e_a (cos na, sin na) + r e_e (cos 2a, sin 2a, cos ne, sin ne)
            + e_r (1, r, r²) + e_z r², n = 1, 2; a azimuth, e elevation, r range and h
            its level part, seen from the tracker
Source      Muralikrishnan, Phillips, Sawyer 2016, "Laser trackers for large-scale
            dimensional metrology: a review", section 4: circles off their centres,
            axes that wobble, offsets of the beam
Valid       a tracker whose third axis is upright
Ignores     a target that turns away from the beam
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.hypotheses.axes import absolute
from stiffness.diagnosis.hypotheses.bodies import point_of
from stiffness.diagnosis.signature import NOTHING, Shift, Signature
from stiffness.diagnosis.situation import Situation

COLUMNS = 14
NEAREST = 1e-3
"""Level distance in m below which a target has no azimuth; chosen."""


def errors_of_tracker(situation: Situation) -> Signature:
    """Return how each marker would be seen beside its place; nothing where it cancels.

    A marker of unknown place is taken at its body's origin.
    """
    if situation.tracker is None or not absolute(situation):
        return NOTHING
    turn, stand = situation.tracker[:3, :3], situation.tracker[:3, 3]
    parts = []
    for m, marker in enumerate(situation.recording.markers):
        place = np.zeros(3) if marker.position is None else marker.position
        away = (point_of(situation, marker.body, place) - stand) @ turn
        parts.append(Shift(m, turn @ along_circles(away)))
    return Signature(COLUMNS, tuple(parts)) if parts else NOTHING


def along_circles(away: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3 14"]:
    """Return the errors per unit of each, along the tracker's axes.

    Args:
        away: Targets in the tracker's frame, in m.
    """
    level = np.maximum(np.hypot(away[:, 0], away[:, 1]), NEAREST)
    far = np.hypot(level, away[:, 2])
    a, e = np.arctan2(away[:, 1], away[:, 0]), np.arctan2(away[:, 2], level)
    none = np.zeros_like(a)
    beam = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    side = np.stack([-np.sin(a), np.cos(a), none], axis=1)
    up = np.cross(beam, side)
    waves = [f(n * x) for x in (a, e) for n in (1, 2) for f in (np.cos, np.sin)]
    columns = [side * (level * w)[:, None] for w in waves[:4]]
    columns += [up * (far * w)[:, None] for w in waves[2:]]
    columns += [beam * (far**n)[:, None] for n in (0, 1, 2)]
    columns.append(np.array([0.0, 0.0, 1.0]) * (far**2)[:, None])
    return np.stack(columns, axis=2)
