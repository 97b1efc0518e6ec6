"""Detection of any difference, at first and of the residual of a fitted set.

Max-T tests of all effects and of the residual map, overdispersion, and homogeneity.

What no law explains still shows: readings scatter by more than their errors.

==========  ==========================================================================
Equation    dispersion = sum of whitened squares / degrees of freedom, of differences
            within visits or of their means, whichever is larger, or of one marker's
            means; p-value of its being at most w: normal, standard error over poses,
            times the number of markers (Bonferroni)
Source      goodness of fit; the pose as the unit that errs independently
Valid       errors that are stated, or measured by marks of one body
Ignores     the few coefficients that were fitted
==========  ==========================================================================

The map asks along laws of axes. A mark that sags, or a tracker whose circle errs, moves
readings along none of them.

Whether anything is there is asked of all hypotheses and of a map that names none.

After a name is given, everything is asked once more whether something is left.
A law that holds is the same at all poses, loads, directions of pull and times.

==========  ==========================================================================
Equation    columns: the law as fitted, in each group of rows but one; known: nominal
            columns, laws, their shapes and other forms; all groups of a kind at once by
            sign flips of poses, the largest over kinds and laws
Source      Cochran 1954, "The combination of estimates from different experiments":
            Q as a score test of group and law
Valid       groups that each have some poses
Ignores     what differs within groups
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int
from scipy.stats import chi2, norm

from stiffness.diagnosis.model_fit import (
    ModelFit,
    SelectionProblem,
    other_forms,
    shape_columns,
    training,
)
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    cross_gram,
    given_many,
    normal_equations_of,
)
from stiffness.effects.candidates import Library, Mapped
from stiffness.effects.design_matrix import KeptColumns
from stiffness.effects.jacobian import EffectJacobian, mixture, values, with_values
from stiffness.experiment.static_state import StaticState
from stiffness.regression.normal_equations import (
    NormalEquations,
    minimum_norm_fit,
    projection_coefficients,
    schur_complement,
)
from stiffness.regression.splits import k_means
from stiffness.regression.testing import (
    SIGNIFICANCE,
    SMALLEST,
    MaxTResult,
    combine_tests,
    sign_flip_test,
    white_scores,
)

# --- Dispersion of the readings -------------------------------------------------------

WITNESSES = 2
"""Other markers of a body that tell which one moves; chosen: three of them."""
FEWEST_FOR_DISPERSION = 20
"""Poses from which scatter is judged; chosen."""


@dataclass(frozen=True)
class Scatter:
    """How readings scatter once everything known is taken off.

    Attributes:
        dispersion: Variance over that of the errors.
        error: Its standard error over poses.
        excess: Whitened square beyond the errors.
        dispersion_limit: Dispersion of poses along laws up to which errors may be
            misstated.
        markers: The same of each marker's means alone; empty where there are none.
        witnesses: How many other markers a marker's body has.
    """

    dispersion: float
    error: float
    excess: float
    dispersion_limit: float
    markers: tuple["Scatter", ...] = ()
    witnesses: int = 0

    def p_value(self, most: float) -> float:
        """Return the p-value of no dispersion's being more than this."""
        alone = [marker.p_value(most) for marker in self.markers]
        own = float(norm.sf((self.dispersion - most) / max(self.error, 1e-12)))
        return min([own, *(len(alone) * p for p in alone)])

    @property
    def is_noise_measured(self) -> bool:
        """Whether marks of one body measured the noise; else it is stated alone."""
        return self.dispersion_limit <= MEASURED

    @property
    def marker(self) -> int | None:
        """Return which marker has most of the excess, against the others of its body.

        None where none has: a marker alone goes where its body goes.
        """
        excess = [marker.excess for marker in self.markers]
        if not excess:
            return None
        worst = int(np.argmax(excess))
        seen = self.markers[worst].witnesses >= WITNESSES
        return worst if seen and 2.0 * excess[worst] > sum(excess) else None


