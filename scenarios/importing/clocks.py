"""What was read by one clock is wanted at the instants of another.

Between two readings that are near in time the value lies on the line between them;
farther apart, nobody knows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

GAP = 0.5
"""Longest time between two readings that is bridged, in s, unless said; chosen: an arm
that stops in between has moved by millimetres."""


@dataclass(frozen=True)
class Channel:
    """What one instrument said.

    Attributes:
        time: Of each reading by its own clock, in s, ascending.
        values: One row each; NaN where nothing was seen.
    """

    time: Float[np.ndarray, " readings"]
    values: Float[np.ndarray, "readings columns"]

    def at(self, time: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows columns"]:
        """Return the values at other instants, the nearest beyond both ends."""
        columns = [np.interp(time, self.time, v) for v in self.values.T]
        return np.array(columns).reshape(-1, len(time)).T

    def covers(
        self, time: Float[np.ndarray, " rows"], gap: float
    ) -> Bool[np.ndarray, " rows"]:
        """Say which instants lie between readings no farther apart than a gap."""
        after = np.searchsorted(self.time, time)
        before = np.searchsorted(self.time, time, side="right") - 1
        inside = (before >= 0) & (after < len(self.time))
        last = len(self.time) - 1
        apart = self.time[np.minimum(after, last)] - self.time[np.maximum(before, 0)]
        return inside & (apart <= gap)


def rows_of(
    time: Float[np.ndarray, " rows"], stamps: Sequence[np.ndarray]
) -> Int[np.ndarray, " kept"]:
    """Return the rows that are nearest to the readings of the slowest instrument.

    More rows would count one reading more than once, as if its noise were new.

    Args:
        time: Of the rows, ascending.
        stamps: When each instrument read, by the same clock; empty: all rows.
    """
    if not stamps or len(time) < 2:
        return np.arange(len(time))
    slowest = min(stamps, key=len)
    after = np.clip(np.searchsorted(time, slowest), 1, len(time) - 1)
    early = slowest - time[after - 1] <= time[after] - slowest
    return np.unique(np.where(early, after - 1, after))


def on_one_side(
    quaternions: Float[np.ndarray, "readings _"],
) -> Float[np.ndarray, "readings _"]:
    """Return the same turns without jumps between q and -q."""
    seen = np.isfinite(quaternions).all(axis=1)
    turns, known = quaternions.copy(), quaternions[seen]
    along = np.sum(known[1:] * known[:-1], axis=1)
    sign = np.concatenate([np.ones(min(1, len(known))), np.where(along < 0, -1.0, 1.0)])
    turns[seen] = known * np.cumprod(sign)[: len(known), None]
    return turns
