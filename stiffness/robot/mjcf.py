"""Reader of arms from MJCF: axes, masses and joint stiffness.

Pinocchio reads the chain; gravity and joint stiffness, which it ignores, are read from
the XML itself. So is the pose of the first body in the world: where that body has no
joint, Pinocchio takes its frame for the world's.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

import numpy as np
import pinocchio
from jaxtyping import Float

from bench.shared.errors import BenchError, UnknownName, Unusable

STAND = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
"""Attributes that rotate a body."""
Read = TypeVar("Read")
KINDS = ("Revolute", "Prismatic", "RX", "RY", "RZ", "PX", "PY", "PZ")
"""Pinocchio's names of joints that turn or slide with one coordinate."""


@dataclass(frozen=True)
class ArmFile:
    """Content of the MJCF of an arm.

    Attributes:
        model: The chain as Pinocchio read it.
        gravity: Acceleration along the axes of Pinocchio's world, in m/s^2.
        stiffness: Of each joint by name, in N m/rad (N/m where it slides); joints
            without a spring are missing.
        followers: Joints that follow others: the leader of each, and coefficients of
            its angle, from the constant on, in rad (m).
    """

    model: pinocchio.Model
    gravity: tuple[float, float, float]
    stiffness: dict[str, float]
    followers: dict[str, tuple[str, tuple[float, ...]]]


def read(path: Path | str) -> ArmFile:
    """Read an arm from a plain MJCF file.

    Args:
        path: The MJCF; files that it includes must be in the same folder.

    Returns:
        The chain, gravity and the springs.

    Raises:
        BenchError: Where the file is missing.
        Unusable: Where it is not an MJCF of a chain of hinges and slides, with all
            faults.
    """
    path = Path(path)
    if not path.is_file():
        raise BenchError(f"There is no model file {str(path)!r}; give the arm's MJCF.")
    try:
        root = ElementTree.parse(path).getroot()
        model = pinocchio.buildModelFromMJCF(str(path))
    except (ElementTree.ParseError, RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[-1]
        raise Unusable(f"Model {str(path)!r}", [f"no MJCF: {reason}"]) from None
    faults = _faults(model, root)
    if faults:
        raise Unusable(f"Model {str(path)!r}", faults)
    option = root.find("option")
    gravity = "0 0 -9.81" if option is None else option.get("gravity", "0 0 -9.81")
    down = np.array([float(word) for word in gravity.split()])
    x, y, z = (down @ _first_turn(root)).tolist()
    return ArmFile(model, (x, y, z), _stiffness(root), _followers(root))


def read_text(text: str) -> ArmFile:
    """Read an arm from self-contained MJCF text, as `read` does from a file."""
    return _on_disk(text, read)


def _on_disk(text: str, reader: Callable[[Path], Read]) -> Read:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(text, encoding="utf-8")
        return reader(path)


APART = "no joint: "
"""Put before names of other frames while joints are fixed; a name must not begin so."""


def without_other_joints(
    model: pinocchio.Model, axes: Sequence[str]
) -> pinocchio.Model:
    """Fix every joint but the named ones at zero.

    Args:
        model: The chain.
        axes: The joints that stay.

    Returns:
        A chain whose joints are the named ones, in the model's order.

    Raises:
        UnknownName: Where a name is no joint of the chain.
    """
    known = list(model.names)[1:]
    for axis in axes:
        if axis not in known:
            raise UnknownName("joint", axis, known)
    others = [model.getJointId(name) for name in known if name not in axes]
    if not others:
        return model
    named = model.copy()  # Pinocchio finds a joint's frame by its name alone
    for frame in named.frames:
        if frame.type != pinocchio.FrameType.JOINT:
            frame.name = APART + frame.name
    reduced = pinocchio.buildReducedModel(named, others, pinocchio.neutral(named))
    for frame in reduced.frames:
        frame.name = frame.name.removeprefix(APART)
    return reduced


def _faults(model: pinocchio.Model, root: ElementTree.Element) -> list[str]:
    """Return what a model has that a chain of hinges and slides does not have."""
    faults = []
    if model.njoints < 2:
        faults.append("it has no joint; an arm needs at least one hinge or slide.")
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        kind = joint.shortname().removeprefix("JointModel")
        if not kind.startswith(KINDS):
            faults.append(f"joint {name!r} is a {kind}; use hinges and slides.")
    for joint in root.iter("joint"):
        if float(joint.get("ref", "0")) != 0.0:
            faults.append(f"joint {joint.get('name')!r} has a ref; make its zero 0.")
    return faults


def _first_turn(root: ElementTree.Element) -> Float[np.ndarray, "3 3"]:
    """Return world_from_first, the rotation of a first body without a joint.

    Pinocchio reads it from a copy in which another body carries that one.
    """
    first = root.find("worldbody/body")
    if first is None or first.find("joint") is not None:
        return np.eye(3)
    copy = ElementTree.Element("mujoco")
    copy.extend(root.findall("compiler"))
    origin = ElementTree.SubElement(ElementTree.SubElement(copy, "worldbody"), "body")
    origin.set("name", "origin")
    stand = {name: value for name, value in first.attrib.items() if name in STAND}
    body = ElementTree.SubElement(origin, "body", {**stand, "name": "first"})
    inertia = {"mass": "1", "pos": "0 0 0", "diaginertia": "1 1 1"}
    ElementTree.SubElement(body, "inertial", inertia)
    text = ElementTree.tostring(copy, encoding="unicode")
    model = _on_disk(text, lambda path: pinocchio.buildModelFromMJCF(str(path)))
    return model.frames[model.getFrameId("first")].placement.rotation.copy()


FOLLOWS = "follows:"
"""Prefix of the custom text by which plain MJCF notes a law: coefficients, a colon,
and the leader."""


def _followers(
    root: ElementTree.Element,
) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Read which joints follow others, and how."""
    found = {}
    for text in root.iterfind("custom/text"):
        name, data = text.get("name", ""), text.get("data", "")
        if name.startswith(FOLLOWS):
            law, _, leader = data.partition(":")
            found[name.removeprefix(FOLLOWS)] = leader, tuple(map(float, law.split()))
    return found


def _stiffness(root: ElementTree.Element) -> dict[str, float]:
    """Read each joint's linear stiffness, from itself or from its default class."""
    defaults: dict[str, str] = {}

    def collect(node: ElementTree.Element, inherited: str) -> None:
        joint = node.find("joint")
        own = inherited if joint is None else joint.get("stiffness", inherited)
        defaults[node.get("class", "main")] = own
        for child in node.findall("default"):
            collect(child, own)

    for node in root.findall("default"):
        collect(node, "0")
    springs = {}

    def walk(node: ElementTree.Element, child_class: str) -> None:
        child_class = node.get("childclass", child_class)
        for joint in node.findall("joint"):
            fallback = defaults.get(joint.get("class", child_class), "0")
            value = float(joint.get("stiffness", fallback).split()[0])
            if value > 0.0:
                springs[joint.get("name", "")] = value
        for body in node.findall("body"):
            walk(body, child_class)

    for world in root.findall("worldbody"):
        walk(world, "main")
    return springs