def scatter_of(data: SufficientStatistics, dispersion_limit: float) -> Scatter:
    """Return how readings scatter, of both blocks the one that does more.

    Args:
        data: The residuals.
        dispersion_limit: Dispersion of poses along laws up to which errors may be
            misstated.
    """
    pose, within = data.visits.posture_index, data.within
    found = _of(pose, within.square, within.degrees_of_freedom, dispersion_limit)
    if data.between is None:
        return found
    between = data.between
    seen = np.any(between.whitening.half != 0.0, axis=(2, 3))  # (visits, markers)
    square = np.sum(between.residual.reshape(*seen.shape, 3) ** 2, axis=2)
    share = max(1.0 - data.nuisance_count / max(3.0 * seen.sum(), 1.0), 0.0)
    freedom = 3.0 * share * seen
    body = np.unique(between.carries, axis=1, return_inverse=True)[1].ravel()
    others = np.bincount(body)[body] - 1
    markers = tuple(
        replace(_of(pose, s, f, dispersion_limit), witnesses=int(n))
        for s, f, n in zip(square.T, freedom.T, others, strict=True)
    )
    means = _of(pose, square.sum(axis=1), freedom.sum(axis=1), dispersion_limit)
    return replace(max(found, means, key=lambda s: s.dispersion), markers=markers)


def _of(
    pose: Int[np.ndarray, " visits"],
    square: Float[np.ndarray, " visits"],
    degrees_of_freedom: Float[np.ndarray, " visits"],
    dispersion_limit: float,
) -> Scatter:
    one, free = np.bincount(pose, square), np.bincount(pose, degrees_of_freedom)
    one, free = one[free > 0.0], free[free > 0.0]
    if len(one) < FEWEST_FOR_DISPERSION:
        return Scatter(0.0, 1.0, 0.0, dispersion_limit)
    ratio = float(one.sum() / free.sum())
    error = float(np.linalg.norm(one - ratio * free) / free.sum())
    return Scatter(
        ratio, error, max(float(one.sum() - free.sum()), 0.0), dispersion_limit
    )


# --- Detection ------------------------------------------------------------------------

WOULD_SHOW = 45.0
"""Whitened square that a hidden effect would need to be seen. Of twenty effects, each
another, all were seen at 45 to 56 and fifteen at 25 to 31; `scenarios.blind_trials
--strata one_45` holds it to nine in ten."""
FEWEST_POSES = 10
"""Poses from which random signs can reject: fewer are all alike or all turned in more
than one of 400 cases, and there are two families."""
MISSTATED = 4.0
"""Variance of poses over that of stated errors that fewer than `FEWEST_POSES` must
exceed to differ; chosen: twice the stated size. Of more poses any such variance is
taken for noise that was misstated: only where noise is measured it is a finding."""
MEASURED = 1.5
"""The same where the noise is not only stated but measured; chosen: recordings of
nothing have 0.7 to 1.1."""
SCATTERED = 1.3
"""Variance of readings over that of their errors that is still taken for noise, where
it is measured; chosen: recordings of nothing have 0.6 to 1.13."""


@dataclass(frozen=True)
class DetectionTest:
    """What the test of everything found.

    Candidates are one family and the map another, so that a thousand names do not
    drown what has none.

    Attributes:
        tested: Candidates at every shape, then blocks of the map, then whole places of
            the map, then the whole map.
        candidates: How many blocks belong to candidates.
        blocks: How many to the map's blocks.
        places: Names of the places of the map.
        where: Place of each block that was tested; the whole map has none.
        dispersion: Mean square of white scores of the map: noise variance over the
            stated one if nothing is there.
        poses: How many poses that is the mean of.
        scatter: Of the readings themselves.
    """

    tested: MaxTResult
    candidates: int
    blocks: int
    places: tuple[str, ...]
    where: tuple[str, ...]
    dispersion: float
    poses: int
    scatter: Scatter

    @property
    def p_value(self) -> float:
        """Return the p-value: of any block, of overdispersed poses, or of outliers.

        The least of three, uncorrected: up to three times the level alarm on nothing.
        """
        if not self.is_noise_known:
            return self.tested.p_value
        over = self.dispersion / self.scatter.dispersion_limit
        beyond = float(chi2.sf(self.poses * over, self.poses))
        beyond = min(beyond, self.scatter.p_value(self.scatter_limit))
        return min(self.tested.p_value, max(beyond, SMALLEST))

    @property
    def is_noise_known(self) -> bool:
        """Return whether more scatter than noise makes is a finding, law or none."""
        return self.scatter.is_noise_measured or self.poses < FEWEST_POSES

    @property
    def noise_ratio(self) -> float:
        """Return the noise that scatter along no law would be, over the present one.

        One where a law is found, one mark moves alone, or poses are few.
        """
        of_mark = self.is_overdispersed and self.scatter.marker is not None
        lawful = self.tested.p_value < SIGNIFICANCE
        if lawful or of_mark or self.poses < FEWEST_POSES:
            return 1.0
        return float(np.sqrt(max(self.scatter.dispersion, self.dispersion)))

    @property
    def scatter_limit(self) -> float:
        """Return the scatter of readings that is still taken for noise."""
        if self.scatter.is_noise_measured:
            return SCATTERED
        return self.scatter.dispersion_limit

    @property
    def excess(self) -> float:
        """Return the whitened square that errors do not make: the map's, or all."""
        of_map = float(self.tested.captured[-1] - self.tested.degrees_of_freedom[-1])
        return max(of_map, self.scatter.excess) if self.is_overdispersed else of_map

    @property
    def is_overdispersed(self) -> bool:
        """Return whether readings surely scatter by more than known noise does."""
        if not self.is_noise_known:
            return False
        return self.scatter.p_value(self.scatter_limit) < SIGNIFICANCE

    def of_places(self, values: np.ndarray) -> dict[str, float]:
        """Return values of whole places of the map."""
        start = self.candidates + self.blocks
        named = values[start : start + len(self.places)]
        return dict(zip(self.places, (float(v) for v in named), strict=True))


