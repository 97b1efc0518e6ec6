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

from stiffness.diagnosis.between import Between
from stiffness.diagnosis.columns import Columns, columns_of
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.visits import Visits
from stiffness.diagnosis.within import Within

SPANS = 1e-10
"""Least share of a direction that is no rounding error; chosen: a million times above
what sums of some 100,000 products leave."""


SURVIVES = 1e-9
"""Share of a direction's raw information that must survive the projection; chosen: a
thousand times above rounding, a hundredth of what could ever be detected."""


@dataclass(frozen=True)
class Data:
    """Both blocks of a recording's readings.

    Attributes:
        visits: How rows lie side by side.
        within: Differences within visits.
        between: Means of visits; None where readings are relative.
    """

    visits: Visits
    within: Within
    between: Between | None

    def less(
        self,
        signatures: Sequence[Signature],
        coefficients: Float[np.ndarray, " columns"],
    ) -> "Data":
        """Return the data without what these columns do."""
        columns = columns_of(signatures, self.visits)
        between = self.between
        if between is not None:
            between = between.less(columns, coefficients)
        return Data(self.visits, self.within.less(columns, coefficients), between)


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
    data: Data, signatures: Sequence[Signature], fold: Int[np.ndarray, " poses"]
) -> Evidence:
    """Let the readings speak about signatures.

    Args:
        data: The readings.
        signatures: The columns.
        fold: Of each pose.
    """
    columns = columns_of(signatures, data.visits)
    folds = int(fold.max()) + 1
    of_visit = fold[data.visits.pose]
    gram, score = data.within.products(columns, of_visit, folds)
    if data.between is not None:
        more, extra = data.between.products(columns, of_visit, folds)
        gram, score = gram + more, score + extra
    return Evidence(gram, by_pose(score, data.visits), fold, _raw(data, columns, gram))


def _raw(
    data: Data, columns: Columns, gram: Float[np.ndarray, "folds columns columns"]
) -> Float[np.ndarray, " columns"]:
    raw = np.maximum(np.diagonal(gram.sum(axis=0)), 0.0)
    return raw if data.between is None else raw + data.between.raw(columns)


def cross_of(
    data: Data,
    few: Sequence[Signature],
    many: Sequence[Signature],
    fold: Int[np.ndarray, " poses"],
) -> Float[np.ndarray, "folds few many"]:
    """Return the products of a few columns with many, fold by fold."""
    one, other = columns_of(few, data.visits), columns_of(many, data.visits)
    of_visit = fold[data.visits.pose]
    folds = int(fold.max()) + 1
    gram = data.within.cross(one, other, of_visit, folds)
    if data.between is not None:
        gram = gram + data.between.cross(one, other, of_visit, folds)
    return gram


def scores_of(data: Data, signatures: Sequence[Signature]) -> np.ndarray:
    """Return each pose's scores alone, for data that have changed."""
    columns = columns_of(signatures, data.visits)
    score = data.within.scores(columns)
    if data.between is not None:
        score = score + data.between.scores(columns)
    return by_pose(score, data.visits)


def gram_by_pose(data: Data, signatures: Sequence[Signature]) -> np.ndarray:
    """Return each pose's own Gram matrix; for few columns."""
    columns = columns_of(signatures, data.visits)
    gram = data.within.by_visit(columns)
    if data.between is not None:
        gram = gram + data.between.by_visit(columns)
    return by_pose(gram, data.visits)


def by_pose(values: np.ndarray, visits: Visits) -> np.ndarray:
    """Add up what visits of the same pose say."""
    total = np.zeros((visits.poses(), *values.shape[1:]))
    np.add.at(total, visits.pose, values)
    return total


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
