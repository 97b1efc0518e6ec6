"""What each pose says of a few columns is kept apart, for fits that leave poses out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.columns import columns_of
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.visits import stretches


@dataclass(frozen=True)
class ByPose:
    """Gram matrices and scores of a few columns.

    Attributes:
        gram: Of each fold, the unknown marginalised.
        own: Of each pose, the unknown where all poses together put it.
        score: Of each pose.
    """

    gram: Float[np.ndarray, "folds columns columns"]
    own: Float[np.ndarray, "poses columns columns"]
    score: Float[np.ndarray, "poses columns"]

    def mixed(self, mix: Float[np.ndarray, "columns others"]) -> "ByPose":
        """Return the same of sums of the columns."""
        gram, own = mix.T @ self.gram @ mix, mix.T @ self.own @ mix
        return ByPose(gram, own, self.score @ mix)


def by_pose(
    data: Data, signatures: Sequence[Signature], fold: Int[np.ndarray, " poses"]
) -> ByPose:
    """Let every pose speak about a few signatures.

    Args:
        data: The readings.
        signatures: The columns.
        fold: Of each pose.
    """
    visits, between = data.visits, data.between
    of_visit, folds = fold[visits.pose], int(fold.max()) + 1
    count = sum(s.columns for s in signatures)
    gram = np.zeros((folds, count, count))
    own = np.zeros((visits.poses(), count, count))
    score = np.zeros((visits.poses(), count))
    asked = np.zeros((folds, data.unknowns, count))
    means_of = []
    for some in stretches(len(visits.row), of_visit):
        f, pose = of_visit[some[0]], visits.pose[some]
        columns = columns_of(signatures, visits.row[some])
        within = data.within.some(some)
        moved = within.moved(columns)
        pull = within.cleaned(within.raw_pulls(moved))
        each = np.sum(moved.swapaxes(2, 3) @ pull, axis=0)
        asks = np.sum(moved.swapaxes(2, 3) @ within.pull, axis=0)[..., 0]
        gram[f] += each.sum(axis=0)
        np.add.at(own, pose, each)
        np.add.at(score, pose, asks)
        if between is not None:
            means = between.some(some)
            white = means.roots.white(means.moved(columns))
            back = means.roots.back(white)
            flat = white.reshape(white.shape[0] * white.shape[1], count)
            gram[f] += flat.T @ flat
            asked[f] += np.sum(means.unknown.swapaxes(1, 2) @ back, axis=0)
            means_of.append((some, white))
    if between is None:
        return ByPose(gram, own, score)
    taken = between.taken(asked.sum(axis=0))
    gram -= between.projected(asked, asked, of_visit)
    for some, white in means_of:
        pose = visits.pose[some]
        means = between.some(some)
        left = white - means.roots.white(means.unknown @ taken)
        np.add.at(own, pose, left.swapaxes(1, 2) @ left)
        np.add.at(score, pose, (left.swapaxes(1, 2) @ between.residual[some])[..., 0])
    return ByPose(gram, own, score)
