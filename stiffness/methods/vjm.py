"""Virtual joint model: one spring per axis carries all compliance of the arm.

==========  ==========================================================================
Equation    K_X = J^-T K_theta J^-1, so d = J K_theta^-1 J^T w; in full
            d = p(q_loaded) - p(q_unloaded), q = q_commanded + C torque(q)
Source      Wu et al. 2024, Eq. 6, after Chen and Kao 2000; identification after
            Dumas et al. 2011, least squares on the end-effector's deformation, by
            Gauss-Newton, Nocedal and Wright 2006, section 10.3
Needs       loaded and unloaded readings of the end-effector, wrenches that load
            every axis, masses of the links and of the tool
Assumes     linear springs about the axes; everything else is rigid
==========  ==========================================================================

Jacobians and torques are evaluated at the rest posture of the fitted arm, not at the
commanded one: there the sag under its own weight biases the compliance of axis 3. So
compliances and rest postures are iterated together, the torques held within a step.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.errors import NotIdentifiable, UnknownName
from bench.shared.recording import Recording
from stiffness.experiment.deflections import (
    Deflections,
    LoadCases,
    Selection,
    every_plateau,
)
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.regression.least_squares import LeastSquares, least_squares, solve
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium
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
    every compliance. Compliances and sigma are in rad/(N m), the model's 0 where it is
    rigid; `free` are the axes that were fitted.

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

    Axes that are held keep the compliance of the model's own spring.

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


@dataclass(frozen=True)
class Vjm(Method):
    """Virtual joint model: one compliance per axis, by weighted least squares.

    Attributes:
        arm: The nominal arm.
        held: Axes whose compliance is not fitted but taken from the model's spring.
        select: Which readings are used: `every_plateau` or `one_per_pose`.
    """

    arm: Arm
    held: tuple[str, ...] = ()
    select: Selection = every_plateau

    def __post_init__(self):
        """Check that the held axes exist."""
        for axis in self.held:
            if axis not in self.arm.axes:
                raise UnknownName("axis", axis, self.arm.axes)

    @override
    def fit(self, recording: Recording) -> "VjmFit":
        """Find the compliances; see the base class.

        Raises:
            Unusable: Where the recording cannot be used, with all faults.
            NotIdentifiable: Where an axis cannot be identified, by name.
        """
        arm = self.arm.for_recording(recording)
        data = self.select(arm, recording, None)
        compliance, solution = fit_springs(arm, self.held, data)
        if data.frame.source == "arm markers":  # found rigid; once more, sagging
            data = self.select(arm, recording, compliance)
            compliance, solution = fit_springs(arm, self.held, data)
        free = tuple(k for k, axis in enumerate(arm.axes) if axis not in self.held)
        return VjmFit(arm, compliance, free, solution)


@dataclass(frozen=True)
class VjmFit(Fitted):
    """One compliance per axis.

    Attributes:
        compliance: Of each axis, in rad/(N m).
        free: Which axes were fitted.
        solution: The last linear step: covariances of the free axes' compliances.
    """

    arm: Arm
    compliance: Float[np.ndarray, " axes"]
    free: tuple[int, ...]
    solution: LeastSquares

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Predict the motion between two rests; see the base class."""
        ends = []
        for wrench in (cases.wrench_in_base, None):
            rest = equilibrium(
                self.arm,
                cases.posture,
                self.compliance,
                wrench,
                cases.origin_in_flange,
                cases.payload,
            )
            ends.append(self.arm.point_in_base(rest, "flange", cases.point_in_flange))
        return ends[0] - ends[1]

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """The fitted compliances, in rad/(N m)."""
        low, high = self.solution.interval(self.compliance[list(self.free)])
        return tuple(
            Parameter(
                self.arm.axes[k],
                float(self.compliance[k]),
                float(self.solution.sigma[i]),
                "m/N" if self.arm.slides[k] else "rad/(N m)",
                float(low[i]),
                float(high[i]),
            )
            for i, k in enumerate(self.free)
        )

    @property
    def stiffness(self) -> tuple[Parameter, ...]:
        """The fitted stiffness, in N m/rad; a compliance not above zero is rigid."""
        rigid = np.inf
        return tuple(
            replace(
                p,
                value=1.0 / p.value if p.value > 0.0 else rigid,
                sigma=p.sigma / p.value**2 if p.value > 0.0 else rigid,
                unit="N/m" if p.unit == "m/N" else "N m/rad",
                low=1.0 / p.high if p.high > 0.0 else rigid,
                high=1.0 / p.low if p.low > 0.0 else rigid,
            )
            for p in self.parameters
        )
