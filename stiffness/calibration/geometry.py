"""The drawing of an arm is a little wrong, and not in all of its numbers visibly.

==========  ==========================================================================
Equation    q = q_reported + offset; the seat of the next axis in its link's frame:
            p' = p + (x, y, z), R' = exp([(rx, ry, rz)]x) R
Source      Mooring, Roth, Driels 1991, "Fundamentals of manipulator calibration";
            rotation vector (Rodrigues 1840)
Valid       always
Ignores     nothing of a rigid arm: frame and places of targets take up the rest
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from stiffness.chain import Chain, Place
from stiffness.standing import Standing

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Entry:
    """One number of the drawing.

    Attributes:
        effect: `encoder_offset` or `geometry_error`.
        where: Axis or link.
        parameter: Its name in the vocabulary.
    """

    effect: str
    where: str
    parameter: str


def entries_of(chain: Chain) -> tuple[Entry, ...]:
    """Return all numbers of a drawing, in the order of their vector.

    First an offset of each axis, then six numbers for each axis that is carried by
    another one: they belong to the link between the two.
    """
    offsets = [
        Entry("encoder_offset", f"a{k + 1}", "offset_m" if slides else "offset_rad")
        for k, slides in enumerate(chain.slides)
    ]
    links = [
        Entry("geometry_error", f"link_{chain.parent[k] + 1}", name)
        for k in seats_of(chain)
        for name in NAMES
    ]
    return (*offsets, *links)


def seats_of(chain: Chain) -> list[int]:
    """Return the axes that another axis carries."""
    return [k for k, parent in enumerate(chain.parent) if parent >= 0]


def redrawn(chain: Chain, values: Float[np.ndarray, " entries"]) -> Chain:
    """Return a chain whose seats are moved and turned; offsets act on postures."""
    axes = len(chain.parent)
    before = chain.before.copy()
    for k, twist in zip(
        seats_of(chain), np.reshape(values[axes:], (-1, 6)), strict=True
    ):
        axes_of_link = link_axes(chain, chain.parent[k])
        before[k, :3, 3] += axes_of_link @ twist[:3]
        turn = Rotation.from_rotvec(axes_of_link @ twist[3:]).as_matrix()
        before[k, :3, :3] = turn @ before[k, :3, :3]
    return replace(chain, before=before)


def link_axes(chain: Chain, axis: int) -> Float[np.ndarray, "3 3"]:
    """Return a link's own axes, as columns, in the frame of the axis that moves it."""
    place = chain.places.get(f"link_{axis + 1}", Place(axis, np.eye(4)))
    return place.placement[:3, :3]


def columns(
    standing: Standing,
    points: Float[np.ndarray, "rows 3"],
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 3 entries"]:
    """Return how points move with each number of the drawing.

    This is Pinocchio's kinematic regressor, for many postures at once.

    Args:
        standing: The arm.
        points: On one body, in the base's frame, in m.
        carried: The axes that carry that body.
    """
    chain, rows = standing.chain, len(points)
    moved = [turning(standing, points, k, carried) for k in range(len(chain.parent))]
    for k in seats_of(chain):
        parent = chain.parent[k]
        axes = standing.rotation[parent] @ link_axes(chain, parent)
        for turns in (False, True):
            for j in range(3):
                if k not in carried:
                    moved.append(np.zeros((rows, 3)))
                elif turns:
                    moved.append(np.cross(axes[:, :, j], points - standing.origin[k]))
                else:
                    moved.append(axes[:, :, j])
    return np.stack(moved, axis=2)


def turning(
    standing: Standing,
    points: Float[np.ndarray, "rows 3"],
    axis: int,
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 3"]:
    """Return how points move per unit of an axis, in m/rad (m/m where it slides)."""
    if axis not in carried:
        return np.zeros_like(points)
    along = standing.rotation[axis, :, :, 2]
    if standing.chain.slides[axis]:
        return along
    return np.cross(along, points - standing.origin[axis])
