"""A tracker stands somewhere before the robot, and nobody knows quite where.

base_from_tracker: p_base = R p_tracker + t. The tracker's z axis looks at the middle of
the arm's postures, its y axis down.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

MIDDLE = np.array([0.4, 0.0, 0.7])
"""What it looks at in the base's frame, in m; chosen: the middle of the postures."""
DISTANCE = (2.0, 2.5)
"""How far it stands from there, in m; chosen: inside a volume of 9.1 m³."""
AZIMUTH = (-np.pi / 3, np.pi / 3)
"""In which direction from there, about the base's z, in rad; chosen: before the arm."""
RISE = (0.0, 0.8)
"""How far above that point, in m; chosen: a tripod."""
TILT = np.deg2rad(5.0)
"""One sigma of how it is turned beside its aim about each axis, in rad; chosen."""


def standpoint(random: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """Draw where a tracker stands: base_from_tracker, in m."""
    distance, azimuth, rise = (random.uniform(*r) for r in (DISTANCE, AZIMUTH, RISE))
    level = np.sqrt(distance**2 - rise**2)
    away = np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])
    forward = -away / distance
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    aim = np.column_stack([right, np.cross(forward, right), forward])
    tilt = Rotation.from_rotvec(TILT * random.standard_normal(3)).as_matrix()
    transform = np.eye(4)
    transform[:3, :3] = aim @ tilt
    transform[:3, 3] = MIDDLE + away
    return transform


def inverse(
    base_from_tracker: Float[np.ndarray, "4 4"], point: Float[np.ndarray, "*rows 3"]
) -> Float[np.ndarray, "*rows 3"]:
    """Return points of the base's frame in the tracker's: Rᵀ (p - t), in m."""
    return (point - base_from_tracker[:3, 3]) @ base_from_tracker[:3, :3]


def moved(
    point: Float[np.ndarray, "rows markers 3"],
    rate: tuple[float, ...],
    hours: Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows markers 3"]:
    """Return points that wander as one body: exp(hours r) p + hours v, in m.

    Args:
        point: Where they would be, in m.
        rate: v in m/h, then the rotation vector r in rad/h.
        hours: Since the start, row by row.
    """
    turn = Rotation.from_rotvec(np.outer(hours, rate[3:])).as_matrix()
    shift = np.outer(hours, rate[:3])
    return np.einsum("nij,nmj->nmi", turn, point) + shift[:, None]
