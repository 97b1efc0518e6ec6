"""Ends of links in the MuJoCo model: bodies, poses and rotations along the chain.

A link ends at the bearing of the next axis, the last one at the flange.
"""

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.kinematic_chain import Anatomy


def end_of(arm: Anatomy, where: str) -> str:
    """Return the body at the end of a link, or the flange.

    Args:
        arm: The names of the arm's parts.
        where: `link_k`, or the link's own name.
    """
    k = arm.links.index(arm.body(where)) + 1
    return arm.end(arm.axes[k]) if k < len(arm.axes) else arm.flange


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
