"""Gaussian process on the residual of springs, as a function of posture and wrench.

==========  ==========================================================================
Equation    d = d_VJM + g(x); k(x, x') = s^2 exp(-sum_i (x_i - x'_i)^2 / (2 l_i^2));
            C = K + p^2 [same pose] + n^2 I; mean of g(x*) = k* C^-1 (d - d_VJM);
            log likelihood of y = d - d_VJM: -(y C^-1 y + log |C| + N log 2 pi) / 2; its
            slope along t: tr((a a^T - C^-1) dC/dt) / 2, a = C^-1 y
Source      Rasmussen, Williams 2006, "Gaussian Processes for Machine Learning", Eqs
            2.23, 2.30, 5.1, 5.8 and 5.9
Needs       what the virtual joint model needs; some thousand values at most: time grows
            with their cube
Assumes     errors that vary smoothly with sines and cosines of the posture and with the
            wrench, about zero; p: an error shared by all readings of a pose
==========  ==========================================================================

A common first choice. Own lines rather than scikit-learn's: that would be 9 MB and 3 s
of import for this one method, and its kernels have no term shared by the readings of a
pose.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.distance import cdist
from typing_extensions import override

from bench.shared.recording import Recording
from stiffness.experiment.deflections import LoadCases, every_plateau
from stiffness.methods.method import Fitted, Method, Parameter
from stiffness.methods.transferred_networks import wrench_about
from stiffness.methods.vjm import Vjm, VjmFit
from stiffness.networks.model import Scaling, sine_and_cosine
from stiffness.robot.arm import Arm

# --- Gaussian process ----------------------------------------------------------------

LENGTHS, SIZES = np.log([0.3, 1e2]), np.log([1e-3, 1e1])
"""Bounds of hyperparameters where inputs and values have size one; chosen. Shorter
lengths than 0.3 are noise by another name, and a search gets caught there."""
ENOUGH = 500
"""Values on which the hyperparameters are sought; chosen: three seconds a process."""


@dataclass(frozen=True)
class GaussianProcess:
    """A process that has seen values.

    Attributes:
        inputs: Where values were seen; no unit.
        length: How far values are alike, along each input; no unit.
        amplitude: s, in the values' unit.
        weight: C^-1 y, in one over the values' unit.
    """

    inputs: Float[np.ndarray, "seen inputs"]
    length: Float[np.ndarray, " inputs"]
    amplitude: float
    weight: Float[np.ndarray, " seen"]

    def mean(self, inputs: Float[np.ndarray, "rows inputs"]) -> np.ndarray:
        """Return what is expected elsewhere, in the values' unit."""
        likeness = _likeness(inputs / self.length, self.inputs / self.length)
        return self.amplitude**2 * likeness @ self.weight


def most_likely(
    inputs: Float[np.ndarray, "seen inputs"],
    values: Float[np.ndarray, " seen"],
    group: Int[np.ndarray, " seen"],
    evaluations: int,
) -> GaussianProcess:
    """Return the process under whose hyperparameters the values are most likely.

    Inputs are about of size one, values scatter about zero in any unit; values of one
    group share an error.
    """
    size = float(np.sqrt(np.mean(values**2))) or 1.0
    y = values / size
    same = (group[:, None] == group).astype(float)
    some = np.unique(np.linspace(0, len(y) - 1, ENOUGH).astype(int))
    count = inputs.shape[1]
    found = minimize(
        negative_log_likelihood,
        np.log([*np.full(count, np.sqrt(count)), 1.0, 0.3, 0.3]),
        args=(inputs[some], y[some], same[np.ix_(some, some)]),
        jac=True,
        method="L-BFGS-B",
        bounds=[*[tuple(LENGTHS)] * count, *[tuple(SIZES)] * 3],
        options={"maxfun": evaluations},
    )
    *length, s, p, n = (float(value) for value in np.exp(found.x))
    length = np.array(length)
    likeness = _likeness(inputs / length, inputs / length)
    covariance = s**2 * likeness + p**2 * same + n**2 * np.eye(len(y))
    weight = cho_solve(cho_factor(covariance, lower=True), y) / size
    return GaussianProcess(inputs, length, s * size, weight)


def negative_log_likelihood(
    theta: Float[np.ndarray, " parameters"],
    inputs: Float[np.ndarray, "seen inputs"],
    y: Float[np.ndarray, " seen"],
    same: Float[np.ndarray, "seen seen"],
) -> tuple[float, Float[np.ndarray, " parameters"]]:
    """Return how unlikely values are, one by one on average, and the slope.

    `theta` holds the logarithms of l for each input, then of s, p and n; `same` is one
    where two values are of one group, else zero.
    """
    *length, s, p, n = np.exp(theta)
    near = inputs / np.array(length)
    smooth = s**2 * _likeness(near, near)
    covariance = smooth + p**2 * same
    covariance[np.diag_indices(len(y))] += n**2
    factor = cho_factor(covariance, lower=True)
    a = cho_solve(factor, y)
    inverse = cho_solve(factor, np.eye(len(y)))
    value = (y @ a + len(y) * np.log(2 * np.pi)) / 2
    value += np.log(np.diag(factor[0])).sum()
    pull = np.outer(a, a) - inverse
    smooth *= pull
    # dC/dlog l_i = smooth (x_i - x'_i)^2 / l_i^2, summed without forming it
    lengths = smooth.sum(axis=1) @ near**2 - np.sum(near * (smooth @ near), axis=0)
    others = [smooth.sum(), p**2 * np.sum(pull * same), n**2 * np.trace(pull)]
    slope = np.concatenate([lengths, others])
    return float(value) / len(y), -slope / len(y)


def _likeness(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * cdist(a, b, "sqeuclidean"))


@dataclass(frozen=True)
class GpResidual(Method):
    """Springs, and a Gaussian process for each direction of their residual.

    Attributes:
        arm: The nominal arm.
        held: Axes whose compliance the springs take from the model, as in `Vjm`.
        evaluations: Maximum number of evaluations of the likelihood for each direction;
            chosen.
    """

    arm: Arm
    held: tuple[str, ...] = ()
    evaluations: int = 60

    @override
    def fit(self, recording: Recording) -> "GpResidualFit":
        """Fit springs, then the processes of maximum likelihood; see the base class."""
        arm = self.arm.for_recording(recording)
        springs = Vjm(arm, self.held).fit(recording)
        data = every_plateau(arm, recording, springs.compliance)
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
