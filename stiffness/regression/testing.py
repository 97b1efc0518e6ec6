"""Max-T sign-flip tests over poses, gains on data left out, several sizes at once.

If nothing is there, a pose's scores could as well have had the other sign.

==========  ==========================================================================
Equation    T_b = |sum_p e_p w_p,b|^2, e_p = 1 for the data and random signs for the
            comparison; z_b = Wilson-Hilferty of T_b with b's degrees of freedom;
            p = (1 + number of comparisons with max_b z* >= max_b z) / (1 + comparisons)
Source      wild cluster bootstrap (Cameron, Gelbach & Miller 2008) with Rademacher
            signs; max-T (Westfall & Young 1993); Wilson & Hilferty 1931
Valid       poses that err independently with symmetric errors, of whatever size
Ignores     that fitted nuisance makes scores of poses slightly dependent
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import sem

from bench.shared.settings import SETTINGS
from stiffness.regression.normal_equations import (
    projection_coefficients,
    schur_complement,
    unit_scale,
    whitening_transform,
)

# --- Detection ------------------------------------------------------------------------

SIGNIFICANCE = SETTINGS.significance


# --- Max-T sign-flip test -------------------------------------------------------------

COMPARISONS = 4999
"""Chosen: p-values down to 0.0002, and a verdict at 0.005 that rests on 25 of them."""
SMALLEST = 1.0 / (1.0 + COMPARISONS)
"""Smallest p-value that is said."""
ROUNDING = 1e-4
"""What single precision may err by in z: signs that are all the same, or all turned,
come often where poses are few, and are as strong as the data themselves."""
AT_ONCE = 500
"""Comparisons made at once; chosen: signs of many poses never fill the memory."""


@dataclass(frozen=True)
class MaxTResult:
    """Blocks of columns against what random signs would make of them.

    Attributes:
        captured: Whitened square that each block captures.
        degrees_of_freedom: Degrees of freedom of each block.
        z: The same on the scale of a standard normal.
        unadjusted: p-value of each block for itself.
        together: p-value of each block among all.
        p_value: Of the strongest.
    """

    captured: Float[np.ndarray, " blocks"]
    degrees_of_freedom: Float[np.ndarray, " blocks"]
    z: Float[np.ndarray, " blocks"]
    unadjusted: Float[np.ndarray, " blocks"]
    together: Float[np.ndarray, " blocks"]

    @property
    def p_value(self) -> float:
        """Return the p-value of the strongest block, for all blocks looked at."""
        return float(self.together.min()) if len(self.together) else 1.0


def white_scores(
    gram: Float[np.ndarray, "columns columns"],
    score: Float[np.ndarray, "poses columns"],
    known: Int[np.ndarray, " known"],
    blocks: Sequence[Int[np.ndarray, " _"]],
    raw: Float[np.ndarray, " columns"],
) -> list[Float[np.ndarray, "poses _"]]:
    """Return scores of blocks, each made white, with known columns taken out.

    Args:
        gram: Of all columns, over the poses of `score`.
        score: Of data from which the known columns are already fitted away.
        known: Columns that explain for free.
        blocks: Columns of each block.
        raw: Each column's information before anything was projected out.
    """
    share = projection_coefficients(gram, known)
    white = []
    for block in blocks:
        left = schur_complement(gram, known, share, block)
        turn = whitening_transform(left, raw[block])
        white.append((score[:, block] - score[:, known] @ share[:, block]) @ turn)
    return white


def sign_flip_test(
    white: Sequence[Float[np.ndarray, "poses _"]],
    seed: int,
) -> MaxTResult:
    """Compare blocks with random signs of poses.

    Args:
        white: White scores of each block.
        seed: Of the signs.
    """
    freedom = np.array([w.shape[1] for w in white], dtype=int)
    some = np.flatnonzero(freedom > 0)
    if not len(some):
        count = len(white)
        return MaxTResult(
            np.zeros(count), np.zeros(count), np.full(count, -9.0), *np.ones((2, count))
        )
    poses = len(white[0])
    stacked = np.concatenate([w for w in white if w.shape[1]], axis=1)
    start = np.cumsum(freedom[some]) - freedom[some]
    random = np.random.default_rng(seed)
    seen = np.add.reduceat(stacked.sum(axis=0) ** 2, start)
    single = stacked.astype(np.float32)  # compared, never reported
    flipped = np.empty((COMPARISONS, len(some)), dtype=np.float32)
    for at in range(0, COMPARISONS, AT_ONCE):
        count = min(AT_ONCE, COMPARISONS - at)
        signs = 2 * random.integers(0, 2, (count, poses)) - 1
        square = (signs.astype(np.float32) @ single) ** 2
        flipped[at : at + count] = np.add.reduceat(square, start, axis=1)
    z, others = _normal(seen, freedom[some]), _normal(flipped, freedom[some])
    strongest = np.sort(others.max(axis=1))
    as_much = z - ROUNDING * np.maximum(np.abs(z), 1.0)  # the same signs, all or none
    above = COMPARISONS - np.searchsorted(strongest, as_much, side="left")
    alone = (1.0 + (others >= as_much).sum(axis=0)) / (1.0 + COMPARISONS)
    answer = [
        np.zeros(len(white)),
        np.full(len(white), -9.0),
        *np.ones((2, len(white))),
    ]
    answer[0][some], answer[1][some] = seen, z
    answer[2][some], answer[3][some] = alone, (1.0 + above) / (1.0 + COMPARISONS)
    return MaxTResult(answer[0], freedom.astype(float), answer[1], answer[2], answer[3])


def combine_tests(one: MaxTResult, other: MaxTResult) -> MaxTResult:
    """Return two families of blocks as one, each with half of the error."""
    together = np.minimum(1.0, 2.0 * np.concatenate([one.together, other.together]))
    return MaxTResult(
        np.concatenate([one.captured, other.captured]),
        np.concatenate([one.degrees_of_freedom, other.degrees_of_freedom]),
        np.concatenate([one.z, other.z]),
        np.concatenate([one.unadjusted, other.unadjusted]),
        together,
    )


def _normal(square: np.ndarray, degrees_of_freedom: np.ndarray) -> np.ndarray:
    """Return chi-squares on the scale of a standard normal (Wilson & Hilferty)."""
    spread = 2.0 / (9.0 * degrees_of_freedom)
    return (np.cbrt(square / degrees_of_freedom) - (1.0 - spread)) / np.sqrt(spread)


# --- Score of a model -----------------------------------------------------------------

MARGIN = SETTINGS.standard_errors
"""Standard errors by which a term must improve the prediction of poses left out."""


def is_significant(gain: Float[np.ndarray, " poses"]) -> bool:
    """Return whether poses gain by more than chance.

    Poses that gain nothing at all say nothing.
    """
    gain = gain[gain != 0.0]
    error = np.std(gain, ddof=1) / np.sqrt(len(gain)) if len(gain) > 1 else 0.0
    return bool(np.sum(gain) > MARGIN * error * len(gain))


# --- Gain and impossible values -------------------------------------------------------


def gain_of(
    before: Sequence[np.ndarray], after: Sequence[np.ndarray]
) -> tuple[float, float]:
    """Return the mean gain over the stretches of motions left out, and its error."""
    gains = np.concatenate(
        [(b - a) / b.mean() for b, a in zip(before, after, strict=True)]
    )
    return float(gains.mean()), float(sem(gains))


# --- Several sizes at once ------------------------------------------------------------


def joint_statistic(
    size: Float[np.ndarray, " sizes"], covariance: Float[np.ndarray, "sizes sizes"]
) -> float:
    """Return how far sizes are from zero together; 0 of none.

    Sizes that are known only together may each be zero by its own interval where all
    at once can not.

    ==========  ======================================================================
    Equation    s' C^-1 s / k, of k sizes s with covariance C
    Source      Hotelling 1931, "The generalization of Student's ratio"; F with k and
                the covariance's degrees of freedom
    Valid       normal errors
    Ignores     what of C a small sample has too small; directions without variance
    ==========  ======================================================================
    """
    scale = unit_scale(np.diag(covariance))
    even = covariance * scale * scale[:, None]
    inverse = np.linalg.pinv(even, rcond=1e-10, hermitian=True)
    return float((scale * size) @ inverse @ (scale * size)) / max(len(size), 1)
