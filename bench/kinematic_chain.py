"""Kinematic chain of a model: base, axes, links, flange; one of several arms.

`Anatomy` names the parts of an arm: a base, axes, the links that they move, and a
flange at the end.

`with_seats` returns the compliant chain, which has two more bodies for each axis: the
end, where the link before ends, and on it the seat, where the axis' bearing sits. Both
are practically massless. Without a load they coincide with the next link's frame at
zero, so they change nothing; bending links move the ends, bearings and gears the seats.

`with_axes` selects one chain of a torso with several arms, for ropes, patches and
proofs; the joints of the other arms are held at zero, as in `stiffness.robot.arm`.
"""

from collections.abc import Collection
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from bench.model_file import PATCH, load, plain_mjcf
from bench.shared.errors import UnknownName, Unusable
from bench.shared.recording import Recording

# --- Anatomy --------------------------------------------------------------------------

SPECK = 1e-12
"""Mass in kg and inertia in kg m² of a seat; the least that MuJoCo accepts for a moving
body. Its weight at 1 m is 1e-11 N m, below the 1e-10 at which an equilibrium
converges."""


@dataclass(frozen=True)
class Anatomy:
    """The names of an arm's parts, from base to flange.

    Attributes:
        axes: Joints of the model, a1 first.
        links: The body that each axis moves.
        base: The body that carries the first axis.
        flange: The body of that name, or the last in the file that the last axis
            carries.
        slides: Whether each axis slides instead of turning.
    """

    axes: tuple[str, ...]
    links: tuple[str, ...]
    base: str
    flange: str
    slides: tuple[bool, ...]

    def seat(self, axis: str) -> str:
        """Return the name of the seat that carries an axis."""
        return f"{axis}_seat"

    def end(self, axis: str) -> str:
        """Return the name of the body where the link before an axis ends."""
        return f"{axis}_end"

    def body(self, name: str) -> str:
        """Return the model's body for `base`, `link_k`, `flange` or its own name."""
        if name == "base":
            return self.base
        if name == "flange":
            return self.flange
        if name.startswith("link_") and name[5:].isdigit():
            k = int(name[5:])
            if 1 <= k <= len(self.links):
                return self.links[k - 1]
        return name

    def axis(self, where: str) -> str:
        """Return the model's joint for `a3`, or for the joint's own name.

        `a3` is always the third axis from the base, whatever joints are called.
        """
        if where[:1] == "a" and where[1:].isdigit():
            k = int(where[1:])
            if 1 <= k <= len(self.axes):
                return self.axes[k - 1]
        return where


def anatomy(model: mujoco.MjModel) -> Anatomy:
    """Return the parts of a serial arm in a compiled model.

    Args:
        model: The arm alone, or an arm with a tool.

    Returns:
        Its parts, in the order of the chain.

    Raises:
        Unusable: Where the model has no joint, or its joints do not form one chain.
    """
    joints = list(range(model.njnt))
    faults = []
    if not joints:
        faults.append("it has no joint; an arm needs at least one hinge.")
    bodies = [int(model.jnt_bodyid[j]) for j in joints]
    for before, after in branches(model):
        faults.append(
            f"joint on {model.body(after).name!r} does not follow from "
            f"{model.body(before).name!r}; the axes must form one chain. Where "
            "they carry several arms, choose one (`record`: --hand)."
        )
    if faults:
        raise Unusable("The model", faults)
    names = [model.body(b).name for b in range(model.nbody)]
    carried = [b for b in range(model.nbody) if bodies[-1] in carriers_of(model, b)]
    flange = "flange" if "flange" in names else names[carried[-1]]
    below = int(model.body_parentid[bodies[0]])
    while names[below].startswith(PATCH):
        below = int(model.body_parentid[below])
    return Anatomy(
        axes=tuple(model.joint(j).name for j in joints),
        links=tuple(names[b] for b in bodies),
        base="base" if "base" in names else names[below],
        flange=flange,
        slides=tuple(
            bool(model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE) for j in joints
        ),
    )


