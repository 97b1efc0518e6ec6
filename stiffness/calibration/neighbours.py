"""What neighbouring poses leave alike is not noise.

==========  ==========================================================================
Equation    pairs (i, j) of poses next to each other in posture; noise² = mean
            |r_i − r_j|² / 2; agreement = mean r_i . r_j / mean |r|²; p-value by turning
            the signs of half the poses at random
Source      von Neumann 1941, "Distribution of the ratio of the mean square successive
            difference to the variance"; sign flips: Fisher 1935
Valid       what was left out changes slowly from pose to pose
Ignores     what changes within the distance of neighbours: it counts as noise
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree
from scipy.stats import norm

FLIPS = 1999
ALPHA = 0.005
POWER = 0.9


@dataclass(frozen=True)
class Agreement:
    """How alike residuals of neighbours are.

    Attributes:
        p_value: Of there being nothing but noise.
        share: Of the mean square that neighbours have in common.
        rms: Of the residuals, 3-D, in m.
        noise: What neighbours differ by, 3-D of one pose, in m.
        smallest: Rms of a common part that these data would have shown, in m.
        pairs: How many.
    """

    p_value: float
    share: float
    rms: float
    noise: float
    smallest: float
    pairs: int


def agreement(
    residual: Float[np.ndarray, "rows 3"], posture: Float[np.ndarray, "rows axes"]
) -> Agreement:
    """Compare residuals of poses that are each other's nearest."""
    found = KDTree(posture).query(posture, k=2)
    distance, near = (np.asarray(values) for values in found)
    a, b = np.arange(len(posture)), near[:, 1]
    closest = distance[:, 1] <= np.median(distance[:, 1])
    twice = (near[b, 1] == a) & (a > b)  # count a pair of mutual neighbours once
    a, b = a[closest & ~twice], b[closest & ~twice]
    product = np.sum(residual[a] * residual[b], axis=1)
    seen = float(product.mean())
    rng = np.random.default_rng(len(posture))
    beaten = 0
    for _ in range(FLIPS):
        sign = rng.choice([-1.0, 1.0], len(posture))
        beaten += bool(np.mean(sign[a] * sign[b] * product) >= seen)
    square = float(np.mean(np.sum(residual**2, axis=1)))
    noise2 = float(np.mean(np.sum((residual[a] - residual[b]) ** 2, axis=1)) / 2.0)
    reach = (norm.ppf(1.0 - ALPHA) + norm.ppf(POWER)) / np.sqrt(3.0 * len(a))
    return Agreement(
        p_value=(1 + beaten) / (1 + FLIPS),
        share=seen / max(square, 1e-30),
        rms=float(np.sqrt(square)),
        noise=float(np.sqrt(noise2)),
        smallest=float(np.sqrt(noise2 * reach)),
        pairs=len(a),
    )
