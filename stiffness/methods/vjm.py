"""Virtual joint model: one spring per axis carries all compliance of the arm.

==========  ==========================================================================
Equation    K_X = J^-T K_theta J^-1, so d = J K_theta^-1 J^T w; in full
            d = p(q_loaded) - p(q_unloaded), each q at rest under its own torques
Source      Wu et al. 2024, Eq. 6, after Chen and Kao 2000; identification after
            Dumas et al. 2011, least squares on the end-effector's deformation
Needs       loaded and unloaded readings of the end-effector, wrenches that load
            every axis, masses of the links and of the tool
Assumes     linear springs about the axes; everything else is rigid
==========  ==========================================================================

Jacobians and torques are evaluated at the rest posture of the fitted arm, not at the
commanded one: there the sag under its own weight biases the compliance of axis 3.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.errors import UnknownName
from bench.shared.recording import Recording
from stiffness.experiment.deflections import LoadCases, Selection, every_plateau
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.methods.spring_fit import fit_springs
from stiffness.regression.least_squares import LeastSquares
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium


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
        return VjmFit(arm, compliance, free, solution, data.frame.rms)


@dataclass(frozen=True)
class VjmFit(Fitted):
    """One compliance per axis.

    Attributes:
        arm: The nominal arm.
        compliance: Of each axis, in rad/(N m).
        free: Which axes were fitted.
        solution: The last linear step: covariances of the free axes' compliances.
        frame_rms: Residual of the fit of the tracker's frame, in m; 0 = it was stated.
    """

    arm: Arm
    compliance: Float[np.ndarray, " axes"]
    free: tuple[int, ...]
    solution: LeastSquares
    frame_rms: float

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
