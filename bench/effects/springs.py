"""Springs in the MuJoCo model: joints and tendons that effects add to the arm.

Every function adds a joint or a tendon of its own, so that an arm can have the same
effect twice.
"""

from collections.abc import Iterable

import mujoco
import numpy as np
from jaxtyping import Float

from bench.kinematic_chain import Anatomy
from bench.model_file import HINGE, SLIDE, SPECK
from bench.shared.errors import Unusable

ARMATURE = 1e-3
"""Inertia of an added joint, kg m² or kg; chosen: negligible beside the links."""

MOST_JOINTS = 6
"""Maximum number of joints that MuJoCo allows one body."""

CLOSED = 1e8
"""Stiffness across an axis whose play is closed, in N m/rad; chosen: 100 N m tip it by
a µrad."""

NEVER = 1e3
"""A deflection that no spring reaches, in rad: the end of a slack that has none."""


def own_name(name: str, taken: Iterable[str]) -> str:
    """Return a name that no other part has: numbered from the second one on."""
    others, number, free = set(taken), 1, name
    while free in others:
        number += 1
        free = f"{name}_{number}"
    return free


def add_spring(
    body: mujoco.MjsBody,
    name: str,
    axis: np.ndarray,
    stiffness: float,
    *,
    pos: np.ndarray | None = None,
    slide: bool = False,
) -> mujoco.MjsJoint:
    """Add a joint on which a body turns (or slides) against a linear spring.

    The axis is a unit direction and `pos` a point of it, in m, in the body's frame; the
    stiffness is in N m/rad, or N/m for a slide. The name is numbered where the body has
    a joint of that name.

    Raises:
        Unusable: Where the body has as many joints as MuJoCo allows.
    """
    if len(body.joints) >= MOST_JOINTS:
        fault = f"{body.name!r} gives way in {MOST_JOINTS} ways already; leave one out."
        raise Unusable("The list of effects", [fault])
    if not body.explicitinertial:  # what moves must have some mass
        body.mass, body.inertia = SPECK, np.full(3, SPECK)
        body.explicitinertial = True
    joint = body.add_joint(
        name=own_name(name, (joint.name for joint in body.joints)),
        type=SLIDE if slide else HINGE,
        axis=np.asarray(axis, float),
        pos=np.zeros(3) if pos is None else np.asarray(pos, float),
        armature=ARMATURE,
        limited=mujoco.mjtLimited.mjLIMITED_FALSE,
    )
    joint.stiffness = [stiffness, 0.0, 0.0]
    return joint


def add_series(
    spec: mujoco.MjSpec, arm: Anatomy, where: str, label: str, stiffness: float
) -> mujoco.MjsJoint:
    """Put a linear spring in series with the one of an axis, on the axis' seat.

    The stiffness is in N m/rad, or N/m where the axis slides; the label ends the new
    joint's name.
    """
    axis = arm.axis(where)
    own = spec.joint(axis)
    return add_spring(
        spec.body(arm.seat(axis)),
        f"{axis}_{label}",
        own.axis,
        stiffness,
        pos=own.pos,
        slide=own.type == SLIDE,
    )


def add_parallel(
    spec: mujoco.MjSpec,
    name: str,
    joint: str,
    stiffness: float,
    *,
    slack: tuple[float, float] = (0.0, 0.0),
    springyield: float = 0.0,
) -> mujoco.MjsTendon:
    """Put a spring beside a joint's own, with slack or with a yield point.

    It carries nothing between two deflections, in rad, and slips from an elastic
    deflection on, in rad, 0 = never; the stiffness is in N m/rad. The name is numbered
    where there is a tendon of that name.
    """
    tendon = add_tendon(spec, name, slack)
    tendon.stiffness = [stiffness, 0.0, 0.0]
    tendon.springyield = springyield
    tendon.wrap_joint(joint, 1.0)
    return tendon


def add_tendon(
    spec: mujoco.MjSpec, name: str, slack: tuple[float, float] = (0.0, 0.0)
) -> mujoco.MjsTendon:
    """Add a tendon without a path; numbered where its name is taken."""
    free = own_name(name, (tendon.name for tendon in spec.tendons))
    return spec.add_tendon(name=free, springlength=np.asarray(slack, float))


def frame_along(direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Return a right-handed frame with a direction as third column.

    The first two columns are the directions across it, u and v: for one along z they
    are x and y.

    Returns:
        Columns u, v, w in the frame in which the direction is given.
    """
    w = direction / np.linalg.norm(direction)
    helper = np.eye(3)[0] if abs(w[0]) <= np.sqrt(0.5) else np.eye(3)[1]
    u = helper - w * (w @ helper)
    u /= np.linalg.norm(u)
    return np.column_stack([u, np.cross(w, u), w])


def softest_directions(
    first: float, second: float, coupling: float
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 2"]]:
    """Return where moments tilt about themselves alone, nearest to the first two.

    Args:
        first: Tilt about one direction per moment about it, in rad/(N m).
        second: The same about a direction across it.
        coupling: Tilt about either per moment about the other; of at most the root of
            the product of both counts, as no spring gives more back than it took.

    Returns:
        Compliances, and the directions as columns in terms of the two.
    """
    most = np.sqrt(first * second)
    coupling = float(np.clip(coupling, -most, most))
    tilt = np.array([[first, coupling], [coupling, second]])
    turned = 2.0 * coupling * np.copysign(1.0, first - second)
    angle = 0.5 * np.arctan2(turned, abs(first - second))
    directions = np.array(
        [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    )
    return np.diag(directions.T @ tilt @ directions), directions