def detect(
    library: Library,
    of_candidates: NormalEquations,
    of_map: NormalEquations,
    known: Int[np.ndarray, " known"],
    seed: int,
    scatter: Scatter,
) -> DetectionTest:
    """Test every candidate and the map beyond known columns.

    Args:
        library: Candidates and map.
        of_candidates: Normal equations of the data without what the known columns
            explain, of these and the candidates.
        of_map: Of these and the map, over the same poses.
        known: Columns that may explain for free.
        seed: Of the random signs.
        scatter: Of the readings.
    """
    blocks = library.map.blocks
    own = [block for c in library.candidates for block in c.columns]
    parts = [m.columns for m in blocks]
    places = tuple(dict.fromkeys(m.where for m in blocks))
    whole = [
        np.concatenate([m.columns for m in blocks if m.where == place])
        for place in places
    ]
    every = [*parts, *whole, np.concatenate(parts)]
    white = [
        white_scores(given.gram.sum(axis=0), given.score, known, asked, given.raw)
        for given, asked in ((of_candidates, own), (of_map, every))
    ]
    tested = combine_tests(
        sign_flip_test(white[0], seed), sign_flip_test(white[1], seed + 1)
    )
    beyond = np.concatenate(white[1][: len(parts)], axis=1)
    dispersion = float(np.sum(beyond**2) / max(1, beyond.shape[1]))
    where = (
        *(c.where for c in library.candidates for _ in c.columns),
        *(m.where for m in blocks),
        *places,
        "",
    )
    count = len(of_map.score)
    return DetectionTest(
        tested, len(own), len(parts), places, where, dispersion, count, scatter
    )


# --- Test of the residual -------------------------------------------------------------


@dataclass(frozen=True)
class After:
    """A recording once a set is named.

    Attributes:
        known: Nominal columns, the set's laws, a little more of their shapes, their
            other forms.
        normal_equations: What the readings say of these.
        data: The readings without what these explain.
    """

    known: list[EffectJacobian]
    normal_equations: NormalEquations
    data: SufficientStatistics


def residual_after(case: SelectionProblem, fit: ModelFit) -> After:
    """Take what a set explains, in any accepted form, out of the readings."""
    members = [m.jacobian(case.situation) for m in fit.members]
    extra: list[EffectJacobian] = []
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        extra.extend(shape_columns(case.situation, member, coefficients))
    known = [*case.nominal, *members, *extra, *other_forms(case, fit.members)]
    own = normal_equations_of(case.data, known, training(case.split))
    beta = minimum_norm_fit(own.gram[1], own.score[~case.split.held_out].sum(axis=0))
    return After(known, own, case.data.subtract(known, beta))


