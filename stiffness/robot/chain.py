"""Kinematic chain: axes that carry masses, each axis the z axis of its own frame."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable


@dataclass(frozen=True)
class Place:
    """Attachment of a body to the chain.

    Attributes:
        axis: The axis that moves it; -1 = the base.
        placement: Transform from the body's frame to that axis' frame, in m.
    """

    axis: int
    placement: Float[np.ndarray, "4 4"]


@dataclass(frozen=True)
class Chain:
    """Tree of axes, each the z axis of its own frame, with bodies and masses.

    Attributes:
        order: The axes such that each comes after the one that carries it.
        parent: The axis that carries each axis; -1 = the base.
        slides: Whether each axis slides.
        before: Transform from each axis' frame at zero to its parent's, in m.
        nominal_origin: Origin of each axis as drawn, in its parent's frame, in m.
        mass: Mass that each axis moves up to the next one, in kg.
        centre: Centre of that mass, in the axis' frame, in m.
        foot_mass: Mass of the base and all that is fixed to it, in kg.
        foot_centre: Centre of that mass, in the base's frame, in m.
        places: The bodies by name.
        gravity: Acceleration along the base's axes, in m/s^2.
    """

    order: tuple[int, ...]
    parent: tuple[int, ...]
    slides: Bool[np.ndarray, " axes"]
    before: Float[np.ndarray, "axes 4 4"]
    nominal_origin: Float[np.ndarray, "axes 3"]
    mass: Float[np.ndarray, " axes"]
    centre: Float[np.ndarray, "axes 3"]
    foot_mass: float
    foot_centre: Float[np.ndarray, "3"]
    places: Mapping[str, Place]
    gravity: Float[np.ndarray, "3"]

    def carriers(self, axis: int) -> list[int]:
        """Return an axis and all that carry it; none for the base."""
        found = []
        while axis >= 0:
            found.append(axis)
            axis = self.parent[axis]
        return found

    @cached_property
    def links(self) -> dict[str, int]:
        """The links between axes by name, each with the axis at its end.

        Link k is what axis k moves. One that carries several axes has an end at each:
        `link_2:a3` and `link_2:a10`.
        """
        ends = {k: parent for k, parent in enumerate(self.parent) if parent >= 0}
        several = Counter(ends.values())
        return {
            f"link_{parent + 1}" + f":a{k + 1}" * (several[parent] > 1): k
            for k, parent in ends.items()
        }


def seats_of(chain: Chain) -> list[int]:
    """Return the axes that another axis carries."""
    return list(chain.links.values())


def corrected_chain(chain: Chain, links: Float[np.ndarray, "links 6"]) -> Chain:
    """Return a chain whose links end elsewhere than drawn.

    Args:
        chain: As drawn.
        links: Shift in m and rotation vector in rad of each link's end, in its frame.
    """
    before = chain.before.copy()
    for k, twist in zip(seats_of(chain), links, strict=True):
        axes_of_link = link_axes(chain, chain.parent[k])
        before[k, :3, 3] += axes_of_link @ twist[:3]
        turn = Rotation.from_rotvec(axes_of_link @ twist[3:]).as_matrix()
        before[k, :3, :3] = turn @ before[k, :3, :3]
    return replace(chain, before=before)


def link_error_of(screw: Float[np.ndarray, "6"]) -> Float[np.ndarray, "6"]:
    """Return the shift in m and rotation vector of a link's end by a screw motion.

    A link that turns about the axis before it is the same screw as that axis' offset,
    however far: the finite motions of both are one.

    ==========  ======================================================================
    Equation    t = v + r x v / 2 + r x (r x v) / 6: (v, r) the screw at the origin
                before it moves
    Source      the exponential map of SE(3) (Murray, Li, Sastry 1994, "A mathematical
                introduction to robotic manipulation", A.2), to second order in r
    Valid       rotations far below a radian
    Ignores     the next term, r^3 v / 24
    ==========  ======================================================================

    Args:
        screw: v in m and r in rad.
    """
    shift, turn = np.split(screw, 2)
    across = np.cross(turn, shift)
    moved = shift + across / 2.0 + np.cross(turn, across) / 6.0
    return np.concatenate([moved, turn])


def link_axes(chain: Chain, axis: int) -> Float[np.ndarray, "3 3"]:
    """Return the axes of a link's frame, as columns, in its moving axis' frame."""
    place = chain.places.get(f"link_{axis + 1}", Place(axis, np.eye(4)))
    return place.placement[:3, :3]


def chain_of(model: pinocchio.Model, axes: Sequence[str], gravity: np.ndarray) -> Chain:
    """Return Pinocchio's chain with every axis the z axis of its own frame.

    Args:
        model: The chain.
        axes: Its joints in the order in which postures name them.
        gravity: Acceleration along the world's axes, in m/s^2.

    Returns:
        The chain, relative to its base.

    Raises:
        Unusable: Where an axis carries the base.
    """
    joints = [model.getJointId(name) for name in axes]
    number = {joint: k for k, joint in enumerate(joints)} | {0: -1}
    frames = list(model.frames)
    kinds = [_motion_axis(model, joint) for joint in joints]
    turn = {0: np.eye(4)} | {
        joint: _turn_z_to(axis) for joint, (_, axis) in zip(joints, kinds, strict=True)
    }
    inner = [f for f in frames if f.type == pinocchio.FrameType.BODY]
    own = {f.name: f for f in inner if f.name != "universe"}
    first = min(joints)
    jointed = model.getFrameId(model.names[first], pinocchio.FrameType.JOINT)
    foot = own.get("base", frames[frames[jointed].parentFrame])
    if foot.parentJoint != 0:
        raise Unusable("The model", [f"its base {foot.name!r} moves with an axis."])
    base_from_world = foot.placement.inverse().homogeneous
    places = {
        name: Place(
            number[f.parentJoint],
            (base_from_world if f.parentJoint == 0 else turn[f.parentJoint].T)
            @ f.placement.homogeneous,
        )
        for name, f in own.items()
    }
    places.setdefault("base", Place(-1, np.eye(4)))
    numbered = {}  # link_k is what axis k moves, whatever bodies are called
    for k, joint in enumerate(joints):
        moved = next((f.name for f in inner if f.parentJoint == joint), None)
        if moved is not None:
            numbered[f"link_{k + 1}"] = places[moved]
    places.update(numbered)
    last = [f.name for f in inner if f.parentJoint == max(joints)][-1]
    places.setdefault("flange", places[last])
    places.setdefault("tool", places["flange"])
    parents = [model.parents[joint] for joint in joints]
    before = [
        (base_from_world if parent == 0 else turn[parent].T)
        @ model.jointPlacements[joint].homogeneous
        @ turn[joint]
        for joint, parent in zip(joints, parents, strict=True)
    ]
    centres = [turn[j].T[:3, :3] @ model.inertias[j].lever for j in joints]
    return Chain(
        order=tuple(int(k) for k in np.argsort(joints)),
        parent=tuple(number[parent] for parent in parents),
        slides=np.array([slides for slides, _ in kinds]),
        before=np.stack(before),
        nominal_origin=np.stack(before)[:, :3, 3],
        mass=np.array([model.inertias[joint].mass for joint in joints]),
        centre=np.stack(centres),
        foot_mass=float(model.inertias[0].mass),
        foot_centre=base_from_world[:3, :3] @ model.inertias[0].lever
        + base_from_world[:3, 3],
        places=places,
        gravity=base_from_world[:3, :3] @ gravity,
    )


def _motion_axis(model: pinocchio.Model, joint: int) -> tuple[bool, np.ndarray]:
    """Return whether a joint slides, and its axis in its own frame."""
    data = model.joints[joint].createData()
    model.joints[joint].calc(data, np.zeros(1))
    motion = np.ravel(data.S)
    slides = bool(np.linalg.norm(motion[3:]) == 0.0)
    return slides, motion[:3] if slides else motion[3:]


def _turn_z_to(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """Return a pure rotation with a given third column; exact for z itself."""
    turn = np.eye(4)
    if not np.array_equal(axis, [0.0, 0.0, 1.0]):
        angle = np.arccos(np.clip(axis[2], -1.0, 1.0))
        about = np.array([-axis[1], axis[0], 0.0])
        length = np.linalg.norm(about)
        about = np.array([1.0, 0.0, 0.0]) if length == 0.0 else about / length
        turn[:3, :3] = Rotation.from_rotvec(angle * about).as_matrix()
    return turn
