"""Whatever hangs on an axis goes where the axis takes it."""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.situation import Situation


def axes_of(situation: Situation, body: str) -> Float[np.ndarray, "rows 3 3"]:
    """Return a body's axes as columns along the base's."""
    place = situation.arm.place(body)
    return situation.frame[:, place.axis + 1] @ place.placement[:3, :3]


def point_of(
    situation: Situation, body: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "rows 3"]:
    """Return where a point of a body is, in the base's frame, in m.

    Args:
        situation: Where the axes are.
        body: Which body.
        position: The point in the body's frame, in m.
    """
    axis, inside = situation.arm.place(body).axis, inside_of(situation, body, position)
    return situation.origin[:, axis + 1] + situation.frame[:, axis + 1] @ inside


def marked_point(situation: Situation, m: int) -> Float[np.ndarray, "rows 3"]:
    """Return where a marker is, or its body's origin where its place is not stated."""
    marker = situation.recording.markers[m]
    place = np.zeros(3) if marker.position is None else marker.position
    return point_of(situation, marker.body, place)


def inside_of(
    situation: Situation, body: str, position: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3"]:
    """Return a point of a body in the frame of the place that carries it, in m."""
    placement = situation.arm.place(body).placement
    return placement[:3, :3] @ position + placement[:3, 3]
