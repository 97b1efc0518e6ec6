"""Gaussian-process regression with hyperparameters by maximum likelihood.

==========  ==========================================================================
Equation    k(x, x') = s^2 exp(-sum_i (x_i - x'_i)^2 / (2 l_i^2));
            C = K + p^2 [same group] + n^2 I; mean(x*) = k* C^-1 y;
            log likelihood = -(y C^-1 y + log |C| + N log 2 pi) / 2;
            its slope along t = tr((a a^T - C^-1) dC/dt) / 2, a = C^-1 y
Source      Rasmussen, Williams 2006, "Gaussian Processes for Machine Learning", Eqs
            2.23, 2.30, 5.1, 5.8 and 5.9
Valid       up to some thousand values: time grows with their cube
Ignores     any mean: values scatter about zero
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

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
        group_sigma: p, in the values' unit.
        noise_sigma: n, in the values' unit.
        weight: C^-1 y, in one over the values' unit.
    """

    inputs: Float[np.ndarray, "seen inputs"]
    length: Float[np.ndarray, " inputs"]
    amplitude: float
    group_sigma: float
    noise_sigma: float
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
    """Find the hyperparameters under which the values are most likely.

    Args:
        inputs: Where values were seen; about size one.
        values: Scatter about zero; any unit.
        group: Values of one group share an error.
        evaluations: Most evaluations of the likelihood.

    Returns:
        The process given the values.
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
    return GaussianProcess(inputs, length, s * size, p * size, n * size, weight)


def negative_log_likelihood(
    theta: Float[np.ndarray, " parameters"],
    inputs: Float[np.ndarray, "seen inputs"],
    y: Float[np.ndarray, " seen"],
    same: Float[np.ndarray, "seen seen"],
) -> tuple[float, Float[np.ndarray, " parameters"]]:
    """Return how unlikely values are, one by one on average, and the slope.

    Args:
        theta: Logarithms of l for each input, then of s, p and n.
        inputs: Where values were seen.
        y: The values.
        same: One where two values are of one group, else zero.
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
