"""A reading far beyond the noise counts less; none is dropped, and each is told.

==========  ==========================================================================
Equation    weight = frames min(1, (severe / size)^2), size = |reading - rigid motion|
            in sigma; measured noise^2 = sum of squares left / degrees of freedom
Source      Huber 1981, "Robust statistics"; pure error from rigid bodies
Valid       bodies with three markers or more
Ignores     an outlier on a body with fewer markers
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.rigid import rigid_motion
from stiffness.diagnosis.visits import Visits, mean_of

SEVERE = 4.5
"""Sigmas beyond which a reading counts less; chosen: three coordinates of a normal law
come there once in 7,000 readings, a slipped mark nearly always."""
ENOUGH = 50
"""Degrees of freedom from which the noise is measured; chosen: to a tenth."""


@dataclass(frozen=True)
class Checked:
    """Readings checked against each other.

    Attributes:
        weight: Of each reading.
        noise: Measured noise over the stated one; 1 where it cannot be measured.
        freedom: Degrees of freedom that it rests on.
        doubtful: Row, marker and size in sigma of each reading that counts less.
    """

    weight: Float[np.ndarray, "rows markers"]
    noise: float
    freedom: int
    doubtful: tuple[tuple[int, int, float], ...]


def checked(
    visits: Visits,
    residual: Float[np.ndarray, "rows markers 3"],
    point: Float[np.ndarray, "rows markers 3"],
    weight: Float[np.ndarray, "rows markers"],
    inverse: Float[np.ndarray, "3 3"],
    body: Int[np.ndarray, " markers"],
) -> Checked:
    """Compare readings with the rigid motion that the others of their body show.

    Args:
        visits: How rows lie side by side.
        residual: Reading less where it should be; NaN where not seen.
        point: The readings themselves.
        weight: Frames behind each.
        inverse: Inverse covariance of one frame's reading, as stated.
        body: Index of each marker's body.
    """
    own = visits.gather(weight) * visits.counts[..., None]
    values = np.nan_to_num(visits.gather(residual))
    place = mean_of(visits.gather(point), own)
    fitted, enough, freedom = rigid_motion(values, own, inverse, place, body)
    if freedom < ENOUGH:
        return Checked(weight, 1.0, 0, ())
    left = np.where(enough[..., None], values - fitted, 0.0)
    lighter = _lighter(left, own, inverse)
    if np.any(lighter < own):
        fitted, _, _ = rigid_motion(values, lighter, inverse, place, body)
        left = np.where(enough[..., None], values - fitted, 0.0)
        lighter = _lighter(left, own, inverse)
    square = float(np.sum((left @ inverse) * left * lighter[..., None]))
    new = weight.copy()
    new[visits.row[visits.counts]] = lighter[visits.counts]
    doubt = np.argwhere(new < weight)
    at = tuple(doubt.T)
    size = SEVERE * np.sqrt(weight[at] / np.maximum(new[at], 1e-12))
    doubtful = tuple(
        (int(r), int(m), float(s)) for (r, m), s in zip(doubt, size, strict=True)
    )
    return Checked(new, float(np.sqrt(square / freedom)), int(freedom), doubtful)


def _lighter(
    left: Float[np.ndarray, "visits rows markers 3"],
    weight: Float[np.ndarray, "visits rows markers"],
    inverse: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "visits rows markers"]:
    size = np.sqrt(np.sum((left @ inverse) * left, axis=3) * weight)
    return weight * np.minimum(1.0, (SEVERE / np.maximum(size, SEVERE)) ** 2)