@dataclass(frozen=True, eq=False)
class ResidualEquations:
    """Normal equations of all columns over the training poses once a set is named.

    Attributes:
        case: What may be looked at.
        fit: The set.
        after: The recording once the set is named.
    """

    case: SelectionProblem
    fit: ModelFit
    after: After

    @classmethod
    def of(cls, case: SelectionProblem, fit: ModelFit) -> "ResidualEquations":
        """Take a set, in any accepted form, out of the readings."""
        return cls(case, fit, residual_after(case, fit))

    @property
    def known(self) -> Int[np.ndarray, " known"]:
        """Numbers of the columns that the set explains with, which come first."""
        return np.arange(self.after.normal_equations.gram.shape[1])

    @cached_property
    def library(self) -> Library:
        """Candidates without the names of the set, and the map, after those."""
        every, by, named = self.case.library, len(self.known), self.fit.names
        blocks = tuple(replace(m, columns=m.columns + by) for m in every.map.blocks)
        candidates = tuple(
            replace(c, columns=tuple(block + by for block in c.columns))
            for c in every.candidates
            if c.name not in named
        )
        whole = replace(every.map, blocks=blocks)
        return replace(every, candidates=candidates, map=whole)

    @cached_property
    def of_candidates(self) -> NormalEquations:
        """Of the set's columns, nominal ones, the candidates'; one fold."""
        return self._after_set(self.case.normal_equations, self.case.library.columns)

    @cached_property
    def of_map(self) -> NormalEquations:
        """Of the set's columns, nominal ones, the residual map's; one fold."""
        return self._after_set(self.case.map_equations, self.case.library.map.columns)

    def _after_set(
        self, given: NormalEquations, columns: KeptColumns
    ) -> NormalEquations:
        after, own = self.after, self.after.normal_equations
        side, score = cross_gram(after.data, after.known, [columns], given.fold)
        raw = np.concatenate([own.raw, given.raw])
        score = score[~self.case.split.held_out]
        gram = given_many(side[1], given.gram[1])
        return NormalEquations(gram[None], score, np.zeros(len(score), dtype=int), raw)


def imitated_share(
    beyond: ResidualEquations, fit: ModelFit, k: int, where: str
) -> float:
    """Return the share of what a member displaces that columns of a place may do.

    ==========  ======================================================================
    Equation    1 - b' G_P b / b' G b, b the member's sizes, G the Gram matrix of its
                columns beside nominal columns and other members, G_P that beside the
                place's columns of the map too
    Source      share of a projected square
    Valid       at the shapes that were found
    Ignores     the error of sizes
    ==========  ======================================================================

    Args:
        beyond: Normal equations once the set is named.
        fit: The set.
        k: Number of the member.
        where: The place.
    """
    size = fit.coefficients[k]
    ends = beyond.library.nominal + np.cumsum([0, *map(len, fit.coefficients)])
    own = np.arange(ends[k], ends[k + 1])
    others = np.setdiff1d(np.arange(ends[-1]), own)
    place = [m.columns for m in beyond.library.map.blocks if m.where == where]
    if not place:  # an instrument or a marker: it has no columns there
        return 1.0
    used = np.concatenate([own, others, *place])
    gram, unexplained = beyond.of_map.gram[0][np.ix_(used, used)], []
    for end in (len(own) + len(others), len(used)):
        known = np.arange(len(own), end)
        share = projection_coefficients(gram, known)
        inner = schur_complement(gram, known, share, np.arange(len(own)))
        unexplained.append(float(size @ inner @ size))
    return float(1.0 - np.clip(unexplained[1] / max(unexplained[0], 1e-300), 0.0, 1.0))


def residual_test(case: SelectionProblem, beyond: ResidualEquations) -> DetectionTest:
    """Test everything again after a set is named, other forms of its laws allowed.

    Other shapes of what is named are no candidates: a law is searched along a line, and
    what that leaves of a strong one is not news.

    Args:
        case: What may be looked at.
        beyond: Normal equations once the set is named.
    """
    return detect(
        beyond.library,
        beyond.of_candidates,
        beyond.of_map,
        beyond.known,
        case.seed + 1,
        scatter_of(beyond.after.data, case.dispersion_limit),
    )


def blocks_beside(case: SelectionProblem, fit: ModelFit) -> list[tuple[Mapped, float]]:
    """Return the blocks of the map with their p-values beside a set.

    A place's own constant motions are not asked: they have a name.

    Args:
        case: What may be looked at.
        fit: The set; other forms of its laws are allowed.
    """
    beyond = ResidualEquations.of(case, fit)
    given, blocks = beyond.of_map, beyond.library.map.blocks
    some = [k for k, b in enumerate(blocks) if b.kind != "geometry"]
    columns = [blocks[k].columns for k in some]
    white = white_scores(given.gram[0], given.score, beyond.known, columns, given.raw)
    tested = sign_flip_test(white, case.seed + 3)
    found = zip(some, tested.together, strict=True)
    return [(case.library.map.blocks[k], float(p)) for k, p in found]


