"""Sufficient statistics: normal equations by fold, scores by pose, cross products.

What was read is kept as two blocks: differences within visits, means of visits.

What readings say about columns is their Gram matrix and each pose's score.

==========  ==========================================================================
Equation    gram = X' S^-1 X by fold; score_p = X_p' S^-1 y_p by pose;
            without K: gram~ = gram - gram_cK gram_KK^-1 gram_Kc, score~ likewise
Source      Gauss-Markov; Frisch-Waugh-Lovell
Valid       S as stated, block A (within visits) and B (between) independent
Ignores     nothing that is linear
==========  ==========================================================================

A few columns meet many: their products, and what else readings say of the many.

What each pose says of a few columns is kept apart, for fits that leave poses out.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.between_visit import BetweenVisitModel
from stiffness.diagnosis.within_visit import WithinVisitModel
from stiffness.effects.design_matrix import (
    DesignMatrix,
    KeptColumns,
    design_matrix_of,
    side_by_side,
    site_means_of,
)
from stiffness.effects.jacobian import EffectJacobian
from stiffness.experiment.visits import Visits, stretches
from stiffness.regression.normal_equations import NormalEquations

# --- Readings as two blocks -----------------------------------------------------------


@dataclass(frozen=True)
class SufficientStatistics:
    """Both blocks of a recording's readings.

    Attributes:
        visits: How rows lie side by side.
        within: Differences within visits.
        between: Means of visits; None where readings are relative.
    """

    visits: Visits
    within: WithinVisitModel
    between: BetweenVisitModel | None

    @property
    def nuisance_count(self) -> int:
        """How many unknowns there are in the means."""
        return 0 if self.between is None else len(self.between.scale)

    @property
    def mismatch_of_poses(self) -> Float[np.ndarray, " poses"]:
        """Each pose's whitened square beyond its degrees of freedom."""
        pose, within = self.visits.posture_index, self.within
        excess = np.bincount(pose, within.square - within.degrees_of_freedom)
        between = self.between
        if between is None:
            return excess
        seen = np.any(between.whitening.half != 0.0, axis=(2, 3))  # (visits, markers)
        square = np.sum(between.residual.reshape(*seen.shape, 3) ** 2, axis=(1, 2))
        free = max(1.0 - self.nuisance_count / max(3.0 * seen.sum(), 1.0), 0.0)
        return excess + np.bincount(pose, square - 3.0 * free * seen.sum(axis=1))

    def subtract(
        self,
        signatures: Sequence[EffectJacobian],
        coefficients: Float[np.ndarray, " columns"],
    ) -> "SufficientStatistics":
        """Return the data without what these columns do."""
        row, between = self.visits.row, self.between
        mix = coefficients[:, None]
        pull, square = self.within.weighted_residual.copy(), self.within.square.copy()
        asked = np.zeros((self.nuisance_count, 1))
        white = []
        for some in stretches(len(row)):
            columns = design_matrix_of(signatures, row[some])
            within = self.within.some(some)
            moved = within.displacement(columns) @ mix
            change = within.centred_scores(within.raw_scores(moved))
            square[some] -= np.sum(moved * (2 * pull[:, some] - change), axis=(0, 2, 3))
            pull[:, some] -= change
            if between is not None:
                means = between.some(some)
                one = means.whitening.white(means.displacement(columns) @ mix)
                back = means.whitening.back(one)
                asked += np.sum(means.nuisance.swapaxes(1, 2) @ back, axis=0)
                white.append(one)
        within = self.within.with_residual(pull, square)
        if between is None:
            return SufficientStatistics(self.visits, within, None)
        residual, taken = between.residual.copy(), between.nuisance_removed(asked)
        for some, one in zip(stretches(len(row)), white, strict=True):
            means = between.some(some)
            residual[some] += means.whitening.white(means.nuisance @ taken) - one
        return SufficientStatistics(
            self.visits, within, between.with_residual(residual)
        )


# --- Normal equations -----------------------------------------------------------------


