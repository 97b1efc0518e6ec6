"""Poses near each other share what a model learns, so whole regions are left out.

==========  ==========================================================================
Equation    k-means over the places of targets in the base's frame; whole regions go to
            the hold-out, the others in turn to folds; seeds from SHA-256 of what was
            seen, before anything is fitted
Source      leave-group-out validation; Lloyd 1982, "Least squares quantization in PCM"
Valid       at least as many poses as regions
Ignores     that regions at the edge are further from the rest
==========  ==========================================================================
"""

import hashlib
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int
from scipy.cluster.vq import kmeans2

from stiffness.calibration.readings import Readings

REGIONS, LEFT_OUT, FOLDS = 30, 8, 22
"""Of all poses; kept back until the end; of the others, for choosing. Chosen: 8 of 30
regions are about a quarter, and each of the others is a fold of its own."""


@dataclass(frozen=True)
class Regions:
    """Where poses lie together.

    Attributes:
        region: Of each row.
        held: Regions that nothing is fitted to.
        fold: Of each row: −1 kept back, else 0 … count.
        count: Of folds.
    """

    region: Int[np.ndarray, " rows"]
    held: tuple[int, ...]
    fold: Int[np.ndarray, " rows"]
    count: int

    @property
    def kept_back(self) -> Bool[np.ndarray, " rows"]:
        """Rows that decide at the end."""
        return self.fold < 0


def regions_of(readings: Readings, draw: int = 0) -> Regions:
    """Draw regions, hold-out and folds.

    Args:
        readings: What was seen.
        draw: Another number draws other regions.
    """
    ids, first, index = np.unique(readings.pose, return_index=True, return_inverse=True)
    digest = hashlib.sha256(np.ascontiguousarray(readings.seen).tobytes()).digest()
    seed = [int.from_bytes(digest[:8], "big"), draw]
    rng = np.random.default_rng(seed)
    count = min(REGIONS, max(len(ids) // 3, 6))
    place = readings.seen[first]
    label = kmeans2(place, count, minit="++", rng=rng)[1]
    label = np.unique(label, return_inverse=True)[1]  # k-means may leave one empty
    count = int(label.max()) + 1
    order = rng.permutation(count)
    left_out = max(1, round(LEFT_OUT / REGIONS * count))
    folds = min(FOLDS, count - left_out)
    fold_of = np.full(count, -1)
    fold_of[order[left_out:]] = np.arange(count - left_out) % folds
    held = tuple(sorted(int(r) for r in order[:left_out]))
    region = label[index]
    return Regions(region, held, fold_of[region], folds)