# --- Homogeneity over poses, loads, directions and times ------------------------------

GROUPS = 4
"""Groups of a kind; chosen: thirty poses of 120 in each."""


@dataclass(frozen=True)
class HomogeneityTest:
    """How a law differs between groups of one kind.

    Attributes:
        grouping: The kind of groups.
        p_value: Among all laws and kinds.
        captured: Whitened square beyond chance.
    """

    grouping: str
    p_value: float
    captured: float


def homogeneity_tests(
    case: SelectionProblem, fit: ModelFit, after: After
) -> tuple[HomogeneityTest, ...]:
    """Return the kind of groups between which each member's law differs most.

    Args:
        case: What may be looked at.
        fit: The set.
        after: The recording once the set is named.
    """
    if not fit.members:
        return ()
    kinds = groups_of(case.situation)
    fitted = [
        mixture(m.jacobian(case.situation), c[:, None])
        for m, c in zip(fit.members, fit.coefficients, strict=True)
    ]
    pieces = [[_in_groups(law, group) for group in kinds.values()] for law in fitted]
    flat = [piece for of_member in pieces for piece in of_member]
    mask = ~case.split.held_out
    every = [*after.known, *flat]
    given = normal_equations_of(after.data, every, training(case.split))
    total = given.gram[1]
    start = after.normal_equations.gram.shape[1]
    ends = start + np.cumsum([0, *(piece.columns for piece in flat)])
    blocks = [np.arange(a, b) for a, b in pairwise(ends)]
    raw = np.maximum(np.diag(total), 0.0)
    white = white_scores(total, given.score[mask], np.arange(start), blocks, raw)
    tested = sign_flip_test(white, case.seed + 2)
    found = []
    for k in range(len(pieces)):
        mine = slice(k * len(kinds), (k + 1) * len(kinds))
        worst = int(np.argmin(tested.together[mine] - 1e-6 * tested.z[mine]))
        at = mine.start + worst
        excess = float(tested.captured[at] - tested.degrees_of_freedom[at])
        found.append(
            HomogeneityTest(list(kinds)[worst], float(tested.together[at]), excess)
        )
    return tuple(found)


def groups_of(situation: StaticState) -> Mapping[str, Int[np.ndarray, " rows"]]:
    """Return the group of each row, kind by kind; kinds with one group are left out."""
    recording = situation.recording
    first = np.unique(situation.posture_index, return_index=True)[1]
    posture = recording.posture[first]
    features = np.column_stack([np.cos(posture), np.sin(posture)])
    found = {
        "postures": _clusters(features)[situation.posture_index],
        "times": _ranks(recording.time),
    }
    if recording.wrench is not None:
        size = np.linalg.norm(situation.wrench[:, :3], axis=1)
        pulled = size > 0.05 * max(float(size.max()), 1e-12)
        direction = situation.wrench[:, :3] / np.maximum(size, 1e-12)[:, None]
        found["loads"] = _ranks(np.round(size, 1))
        if pulled.sum() > GROUPS:
            group = np.zeros(len(size), dtype=int)
            group[pulled] = _clusters(direction[pulled])
            found["directions of pull"] = group
    return {kind: g for kind, g in found.items() if len(np.unique(g)) > 1}


def _clusters(features: np.ndarray) -> Int[np.ndarray, " many"]:
    some = min(GROUPS, len(np.unique(features, axis=0)))
    if some < 2:
        return np.zeros(len(features), dtype=int)
    return k_means(features, some, minit="++", rng=0, iter=20)[1]


def _ranks(of_rows: np.ndarray) -> Int[np.ndarray, " rows"]:
    edges = np.unique(np.quantile(of_rows, np.arange(1, GROUPS) / GROUPS))
    return np.searchsorted(edges, of_rows, side="right")


def _in_groups(law: EffectJacobian, group: Int[np.ndarray, " rows"]) -> EffectJacobian:
    """Return the law in every group but the first."""
    inside = (group[:, None] == np.unique(group)[1:]).astype(float)
    parts = []
    for part in law.parts:
        shape = (len(group), *(1,) * (values(part).ndim - 2), inside.shape[1])
        parts.append(with_values(part, values(part) * inside.reshape(shape)))
    return EffectJacobian(inside.shape[1], tuple(parts))
