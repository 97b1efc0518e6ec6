"""A cover is a skin stretched over outlines, one behind the other along an axis.

For the pictures only: lengths in mm, no mass, no contact.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

POINTS = 36  # on each outline; chosen: round to the eye, all files under 500 kB

Skin = Float[np.ndarray, "triangles 3 3"]

Outline = tuple[float, Float[np.ndarray, "points 2"]]
"""Where along the loft's axis, and the closed curve across it, in mm."""


def rounded(
    at: float, u: tuple[float, float], v: tuple[float, float], power: float = 2.0
) -> Outline:
    """Return a superellipse |x/a|^p + |y/b|^p = 1 between the given extents.

    Power 2 is an ellipse; 8 is a box with rounded corners.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, POINTS, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    curve = np.sign(circle) * np.abs(circle) ** (2.0 / power)
    extents = np.array([u, v])
    return at, extents.mean(axis=1) + curve * np.ptp(extents, axis=1) / 2.0


def around(
    at: float, *circles: tuple[float, float, float], shrink: float = 0
) -> Outline:
    """Return the belt around circles (x, y, radius), each radius less `shrink`."""
    angle = np.linspace(0.0, 2.0 * np.pi, 12 * POINTS, endpoint=False)
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    centre = np.array(circles)[:, :2]
    radius = np.array(circles)[:, 2] - shrink
    outermost = np.argmax(normal @ centre.T + radius, axis=1)
    belt = centre[outermost] + radius[outermost, None] * normal
    closed = np.vstack([belt, belt[:1]])
    length = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    even = np.linspace(0.0, length[-1], POINTS, endpoint=False)
    return at, np.stack([np.interp(even, length, closed[:, k]) for k in (0, 1)], axis=1)


def loft(axis: str, *outlines: Outline) -> Skin:
    """Return a closed skin over outlines across `axis`, facing outwards, in mm."""
    along = "xyz".index(axis)
    rings = [np.insert(curve, along, at, axis=1) for at, curve in outlines]
    faces = []
    for low, high in pairwise(rings):
        low_next, high_next = np.roll(low, -1, axis=0), np.roll(high, -1, axis=0)
        faces += [np.stack([low, low_next, high_next], axis=1)]
        faces += [np.stack([low, high_next, high], axis=1)]
    for ring, step in ((rings[0], -1), (rings[-1], 1)):
        fan = np.stack([np.roll(ring, step, axis=0), ring], axis=1)
        middle = np.broadcast_to(ring.mean(axis=0), (len(ring), 1, 3))
        faces += [np.concatenate([middle, fan], axis=1)]
    skin = np.concatenate(faces)
    volume = np.einsum("ni,ni->", skin[:, 0], np.cross(skin[:, 1], skin[:, 2]))
    return skin if volume > 0 else skin[:, ::-1]


def turned(axis: str, u: float, v: float, *profile: tuple[float, float]) -> Skin:
    """Return a body of revolution through (u, v): (place, radius) pairs, in mm."""
    return loft(axis, *(around(at, (u, v, radius)) for at, radius in profile))


def letters(y: float, x: float, z: float, height: float) -> list[Skin]:
    """Return the maker's name in strokes on a wall facing y, from x on, in mm."""
    strokes = {
        "K": [((0, 0), (0, 1)), ((0, 0.4), (0.65, 1)), ((0.2, 0.6), (0.7, 0))],
        "U": [((0, 0), (0, 1)), ((0, 0), (0.65, 0)), ((0.65, 0), (0.65, 1))],
        "A": [((0, 0), (0.4, 1)), ((0.4, 1), (0.8, 0)), ((0.15, 0.3), (0.65, 0.3))],
    }
    pitch = np.array([-np.sign(y) * height, height])  # read from outside the wall
    bars = []
    for place, letter in enumerate("KUKA"):
        origin = np.array([x, z]) + 1.1 * place * pitch * [1, 0]
        for stroke in strokes[letter]:
            start, end = np.array(stroke) * pitch + origin
            half = (end - start) / np.linalg.norm(end - start) * height / 9
            side = np.array([-half[1], half[0]])
            corners = [start - half - side, end + half - side]
            curve = np.array([*corners, end + half + side, start - half + side])
            bars.append(loft("y", (y, curve), (y - np.sign(y) * 2, curve)))
    return bars


def mirrored(axis: str, *outlines: Outline) -> list[Skin]:
    """Return a loft and its mirror image on the other side of the axis' zero."""
    other = [(-at, curve) for at, curve in outlines]
    return [loft(axis, *outlines), loft(axis, *other)]