def normal_equations_of(
    data: SufficientStatistics,
    signatures: Sequence[EffectJacobian] | KeptColumns,
    fold: Int[np.ndarray, " poses"],
) -> NormalEquations:
    """Return what the readings say about effects' columns.

    Args:
        data: The readings.
        signatures: The columns.
        fold: Of each pose.
    """
    visits, between = data.visits, data.between
    of_visit, folds = fold[visits.posture_index], int(fold.max()) + 1
    if not isinstance(signatures, KeptColumns):
        signatures = KeptColumns(signatures)
    pieces = stretches(len(visits.row), of_visit)
    empty = signatures.of(visits.row, pieces[0])
    slots = len(empty.column)
    gram, raw = np.zeros((folds, slots, slots)), np.zeros(empty.count)
    shared: list[list[np.ndarray]] = [[] for _ in range(folds)]
    asked = np.zeros((folds, data.nuisance_count, slots))
    by_unknown = np.zeros((visits.poses(), data.nuisance_count))
    score = np.zeros((visits.poses(), empty.count))
    for some in pieces:
        f, pose = of_visit[some[0]], visits.posture_index[some]
        columns = signatures.of(visits.row, some)
        within = data.within.some(some)
        within.add_gram(columns, gram[f])
        own = within.of_each(columns, within.weighted_residual)
        if between is not None:
            means = between.some(some)
            sites = site_means_of(columns, means.share, means.screw)
            raw -= empty.diagonal(gram[f])
            means.add_gram(sites, gram[f])
            raw += empty.diagonal(gram[f])
            shared[f].append(columns.joined(means.error_products(sites, slots)))
            asked[f] += means.of_nuisance(sites, slots)
            pull = means.whitening.back(between.residual[some])
            own += means.of_each(sites, slots, pull)
            back = means.nuisance.swapaxes(1, 2) @ pull
            np.add.at(by_unknown, pose, back[..., 0])
        np.add.at(score, pose, columns.joined(own[:, 0]))
    total = np.stack([empty.both_joined(own) for own in gram])
    for f, own in enumerate(shared):
        errors = np.concatenate([np.zeros((0, empty.count)), *own])
        total[f] -= errors.T @ errors
        raw -= np.sum(errors**2, axis=0)
    if between is not None:
        by_fold = empty.joined(asked)
        taken = between.nuisance_removed(by_fold.sum(axis=0))
        total -= between.project_out(by_fold, by_fold, of_visit)
        score -= by_unknown @ taken
    raw += np.maximum(np.einsum("fcc->c", total), 0.0)
    return NormalEquations(total, score, fold, raw)


# --- Cross products with many columns -------------------------------------------------


def cross_gram(
    data: SufficientStatistics,
    few: Sequence[EffectJacobian],
    many: Sequence[KeptColumns],
    fold: Int[np.ndarray, " poses"],
) -> tuple[Float[np.ndarray, "folds few both"], Float[np.ndarray, "poses both"]]:
    """Return the products of a few columns with all by fold, and the scores of all.

    All are the few and then many more.

    Args:
        data: The readings.
        few: Columns without which the readings were not or already are.
        many: More columns, one lot after the other.
        fold: Of each pose.
    """

    def beside(own: DesignMatrix, some: Int[np.ndarray, " some"]) -> DesignMatrix:
        return reduce(side_by_side, (lot.of(visits.row, some) for lot in many), own)

    visits, between = data.visits, data.between
    of_visit, folds = fold[visits.posture_index], int(fold.max()) + 1
    pieces = stretches(len(visits.row), of_visit)
    one = design_matrix_of(few, visits.row[:1])
    other = beside(one, pieces[0])
    slots, unknowns = len(other.column), data.nuisance_count
    gram = np.zeros((folds, one.count, slots))
    near = np.zeros((folds, unknowns, one.count))
    far = np.zeros((folds, unknowns, slots))
    by_unknown = np.zeros((visits.poses(), unknowns))
    score = np.zeros((visits.poses(), other.count))
    for some in pieces:
        f, pose = of_visit[some[0]], visits.posture_index[some]
        few_here = design_matrix_of(few, visits.row[some])
        all_here = beside(few_here, some)
        within = data.within.some(some)
        gram[f] += within.products(few_here, all_here)
        own = within.of_each(all_here, within.weighted_residual)
        if between is not None:
            means = between.some(some)
            sites = site_means_of(all_here, means.share, means.screw)
            moved = means.displacement(few_here)
            pull = means.whitening.back(means.whitening.white(moved))
            residual = means.whitening.back(between.residual[some])
            far[f] += means.of_nuisance(sites, slots)
            gram[f] += means.products(sites, slots, pull)
            near[f] += np.sum(means.nuisance.swapaxes(1, 2) @ pull, axis=0)
            own += means.of_each(sites, slots, residual)
            back = means.nuisance.swapaxes(1, 2) @ residual
            np.add.at(by_unknown, pose, back[..., 0])
        np.add.at(score, pose, other.joined(own[:, 0]))
    total = other.joined(gram)
    if between is not None:
        far = other.joined(far)
        total -= between.project_out(near, far, of_visit)
        score -= by_unknown @ between.nuisance_removed(far.sum(axis=0))
    return total, score


