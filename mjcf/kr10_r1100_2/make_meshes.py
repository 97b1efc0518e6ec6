"""The arm's covers are lofts over outlines; they carry no mass and touch nothing.

Run: python mjcf/kr10_r1100_2/make_meshes.py (writes meshes/*.stl beside this file).

Outlines are given in the base frame with all angles zero (arm stretched along +x), in
millimetres, and turned into each link's frame by the kinematics of kr10_r1100_2.xml.
Proportions are rounded from the public meshes of kroshu/kuka_robot_descriptions
(Apache-2.0), for looks only: nothing may be measured on them.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
from jaxtyping import Float

HERE = Path(__file__).parent
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


# --- Skins over outlines --------------------------------------------------------------

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


# --- Covers of the arm ----------------------------------------------------------------


def shapes() -> dict[str, Sequence[Skin]]:
    """Return the covers of every body, base frame at zero angles, in mm."""
    cheek = (25, 400, 85)
    pod = ((585, 400, 66), (432, 411, 57))
    wrist = ((1100, 425, 45), (952, 425, 53.5))
    # fmt: off
    return {
        "base": [
            loft("z", rounded(0, (-104, 104), (-104, 104), 9),
                 rounded(16, (-104, 104), (-104, 104), 9),
                 rounded(22, (-98, 98), (-98, 98), 9)),
            turned("z", 0, 0, (5, 104), (60, 105), (170, 109), (216, 110), (219, 107)),
            loft("x", rounded(-211, (-70, 70), (40, 158), 9),
                 rounded(-200, (-88, 88), (26, 186), 9),
                 rounded(-130, (-92, 92), (24, 198), 7),
                 rounded(-60, (-92, 92), (24, 198), 7)),
            loft("x", rounded(-140, (-15, 15), (190, 240), 8),
                 rounded(-108, (-15, 15), (190, 240), 8)),
        ],
        "link_1": [
            turned("z", 0, 0, (221, 107), (224, 110), (262, 110), (292, 106),
                   (302, 97)),
            *mirrored("y",
                around(58, cheek, (-72, 244, 22), (62, 244, 22)),
                around(92, cheek, (-42, 246, 22), (40, 246, 22), shrink=1),
                around(105, (25, 400, 83.5), (-24, 264, 26), (32, 264, 26)),
                around(115, (25, 400, 82), (-14, 300, 32), (30, 300, 32)),
                around(126, (24, 397, 73), (2, 345, 38), (22, 345, 38)),
                around(134, (24, 394, 48), (20, 374, 34))),
            loft("x", rounded(95, (-11, 11), (228, 258), 4),
                 rounded(133, (-7, 7), (236, 246), 4)),
        ],
        "link_2": [
            turned("y", 25, 400, (-68, 62), (-66, 74), (-57, 76), (-56, 88), (-50, 90),
                   (50, 90), (56, 88), (57, 76), (66, 74), (68, 62)),
            loft("x", rounded(20, (-52, 52), (311, 489), 6),
                 rounded(60, (-52, 52), (322, 488), 6),
                 rounded(95, (-53, 53), (342, 483), 5),
                 rounded(130, (-53, 53), (355, 478), 5),
                 rounded(240, (-53, 53), (367, 473), 5),
                 rounded(325, (-54, 54), (370, 472), 5),
                 rounded(355, (-78, 78), (362, 472), 6),
                 rounded(392, (-120, 120), (357, 471), 8),
                 rounded(470, (-122, 122), (351, 468), 8)),
            *mirrored("y", around(70, *pod, shrink=4), around(76, *pod),
                around(110, *pod), around(121, *pod, shrink=7),
                around(127, *pod, shrink=18), around(130, *pod, shrink=34)),
        ],
        "link_2_name": letters(-54, 150, 404, 26) + letters(54, 258, 404, 26),
        "link_3": [
            turned("y", 585, 400, (-76, 56), (-74, 66), (-60, 77), (-40, 80), (30, 80),
                   (50, 77), (64, 66), (66, 56)),
            loft("x", rounded(570, (-62, 58), (325, 480), 3),
                 rounded(610, (-64, 57), (328, 483), 3),
                 rounded(640, (-62, 56), (343, 483), 3),
                 rounded(672, (-58, 54), (363, 481), 3),
                 rounded(720, (-55, 54), (370, 480), 3),
                 rounded(796, (-54, 54), (371, 480), 3),
                 rounded(799, (-51, 51), (374, 477), 3)),
        ],
        "link_4": [
            loft("x", rounded(801, (-51, 51), (374, 477), 3),
                 rounded(804, (-54, 54), (371, 480), 3),
                 rounded(880, (-57, 57), (370, 481), 3),
                 rounded(905, (-58, 58), (370, 480), 4),
                 rounded(935, (-72, 72), (371, 479), 5),
                 rounded(1042, (-76, 76), (374, 475), 6)),
            *mirrored("y", around(49, *wrist, shrink=2), around(52, *wrist),
                around(70, *wrist), around(77, *wrist, shrink=5),
                around(81, *wrist, shrink=14)),
            loft("z", rounded(358, (1008, 1034), (-8, 8), 3),
                 rounded(380, (1002, 1040), (-12, 12), 3)),
        ],
        "link_4_name": letters(-82, 968, 411, 28) + letters(82, 1088, 411, 28),
        "link_5": [
            turned("y", 1100, 425, (-52, 36), (-48, 43), (40, 43), (48, 36)),
            turned("x", 0, 425, (1090, 43), (1140, 42), (1160, 40), (1167, 38)),
        ],
    }
    # fmt: on


def covers() -> dict[str, Skin]:
    """Return the cover of every body, in the body's own frame, in metres."""
    arm = pin.buildModelFromMJCF(str(HERE / "kr10_r1100_2.xml"))
    data = arm.createData()
    pin.framesForwardKinematics(arm, data, pin.neutral(arm))
    turned_in = {}
    for name, parts in shapes().items():
        body = data.oMf[arm.getFrameId(name.removesuffix("_name"))].inverse()
        skin = np.concatenate(list(parts)) * 1e-3
        turned_in[name] = skin @ body.rotation.T + body.translation
    return turned_in


def write_stl(path: Path, skin: Skin) -> None:
    """Write a binary STL file; the normals are left to the reader."""
    record = np.zeros(len(skin), STL)
    record["corners"] = skin
    head = b"cover of one body, metres".ljust(80)
    path.write_bytes(head + np.uint32(len(skin)).tobytes() + record.tobytes())


if __name__ == "__main__":
    (HERE / "meshes").mkdir(exist_ok=True)
    for body_name, cover in covers().items():
        write_stl(HERE / "meshes" / f"{body_name}.stl", cover)
