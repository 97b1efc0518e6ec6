"""What holds an axis is known from the model's masses where no motor told it.

==========  ==========================================================================
Equation    torque = M(q) q'' + C(q, q') q' + g(q), the arm's own and its tool's
Source      Featherstone 2008, "Rigid Body Dynamics Algorithms", chapter 5
Valid       masses as in the model; motions that 0.1 s do not blur
Ignores     friction, the rotors' own inertia (it winds up no gear), a load that the
            recording does not tell of, the tool's inertia against acceleration
==========  ==========================================================================
"""

import numpy as np
import pinocchio
from jaxtyping import Float

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.arm_file import without_other_joints
from stiffness.two_encoders.motions import SHORTEST, smoothed


def modelled_torque(
    recording: Recording, arm: Arm
) -> Float[np.ndarray, "rows axes"] | None:
    """Return the torque that holds every axis of an arm in a stream, in N m.

    None of a model without gravity: it says nothing of what the arm carries.

    Args:
        recording: A stream; motions told apart by `pose`.
        arm: With the recording's axes.
    """
    if not np.any(arm.chain.gravity):
        return None
    torque = -arm.gravity_torque(recording.posture, recording.tool)
    for pose in np.unique(recording.pose):
        rows = np.flatnonzero(recording.pose == pose)
        if len(rows) >= SHORTEST:
            q, time = recording.posture[rows], recording.time[rows]
            rate, acceleration = (smoothed(q, time, order) for order in (1, 2))
            torque[rows] += _moving(arm, q, rate, acceleration)
    return torque


def _moving(
    arm: Arm, q: np.ndarray, rate: np.ndarray, acceleration: np.ndarray
) -> Float[np.ndarray, "rows axes"]:
    """Return what speed and acceleration ask for, without gravity, in N m."""
    model = without_other_joints(arm.file.model, arm.axes).copy()
    model.gravity.setZero()
    model.armature = np.zeros(model.nv)
    data = model.createData()
    joints = [model.joints[model.getJointId(name)] for name in arm.axes]
    at, turns = [j.idx_q for j in joints], [j.idx_v for j in joints]
    inside = np.empty_like(q), np.empty_like(q), np.empty_like(q)
    inside[0][:, at], inside[1][:, turns], inside[2][:, turns] = q, rate, acceleration
    found = [pinocchio.rnea(model, data, *row) for row in zip(*inside, strict=True)]
    return np.array(found)[:, turns]
