"""Intervals are as wide as regions of poses disagree.

==========  ==========================================================================
Equation    cov = C (sum over regions g g') C R / (R − 1), g = A'r / s² of a region,
            C = (A'A / s² + P)⁻¹; estimate ± t(R − 1) sqrt(cov), never narrower than
            C alone gives
Source      Liang, Zeger 1986 (the sandwich of clusters); Cameron, Miller 2015
            (R / (R − 1) and Student's t with R − 1)
Valid       ten regions or more
Ignores     that what is reported was chosen before, on folds left out
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import t as student

from stiffness.calibration.blocks import Blocks
from stiffness.calibration.ridge import Sizes, Solved
from stiffness.calibration.stance import Stance

LEVEL = 0.95


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, in SI."""

    value: float
    low: float
    high: float


def spread(
    blocks: Blocks,
    stance: Stance,
    region: Int[np.ndarray, " rows"],
    columns: Int[np.ndarray, " known"],
    fit: Solved,
    sizes: Sizes,
    wanted: Int[np.ndarray, " some"],
) -> Float[np.ndarray, " some"]:
    """Return half the width of the intervals of some coefficients.

    Args:
        blocks: All columns.
        stance: The arm.
        region: Of each row; rows below zero were not fitted.
        columns: Those that were fitted.
        fit: Their solution.
        sizes: Of noise and bands.
        wanted: Numbers of the coefficients within those that were fitted.
    """
    inverse = fit.inverse(wanted)  # (known, some)
    regions = np.unique(region[region >= 0])
    total = np.zeros((len(wanted), len(wanted)))
    for r in regions:
        rows = np.flatnonzero(region == r)
        a, y = blocks.problem(stance, rows)
        a = a[:, columns]
        left = y - a @ fit.x
        score = inverse.T @ (a.T @ left / sizes.noise)
        total += np.outer(score, score)
    count = len(regions)
    variance = np.diag(total) * count / (count - 1)
    variance = np.maximum(variance, inverse[wanted, np.arange(len(wanted))])
    return student.ppf(0.5 + LEVEL / 2, count - 1) * np.sqrt(variance)
