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
    place = situation.arm.place(body)
    inner = place.placement[:3, :3] @ position + place.placement[:3, 3]
    frame = situation.frame[:, place.axis + 1]
    return situation.origin[:, place.axis + 1] + frame @ inner
