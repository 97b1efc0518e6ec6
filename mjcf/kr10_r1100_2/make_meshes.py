"""The arm's covers are lofts over outlines; they carry no mass and touch nothing.

Run: python mjcf/kr10_r1100_2/make_meshes.py (writes meshes/*.stl beside this file).

Outlines are given in the base frame with all angles zero (arm stretched along +x), in
millimetres, and turned into each link's frame by the kinematics of kr10_r1100_2.xml.
Proportions are rounded from the public meshes of kroshu/kuka_robot_descriptions
(Apache-2.0), for looks only: nothing may be measured on them.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from lofts import Skin, around, letters, loft, mirrored, rounded, turned

HERE = Path(__file__).parent
STL = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


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


def read_stl(path: Path) -> Skin:
    """Return the triangles of a binary STL file."""
    return np.frombuffer(path.read_bytes()[84:], STL)["corners"]


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
