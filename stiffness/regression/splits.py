"""Held-out poses, folds of poses, and subsamples, drawn from a hash of the recording.

Which poses are kept back is drawn from the recording before anything is fitted.

==========  ==========================================================================
Equation    clusters of postures by k-means over cos and sin of the angles; whole
            clusters go to the hold-out until it has a fifth of the poses, the rest to
            folds of nearly equal size; seeds from SHA-256 of the readings
Source      leave-group-out validation; the fifth is the rule of the answer's proof
Valid       at least ten poses; fewer are all fitted and none is kept back
Ignores     nothing
==========  ==========================================================================

Beyond some number of poses more of them say nothing new: a sample is looked at.

Time and memory then stay where they are, however long a recording is.
"""

import hashlib
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.vq import kmeans2

from bench.shared.recording import Recording

# --- Clusters -------------------------------------------------------------------------


def k_means(
    values: Float[np.ndarray, "many n"],
    start: int | Float[np.ndarray, "clusters n"],
    **settings: Any,
) -> tuple[Float[np.ndarray, "clusters n"], Int[np.ndarray, " many"]]:
    """Return centres and labels of clusters by k-means; some may be empty.

    Args:
        values: What is clustered, a point a row.
        start: Number of clusters, or their first centres.
        **settings: Of `scipy.cluster.vq.kmeans2`.
    """
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        return kmeans2(values, start, **settings)


# --- Split ----------------------------------------------------------------------------

HELD_OUT = 0.2
FOLDS = 8
CLUSTERS = 40
"""Chosen: about four neighbouring postures of 151 stay together."""

CROSS_VALIDATED = 100
"""Poses below which the held-out fifth is too few to judge by, so that the other fifths
are held out too, in turn; the rule of the answer's proof."""

COUNTED, UNSEEN = 1e-6, 2.0**62
"""What readings are rounded to before they are hashed, in s, rad or m; chosen: above
all rounding, below a tracker's noise. And what stands for one that is missing."""


@dataclass(frozen=True)
class Split:
    """Which poses are kept back and which are fitted together.

    Attributes:
        fold: Of each pose: 0 held out, else 1 … count.
        count: How many folds are fitted.
        cluster: Of each pose.
    """

    fold: Int[np.ndarray, " poses"]
    count: int
    cluster: Int[np.ndarray, " poses"]

    @property
    def held_out(self) -> Bool[np.ndarray, " poses"]:
        """The poses that naming never sees."""
        return self.fold == 0


def seed_of(recording: Recording) -> int:
    """Return a number that only this recording has, on any processor."""
    every = (recording.time, recording.posture, recording.points)
    return seed_of_values(*(values for values in every if values is not None))


def seed_of_values(*every: Float[np.ndarray, "..."]) -> int:
    """Return a number that only these readings have, on any processor.

    They count to a millionth: the last digits of simulated ones are those of the
    library and the processor that made them.
    """
    digest = hashlib.sha256()
    for values in every:
        counted = np.nan_to_num(values / COUNTED, nan=UNSEEN)
        counted = np.clip(np.rint(counted), -UNSEEN, UNSEEN).astype("<i8")
        digest.update(counted.tobytes())
    return int.from_bytes(digest.digest()[:8], "big")


def split_of(recording: Recording) -> Split:
    """Draw the hold-out and the folds."""
    ids, first = np.unique(recording.posture_id, return_index=True)
    posture = recording.posture[first]
    poses = len(ids)
    if poses < 10:
        return Split(np.arange(poses) % 2 + 1, 2, np.arange(poses))
    random = np.random.default_rng(seed_of(recording))
    features = np.column_stack([np.cos(posture), np.sin(posture)])
    count = min(CLUSTERS, poses // 2)
    start = features[random.permutation(poses)[:count]]
    cluster = k_means(features, start)[1]
    names = random.permutation(np.unique(cluster))
    fold = np.full(poses, -1)
    for name in names:
        if np.sum(fold == 0) >= HELD_OUT * poses:
            break
        fold[cluster == name] = 0
    size = np.zeros(FOLDS)
    for name in names:
        own = cluster == name
        if fold[own][0] == 0:
            continue
        goal = int(np.argmin(size))
        fold[own] = goal + 1
        size[goal] += own.sum()
    return Split(fold, FOLDS, cluster)


def other_splits(split: Split) -> Iterator[Split]:
    """Yield splits of few poses that hold out the others, each pose once over all.

    Two folds at a time are held out, so about a fifth; the poses of the first hold-out
    take their place, whole clusters at a time. None with many poses, or fewer than ten.
    """
    first = split.held_out
    if not first.any() or len(split.fold) >= CROSS_VALIDATED:
        return
    turn = np.unique(split.cluster[first], return_inverse=True)[1] % 2
    for k in range(1, split.count, 2):
        out = np.isin(split.fold, (k, k + 1))
        if out.any():
            fold = np.where(out, 0, split.fold)
            fold[first] = k + turn
            yield Split(fold, split.count, split.cluster)


# --- Subsamples of poses --------------------------------------------------------------

MOST_POSES = 800
"""Poses that are looked at; chosen: five times the paper's, about 30 s on one core. An
effect of a twentieth of one reading's noise still has a whitened square of hundreds."""


def subsample_poses(
    recording: Recording, most: int = MOST_POSES
) -> tuple[Recording, str]:
    """Draw the poses that are looked at, from a hash of the recording.

    Args:
        recording: The whole.
        most: How many poses at most.

    Returns:
        The recording of these poses, and a sentence that says so; empty where all are
        looked at.
    """
    poses = np.unique(recording.posture_id)
    if len(poses) <= most:
        return recording, ""
    random = np.random.default_rng(seed_of(recording))
    chosen = random.permutation(poses)[:most]
    note = (
        f"{most} of {len(poses)} poses are looked at, drawn at random; "
        "all numbers below are theirs."
    )
    return recording.take(np.isin(recording.posture_id, chosen)), note
