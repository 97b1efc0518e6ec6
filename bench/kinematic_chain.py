"""Kinematic chain or tree of a model: base, axes, links, flange, hands.

`Anatomy` names the parts of an arm: a base, axes, the links that they move, and a
flange at the end. Where a link carries several axes, the arm is a tree with several
hands, as a torso with two arms; the flange is the hand that ropes pull.

`with_seats` returns the compliant chain, which has two more bodies for each axis: the
end, where the link before ends, and on it the seat, where the axis' bearing sits. Both
are practically massless. Without a load they coincide with the next link's frame at
zero, so they change nothing; bending links move the ends, bearings and gears the seats.

`with_axes` holds all other joints at zero, as in `stiffness.robot.arm`: for one arm of
a torso, or for the arms that a recording moves.
"""

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass
from xml.etree import ElementTree

import mujoco
import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial
from scipy.spatial.transform import Rotation

from bench.model_file import PATCH, SPECK, followers_of, plain_mjcf
from bench.shared.errors import UnknownName, Unusable
from bench.shared.recording import Recording

# --- Anatomy --------------------------------------------------------------------------


@dataclass(frozen=True)
class Anatomy:
    """The names of an arm's parts, from base to flange.

    Attributes:
        axes: Joints of the model, a1 first.
        links: The body that each axis moves.
        base: The body that carries the first axis.
        flange: The hand that was asked for, else the body of that name, else the last
            in the file that the last axis carries.
        parents: The axis that carries each, from 0; -1: the base.
        mount: The axis that carries the flange.
        hands: Of each axis that carries no other, the body at the arm's end: the
            flange, where it carries that, else the last in the file.
        followers: Axes that follow others, see `bench.model_file.followers_of`.
    """

    axes: tuple[str, ...]
    links: tuple[str, ...]
    base: str
    flange: str
    slides: tuple[bool, ...]
    parents: tuple[int, ...]
    mount: int
    hands: dict[int, str]
    followers: dict[str, tuple[str, tuple[float, ...]]]

    def following(
        self, posture: Float[np.ndarray, "postures axes"]
    ) -> Float[np.ndarray, "postures axes"]:
        """Return postures in which axes that follow others do so, in rad (m)."""
        posture = posture.copy()
        for name, (leader, law) in self.followers.items():
            known = leader in self.axes
            angle = (
                posture[:, self.axes.index(leader)] if known else np.zeros(len(posture))
            )
            posture[:, self.axes.index(name)] = Polynomial(law or (0.0,))(angle)
        return posture

    @property
    def chain(self) -> tuple[int, ...]:
        """The axes that carry the flange, from the base on."""
        return self.carriers(self.mount)

    def carriers(self, axis: int) -> tuple[int, ...]:
        """Return an axis and those that carry it, from the base on."""
        found: list[int] = []
        while axis >= 0:
            found.append(axis)
            axis = self.parents[axis]
        return tuple(reversed(found))

    def carried(self, axis: int) -> tuple[int, ...]:
        """Return the axes that sit on the link of an axis; of -1, on the base."""
        return tuple(k for k, parent in enumerate(self.parents) if parent == axis)

    def seat(self, axis: str) -> str:
        """Return the name of the seat that carries an axis."""
        return f"{axis}_seat"

    def end(self, axis: str) -> str:
        """Return the name of the body where the link before an axis ends."""
        return f"{axis}_end"

    def end_of(self, where: str) -> str:
        """Return the body at the end of a link, or the hand.

        A link is `link_k`, or the link's own name. It ends at the bearing of the next
        axis, the last one at the flange; one that carries several axes, as a torso
        does, has as many ends: `link_2:a10` is where a10 sits.

        Raises:
            Unusable: Where the link carries several axes and none of them is named, or
                one that it does not carry.
        """
        k = self.links.index(self.body(where))
        ends = {f"a{n + 1}": self.axes[n] for n in self.carried(k)}
        if not ends:
            return self.hands[k]
        _, colon, name = where.partition(":")
        axis = self.axis(name) if colon else next(iter(ends.values()))
        if axis not in ends.values() or (len(ends) > 1 and not colon):
            fault = (
                f"{where!r} is no end of one link: it carries "
                f"{', '.join([*ends, *ends.values()])}; write "
                f"{' or '.join(f'link_{k + 1}:{end}' for end in ends)}."
            )
            raise Unusable("The place of an effect", [fault])
        return self.end(axis)

    def body(self, name: str) -> str:
        """Return the model's body for `base`, `link_k`, `flange` or its own name.

        `link_k:aN`, the end of a link that carries several axes, is on that link.
        """
        name = name.partition(":")[0] if name.startswith("link_") else name
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


