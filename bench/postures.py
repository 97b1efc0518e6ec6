"""Postures spread evenly over what an arm can reach show all of its axes at work."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import qmc

from bench.errors import Unusable

CENTRAL = 0.8  # chosen: a tenth of the range is kept free at either stop
CANDIDATES = 1000  # chosen: tried per posture before the wish is called infeasible

Feasible = Callable[[Float[np.ndarray, "tried axes"]], Bool[np.ndarray, " tried"]]
"""Says of each posture, in rad, whether the cell has room for it."""


def anywhere(posture: Float[np.ndarray, "tried axes"]) -> Bool[np.ndarray, " tried"]:
    """Say of each posture that there is room for it."""
    return np.ones(len(posture), dtype=bool)


def spread(
    limits: Float[np.ndarray, "axes 2"],
    count: int,
    seed: int,
    feasible: Feasible = anywhere,
    central: float = CENTRAL,
) -> Float[np.ndarray, "count axes"]:
    """Return postures of low discrepancy within the central part of the limits.

    Scrambled Halton points (Owen 2017, "A randomized Halton algorithm in R", as in
    `scipy.stats.qmc`), of which the infeasible are passed over. The same seed gives the
    same postures, and fewer of them are the first of more.

    Args:
        limits: Lowest and highest value of each axis, in rad (slides in m).
        count: How many postures.
        seed: Of the scrambling.
        feasible: Whether there is room, for a batch of postures.
        central: Share of each range that is used, above 0, at most 1.

    Raises:
        Unusable: Where limits are not finite or in order, the share or the count is out
            of range, or too few postures are feasible.
    """
    faults = [
        f"limits of axis a{axis} are {low} to {high}, expected finite and rising; "
        "for an axis without stops give the part that shall be used."
        for axis, (low, high) in enumerate(limits, start=1)
        if not (np.isfinite(low) and np.isfinite(high) and low < high)
    ]
    if not 0.0 < central <= 1.0:
        faults.append(f"central is {central}, expected above 0 and at most 1.")
    if count < 1:
        faults.append(f"count is {count}, expected at least 1.")
    if faults:
        raise Unusable("Spread of postures", faults)
    middle, half = limits.mean(axis=1), np.diff(limits, axis=1)[:, 0] / 2.0
    points = qmc.Halton(len(limits), rng=np.random.default_rng(seed))
    found = np.empty((0, len(limits)))
    tried = 0
    while len(found) < count and tried < CANDIDATES * count:
        batch = middle + central * half * (2.0 * points.random(4 * count) - 1.0)
        found = np.concatenate([found, batch[feasible(batch)]])
        tried += len(batch)
    if len(found) < count:
        fault = (
            f"of {tried} postures tried only {len(found)} were feasible, {count} were "
            "asked for; widen the limits, raise `central` or ask for fewer."
        )
        raise Unusable("Spread of postures", [fault])
    return found[:count]
