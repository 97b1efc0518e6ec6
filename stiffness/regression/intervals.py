"""Intervals of an estimate: bootstrap over poses, shares and quotients.

An interval says where a number would fall if other poses had been measured.

==========  ==========================================================================
Equation    BCa: ends at G^-1(Phi(z0 + (z0 + z)/(1 - a (z0 + z)))), z0 the bias, a the
            skewness of the jackknife over 6; shares: Clopper and Pearson's tails
Source      Efron 1987, "Better bootstrap confidence intervals", JASA 82, 171;
            Field and Welsh 2007 for drawing clusters; Clopper and Pearson 1934
Needs       poses that are independent; 30 or more for the stated level
Assumes     rows of a pose stay together: poses are drawn, not rows
==========  ==========================================================================

The maximum is no smooth function of the data, so its interval is a rough one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy import stats

from bench.shared.errors import BenchError
from bench.shared.settings import SETTINGS, Interval

# --- Intervals ------------------------------------------------------------------------

LEVEL = SETTINGS.confidence
"""How often an interval covers."""


@dataclass(frozen=True)
class FittedParameters:
    """Parameters of a fitted law, and whether all its sizes may be nothing at once.

    Attributes:
        intervals: Of each parameter, by name.
        together: `joint_statistic` of how far its sizes are from nothing.
        limit: What it exceeds as rarely as an interval misses, where they are nothing.
    """

    intervals: dict[str, Interval]
    together: float
    limit: float


# --- Bootstrap ------------------------------------------------------------------------

Statistic: TypeAlias = Callable[
    [Float[np.ndarray, "..."], Float[np.ndarray, "..."]], Float[np.ndarray, "..."]
]
"""Takes values (rows, …) and how often each row counts (…, rows); returns (…)."""


def bootstrap(
    values: Float[np.ndarray, "rows ..."],
    pose: Int[np.ndarray, " rows"],
    statistic: Statistic,
    seed: int = 0,
    resamples: int = 2000,
) -> Interval:
    """Draw poses anew and see how a statistic scatters, by the BCa method.

    Two calls with one seed draw the same poses, so their results may be compared.

    Args:
        values: What the statistic is of.
        pose: Id of the pose of each row.
        statistic: Vectorised over weights.
        seed: Of the draws.
        resamples: How many.

    Returns:
        The statistic of all rows, and its interval.

    Raises:
        BenchError: Where there is a single pose.
    """
    _, number = np.unique(pose, return_inverse=True)
    poses = int(number.max(initial=-1)) + 1
    if poses < 2:
        raise BenchError("An interval over poses needs two poses or more.")
    draw = np.random.default_rng(seed)
    drawn = draw.multinomial(poses, np.full(poses, 1.0 / poses), size=resamples)
    value = float(statistic(values, np.ones(len(number))))
    replicates = np.sort(statistic(values, drawn[:, number].astype(float)))
    without = statistic(values, (1.0 - np.eye(poses))[:, number])
    pull = without.mean() - without
    spread = np.sum(pull**2) ** 1.5
    skew = np.sum(pull**3) / (6.0 * spread) if spread > 0.0 else 0.0
    below = np.mean(replicates < value) + 0.5 * np.mean(replicates == value)
    bias = stats.norm.ppf(np.clip(below, 1.0 / resamples, 1.0 - 1.0 / resamples))
    ends = bias + stats.norm.ppf([0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL])
    shares = stats.norm.cdf(bias + ends / (1.0 - skew * ends))
    low, high = np.quantile(replicates, shares)
    return Interval(value, float(low), float(high))


def share(successes: int, trials: int) -> Interval:
    """Return a share of trials with Clopper and Pearson's exact interval.

    The interval covers at least as often as `LEVEL`.

    Args:
        successes: How many succeeded.
        trials: Of how many; at least one.

    Raises:
        BenchError: Where the counts make no share.
    """
    if not 0 <= successes <= trials or trials < 1:
        raise BenchError(
            f"{successes} of {trials} is no share: 0 <= part <= whole >= 1."
        )
    ends = stats.binomtest(successes, trials).proportion_ci(LEVEL, method="exact")
    return Interval(successes / trials, float(ends.low), float(ends.high))


def quotient_interval(
    above: float, below: float, covariance: Float[np.ndarray, "2 2"], quantile: float
) -> Interval:
    """Return the interval of a quotient of two estimates; without ends where 0 divides.

    ==========  ======================================================================
    Equation    all r with (x - r m)^2 <= q^2 (1, -r) C (1, -r)', C of (x, m)
    Source      Fieller 1954, "Some problems in interval estimation", JRSS B 16
    Valid       normal errors
    Ignores     that the set is two half-lines where m may be nothing and x not
    ==========  ======================================================================

    Args:
        above: The numerator x.
        below: The denominator m.
        covariance: Of both.
        quantile: Of the level, in standard errors.
    """
    squared = quantile**2 * covariance
    a, b = below**2 - squared[1, 1], above * below - squared[0, 1]
    c = above**2 - squared[0, 0]
    if a <= 0.0:
        return Interval(above / below, -np.inf, np.inf)
    half = np.sqrt(max(b**2 - a * c, 0.0)) / a
    return Interval(above / below, float(b / a - half), float(b / a + half))


def jackknife_covariance(
    own: Float[np.ndarray, "poses columns columns"],
    score: Float[np.ndarray, "poses columns"],
    prior: Float[np.ndarray, "columns columns"] | float = 0.0,
) -> Float[np.ndarray, "columns columns"]:
    """Return the covariance of a fit from how it moves as one pose is left out.

    Args:
        own: Gram matrix of each pose.
        score: Of each pose, at the fit.
        prior: Information before any reading.
    """
    whole, poses = own.sum(axis=0) + prior, len(own)
    moved = [
        np.linalg.pinv(whole - one, rcond=1e-10, hermitian=True) @ asked
        for one, asked in zip(own, score, strict=True)
    ]
    return (poses - 1) / poses * np.asarray(moved).T @ np.asarray(moved)
