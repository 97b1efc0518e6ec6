"""Gaussian process on the residual of springs, as a function of posture and wrench.

==========  ==========================================================================
Equation    d = d_VJM + g(x); k(x, x') = s^2 exp(-sum_i (x_i - x'_i)^2 / (2 l_i^2));
            mean of g(x*) = k* (K + p^2 [same pose] + n^2 I)^-1 (d - d_VJM); s, l, p, n
            maximise the marginal likelihood
Source      Rasmussen, Williams 2006, "Gaussian Processes for Machine Learning", Eqs
            2.23, 5.1, 5.8 and 5.9
Needs       what the virtual joint model needs
Assumes     errors that vary smoothly with sines and cosines of the posture and with the
            wrench; p: an error shared by all readings of a pose
==========  ==========================================================================

A common first choice. Own lines rather than scikit-learn's: that would be 9 MB and 3 s
of import for this one method, and its kernels have no term shared by the readings of a
pose.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import LoadCases, Selection, every_plateau
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.methods.transferred_networks import wrench_about
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.features import Scaling, sine_and_cosine
from stiffness.regression.gaussian_process import GaussianProcess, most_likely
from stiffness.robot.arm import Arm


@dataclass(frozen=True)
class GpResidual(Method):
    """Springs, and a Gaussian process for each direction of their residual.

    Attributes:
        arm: The nominal arm.
        select: Readings that it is fitted to.
        held: Axes whose compliance the springs take from the model, as in `Vjm`.
        evaluations: Maximum number of evaluations of the likelihood for each direction;
            chosen.
    """

    arm: Arm
    select: Selection = every_plateau
    held: tuple[str, ...] = ()
    evaluations: int = 60

    @override
    def fit(self, recording: Recording) -> "GpResidualFit":
        """Fit springs, then the processes of maximum likelihood; see the base class."""
        arm = self.arm.for_recording(recording)
        springs = Vjm(arm, self.held).fit(recording)
        data = self.select(arm, recording, springs.compliance)
        left = data.deflection - springs.predict(data.cases)
        origin = data.cases.origin_in_flange
        seen = sine_and_cosine(data.cases.posture, data.cases.wrench_in_base)
        scaling = Scaling.of(seen)
        inputs = scaling.unitless(seen)
        processes = tuple(
            most_likely(inputs, left[:, k], data.posture_id, self.evaluations)
            for k in range(3)
        )
        return GpResidualFit(springs, scaling, processes, origin)


@dataclass(frozen=True)
class GpResidualFit(Fitted):
    """Fitted springs and processes of their residual.

    Attributes:
        springs: The virtual joint model.
        scaling: Standardises postures and wrenches.
        processes: For x, y and z, in m.
        origin_in_flange: About which torques are given, in m.
    """

    springs: VjmFit
    scaling: Scaling
    processes: tuple[GaussianProcess, ...]
    origin_in_flange: Float[np.ndarray, "3"]

    @override
    def predict(self, cases: LoadCases) -> Float[np.ndarray, "cases 3"]:
        """Add the processes' mean to the springs' prediction."""
        wrench = wrench_about(self.springs.arm, cases, self.origin_in_flange)
        inputs = self.scaling.unitless(sine_and_cosine(cases.posture, wrench))
        more = [process.mean(inputs) for process in self.processes]
        return self.springs.predict(cases) + np.stack(more, axis=1)

    @property
    @override
    def parameters(self) -> tuple[Parameter, ...]:
        """The springs' compliances, in rad/(N m)."""
        return self.springs.parameters
