"""Ends of links in the MuJoCo model: bodies, poses and rotations along the chain.

A link ends at the bearing of the next axis, the last one at the flange. A link that
carries several axes, as a torso does, has as many ends: `link_2:a10` is where a10 sits.
"""

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.kinematic_chain import Anatomy
from bench.shared.errors import Unusable


def end_of(arm: Anatomy, where: str) -> str:
    """Return the body at the end of a link, or the hand.

    A link is `link_k`, or the link's own name; `link_k:aN` where it carries several
    axes.

    Raises:
        Unusable: Where the link carries several axes and none of them is named, or one
            that it does not carry.
    """
    k = arm.links.index(arm.body(where))
    ends = {f"a{n + 1}": arm.axes[n] for n in arm.carried(k)}
    if not ends:
        return arm.hands[k]
    _, colon, name = where.partition(":")
    known = [*ends, *ends.values()]
    axis = arm.axis(name) if colon else next(iter(ends.values()))
    if axis not in ends.values() or (len(ends) > 1 and not colon):
        fault = (
            f"{where!r} is no end of one link: it carries {', '.join(known)}; write "
            f"{' or '.join(f'link_{k + 1}:{end}' for end in ends)}."
        )
        raise Unusable("The place of an effect", [fault])
    return arm.end(axis)


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
