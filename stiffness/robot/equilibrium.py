"""Static equilibrium of an arm with joint springs, and its Cartesian compliance.

An arm with springs in its axes rests where springs, gravity and load agree.

==========  ==========================================================================
Equation    q = q_commanded + C (gravity torque(q) + J(q)^T wrench), C = diag(1/k)
Source      Spong 1987, "Modeling and control of elastic joint robots", at rest
Valid       springs in the axes, stiff against what gravity and load change with q
Ignores     friction, hysteresis, everything that gives way but the axes
==========  ==========================================================================

What springs in the axes come to at the end-effector depends on the posture.

==========  ==========================================================================
Equation    K_X = J^-T K_theta J^-1, and its inverse C_X = J K_theta^-1 J^T
Source      Wu et al. 2024, Eq. 6
Valid       small deflections about the given posture
Ignores     how the load changes the lever arms (Chen and Kao's K_C)
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from bench.shared.errors import BenchError
from bench.shared.recording import Payload
from stiffness.robot.arm import Arm

# --- Equilibrium ----------------------------------------------------------------------

CLOSE_ENOUGH = 1e-12
"""Largest step that counts as rest, in rad; chosen: a thousandth of a nanometre."""
STEPS = 60
"""Tries before giving up; chosen: each gains a factor k / |d torque/dq|, about 300."""


def equilibrium(
    arm: Arm,
    posture: Float[np.ndarray, "cases axes"],
    compliance: Float[np.ndarray, " axes"],
    wrench_in_base: Float[np.ndarray, "cases 6"] | None = None,
    position: Float[np.ndarray, "*cases 3"] | None = None,
    payload: Payload | None = None,
    body: str = "flange",
) -> Float[np.ndarray, "cases axes"]:
    """Find where the links rest while the motors hold a posture.

    Torques are taken where the links are, not where the motors are, so the change of
    the lever arms is in the answer.

    Args:
        arm: The nominal arm.
        posture: What the motors hold, in rad.
        compliance: Of each axis, in rad/(N m); 0 = rigid.
        wrench_in_base: Load on the body, force and torque about the point, along the
            base's axes, which do not turn with the arm; None = none.
        position: The point in the body's frame, in m; None = the body's origin.
        payload: A mass mounted on the flange.
        body: The body that the load acts on.

    Returns:
        Link-side posture, in rad.

    Raises:
        BenchError: Where there is no rest: the springs are too soft for the load.
    """
    position = np.zeros(3) if position is None else position
    rest = np.array(posture, dtype=float)
    for _ in range(STEPS):
        standing = arm.at(rest)
        torque = standing.gravity_torque(payload)
        if wrench_in_base is not None:
            torque = torque + standing.load_torque(wrench_in_base, body, position)
        after = posture + torque * compliance
        step = np.max(np.abs(after - rest), initial=0.0)
        rest = after
        if step < CLOSE_ENOUGH:
            return rest
        if not np.isfinite(step):
            break
    softest = arm.axes[int(np.argmax(np.abs(compliance)))]
    raise BenchError(
        f"The arm finds no rest under its load: axis {softest!r} is the softest with "
        f"{np.max(np.abs(compliance)):.3g} rad/(N m). Check the units."
    )


# --- Cartesian compliance -------------------------------------------------------------


def cartesian_compliance(
    arm: Arm,
    posture: Float[np.ndarray, "cases axes"],
    compliance: Float[np.ndarray, " axes"],
    point_in_flange: Float[np.ndarray, "*cases 3"],
) -> Float[np.ndarray, "cases 6 6"]:
    """Return C_X = J diag(compliance) J^T; unlike K_X it exists at singular postures.

    Args:
        arm: The nominal arm.
        posture: Joint angles, in rad.
        compliance: Of each axis, in rad/(N m).
        point_in_flange: Where the wrench acts and motion is read, in m.

    Returns:
        Motion (m, rad) per wrench (N, N m), along the base's axes.
    """
    jacobian = arm.jacobian(posture, "flange", point_in_flange)
    return (jacobian * compliance) @ jacobian.swapaxes(1, 2)
