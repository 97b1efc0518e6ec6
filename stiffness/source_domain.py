"""Springs that were fitted to a few postures can be asked about thousands of others.

==========  ==========================================================================
Equation    d = J_p C J_o^T w at the commanded posture: p, the point whose motion is
            meant; o, the point about which torques are given; C = diag(1/k)
Source      Wu et al. 2024, Eq. 6 (d = K_X^-1 w where p = o), Tables 4 and 5
Valid       small deflections
Ignores     how sag and load change the lever arms: half a percent of `VjmFit.predict`
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from stiffness.arm import Arm
from stiffness.source_plan import SourcePlan


@dataclass(frozen=True)
class SourceDomain:
    """What the springs answered, one row per posture and wrench.

    Attributes:
        plan: The plan's name.
        posture: Joint angles, in rad.
        wrench_in_base: Force in N, then torque in N m, along the base's axes.
        deflection: Along the base's axes, in m.
        point_in_flange: The point that moves, in the flange's frame, in m.
        origin_in_flange: The point about which torques are given, same frame, in m.
    """

    plan: str
    posture: Float[np.ndarray, "rows axes"]
    wrench_in_base: Float[np.ndarray, "rows 6"]
    deflection: Float[np.ndarray, "rows 3"]
    point_in_flange: Float[np.ndarray, "3"]
    origin_in_flange: Float[np.ndarray, "3"]

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.posture)

    def take(self, rows: np.ndarray) -> "SourceDomain":
        """Return the same with only these rows (indices or a mask)."""
        return replace(
            self,
            posture=self.posture[rows],
            wrench_in_base=self.wrench_in_base[rows],
            deflection=self.deflection[rows],
        )


def source_domain(
    arm: Arm,
    compliance: Float[np.ndarray, " axes"],
    plan: SourcePlan,
    point_in_flange: Float[np.ndarray, "3"],
    origin_in_flange: Float[np.ndarray, "3"],
) -> SourceDomain:
    """Let fitted springs answer a plan.

    Args:
        arm: The nominal arm.
        compliance: Of each axis, in rad/(N m), as fitted.
        plan: Postures and wrenches.
        point_in_flange: The end-effector point, in m.
        origin_in_flange: About which torques are given, in m.

    Raises:
        Unusable: Where the plan's postures have another number of axes than the arm.
    """
    standing = arm.at(plan.posture)
    moves = standing.jacobian("flange", point_in_flange)[:, :3] * compliance
    twists = standing.jacobian("flange", origin_in_flange)
    per_wrench = moves @ twists.swapaxes(1, 2)  # (postures, 3, 6) m/N, m/(N m)
    deflection = plan.wrench_in_base @ per_wrench.swapaxes(1, 2)
    return SourceDomain(
        plan.name,
        np.repeat(plan.posture, plan.wrench_in_base.shape[1], axis=0),
        plan.wrench_in_base.reshape(-1, 6),
        deflection.reshape(-1, 3),
        point_in_flange,
        origin_in_flange,
    )
