"""Fit of joint compliance to deflections, refusing axes that are not identifiable.

Rest postures and compliances depend on each other, so both are iterated together.

==========  ==========================================================================
Equation    d = p(q_loaded) - p(q_unloaded), q = q_commanded + C torque(q); column k:
            J_k torque_k loaded, less the same unloaded; C by weighted least squares
Source      Wu et al. 2024, Eq. 6, taken at the rest postures; Gauss-Newton with the
            torques held within a step, Nocedal and Wright 2006, section 10.3
Needs       deflections with their noise
Assumes     linear springs about the axes; everything else is rigid
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from bench.shared.errors import NotIdentifiable
from stiffness.experiment.deflections import Deflections, LoadCases
from stiffness.regression.least_squares import LeastSquares, least_squares, solve
from stiffness.robot.arm import Arm
from stiffness.robot.kinematics import ArmState

# --- Axes that the data cannot see ----------------------------------------------------

SIGNIFICANT = 3.0
"""Compliance over sigma from which an axis counts as identifiable; chosen: one false in
740."""


def refuse_if_blind(
    arm: Arm,
    free: list[int],
    compliance: Float[np.ndarray, " free"],
    sigma: Float[np.ndarray, " free"],
    nominal: Float[np.ndarray, " axes"],
) -> None:
    """Refuse axes whose compliance is not identifiable, each by name.

    An axis is identifiable where its sigma, estimated jointly with all other axes, is
    below a third of its compliance, or of the model's where that is larger: an axis may
    be stiff, but a soft one must not be missed. No identifiable axis may be negative by
    as much; where all are, the wrench has the wrong sign, which reverses the sign of
    every compliance.

    Args:
        arm: Names the axes.
        free: The axes that were fitted.
        compliance: Their estimates, in rad/(N m).
        sigma: Its standard deviation.
        nominal: The model's compliance of all axes; 0 = rigid.

    Raises:
        NotIdentifiable: With every such axis and what to do.
    """
    seen = SIGNIFICANT * sigma < np.maximum(np.abs(compliance), nominal[free])
    negative = seen & (compliance < -SIGNIFICANT * sigma)
    if np.any(seen) and np.all(negative[seen]):
        cause = (
            "as do all that are seen. Check the wrench's sign: it is what the world "
            "exerts on the robot"
        )
    else:
        cause = (
            "which no spring has; others are positive, so the wrench's sign is right. "
            "What gives way beside the axes (a bearing, a link, the base) is taken for "
            "it. Add postures and loads that twist it"
        )
    faults = []
    for i, k in enumerate(free):
        axis = arm.axes[k]
        found = f"{compliance[i]:.2g} ± {sigma[i]:.2g} rad/(N m)"
        hold = f"or hold it: held=({axis!r},)."
        if np.isinf(sigma[i]):
            faults.append(
                f"No load case turns axis {axis!r} and moves the tool by it. Add a "
                f"load whose line of action passes beside its axis, {hold}"
            )
        elif not seen[i]:
            faults.append(
                f"The compliance of axis {axis!r} is too uncertain beside the others': "
                f"{found}. Add postures, and loads whose line of action passes beside "
                f"its axis, {hold}"
            )
        elif negative[i]:
            faults.append(
                f"Axis {axis!r} comes out with the negative compliance {found}, "
                f"{cause}, {hold}"
            )
    if faults:
        unseen = [arm.axes[k] for i, k in enumerate(free) if not seen[i] or negative[i]]
        raise NotIdentifiable("\n".join(faults), unseen)


# --- Fit of the springs ---------------------------------------------------------------

STEPS = 40
"""Maximum number of Gauss-Newton steps; chosen: five are usual."""
CLOSE_ENOUGH = 1e-4
"""Change of a compliance, over its sigma, at which the fit ends; chosen."""
FAR = 0.5
"""Wind-up of an axis, in rad, beyond any spring of an arm; chosen."""
UNSETTLED = (
    "The springs do not settle: these deflections and wrenches are of no one arm. "
    "Check units, the wrench's frame and the tracker's frame."
)


def fit_springs(
    arm: Arm, held: tuple[str, ...], data: Deflections
) -> tuple[Float[np.ndarray, " axes"], LeastSquares]:
    """Iterate compliances and rest postures together until both converge.

    Args:
        arm: The nominal arm.
        held: Axes that keep the compliance of the model's own spring.
        data: Loads and deflections.

    Returns:
        The compliance of every axis in rad/(N m), and the errors of those fitted.

    Raises:
        NotIdentifiable: Where an axis cannot be identified, by name.
    """
    free = [k for k, axis in enumerate(arm.axes) if axis not in held]
    compliance = np.where([axis in held for axis in arm.axes], arm.compliance, 0.0)
    cases = data.cases
    count = len(cases)
    commanded = np.concatenate([cases.posture, cases.posture])  # loaded, then not
    point = np.concatenate([cases.point_in_flange, cases.point_in_flange])
    rest = commanded
    whiten = data.noise.whitener()
    for step in range(STEPS):
        standing = arm.at(rest)
        jacobian = standing.jacobian("flange", point)
        wrench = _wrench_at_point(data, standing)
        torque = standing.gravity_torque(cases.payload)
        torque[:count] += np.einsum("cia,ci->ca", jacobian[:count], wrench)
        columns = jacobian[:, :3] * torque[:, None]
        columns = (columns[:count] - columns[count:])[:, :, free]
        reached = standing.point("flange", point)
        moved = reached[:count] - reached[count:]
        if step == 1:  # the force sensor's noise moves the tool through the springs
            whiten = data.noise.whitener(_per_wrench(arm, cases, compliance))
        design = whiten(columns)
        left = whiten((data.deflection - moved)[:, :, None])[:, :, 0]
        change, covariance = solve(design, left)
        compliance[free] += change
        sigma = np.sqrt(np.diag(covariance))
        if step == 0:
            refuse_if_blind(arm, free, compliance[free], sigma, arm.compliance)
        rest = commanded + torque * compliance
        if step > 1 and np.all(np.abs(change) < CLOSE_ENOUGH * sigma):
            break
        if not np.all(np.abs(rest - commanded) < FAR):
            raise NotIdentifiable(UNSETTLED)
    else:
        raise NotIdentifiable(UNSETTLED)
    solution = least_squares(design, left, data.posture_id)
    refuse_if_blind(
        arm, free, compliance[free], solution.sigma_clustered, arm.compliance
    )
    return compliance, solution


def _wrench_at_point(
    data: Deflections, standing: ArmState
) -> Float[np.ndarray, "rows 6"]:
    """Carry the wrench to the end-effector point, rotated with a sensor that turns."""
    cases = data.cases
    turn = standing.turn("flange")[: len(cases)]
    force, torque = cases.wrench_in_base[:, :3], cases.wrench_in_base[:, 3:]
    if data.wrench_in_flange is not None:
        turning = data.wrench_in_flange
        force = (turn @ turning[:, :3, None])[:, :, 0]
        torque = (turn @ turning[:, 3:, None])[:, :, 0]
    arm_of_force = cases.origin_in_flange - cases.point_in_flange
    lever = (turn @ arm_of_force[:, :, None])[:, :, 0]
    return np.concatenate([force, torque + np.cross(lever, force)], axis=1)


def _per_wrench(
    arm: Arm, cases: LoadCases, compliance: Float[np.ndarray, " axes"]
) -> Float[np.ndarray, "rows 3 6"]:
    """Return each case's displacement of the point per wrench at the sensor."""
    standing = arm.at(cases.posture)
    moved = standing.jacobian("flange", cases.point_in_flange)[:, :3]
    pulled = standing.jacobian("flange", cases.origin_in_flange)
    return (moved * compliance) @ pulled.swapaxes(1, 2)
