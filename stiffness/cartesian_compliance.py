"""What springs in the axes come to at the end-effector depends on the posture.

==========  ==========================================================================
Equation    K_X = J^-T K_theta J^-1, and its inverse C_X = J K_theta^-1 J^T
Source      Wu et al. 2024, Eq. 6
Valid       small deflections about the given posture
Ignores     how the load changes the lever arms (Chen and Kao's K_C)
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from stiffness.arm import Arm


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
