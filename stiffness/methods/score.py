"""Errors of a method in millimetres, with bootstrap intervals over poses.

==========  ==========================================================================
Equation    Eq. 7: MAE = mean e; Eq. 8: STDE = sqrt(mean (e - mean e)^2);
            Eq. 9: ME = max e; e = |predicted - measured| in one direction
Source      Wu et al. 2024, section 3.3
Valid       one direction at a time
Ignores     correlated errors of a pose's rows, which the intervals do include
==========  ==========================================================================

Eq. 8 literally is of absolute errors (`stde_absolute`); the paper's Tables 2 and 10
agree with signed ones, which are reported as well (`stde_signed`). Lower is better, for
all metrics.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from bench.shared.errors import Unusable
from stiffness.regression.intervals import Statistic, bootstrap

DIRECTIONS: Final = ("x", "y", "z")


@dataclass(frozen=True)
class Score:
    """Error of a method in one direction, by one metric.

    Attributes:
        direction: Axis of the base.
        metric: A name of `METRICS`.
        value_mm: In mm; lower is better.
        low_mm: Lower end of the 95 % interval over poses; None for a largest error,
            which draws from these poses cannot exceed (Efron, Tibshirani 1993, 7.4).
    """

    direction: str
    metric: str
    value_mm: float
    low_mm: float | None
    high_mm: float | None
    n: int


def mae(
    error: Float[np.ndarray, " rows"], weight: Float[np.ndarray, "*resamples rows"]
) -> Float[np.ndarray, "*resamples"]:
    """Return the mean absolute error, Eq. 7; a weight is the count of a row."""
    return np.asarray(weight @ np.abs(error) / weight.sum(axis=-1))


def stde_absolute(
    error: Float[np.ndarray, " rows"], weight: Float[np.ndarray, "*resamples rows"]
) -> Float[np.ndarray, "*resamples"]:
    """Return the standard deviation of absolute errors: Eq. 8 literally."""
    return stde_signed(np.abs(error), weight)


def stde_signed(
    error: Float[np.ndarray, " rows"], weight: Float[np.ndarray, "*resamples rows"]
) -> Float[np.ndarray, "*resamples"]:
    """Return the standard deviation of signed errors about their mean."""
    total = weight.sum(axis=-1)
    centred = error - error.mean()
    mean = weight @ centred / total
    return np.asarray(np.sqrt(np.maximum(weight @ centred**2 / total - mean**2, 0.0)))


def me(
    error: Float[np.ndarray, " rows"], weight: Float[np.ndarray, "*resamples rows"]
) -> Float[np.ndarray, "*resamples"]:
    """Return the largest absolute error, Eq. 9, among rows of positive weight."""
    order = np.argsort(-np.abs(error), kind="stable")
    first = np.argmax(weight[..., order] > 0.0, axis=-1)
    return np.asarray(np.abs(error)[order][first])


METRICS: Final[Mapping[str, Statistic]] = MappingProxyType(
    {
        "MAE": mae,
        "STDE_absolute": stde_absolute,
        "STDE_signed": stde_signed,
        "ME": me,
    }
)
"""The paper's metrics, Eqs 7 to 9, Eq. 8 in both readings."""


def scores(
    predicted: Float[np.ndarray, "rows 3"],
    measured: Float[np.ndarray, "rows 3"],
    pose: Int[np.ndarray, " rows"],
    seed: int = 0,
    resamples: int = 2000,
) -> tuple[Score, ...]:
    """Score predictions in every direction, with intervals over poses.

    Both are in m along the base's axes; poses are drawn, not rows.

    Returns:
        Every metric in x, y and z, in mm.

    Raises:
        Unusable: Where there are no rows or an error is not a number.
    """
    error_mm = 1e3 * (predicted - measured)
    if not len(error_mm) or not np.isfinite(error_mm).all():
        fault = "there are no rows." if not len(error_mm) else "some are no numbers."
        raise Unusable("The errors to score", [fault])
    found = []
    for k, direction in enumerate(DIRECTIONS):
        for metric, statistic in METRICS.items():
            interval = bootstrap(error_mm[:, k], pose, statistic, seed, resamples)
            value, low, high = interval.estimate, interval.low, interval.high
            if metric == "ME":
                low = high = None
            found.append(Score(direction, metric, value, low, high, len(error_mm)))
    return tuple(found)
