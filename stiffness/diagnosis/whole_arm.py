"""Selection for arms of many effects at once, judged when the set is whole.

Real arms have every fault at once: each gear hardens and holds back some of its
wind-up, each bearing tilts, links bend, the foot gives. Sets of a few effects explain
none of that, and a name that is judged before the others are there is judged wrongly.

All columns compete in one search without a limit of size, on the normal equations
alone. Shapes are then fitted together, all columns laid out once more under everything
that was found, and the search goes on from there, the fitted shapes beside the grid.
Names stay that predict poses left out, one shape each.

==========  ==========================================================================
Equation    share = 2 (g - g_0) / (sum e_p - 2 g_0); g the gain of poses left out with
            the names, g_0 with the nominal columns alone, e_p the whitened square of a
            pose beyond its degrees of freedom
Source      leave-groups-out validation; the noise ceiling of an explained variance
Valid       noise that is stated or measured well: else the share errs with it
Ignores     what the poses kept back would say: they are for the proof
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.candidates import Library
from stiffness.diagnosis.model_evaluation import (
    ModelEvaluation,
    beyond_limits,
    evaluate_model,
    jackknife_covariance,
    may_be_nothing,
    parameters_of,
)
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_model,
    training,
)
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.relinearisation import build_problem, total_softening
from stiffness.diagnosis.selection import MAX_EXHAUSTIVE_SIZE
from stiffness.diagnosis.shape_fit import fit_shapes
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    cross_gram,
    given_many,
    per_pose_scores,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import EffectJacobian
from stiffness.regression.group_selection import (
    ColumnGroup,
    Decision,
    FactorisedSet,
    GroupProblem,
    Name,
    select_groups,
)
from stiffness.regression.intervals import Parameter
from stiffness.regression.predictive_gate import (
    GatedNames,
    UnitStatistics,
    gate_names,
    left_out_gain,
)

CLEARLY_MORE = 0.05
"""Share of the mismatch that the whole set explains on poses left out beyond the best
set of three names, from which small sets are not tried; chosen: other forms of one or
two laws leave less."""
LEAST_SHARE = 0.9
"""Share of the mismatch on poses left out that a set of many names explains at least.
Chosen: where the library holds what is true, sets explain 0.98 and more; a mechanism
outside it is imitated by many names together, but only up to 0.7."""


@dataclass(frozen=True, eq=False)
class Search:
    """Everything that the search selects from.

    Attributes:
        case: What may be looked at.
        terms: Of each group of columns: terms of the last set first, then the library.
        problem: Their normal equations over the training poses.
    """

    case: SelectionProblem
    terms: tuple[ModelTerm, ...]
    problem: GroupProblem

    @classmethod
    def of(cls, case: SelectionProblem, first: Sequence[ModelTerm] = ()) -> "Search":
        """Lay out a few terms with shapes of their own beside the library.

        Args:
            case: What may be looked at.
            first: Terms that come before those of the library.
        """
        given, found = case.normal_equations, tuple(first)
        gram, score, raw = given.gram[1], given.score, given.raw
        width = 0
        if found:
            own = [term.jacobian(case.situation) for term in found]
            side, score = cross_gram(
                case.data, own, [*own, *case.library.jacobians], given.fold
            )
            gram = given_many(side, given.gram)[1]
            width = sum(law.columns for law in own)
            total = side.sum(axis=0)
            raw = np.concatenate([np.maximum(np.diag(total), 0.0), raw])
            ends = np.cumsum([0, *(law.columns for law in own)])
            owned = [np.arange(a, b) for a, b in pairwise(ends)]
        else:
            owned = []
        of_library = _terms_of(case.library)
        owned += [columns + width for _, columns in of_library]
        terms = (*found, *(term for term, _ in of_library))
        groups = [
            ColumnGroup(
                term.name, columns, term.degrees_of_freedom, term.hypothesis.log_prior
            )
            for term, columns in zip(terms, owned, strict=True)
        ]
        nominal = width + np.arange(case.library.nominal)
        asked = score[~case.split.held_out].sum(axis=0)
        problem = GroupProblem.of(gram, asked, raw, nominal, groups, case.poses)
        return cls(case, terms, problem)


def _terms_of(library: Library) -> list[tuple[ModelTerm, Int[np.ndarray, " columns"]]]:
    """Return the library's terms at all coarse shapes, with their columns."""
    return [
        (ModelTerm(candidate.hypothesis, candidate.where, shape), columns)
        for candidate in library.candidates
        for shape, columns in zip(candidate.shapes, candidate.columns, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class CoarseSelection:
    """The whole set at coarse shapes, and what few names would do.

    Attributes:
        terms: Of the names that predict poses left out.
        names: How many of these there are.
        share: Of the mismatch, on poses left out.
        share_of_few: The same of the best set of few names.
    """

    terms: tuple[ModelTerm, ...]
    names: int
    share: float
    share_of_few: float

    @property
    def is_plausible(self) -> bool:
        """Return whether the arm may be one of many effects."""
        return self.names > MAX_EXHAUSTIVE_SIZE and self.share >= LEAST_SHARE

    @property
    def is_beyond_few(self) -> bool:
        """Return whether sets of few names need not be tried."""
        return self.is_plausible and self.share - self.share_of_few >= CLEARLY_MORE


def select_coarsely(case: SelectionProblem) -> CoarseSelection:
    """Select a whole set at coarse shapes, and judge it against few names.

    Args:
        case: What may be looked at.
    """
    search = Search.of(case)
    some = select_groups(search.problem).groups
    names = {search.terms[k].name for k in some}
    if len(names) <= MAX_EXHAUSTIVE_SIZE:
        return CoarseSelection((), len(names), 0.0, 0.0)
    few = select_groups(search.problem, most_names=MAX_EXHAUSTIVE_SIZE).groups
    every = list(dict.fromkeys([*some, *few]))
    poses = _pose_statistics(case, [search.terms[k] for k in every])
    place = {k: p for p, k in enumerate(every)}
    gated = poses.gate([place[k] for k in some])
    explained = poses.share(gated.gain)
    of_few = poses.share(
        left_out_gain(poses.units, poses.nominal, [poses.owned[place[k]] for k in few])
    )
    terms = [search.terms[k] for k in some]
    terms = tuple(term for term in terms if term.name in gated.names)
    return CoarseSelection(terms, len(gated.names), explained, of_few)


# --- What poses say of a set ----------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PoseStatistics:
    """What each training pose says of the terms of a set.

    Attributes:
        terms: The set.
        units: Statistics of each pose; nominal columns come first.
        nominal: Their numbers.
        owned: Columns of each term.
        forms: Columns of the other accepted forms of each term's law; none where these
            were not asked for.
        mismatch: Whitened square of each training pose beyond its degrees of freedom.
    """

    terms: tuple[ModelTerm, ...]
    units: UnitStatistics
    nominal: Int[np.ndarray, " nominal"]
    owned: tuple[Int[np.ndarray, " _"], ...]
    forms: tuple[Int[np.ndarray, " _"], ...]
    mismatch: Float[np.ndarray, " poses"]

    def gate(self, some: Sequence[int]) -> GatedNames:
        """Gate some of the terms on poses left out, each with its law's other forms."""
        own = [(self.terms[t].name, self.owned[t]) for t in some]
        own += [(self.terms[t].name, self.forms[t]) for t in some if len(self.forms[t])]
        return gate_names(self.units, self.nominal, own)

    @cached_property
    def nominal_gain(self) -> float:
        """What the nominal columns alone gain on poses left out."""
        return float(left_out_gain(self.units, self.nominal, []).sum())

    @property
    def whole(self) -> float:
        """Whitened square of the mismatch that nominal columns do not explain."""
        return max(float(self.mismatch.sum()) - 2.0 * self.nominal_gain, 1e-12)

    def share(self, gain: Float[np.ndarray, " poses"]) -> float:
        """Return the share of the mismatch that a gain on poses left out explains."""
        return 2.0 * (float(gain.sum()) - self.nominal_gain) / self.whole

    def share_of(self, lost: Float[np.ndarray, " poses"]) -> float:
        """Return a loss of poses left out as a share of the same mismatch."""
        return 2.0 * float(lost.sum()) / self.whole


def _pose_statistics(
    case: SelectionProblem, terms: Sequence[ModelTerm], with_forms: bool = False
) -> PoseStatistics:
    here, held_out = case.situation, case.split.held_out
    laws = [term.jacobian(here) for term in terms]
    forms = [EffectJacobian(0) for _ in terms]
    if with_forms:
        forms = [t.hypothesis.variants(here, t.where, t.shape) for t in terms]
    every = [*laws, *(form for form in forms if form.columns)]
    found = per_pose_scores(case.data, [*case.nominal, *every], training(case.split))
    widths = [part.columns for part in (*laws, *forms)]
    ends = np.cumsum([case.library.nominal, *widths])
    blocks = tuple(np.arange(a, b) for a, b in pairwise(ends))
    return PoseStatistics(
        tuple(terms),
        UnitStatistics(found.own, found.score, np.where(held_out, -1, case.split.fold)),
        np.arange(case.library.nominal),
        blocks[: len(laws)],
        blocks[len(laws) :],
        mismatch_of_poses(case.data)[~held_out],
    )


def mismatch_of_poses(data: SufficientStatistics) -> Float[np.ndarray, " poses"]:
    """Return each pose's whitened square beyond its degrees of freedom."""
    pose, within = data.visits.posture_index, data.within
    excess = np.bincount(pose, within.square - within.degrees_of_freedom)
    between = data.between
    if between is None:
        return excess
    seen = np.any(between.whitening.half != 0.0, axis=(2, 3))  # (visits, markers)
    square = np.sum(between.residual.reshape(*seen.shape, 3) ** 2, axis=(1, 2))
    free = max(1.0 - data.nuisance_count / max(3.0 * seen.sum(), 1.0), 0.0)
    return excess + np.bincount(pose, square - 3.0 * free * seen.sum(axis=1))


# --- The whole set --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class WholeArm:
    """A set of many names, each with one shape.

    Attributes:
        case: As laid out under everything that was found.
        fit: The set.
        parameters: Of each term, with 95 % intervals.
        lost: What each term's leaving costs each training pose, left out.
        statistics: What poses say of the set.
        dispersion: Variance of the coefficients by fits that leave a pose out, over the
            one that the stated errors make; 1 at least.
        share: Of the mismatch that is explained on poses left out.
        decisions: Of all gates on all candidates.
    """

    case: SelectionProblem
    fit: ModelFit
    parameters: tuple[dict[str, Parameter], ...]
    lost: tuple[Float[np.ndarray, " poses"], ...]
    statistics: PoseStatistics
    dispersion: float
    share: float
    decisions: tuple[Decision, ...]

    @property
    def is_sound(self) -> bool:
        """Return whether many names explain nearly all that there is."""
        return len(self.fit.members) > MAX_EXHAUSTIVE_SIZE and self.share >= LEAST_SHARE


def select_whole_arm(
    case: SelectionProblem,
    prepared: Prepared,
    hypotheses: Sequence[Hypothesis],
    coarse: CoarseSelection,
) -> WholeArm:
    """Fit shapes, lay out once more, select again, and withhold what does not hold.

    Args:
        case: As laid out where nothing is named.
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
        coarse: The set at coarse shapes.
    """
    terms = fit_shapes(case, coarse.terms)
    fit = fit_model(case.data, case.situation, case.nominal, terms, case.split)
    softer = total_softening(case, prepared, fit)
    case = build_problem(prepared, hypotheses, softer, fit)
    search = Search.of(case, terms)
    selected = select_groups(search.problem, range(len(terms)))
    decisions = list(selected.decisions)
    terms = fit_shapes(case, _one_each(search, selected.groups))
    while True:
        statistics = _pose_statistics(case, terms, with_forms=True)
        gated = statistics.gate(range(len(terms)))
        decisions += gated.decisions
        terms = tuple(term for term in terms if term.name in gated.names)
        look = evaluate_model(
            case.data, case.situation, case.nominal, terms, (), case.split
        )
        parameters, _ = parameters_of(
            case.situation, case.springs, look, case.split, many=True
        )
        withheld = _withheld(case, terms, parameters)
        if not withheld:
            break
        z = dict(zip(gated.names, gated.z, strict=True))
        weakest = min(withheld, key=lambda decision: z[decision.candidate])
        decisions.append(weakest)
        terms = tuple(term for term in terms if term.name != weakest.candidate)
    return WholeArm(
        case,
        look.fit,
        tuple(parameters),
        gated.lost,
        statistics,
        _dispersion(case, look),
        statistics.share(gated.gain),
        _last_of_each(decisions),
    )


def _one_each(search: Search, groups: Sequence[int]) -> tuple[ModelTerm, ...]:
    """Return one term of each name: of several shapes the one that explains most.

    Reported parameters are of one law; what a second shape mends is left to the other
    forms of the law, which the residual test allows.
    """
    several: dict[Name, list[int]] = {}
    for k in groups:
        several.setdefault(search.terms[k].name, []).append(k)
    best = {name: own[0] for name, own in several.items()}
    for name, own in several.items():
        others = [k for n, k in best.items() if n != name]
        gain = [FactorisedSet.of(search.problem, [*others, k]).gain for k in own]
        best[name] = own[int(np.argmax(gain))]
    return tuple(search.terms[k] for k in best.values())


def _withheld(
    case: SelectionProblem,
    terms: Sequence[ModelTerm],
    parameters: Sequence[dict[str, Parameter]],
) -> list[Decision]:
    """Return the names that hold nothing, or more than any arm has."""
    found = []
    for term, own in zip(terms, parameters, strict=True):
        if may_be_nothing(term.hypothesis, own):
            reason = "the intervals of all its magnitudes contain zero"
            found.append(Decision(term.name, "magnitude", False, 0.0, 0.0, reason))
        elif beyond_limits(case.situation, term, own):
            reason = "a parameter lies beyond its physical limits, interval and all"
            found.append(Decision(term.name, "physical", False, 0.0, 0.0, reason))
    return found


def _dispersion(case: SelectionProblem, look: ModelEvaluation) -> float:
    """Return by how much poses differ beyond the stated errors, along the set."""
    count = case.library.nominal + sum(len(c) for c in look.fit.coefficients)
    mask, some = ~case.split.held_out, np.arange(count)
    own = look.slopes.own[mask][:, some[:, None], some]
    fitted = np.concatenate([look.fit.springs, *look.fit.coefficients])
    score = look.slopes.score[mask][:, some] - own @ fitted
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own.sum(axis=0)), 1e-300))
    own, score = own * scale * scale[:, None], score * scale
    spread = jackknife_covariance(own, score)
    return max(1.0, float(np.sum(own.sum(axis=0) * spread)) / count)


def _last_of_each(decisions: Sequence[Decision]) -> tuple[Decision, ...]:
    """Return the last decision of each gate on each candidate."""
    return tuple({(d.candidate, d.gate): d for d in decisions}.values())
