"""A number over seeds and poses scatters with both, and so does its interval.

==========  ==========================================================================
Equation    value = mean over seeds of statistic(errors of that seed); interval: 2.5 to
            97.5 % of the same with seeds and poses drawn anew, with replacement
Source      Efron, Tibshirani 1993, "An Introduction to the Bootstrap", chapter 8 and
            13; all seeds are judged on the same poses, which are drawn together
Needs       a few seeds, some hundred poses
Assumes     poses that are independent; with one seed it scatters with poses alone
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from stiffness.intervals import Interval, Statistic
from stiffness.score import METRICS, me

RESAMPLES = 2000


def p99(
    error: Float[np.ndarray, " rows"], weight: Float[np.ndarray, "*resamples rows"]
) -> Float[np.ndarray, "*resamples"]:
    """Return the 99th percentile of absolute errors: a maximum that can be trusted."""
    size = np.abs(error)
    order = np.argsort(size, kind="stable")
    share = np.cumsum(weight[..., order], axis=-1)
    first = np.argmax(share >= 0.99 * share[..., -1:], axis=-1)
    return np.asarray(size[order][first])


MEASURES: Final[Mapping[str, Statistic]] = MappingProxyType({**METRICS, "P99": p99})
"""The paper's measures and the 99th percentile."""


@dataclass(frozen=True)
class Draws:
    """A number and what it would have been with other seeds and poses.

    Attributes:
        value: Of all.
        replicates: Of every draw.
    """

    value: float
    replicates: Float[np.ndarray, " resamples"]

    @property
    def interval(self) -> Interval:
        """The 95 % interval; its ends are NaN where there is none."""
        low, high = np.quantile(self.replicates, [0.025, 0.975])
        return Interval(self.value, float(low), float(high))

    def change_from(self, other: "Draws") -> "Draws":
        """Return by which share this differs from another, draw by draw."""
        return Draws(
            self.value / other.value - 1.0, self.replicates / other.replicates - 1.0
        )

    def way(self, top: "Draws", bottom: "Draws") -> "Draws":
        """Return how far down this is from one to another, 0 to 1, draw by draw."""
        return Draws(
            (top.value - self.value) / (top.value - bottom.value),
            (top.replicates - self.replicates) / (top.replicates - bottom.replicates),
        )


@lru_cache(maxsize=4)
def _drawn(
    seeds: int, poses: int, seed: int, resamples: int
) -> tuple[Float[np.ndarray, "resamples poses"], Float[np.ndarray, "resamples seeds"]]:
    """Return how often each pose counts, and what each seed weighs."""
    draw = np.random.default_rng(seed)
    weight = draw.multinomial(poses, np.full(poses, 1 / poses), resamples).astype(float)
    which = draw.multinomial(seeds, np.full(seeds, 1 / seeds), resamples) / seeds
    return weight, which


def pooled(
    error: Float[np.ndarray, "seeds poses *more"],
    statistic: Statistic,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Draws:
    """Pool a statistic over seeds; two calls of one shape and seed draw alike.

    A largest error has no interval, for draws from these poses cannot exceed it.

    Args:
        error: Of each seed in each pose, the same poses for all seeds; one number or,
            where the statistic takes them, several.
        statistic: Of one seed's errors, vectorised over weights.
        seed: Of the draws.
        resamples: How many.
    """
    seeds, poses = error.shape[:2]
    weight, which = _drawn(seeds, poses, seed, resamples)
    values = [float(statistic(row, np.ones(poses))) for row in error]
    if statistic is me:
        return Draws(float(np.mean(values)), np.full(resamples, np.nan))
    replicates = np.stack([statistic(row, weight) for row in error], axis=1)
    return Draws(float(np.mean(values)), (which * replicates).sum(axis=1))
