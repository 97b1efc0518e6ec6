"""A pull at one point is three numbers; what six channels say beyond them is noise.

==========  ==========================================================================
Equation    w / sigma = U S V' over all rows; kept are directions with S > sqrt(n) +
            sqrt(6) + 4
Source      what noise alone leaves of n rows and 6 channels: Davidson, Szarek 2001,
            "Local operator theory, random matrices and Banach spaces", theorem II.13;
            a regressor that errs leans on its own error: Fuller 1987, "Measurement
            Error Models", section 1.1
Valid       sensors whose noise is stated
Ignores     what is said no louder than the noise, in all rows together
==========  ==========================================================================

A direction that is noise alone moves no axis, and yet the readings answer to it: by
just what the nominal arm was thought to do under it.
"""

import numpy as np
from jaxtyping import Float

from bench.stated import WrenchSpec
from stiffness.wrench import turned

LOUDER = 4.0
"""By how much a direction must be longer than noise is on average: noise is so once in
3,000 recordings."""


def clear_channels(
    spec: WrenchSpec,
    wrench: Float[np.ndarray, "rows 6"],
    axes: Float[np.ndarray, "rows 3 3"],
) -> Float[np.ndarray, "rows 6"]:
    """Return wrenches without the directions along which a sensor reads noise alone.

    Args:
        spec: Its stated noise.
        wrench: Along the base's axes, in N and N m.
        axes: The sensor's own, as columns.
    """
    noise = spec.sigma
    rows, channels = wrench.shape
    if rows < channels or not np.all(noise > 0.0):
        return wrench
    own = turned(wrench, axes.swapaxes(1, 2)) / noise
    left, size, right = np.linalg.svd(own, full_matrices=False)
    clear = size > np.sqrt(rows) + np.sqrt(channels) + LOUDER
    return turned((left[:, clear] * size[clear]) @ right[clear] * noise, axes)
