"""Model files of an arm that state nothing of its joints' stiffness."""

import warnings
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from bench.model_file import load, plain_mjcf


def as_mjcf(arm_file: Path, folder: Path) -> Path:
    """Write an arm as plain MJCF without joint stiffness."""
    root = ElementTree.fromstring(plain_mjcf(load(arm_file)))
    for joint in root.iter("joint"):
        del joint.attrib["stiffness"]
    path = folder / "rigid.xml"
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


def as_urdf(arm_file: Path, folder: Path) -> Path:
    """Write a chain of hinges as URDF, which knows no stiffness; axes start at 0."""
    model = load(arm_file)
    robot = ElementTree.Element("robot", name="rigid")
    for b in range(1, model.nbody):
        link = ElementTree.SubElement(robot, "link", name=model.body(b).name)
        if model.body_mass[b] > 0.0:
            inertial = ElementTree.SubElement(link, "inertial")
            mass = repr(float(model.body_mass[b]))
            ElementTree.SubElement(inertial, "mass", value=mass)
            inertial.append(_origin(model.body_ipos[b], model.body_iquat[b]))
            own = dict(zip(("ixx", "iyy", "izz"), model.body_inertia[b], strict=True))
            own |= dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
            inertia = {name: repr(float(value)) for name, value in own.items()}
            ElementTree.SubElement(inertial, "inertia", inertia)
        parent = model.body_parentid[b]
        if parent:
            robot.append(_joint(model, b, model.body(parent).name))
    path = folder / "rigid.urdf"
    path.write_text(ElementTree.tostring(robot, encoding="unicode"), encoding="utf-8")
    return path


def _joint(model: mujoco.MjModel, b: int, parent: str) -> ElementTree.Element:
    hinged, j = bool(model.body_jntnum[b]), model.body_jntadr[b]
    name = model.joint(j).name if hinged else f"to_{model.body(b).name}"
    joint = ElementTree.Element(
        "joint", name=name, type="revolute" if hinged else "fixed"
    )
    ElementTree.SubElement(joint, "parent", link=parent)
    ElementTree.SubElement(joint, "child", link=model.body(b).name)
    joint.append(_origin(model.body_pos[b], model.body_quat[b]))
    if hinged:
        assert not np.any(model.jnt_pos[j])
        ElementTree.SubElement(joint, "axis", xyz=_numbers(model.jnt_axis[j]))
        low, high = map(float, model.jnt_range[j])
        limit = {"lower": repr(low), "upper": repr(high)}
        ElementTree.SubElement(joint, "limit", limit, effort="0", velocity="0")
    return joint


def _origin(position: np.ndarray, quaternion: np.ndarray) -> ElementTree.Element:
    turn = Rotation.from_quat(quaternion, scalar_first=True)
    with warnings.catch_warnings(action="ignore"):  # of two angles that are one
        angles = turn.as_euler("xyz")
    place = {"xyz": _numbers(position), "rpy": _numbers(angles)}
    return ElementTree.Element("origin", place)


def _numbers(values: np.ndarray) -> str:
    return " ".join(repr(float(value)) for value in values)