def with_seats(plain: str, arm: Anatomy) -> str:
    """Put an end and a seat, practically massless, before each axis.

    Args:
        plain: The arm as written by `bench.model_file.plain_mjcf`.
        arm: Its parts.

    Returns:
        MJCF text of the same arm with ends and seats.
    """
    root = ElementTree.fromstring(plain)
    parents = {child: parent for parent in root.iter() for child in parent}
    bodies = {body.get("name"): body for body in root.iter("body")}
    for axis, link in zip(arm.axes, arm.links, strict=True):
        body = bodies[link]
        parent = parents[body]
        position = list(parent).index(body)
        parent.remove(body)
        end = _massless(arm.end(axis), body.get("pos", ""), body.get("quat", ""))
        seat = _massless(arm.seat(axis), "0 0 0", "1 0 0 0")
        parent.insert(position, end)
        end.append(seat)
        seat.append(body)
        body.set("pos", "0 0 0")
        body.set("quat", "1 0 0 0")
    return ElementTree.tostring(root, encoding="unicode")


def _massless(name: str, pos: str, quat: str) -> ElementTree.Element:
    body = ElementTree.Element("body", name=name, pos=pos, quat=quat)
    inertia = " ".join([str(SPECK)] * 3)
    ElementTree.SubElement(
        body, "inertial", pos="0 0 0", mass=str(SPECK), diaginertia=inertia
    )
    return body


def branches(model: mujoco.MjModel) -> list[tuple[int, int]]:
    """Return pairs of moved bodies of which the first does not carry the second."""
    bodies = [int(b) for b in model.jnt_bodyid]
    return [
        (before, after)
        for before, after in pairwise(bodies)
        if before not in carriers_of(model, after)
    ]


def carriers_of(model: mujoco.MjModel, body: int) -> set[int]:
    """Return a body and all bodies that carry it, without the world."""
    found = set()
    while body:
        found.add(body)
        body = int(model.body_parentid[body])
    return found


# --- One chain of several -------------------------------------------------------------


def axes_to(model: mujoco.MjModel, hand: str) -> tuple[str, ...]:
    """Return the joints that carry a body, from the base on.

    Args:
        model: The arm or torso alone.
        hand: Name of a body.

    Raises:
        UnknownName: Where the model has no such body.
        Unusable: Where no joint carries it.
    """
    names = [model.body(b).name for b in range(1, model.nbody)]
    if hand not in names:
        raise UnknownName("body", hand, names)
    carriers = carriers_of(model, int(model.body(hand).id))
    axes = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in carriers]
    if not axes:
        raise Unusable("The model", [f"no joint carries {hand!r}."])
    return tuple(model.joint(j).name for j in axes)


def with_axes(model: mujoco.MjModel, axes: Collection[str]) -> mujoco.MjModel:
    """Return a model in which only these joints move.

    Raises:
        UnknownName: Where the model has no such joint.
    """
    known = [model.joint(j).name for j in range(model.njnt)]
    for axis in axes:
        if axis not in known:
            raise UnknownName("joint", axis, known)
    root = ElementTree.fromstring(plain_mjcf(model))
    for body in root.iter("body"):
        for joint in body.findall("joint"):
            if joint.get("name") not in axes:
                body.remove(joint)
    return mujoco.MjModel.from_xml_string(
        ElementTree.tostring(root, encoding="unicode")
    )


def moving(recording: Recording, arm_file: Path) -> tuple[str, ...]:
    """Return the joints of a several-armed model that a recording moves; () = all.

    Raises:
        Unusable: Where they form no chain.
    """
    model = load(arm_file)
    if not branches(model):
        return ()
    if recording.axes and not branches(with_axes(model, recording.axes)):
        return tuple(recording.axes)
    fault = (
        "it carries several arms, and the simulator takes one chain at a time: record "
        "each arm by itself and name its joints in [robot] axes, the others at zero"
    )
    raise Unusable("The model", [f"{fault}."])
