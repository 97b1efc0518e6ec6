"""Static equilibrium of an arm with joint springs, under gravity and load.

==========  ==========================================================================
Equation    q = q_commanded + C (gravity torque(q) + J(q)^T wrench(q)), C = diag(1/k)
Source      Spong 1987, "Modeling and control of elastic joint robots", at rest
Valid       springs in the axes, stiff against the change of gravity and load torque
            with q
Ignores     friction, hysteresis, compliance except in the axes
==========  ==========================================================================
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from bench.shared.errors import BenchError
from bench.shared.recording import Payload
from stiffness.robot.arm import Arm
from stiffness.robot.kinematics import ArmState

CLOSE_ENOUGH = 1e-12
"""Largest step at convergence, in rad; chosen: a thousandth of a nanometre."""
STEPS = 60
"""Maximum number of iterations; chosen: each gains a factor k / |d torque/dq|, about
300."""
TurningWrench = Callable[[ArmState], Float[np.ndarray, "cases 6"]]
"""A wrench along the base's axes, by where the arm stands."""


def equilibrium(
    arm: Arm,
    posture: Float[np.ndarray, "cases axes"],
    compliance: Float[np.ndarray, " axes"],
    wrench_in_base: Float[np.ndarray, "cases 6"] | TurningWrench | None = None,
    position: Float[np.ndarray, "*cases 3"] | None = None,
    payload: Payload | None = None,
    body: str = "flange",
) -> Float[np.ndarray, "cases axes"]:
    """Return the links' rest posture while the motors hold a commanded one.

    Torques are evaluated at the links' posture, not at the motors', so the change of
    the lever arms is included.

    Args:
        arm: The nominal arm.
        posture: Joint angles that the motors hold, in rad.
        compliance: Of each axis, in rad/(N m); 0 = rigid.
        wrench_in_base: Load on the body, force and torque about the point, along the
            base's axes, which do not turn with the arm; or how it follows from where
            the arm stands, as one that was read by a sensor that turns with it; None =
            none.
        position: The point in the body's frame, in m; None = the body's origin.
        payload: A mass mounted on the flange.
        body: The body that the load acts on.

    Returns:
        Link-side posture, in rad.

    Raises:
        BenchError: Where there is no equilibrium: the springs are too soft for the
            load.
    """
    position = np.zeros(3) if position is None else position
    rest = np.array(posture, dtype=float)
    for _ in range(STEPS):
        standing = arm.at(rest)
        torque = standing.gravity_torque(payload)
        if wrench_in_base is not None:
            turns = callable(wrench_in_base)
            wrench = wrench_in_base(standing) if turns else wrench_in_base
            torque = torque + standing.load_torque(wrench, body, position)
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
