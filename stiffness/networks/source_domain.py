"""Source domain of transfer learning: postures, wrenches, deflections of springs.

A `SourcePlan` lists postures, and wrenches in each; `source_domain` computes the
deflections of fitted springs for it.

What to use when: `table_5_plan` is the paper's (Wu et al. 2024, Tables 4 and 5); its
five wrenches span three of six dimensions, and a network trained on them extrapolates
to all others. `spanning_plan` draws five wrenches for each of the same 21,280 postures,
which span all six. Both have 106,400 rows.

Deflections of springs (`source_domain`):

==========  ==========================================================================
Equation    d = J_p C J_o^T w at the commanded posture: p, the point whose deflection
            is predicted; o, the point about which torques are given; C = diag(1/k)
Source      Wu et al. 2024, Eq. 6 (d = K_X^-1 w where p = o), Tables 4 and 5
Valid       small deflections
Ignores     the change of lever arms by sag and load: half a percent of `VjmFit.predict`
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.shared.errors import Unusable
from stiffness.robot.arm import Arm

# --- Plan -----------------------------------------------------------------------------

TABLE_4_DEG = (
    (-45.0, 45.0, 15.0),
    (-180.0, 0.0, 10.0),
    (0.0, 150.0, 10.0),
    (0.0, 0.0, 1.0),
    (0.0, 90.0, 10.0),
    (0.0, 0.0, 1.0),
)
"""First, last and step of A1 to A6. The table prints 156 as the end of A3, where steps
of 10 end at 150; the paper's 21,280 postures need the 16 values up to there. A4 and A6
are 0 (section 4.1)."""

TABLE_5 = np.array(
    [
        [100.0, 40.0, -20.0, 10.0, 10.0, 2.0],
        [80.0, 30.0, -40.0, 8.0, 8.0, 1.0],
        [60.0, 20.0, -60.0, 6.0, 6.0, 0.0],
        [40.0, 10.0, -80.0, 4.0, 4.0, -1.0],
        [20.0, 5.0, -100.0, 2.0, 2.0, -2.0],
    ]
)
"""Fx, Fy, Fz in N and Ta, Tb, Tc in N m. The table names no frame; taken along the
base's axes, where Fz < 0 is a weight."""

KUKA_ORDER, FORCE_ORDER = (2, 1, 0), (0, 1, 2)
"""Which of Ta, Tb, Tc are about x, y and z. The paper does not say. KUKA's angles A, B,
C turn about z, y, x, and the letters are KUKA's: the reading taken. The other is that
they follow the order of the forces."""

FORCE, LEVER = 100.0, 0.1
"""In N and m: the largest force of Table 5, and its largest torque over that force."""


@dataclass(frozen=True)
class SourcePlan:
    """Postures, and several wrenches in every posture.

    Attributes:
        posture: Joint angles, in rad.
        wrench_in_base: Force in N, then torque in N m, along the base's axes.

    Raises:
        Unusable: Where the arrays do not belong together.
    """

    name: str
    posture: Float[np.ndarray, "postures axes"]
    wrench_in_base: Float[np.ndarray, "postures wrenches 6"]

    def __post_init__(self):
        """Check that there are wrenches for every posture."""
        shape, count = self.wrench_in_base.shape, len(self.posture)
        if len(shape) != 3 or shape[0] != count or shape[2] != 6 or 0 in shape:
            fault = f"wrenches are {shape}, expected ({count}, at least 1, 6)."
            raise Unusable(f"Source plan {self.name!r}", [fault])

    @property
    def rows(self) -> int:
        """Number of rows, one per posture and wrench."""
        return self.wrench_in_base.shape[0] * self.wrench_in_base.shape[1]


def table_4_postures() -> Float[np.ndarray, "21280 6"]:
    """Return the paper's Table 4, in rad, A1 slowest."""
    axes = [
        first + step * np.arange(round((last - first) / step) + 1)
        for first, last, step in TABLE_4_DEG
    ]
    grid = np.meshgrid(*axes, indexing="ij")
    return np.deg2rad(np.stack([axis.ravel() for axis in grid], axis=1))


def table_5_plan(
    posture: Float[np.ndarray, "postures axes"] | None = None,
    torque_order: Sequence[int] = KUKA_ORDER,
) -> SourcePlan:
    """Return the paper's plan: the same five wrenches in every posture.

    Postures are in rad, by default Table 4's; `torque_order` says which of Ta, Tb, Tc
    are about x, y and z.
    """
    posture = table_4_postures() if posture is None else posture
    wrench = np.hstack([TABLE_5[:, :3], TABLE_5[:, 3:][:, list(torque_order)]])
    wrench = np.broadcast_to(wrench, (len(posture), *wrench.shape))
    return SourcePlan("table 5", posture, wrench)


def spanning_plan(
    posture: Float[np.ndarray, "postures axes"] | None = None,
    force: float = FORCE,
    lever: float = LEVER,
    wrenches: int = 5,
    seed: int = 0,
) -> SourcePlan:
    """Return a plan with wrenches of a rope at a hook, in every direction.

    Directions of force are uniform over the sphere, sizes uniform up to the largest;
    the hook is uniform in a ball about the sensor. No two rows have the same wrench.
    Postures are in rad, by default Table 4's; the largest force is in N, the farthest
    hook from the sensor's origin in m.
    """
    posture = table_4_postures() if posture is None else posture
    draw = np.random.default_rng(seed)
    shape = (len(posture), wrenches)
    pull = _directions(draw, shape) * draw.uniform(0.0, force, (*shape, 1))
    hook = _directions(draw, shape) * lever * np.cbrt(draw.random((*shape, 1)))
    wrench = np.concatenate([pull, np.cross(hook, pull)], axis=2)
    return SourcePlan("spanning", posture, wrench)


def _directions(
    draw: np.random.Generator, shape: tuple[int, ...]
) -> Float[np.ndarray, "postures wrenches 3"]:
    """Draw unit vectors, uniform over the sphere."""
    vector = draw.standard_normal((*shape, 3))
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


# --- Source domain --------------------------------------------------------------------


@dataclass(frozen=True)
class SourceDomain:
    """Deflections of springs, one row per posture and wrench.

    Attributes:
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
    """Return the deflections of fitted springs in a plan.

    Compliances are in rad/(N m); torques are about the origin in the flange, and both
    points in m.

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
