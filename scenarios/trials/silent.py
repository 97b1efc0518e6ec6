"""What is nominal is fitted to everything that is seen, and nothing is said of it."""

import numpy as np
from jaxtyping import Float

from bench.rig import Rig
from scenarios.trials.standing import Standing

PLACE, DECADE, UNKNOWN = 1e-2, 2.3, 1.0
"""One sigma of a marker's place in m, of ln stiffness, of what is unknown in m or rad.
The rules call a place nominal within 1 mm: ten times that is flat over it."""


def silent_columns(
    rig: Rig, standing: Standing, known_frame: bool
) -> tuple[Float[np.ndarray, "visits rows markers 3 n"], Float[np.ndarray, " n"]]:
    """Return what is fitted silently, and its inverse variances."""
    point = standing.point
    visits, rows, markers, _ = point.shape
    columns, sigma = [], []
    for axis in np.flatnonzero(rig.nominal.jnt_stiffness > 0.0):
        columns.append(standing.turned(int(axis))[..., None])
        sigma.append(np.array([DECADE]))
    if not known_frame:
        turns = np.stack([np.cross(e, point) for e in np.eye(3)], axis=-1)
        columns += [np.broadcast_to(np.eye(3), (*point.shape, 3)), turns]
        sigma.append(np.full(6, UNKNOWN))
    places = np.zeros((visits, rows, markers, 3, markers, 3))
    for m in range(markers):
        places[:, :, m, :, m] = standing.turn[:, None, m]
    columns.append(places.reshape(*point.shape, 3 * markers))
    sigma.append(np.full(3 * markers, PLACE))
    return np.concatenate(columns, axis=-1), np.concatenate(sigma) ** -2.0
