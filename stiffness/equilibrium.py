"""An arm with springs in its axes rests where springs, gravity and load agree.

==========  ==========================================================================
Equation    q = q_commanded + C (gravity torque(q) + J(q)^T wrench), C = diag(1/k)
Source      Spong 1987, "Modeling and control of elastic joint robots", at rest
Valid       springs in the axes, stiff against what gravity and load change with q
Ignores     friction, hysteresis, everything that gives way but the axes
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from bench.errors import BenchError
from bench.recording import Payload
from stiffness.arm import Arm

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