def given_many(
    cross: Float[np.ndarray, "few both"], gram: Float[np.ndarray, "many many"]
) -> Float[np.ndarray, "both both"]:
    """Return the products of a few columns and many, the few first, with each other.

    Args:
        cross: Of the few with themselves, then with the many.
        gram: Of the many.
    """
    few = len(cross)
    return np.block([[cross[:, :few], cross[:, few:]], [cross[:, few:].T, gram]])


@dataclass(frozen=True, eq=False)
class HeldColumns:
    """Columns that stay, and what the readings say of them, for others beside them.

    Attributes:
        data: The readings.
        columns: That stay.
        fold: Of each pose; those of fold 1 are looked at.
        gram: Products of the columns that stay.
    """

    data: SufficientStatistics
    columns: KeptColumns
    fold: Int[np.ndarray, " poses"]
    gram: Float[np.ndarray, "columns columns"]

    @classmethod
    def of(
        cls,
        data: SufficientStatistics,
        columns: Sequence[EffectJacobian],
        fold: Int[np.ndarray, " poses"],
    ) -> "HeldColumns":
        """Lay columns out and multiply them with each other, once."""
        kept = KeptColumns(columns)
        return cls(data, kept, fold, normal_equations_of(data, kept, fold).gram[1])

    def with_more(
        self, more: Sequence[EffectJacobian]
    ) -> tuple[Float[np.ndarray, "all all"], Float[np.ndarray, " all"]]:
        """Return the Gram matrix and score of the columns that stay, and then more."""
        cross, score = cross_gram(self.data, more, [self.columns], self.fold)
        few, every = cross.shape[1], np.arange(cross.shape[2])
        order = np.concatenate([every[few:], every[:few]])
        gram = given_many(cross[1], self.gram)[np.ix_(order, order)]
        return gram, score[self.fold == 1].sum(axis=0)[order]


@dataclass(eq=False)
class Augmented:
    """Normal equations of many columns with terms before them, each laid out once.

    Attributes:
        data: The readings.
        many: The columns that are always there.
        given: What the readings say about them.
        terms: Columns of the terms so far, one lot after the other.
        owned: Numbers of each term's columns, by what tells it from all others.
        near, far: Products of the terms with each other and with the many, over the
            poses of fold 1.
        score, raw: Of the terms, as of the many.
    """

    data: SufficientStatistics
    many: KeptColumns
    given: NormalEquations

    def __post_init__(self) -> None:
        """Begin without any term."""
        poses, many = self.given.score.shape
        self.terms: list[KeptColumns] = []
        self.owned: dict[Hashable, Int[np.ndarray, " own"]] = {}
        self.near, self.far = np.zeros((0, 0)), np.zeros((0, many))
        self.score, self.raw = np.zeros((poses, 0)), np.zeros(0)

    def by(
        self, keys: Sequence[Hashable], law: Callable[[int], EffectJacobian]
    ) -> tuple[NormalEquations, tuple[Int[np.ndarray, " own"], ...]]:
        """Return the normal equations of terms and of the many columns after them.

        Args:
            keys: What tells each term from all others.
            law: The columns of the term of a number.

        Returns:
            Over the poses of fold 1; numbers of each term's columns.
        """
        new = {key: k for k, key in enumerate(keys) if key not in self.owned}
        if new:
            self._lay_out({key: law(k) for key, k in new.items()})
        own = [self.owned[key] for key in keys]
        some = np.concatenate([np.zeros(0, dtype=int), *own])
        side = np.hstack([self.near[np.ix_(some, some)], self.far[some]])
        ends = np.cumsum([0, *map(len, own)])
        found = NormalEquations(
            given_many(side, self.given.gram[1])[None],
            np.hstack([self.score[:, some], self.given.score]),
            self.given.fold,
            np.concatenate([self.raw[some], self.given.raw]),
        )
        return found, tuple(np.arange(a, b) for a, b in pairwise(ends))

    def _lay_out(self, laws: Mapping[Hashable, EffectJacobian]) -> None:
        """Add terms to those that are laid out."""
        lots, own = [*self.terms, self.many], list(laws.values())
        cross, score = cross_gram(self.data, own, lots, self.given.fold)
        count, first = cross.shape[1], len(self.near)
        inner, old, far = np.split(cross[1], [count, count + first], axis=1)
        self.near = np.block([[self.near, old.T], [old, inner]])
        self.far = np.vstack([self.far, far])
        self.score = np.hstack([self.score, score[:, :count]])
        raw = np.maximum(np.diag(cross.sum(axis=0)), 0.0)
        self.raw = np.concatenate([self.raw, raw])
        ends = first + np.cumsum([0, *(law.columns for law in own)])
        numbers = (np.arange(a, b) for a, b in pairwise(ends))
        self.owned |= dict(zip(laws, numbers, strict=True))
        self.terms.append(KeptColumns(own))