def anatomy(model: mujoco.MjModel, hand: str = "") -> Anatomy:
    """Return the parts of an arm, alone or with a tool, in the order of the model.

    Its flange is the hand that is named, else the body of that name, else the last.

    Raises:
        UnknownName: Where the model has no such body.
        Unusable: Where the model has no joint, or none that carries the flange.
    """
    joints = list(range(model.njnt))
    if not joints:
        fault = "it has no joint; an arm needs at least one hinge or slide."
        raise Unusable("The model", [fault])
    bodies = [int(model.jnt_bodyid[j]) for j in joints]
    names = [model.body(b).name for b in range(model.nbody)]
    if hand and hand not in names[1:]:
        raise UnknownName("body", hand, names[1:])
    moved_by = [_axis_of(model, b) for b in range(model.nbody)]
    last = {axis: names[b] for b, axis in enumerate(moved_by)}
    parents = tuple(_axis_of(model, int(model.body_parentid[b])) for b in bodies)
    flange = hand or ("flange" if "flange" in names else last[len(joints) - 1])
    mount = moved_by[names.index(flange)]
    if mount < 0:
        raise Unusable("The model", [f"no joint carries {flange!r}."])
    hands = {k: last[k] for k in joints if k not in parents} | {mount: flange}
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
        parents=parents,
        mount=mount,
        hands=hands,
        followers=followers_of(model),
    )


def _axis_of(model: mujoco.MjModel, body: int) -> int:
    """Return the joint that moves a body last; -1: none does."""
    while body and not model.body_jntnum[body]:
        body = int(model.body_parentid[body])
    return int(model.body_jntadr[body]) if body else -1


def with_seats(plain: str, arm: Anatomy) -> str:
    """Put an end and a seat, practically massless, before each axis.

    Takes and returns MJCF text, as `bench.model_file.plain_mjcf` writes it.
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


def carriers_of(model: mujoco.MjModel, body: int) -> set[int]:
    """Return a body and all bodies that carry it, without the world."""
    found = set()
    while body:
        found.add(body)
        body = int(model.body_parentid[body])
    return found


def pose_in(
    body: mujoco.MjsBody, ancestor: mujoco.MjsBody
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Return the pose of a body in an ancestor of the chain, all joints at zero.

    Returns:
        Rotation (columns are the body's axes) and origin in the ancestor's frame, in m.
    """
    rotation, origin = np.eye(3), np.zeros(3)
    while body.name != ancestor.name:
        turn = rotation_of(body)
        rotation, origin = turn @ rotation, turn @ origin + np.asarray(body.pos)
        body = body.parent
    return rotation, origin


def rotation_of(body: mujoco.MjsBody) -> Float[np.ndarray, "3 3"]:
    """Return a body's rotation in its parent; columns are the body's axes."""
    quat_wxyz = np.asarray(body.quat, float)
    return Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()


def wraps_on_joints(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Return a tendon's entries in the model's list of wraps; none off the joints."""
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    on_joints = model.wrap_type[first] == mujoco.mjtWrap.mjWRAP_JOINT
    return list(range(first, first + count)) if on_joints else []


# --- Statics --------------------------------------------------------------------------


class Statics:
    """Weight of an arm's links, and how a point on its flange moves with the axes.

    Attributes:
        model: The arm; its gravity acts, even where a flag switches it off.
    """

    def __init__(self, model: mujoco.MjModel, arm: Anatomy):
        """Take a copy of the model: gravity acts in it."""
        self.model = copy(model)
        self.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        self._data = mujoco.MjData(self.model)
        joints = [model.joint(axis) for axis in arm.axes]
        self._position = [int(joint.qposadr[0]) for joint in joints]
        self._dof = [int(joint.dofadr[0]) for joint in joints]
        self._flange = model.body(arm.flange).id

    def at(
        self, posture: Float[np.ndarray, " axes"], place: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, " axes"], Float[np.ndarray, "3 axes"]]:
        """Return the weight's torques and the Jacobian of a place on the flange.

        Torques in N m (slides: N); the place in m in the flange's frame, the Jacobian
        in m per rad along the world's axes. The posture is in rad.
        """
        model, data = self.model, self._data
        data.qpos[self._position] = posture
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        held, jacobian = np.empty(model.nv), np.empty((3, model.nv))
        mujoco.mj_rne(model, data, 0, held)
        turn = data.xmat[self._flange].reshape(3, 3)
        point = data.xpos[self._flange] + turn @ place
        mujoco.mj_jac(model, data, jacobian, None, point, self._flange)
        return -held[self._dof], jacobian[:, self._dof]


# --- Some axes of many ----------------------------------------------------------------


def axes_to(model: mujoco.MjModel, hands: Sequence[str]) -> tuple[str, ...]:
    """Return the joints that carry some bodies, from the base on.

    Raises:
        UnknownName: Where the model has no such body.
        Unusable: Where no joint carries it.
    """
    names = [model.body(b).name for b in range(1, model.nbody)]
    found: set[int] = set()
    for hand in hands:
        if hand not in names:
            raise UnknownName("body", hand, names)
        carriers = carriers_of(model, int(model.body(hand).id))
        axes = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in carriers]
        if not axes:
            raise Unusable("The model", [f"no joint carries {hand!r}."])
        found.update(axes)
    return tuple(model.joint(j).name for j in sorted(found))


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


def moving(recording: Recording, model: mujoco.MjModel) -> tuple[tuple[str, ...], str]:
    """Return the joints of a model that a recording moves, and its hand.

    Returns:
        The joints, empty: all; and the body that the recording calls flange, empty: the
        model's own.
    """
    hand = recording.bodies.get("flange", "")
    axes = tuple(recording.axes)
    return (() if len(axes) in (0, model.njnt) else axes), hand
