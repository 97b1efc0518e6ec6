"""Errors that many readings share make them dependent; a square root undoes it.

==========  ==========================================================================
Equation    (D^-1 + F F')^-1 = R'R, R = (1 + A A')^-1/2 D^1/2, A = D^1/2 F
Source      spectral calculus: A A' has the left singular vectors of A
Valid       D positive semidefinite (0 = not seen)
Ignores     nothing
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float


def inverse_root(
    precision: Float[np.ndarray, "visits markers 3 3"],
    feigned: Float[np.ndarray, "visits n errors"],
) -> Float[np.ndarray, "visits n n"]:
    """Return square roots R of inverse covariances of markers' means.

    Args:
        precision: D, inverse covariance of each marker's mean.
        feigned: F, what shared errors feign, one sigma each.
    """
    visits, markers = precision.shape[:2]
    value, vector = np.linalg.eigh(precision)
    half = (vector * np.sqrt(np.maximum(value, 0.0))[..., None, :]) @ vector.swapaxes(
        -1, -2
    )
    wide = np.zeros((visits, markers, 3, markers, 3))
    wide[:, range(markers), :, range(markers)] = half.swapaxes(0, 1)
    wide = wide.reshape(visits, 3 * markers, 3 * markers)
    u, s, _ = np.linalg.svd(wide @ feigned, full_matrices=False)
    shrink = 1.0 / np.sqrt(1.0 + s**2) - 1.0
    return wide + (u * shrink[:, None]) @ (u.swapaxes(1, 2) @ wide)
