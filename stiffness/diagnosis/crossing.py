"""A few columns meet many: their products, and what else readings say of the many."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.columns import columns_of
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.deferred import Deferred
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.sites import sites_of
from stiffness.diagnosis.visits import stretches


def cross_of(
    data: Data,
    few: Sequence[Signature],
    many: Sequence[Signature | Deferred],
    fold: Int[np.ndarray, " poses"],
) -> tuple[Float[np.ndarray, "folds few many"], Float[np.ndarray, "poses many"]]:
    """Return the products of a few columns with many by fold, and the many's scores.

    Args:
        data: The readings.
        few: Columns without which the readings were not or already are.
        many: More columns.
        fold: Of each pose.
    """
    visits, between = data.visits, data.between
    of_visit, folds = fold[visits.pose], int(fold.max()) + 1
    one, other = (columns_of(s, visits.row[:1]) for s in (few, many))
    slots, unknowns = len(other.column), data.unknowns
    gram = np.zeros((folds, one.count, slots))
    near = np.zeros((folds, unknowns, one.count))
    far = np.zeros((folds, unknowns, slots))
    by_unknown = np.zeros((visits.poses(), unknowns))
    score = np.zeros((visits.poses(), other.count))
    for some in stretches(len(visits.row), of_visit):
        f, pose = of_visit[some[0]], visits.pose[some]
        few_here = columns_of(few, visits.row[some])
        many_here = columns_of(many, visits.row[some])
        within = data.within.some(some)
        gram[f] += within.products(many_here, within.pulls(few_here))
        own = within.of_each(many_here, within.pull)
        if between is not None:
            means = between.some(some)
            sites = sites_of(many_here, means.share, means.screw)
            moved = means.moved(few_here)
            pull = means.roots.back(means.roots.white(moved))
            residual = means.roots.back(between.residual[some])
            far[f] += means.of_unknown(sites, slots)
            gram[f] += means.products(sites, slots, pull)
            near[f] += np.sum(means.unknown.swapaxes(1, 2) @ pull, axis=0)
            own += means.of_each(sites, slots, residual)
            back = means.unknown.swapaxes(1, 2) @ residual
            np.add.at(by_unknown, pose, back[..., 0])
        np.add.at(score, pose, many_here.joined(own[:, 0]))
    total = other.joined(gram)
    if between is not None:
        far = other.joined(far)
        total -= between.projected(near, far, of_visit)
        score -= by_unknown @ between.taken(far.sum(axis=0))
    return total, score


def beside_many(
    cross: Float[np.ndarray, "folds few both"],
    gram: Float[np.ndarray, "folds many many"],
) -> Float[np.ndarray, "folds both both"]:
    """Return the products of a few columns and many, the few first, with each other.

    Args:
        cross: Of the few with themselves, then with the many.
        gram: Of the many.
    """
    below = np.concatenate([cross[..., cross.shape[1] :].swapaxes(1, 2), gram], axis=2)
    return np.concatenate([cross, below], axis=1)
