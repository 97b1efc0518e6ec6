"""What readings say about columns is their Gram matrix and each pose's score.

==========  ==========================================================================
Equation    gram = X' S^-1 X by fold; score_p = X_p' S^-1 y_p by pose;
            without K: gram~ = gram - gram_cK gram_KK^-1 gram_Kc, score~ likewise
Source      Gauss-Markov; Frisch-Waugh-Lovell
Valid       S as stated, block A (within visits) and B (between) independent
Ignores     nothing that is linear
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.columns import columns_of
from stiffness.diagnosis.data import Data
from stiffness.diagnosis.deferred import Deferred
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.sites import sites_of
from stiffness.diagnosis.visits import stretches

SPANS = 1e-10
"""Least share of a direction that is no rounding error; chosen: a million times above
what sums of some 100,000 products leave."""


SURVIVES = 1e-9
"""Share of a direction's raw information that must survive the projection; chosen: a
thousand times above rounding, a hundredth of what could ever be detected."""


@dataclass(frozen=True)
class Evidence:
    """Gram matrices by fold of poses, scores by pose.

    Attributes:
        gram: Of each fold.
        score: Of each pose.
        fold: Of each pose.
        raw: Each column's information before the unknown was projected out.
    """

    gram: Float[np.ndarray, "folds columns columns"]
    score: Float[np.ndarray, "poses columns"]
    fold: Int[np.ndarray, " poses"]
    raw: Float[np.ndarray, " columns"]


def evidence_of(
    data: Data,
    signatures: Sequence[Signature | Deferred],
    fold: Int[np.ndarray, " poses"],
) -> Evidence:
    """Let the readings speak about signatures.

    Args:
        data: The readings.
        signatures: The columns.
        fold: Of each pose.
    """
    visits, between = data.visits, data.between
    of_visit, folds = fold[visits.pose], int(fold.max()) + 1
    empty = columns_of(signatures, visits.row[:1])
    slots = len(empty.column)
    gram, of_means = np.zeros((2, folds, slots, slots))
    asked = np.zeros((folds, data.unknowns, slots))
    by_unknown = np.zeros((visits.poses(), data.unknowns))
    score = np.zeros((visits.poses(), empty.count))
    for some in stretches(len(visits.row), of_visit):
        f, pose = of_visit[some[0]], visits.pose[some]
        columns = columns_of(signatures, visits.row[some])
        within = data.within.some(some)
        within.add_gram(columns, gram[f])
        own = within.of_each(columns, within.pull)
        if between is not None:
            means = between.some(some)
            sites = sites_of(columns, means.share, means.screw)
            means.add_gram(sites, of_means[f])
            asked[f] += means.of_unknown(sites, slots)
            pull = means.roots.back(between.residual[some])
            own += means.of_each(sites, slots, pull)
            back = means.unknown.swapaxes(1, 2) @ pull
            np.add.at(by_unknown, pose, back[..., 0])
        np.add.at(score, pose, columns.joined(own[:, 0]))
    total = np.stack([empty.both_joined(own) for own in gram + of_means])
    if between is not None:
        by_fold = empty.joined(asked)
        taken = between.taken(by_fold.sum(axis=0))
        total -= between.projected(by_fold, by_fold, of_visit)
        score -= by_unknown @ taken
    whole = empty.both_joined(of_means.sum(axis=0))
    raw = np.maximum(np.diagonal(total.sum(axis=0)), 0.0) + np.diag(whole)
    return Evidence(total, score, fold, raw)


def without(
    gram: Float[np.ndarray, "columns columns"], known: Int[np.ndarray, " known"]
) -> Float[np.ndarray, "known columns"]:
    """Return the share of known columns in all columns: gram_KK^+ gram_Kc.

    Known columns may be multiples of each other; only what they span counts.
    """
    if not len(known):
        return np.zeros((0, gram.shape[1]))
    inner = gram[np.ix_(known, known)]
    size = np.sqrt(np.diag(inner))
    scale = np.where(size > 0.0, 1.0 / np.where(size > 0.0, size, 1.0), 0.0)
    value, vector = np.linalg.eigh(inner * scale * scale[:, None])
    keep = value > SPANS * len(known)
    half = (scale[:, None] * vector[:, keep]) / np.sqrt(value[keep])
    return half @ (half.T @ gram[known])


def left_of(
    gram: Float[np.ndarray, "columns columns"],
    known: Int[np.ndarray, " known"],
    share: Float[np.ndarray, "known columns"],
    block: Int[np.ndarray, " block"],
) -> Float[np.ndarray, "block block"]:
    """Return the Gram matrix of X_b - X_K share_b, whatever the shares' rounding.

    Written as gram_bb - gram_bK share_b it would err in the first order of it.
    """
    own, side = share[:, block], gram[np.ix_(block, known)]
    inner = gram[np.ix_(known, known)]
    cross = side @ own
    return gram[np.ix_(block, block)] - cross - cross.T + own.T @ inner @ own


def white_turn(
    left: Float[np.ndarray, "columns columns"], raw: Float[np.ndarray, " columns"]
) -> Float[np.ndarray, "columns freedom"]:
    """Return what makes columns white, directions without information left out.

    Args:
        left: Their Gram matrix after everything known was projected out.
        raw: Their information before that.
    """
    live = raw > 0.0
    scale = np.where(live, 1.0 / np.sqrt(np.where(live, raw, 1.0)), 0.0)
    value, vector = np.linalg.eigh(left * scale * scale[:, None])
    keep = value > SURVIVES * len(raw)
    return scale[:, None] * vector[:, keep] / np.sqrt(value[keep])


def projected(
    gram: Float[np.ndarray, "columns columns"], score: Float[np.ndarray, " columns"]
) -> Float[np.ndarray, " columns"]:
    """Return the smallest coefficients that fit best; columns may be multiples."""
    joint = np.block([[gram, score[:, None]], [score[None], np.ones((1, 1))]])
    return without(joint, np.arange(len(gram)))[:, -1]
