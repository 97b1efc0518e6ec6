"""What encoders and torques state of their noise says how much may be left.

==========  ==========================================================================
Equation    noise² = stated² + (compliance x noise of the torque)²; not stated: from
            third differences of rows, whose variance is 20 times a row's.
            More is left where mean squares of stretches, or their logarithms, lie above
            it: much in few of them, or a little in many
Source      von Neumann et al. 1941 (differences); Student's t over stretches of time
Valid       white noise
Ignores     errors of an encoder that repeat with its angle
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from stiffness.two_encoders.fitting import moving_squares
from stiffness.two_encoders.found import Between
from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.terms import WOUND

STATED = 1.1
"""How much larger than stated noise may be; chosen: a tenth, as statements go."""
SEEN = 2.0
"""The same of noise that only rows tell of, which is its white part; chosen."""


def noise_of(
    motions: Sequence[Motion], found: Between | None, stated: float | None
) -> float:
    """Return the noise of a row of an axis, in rad.

    Args:
        motions: Of the axis.
        found: What lies between its encoders; None: nothing.
        stated: One sigma of an encoder after a gear, in rad; None: not stated.
    """
    own = white(motions) if stated is None else stated
    give = 0.0
    if found is not None:
        give = found.value(WOUND, "compliance_rad_per_nm")
    torque = max(m.scatter for m in motions)
    return float(np.hypot(own, give * torque))


def white(motions: Sequence[Motion]) -> float:
    """Return the white noise that differences from row to row tell of, in rad."""
    rough = np.concatenate([np.diff(m.apart, 3) for m in motions])
    return float(np.sqrt(np.mean(rough**2) / 20.0))


def beyond(
    left: Sequence[Float[np.ndarray, " _"]],
    motions: Sequence[Motion],
    noise: float,
    stated: bool,
) -> float:
    """Return the p-value of more being left than noise.

    Args:
        left: Of each motion, in rad.
        motions: The unit of independence is a stretch of each.
        noise: One sigma of a row, in rad.
        stated: Whether an instrument states it.
    """
    most = ((STATED if stated else SEEN) * noise) ** 2
    parts = [
        moving_squares(part - part.mean(), m)
        for part, m in zip(left, motions, strict=True)
    ]
    squares = np.concatenate(parts) / max(most, np.finfo(float).tiny)
    often = _above(np.log(np.maximum(squares, np.finfo(float).tiny)), 0.0)
    return min(1.0, 2.0 * min(often, _above(squares, 1.0)))


def _above(values: Float[np.ndarray, " stretches"], most: float) -> float:
    """Return the p-value of a mean above the most that it may be."""
    error = max(float(values.std(ddof=1)), 1e-12) / np.sqrt(len(values))
    return float(student.sf((values.mean() - most) / error, len(values) - 1))
