"""A tracker's volumetric error varies smoothly over its volume and does not average.

==========  ==========================================================================
Equation    cov f(p), f(p') = sd^2 mean_L exp(-|p - p'|^2 / (2 L^2)) by coordinate;
            f(p) = k(p, Z) k(Z, Z)^-1/2 a with a ~ N(0, 1), and what the anchors Z
            leave, k(p, p) - k(p, Z) k(Z, Z)^-1 k(Z, p), as noise of each place
Source      Nystroem method (Williams & Seeger 2001); its rest as noise (Snelson &
            Ghahramani 2006, "Sparse Gaussian processes using pseudo-inputs"); lengths L
            chosen: a third to all of an arm's workspace, since no maker states one
Valid       inside the measuring volume
Ignores     that what the anchors leave is alike at neighbouring places
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float
from scipy.cluster.vq import kmeans2
from scipy.spatial.distance import cdist

LENGTHS = (0.35, 0.7, 1.4)
"""L over the arm's extent, in units of a metre; chosen, see above."""
ANCHORS = 120
"""Most anchors; chosen: about one every 0.2 m in the workspace of a 10 kg arm."""


def smooth_basis(
    point: Float[np.ndarray, "many 3"], sd: float
) -> Float[np.ndarray, "many anchors"]:
    """Return basis functions whose coefficients have a standard normal prior, in m.

    Args:
        point: Where the error is wanted, in m.
        sd: The stated size of the error, in m.
    """
    count = min(ANCHORS, max(4, len(point) // 8))
    some = point[:: max(1, len(point) // 4000)]
    anchors, _ = kmeans2(some, count, minit="points", rng=0, iter=5)
    value, vector = np.linalg.eigh(_kernel(anchors, anchors, sd))
    keep = value > 1e-8 * value[-1]
    return _kernel(point, anchors, sd) @ (vector[:, keep] / np.sqrt(value[keep]))


def rest_of(
    basis: Float[np.ndarray, "*places waves"], sd: float
) -> Float[np.ndarray, " *places"]:
    """Return the variance of the error that a basis leaves at each place, in m^2."""
    return np.maximum(sd**2 - np.sum(basis**2, axis=-1), 0.0)


def _kernel(a: np.ndarray, b: np.ndarray, sd: float) -> np.ndarray:
    square = cdist(a, b, "sqeuclidean")
    return sd**2 * np.mean([np.exp(-square / (2 * L * L)) for L in LENGTHS], axis=0)
