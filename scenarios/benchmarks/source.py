"""Small deflections at many postures are one product of arrays, or a loop over them."""

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from scenarios.benchmarks.experiment import KR10
from scenarios.benchmarks.race import Race, Way
from scenarios.paper.numbers import TABLE_03_NM_PER_RAD
from stiffness.arm import Arm
from stiffness.source_domain import source_domain
from stiffness.source_plan import SourcePlan, spanning_plan, table_4_postures

POINT, ORIGIN = np.array([0.01, 0.0, 0.06]), np.array([0.0, 0.0, 0.0254])
"""In the flange's frame, in m; chosen: a tool's tip and a sensor's face."""


def race(postures: int | None = None) -> Race:
    """Return the race over the source domain.

    Args:
        postures: How many of Table 4's 21,280; None: all.
    """
    plan = spanning_plan(table_4_postures()[:postures])
    arm, compliance = Arm.from_mjcf(KR10), 1.0 / np.array(TABLE_03_NM_PER_RAD)
    model = pin.buildModelFromMJCF(str(KR10))
    return Race(
        task=f"source domain: {plan.rows:,} rows by fitted springs",
        ways=(
            Way(
                "stiffness.source_domain",
                lambda: source_domain(arm, compliance, plan, POINT, ORIGIN).deflection,
            ),
            Way(
                "Pinocchio loop",
                lambda: pinocchio_loop(model, compliance, plan),
            ),
        ),
        differs=lambda ours, other: f"{1e3 * np.abs(ours - other).max():.1g} mm",
        bar=0.5 if postures is None else None,
        rounds=2,
    )


def pinocchio_loop(
    model: pin.Model, compliance: Float[np.ndarray, " axes"], plan: SourcePlan
) -> Float[np.ndarray, "rows 3"]:
    """Ask posture by posture for two Jacobians, and all its wrenches at once."""
    model = pin.Model(model)
    flange = model.frames[model.getFrameId("flange")]
    ids = []
    for name, place in (("point", POINT), ("origin", ORIGIN)):
        placement = flange.placement * pin.SE3(np.eye(3), place)
        kind = pin.FrameType.OP_FRAME
        ids.append(model.addFrame(pin.Frame(name, flange.parentJoint, placement, kind)))
    data, along_base = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    moved = []
    for posture, wrench in zip(plan.posture, plan.wrench_in_base, strict=True):
        pin.computeJointJacobians(model, data, posture)
        pin.updateFramePlacements(model, data)
        point, origin = (pin.getFrameJacobian(model, data, i, along_base) for i in ids)
        moved.append((wrench @ origin * compliance) @ point[:3].T)
    return np.concatenate(moved)