# --- Statistics of each pose ----------------------------------------------------------


@dataclass(frozen=True)
class PerPoseScores:
    """Gram matrices and scores of a few columns.

    Attributes:
        gram: Of each fold, the unknown marginalised.
        own: Of each pose, the unknown where all poses together put it; of all columns
            or of the first ones alone.
        score: Of each pose.
    """

    gram: Float[np.ndarray, "folds columns columns"]
    own: Float[np.ndarray, "poses first first"]
    score: Float[np.ndarray, "poses columns"]

    def mixed(
        self, mix: Float[np.ndarray, "columns others"], first: int
    ) -> "PerPoseScores":
        """Return the same of sums of the columns, each pose's of the first ones."""
        some = mix[: self.own.shape[1], :first]
        gram, own = mix.T @ self.gram @ mix, some.T @ self.own @ some
        return PerPoseScores(gram, own, self.score @ mix)


def per_pose_scores(
    data: SufficientStatistics,
    signatures: Sequence[EffectJacobian],
    fold: Int[np.ndarray, " poses"],
) -> PerPoseScores:
    """Return what every pose says about a few effects' columns.

    Args:
        data: The readings.
        signatures: The columns.
        fold: Of each pose.
    """
    visits, between = data.visits, data.between
    of_visit, folds = fold[visits.posture_index], int(fold.max()) + 1
    count = sum(s.columns for s in signatures)
    gram = np.zeros((folds, count, count))
    own = np.zeros((visits.poses(), count, count))
    score = np.zeros((visits.poses(), count))
    asked = np.zeros((folds, data.nuisance_count, count))
    means_of = []
    for some in stretches(len(visits.row), of_visit):
        f, pose = of_visit[some[0]], visits.posture_index[some]
        columns = design_matrix_of(signatures, visits.row[some])
        within = data.within.some(some)
        slots = columns.body_slots
        of_slots = np.zeros((len(some), slots, slots))
        within.add_gram(columns, of_slots)
        asks = within.of_each(columns, within.weighted_residual)
        gram[f] += columns.both_joined(of_slots.sum(axis=0))
        for p, one in zip(pose, of_slots, strict=True):
            own[p] += columns.both_joined(one)
        np.add.at(score, pose, columns.joined(asks[:, 0]))
        if between is not None:
            means = between.some(some)
            white = means.whitening.white(means.displacement(columns))
            back = means.whitening.back(white)
            flat = white.reshape(white.shape[0] * white.shape[1], count)
            gram[f] += flat.T @ flat
            asked[f] += np.sum(means.nuisance.swapaxes(1, 2) @ back, axis=0)
            means_of.append((some, white))
    if between is None:
        return PerPoseScores(gram, own, score)
    taken = between.nuisance_removed(asked.sum(axis=0))
    gram -= between.project_out(asked, asked, of_visit)
    for some, white in means_of:
        pose = visits.posture_index[some]
        means = between.some(some)
        left = white - means.whitening.white(means.nuisance @ taken)
        for p, one in zip(pose, left.swapaxes(1, 2) @ left, strict=True):
            own[p] += one
        np.add.at(score, pose, (left.swapaxes(1, 2) @ between.residual[some])[..., 0])
    return PerPoseScores(gram, own, score)
