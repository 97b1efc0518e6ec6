"""Selection of effects: search over all sets, refinement, and a gate on poses left out.

All effects at all places compete at once, without a limit of size: a set is searched on
normal equations at coarse shapes, once more among fine shapes of its names and of what
could stand in their place, refined, and laid out anew under all that was found. Names
that do not predict poses left out go, the weakest first.

==========  ==========================================================================
Equation    worth of a set: `regression.group_selection`; columns anew at what was found
Source      forward selection with exchange; relinearisation: Gauss-Newton
Valid       poses that err independently
Ignores     sets that differ by two names at once from all that were tried
==========  ==========================================================================
"""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.candidates import Library, Mapped
from stiffness.diagnosis.gate import (
    PoseStatistics,
    gate_terms,
    pose_statistics,
    second_order_name,
)
from stiffness.diagnosis.model_evaluation import (
    ModelEvaluation,
    cost_of_limits,
    evaluate_model,
    jackknife_covariance,
    may_be_nothing,
    parameters_of,
)
from stiffness.diagnosis.model_fit import (
    WHOLE,
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_model,
    fit_shapes,
    training,
    tried,
)
from stiffness.diagnosis.nominal_fit import Prepared
from stiffness.diagnosis.relinearisation import (
    build_problem,
    changes,
    loads_of,
    total_softening,
)
from stiffness.diagnosis.residual_checks import significant_blocks
from stiffness.diagnosis.sufficient_statistics import (
    cross_gram,
    given_many,
    normal_equations_of,
)
from stiffness.effects.base import Hypothesis
from stiffness.regression.group_selection import (
    GroupSelection,
    best_groups_beside,
    exchange_worths,
    gains_beside,
    select_groups,
)
from stiffness.regression.group_sets import (
    ColumnGroup,
    FactorisedSet,
    GroupProblem,
    factorised_set_only,
)
from stiffness.regression.intervals import Interval
from stiffness.regression.predictive_gate import Decision, Name
from stiffness.regression.splits import Split

BEYOND = 0.1
"""Share of what a name explains that it may lose within its physical limits; chosen: a
small part of an effect may be out of place beside what was not named."""

# --- Normal equations of the search ---------------------------------------------------


@dataclass(frozen=True, eq=False)
class Search:
    """Everything that the search selects from.

    Attributes:
        case: What may be looked at.
        terms: Of each group of columns: given terms first, then the library.
        problem: Their normal equations over the training poses.
    """

    case: SelectionProblem
    terms: tuple[ModelTerm, ...]
    problem: GroupProblem

    @classmethod
    def of(
        cls,
        case: SelectionProblem,
        first: Sequence[ModelTerm] = (),
        refused: Collection[Name] = (),
        generic: Sequence[Mapped] = (),
    ) -> "Search":
        """Lay out a few terms with shapes of their own beside the library.

        Args:
            case: What may be looked at.
            first: Terms that come before those of the library.
            refused: Names of the library that are left out.
            generic: Blocks of the residual map that may be selected too.
        """
        given, found = case.normal_equations, tuple(first)
        gram, score, raw = given.gram[1], given.score, given.raw
        width, owned = 0, []
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
        of_library = [
            one for one in _terms_of(case.library) if one[0].name not in refused
        ]
        of_library += [(_generic_term(block), block.columns) for block in generic]
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


def _generic_term(block: Mapped) -> ModelTerm:
    return ModelTerm(block.hypothesis, block.where, np.zeros(0))


# --- Search ---------------------------------------------------------------------------

AGAIN = 2
"""How often all columns are laid out anew; chosen: the second time moves a tenth of the
first."""
STARTS = 4
"""Names from which the search starts, beside nothing; chosen: a name that imitates the
sum of two is left by starting at one of these."""
SMALL_SET = 6
"""Groups of columns up to which a set is searched from several starts; chosen: larger
sets were exchanged many times."""
LIVE = 12.0
"""Log Bayes factor within which another name is tried at fine shapes in the place of a
name of the set; chosen: refining a coarse shape rarely gains more."""
FORMS = 0.1
"""Or share of what the name explains; chosen: what a coarse shape may lose."""
MOST_LIVE = 8
"""Names that are tried in the place of one; chosen for time."""
MOST_FINE = 40
"""Names that are tried at fine shapes in all, the closest first; chosen for time."""
POINTS, POINTS_OF_MANY = 7, 3
"""Fine shapes of a name; of each of more than a dozen. Chosen: the best is fitted."""


def _first_search(problem: GroupProblem) -> GroupSelection:
    """Search from nothing and, a small set, from the strongest single names."""
    best = select_groups(problem)
    if not 0 < len(best.groups) <= SMALL_SET:
        return best
    single: dict[Name, tuple[float, int]] = {}
    for k, gain in enumerate(gains_beside(problem, [])):
        if gain > single.get(problem.groups[k].name, (0.0, 0))[0]:
            single[problem.groups[k].name] = (float(gain), k)
    starts = [k for _, k in sorted(single.values(), reverse=True)[1 : STARTS + 1]]
    for k in starts:
        if k not in best.groups:
            other = select_groups(problem, [k])
            best = max(best, other, key=lambda found: found.log_evidence)
    return best


def _from_rivals(search: Search, selected: GroupSelection, fine: int) -> GroupSelection:
    """Search a small set again with each rival in each name's place; return the best.

    One name may do what two true ones do; only from one of these is the pair found.

    Args:
        search: With the rivals' fine shapes among its first terms.
        selected: The set that was found.
        fine: How many terms come first.
    """
    problem, terms, groups = search.problem, search.terms, selected.groups
    if not 0 < len(groups) <= SMALL_SET:
        return selected
    held = {terms[k].name for k in groups}
    best = selected
    for name in held:
        rest = [k for k in groups if terms[k].name != name]
        gains: dict[Name, tuple[float, int]] = {}
        for k, gain in enumerate(gains_beside(problem, rest)[:fine]):
            if terms[k].name not in held and gain > gains.get(terms[k].name, (0.0,))[0]:
                gains[terms[k].name] = (float(gain), k)
        for _, k in sorted(gains.values(), reverse=True)[:STARTS]:
            other = select_groups(problem, [*rest, k])
            best = max(best, other, key=lambda found: found.log_evidence)
    return best


def _at_fine_shapes(search: Search, groups: Sequence[int]) -> list[ModelTerm]:
    """Return fine shapes of the names of a set and of what could replace each."""
    problem, terms = search.problem, search.terms
    whole = factorised_set_only(problem, groups).gain
    close: dict[int, float] = {}
    for name in dict.fromkeys(terms[k].name for k in groups):
        rest = [k for k in groups if terms[k].name != name]
        lost = 0.5 * (whole - factorised_set_only(problem, rest).gain)
        gains = gains_beside(problem, rest)
        worth = exchange_worths(problem, groups, name).worth
        margin = max(LIVE, FORMS * lost)
        behind = {n: worth[name] - w for n, w in worth.items() if n != name}
        live = sorted((n for n in behind if behind[n] < margin), key=behind.__getitem__)
        for other in live[:MOST_LIVE]:
            own = [k for k, term in enumerate(terms) if term.name == other]
            best = own[int(np.argmax(gains[own]))]
            close[best] = min(close.get(best, np.inf), behind[other] / margin)
    rivals = sorted(close, key=lambda k: (close[k], k))[:MOST_FINE]
    wanted = sorted({*groups, *rivals})
    points = POINTS if len(wanted) <= 12 else POINTS_OF_MANY
    return [
        fine for k in wanted for fine in _fine_shapes(search.case, terms[k], points)
    ]


def _fine_shapes(
    case: SelectionProblem, term: ModelTerm, points: int
) -> list[ModelTerm]:
    """Return a term at shapes between the coarse grid's neighbours of its own."""
    law = term.hypothesis
    grid = law.shapes(case.situation, term.where)
    for j, name in enumerate(law.shape_names[: term.degrees_of_freedom]):
        own = np.unique(grid[:, j])
        if name in WHOLE or len(own) < 2:
            continue
        factor = name in law.logarithmic
        found = []
        for value in tried(float(term.shape[j]), own, factor, points):
            shape = term.shape.copy()
            shape[j] = np.exp(value) if factor else value
            found.append(replace(term, shape=shape))
        return found
    return [term]


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


def _with_generic_terms(
    case: SelectionProblem,
    terms: tuple[ModelTerm, ...],
    fine: Sequence[ModelTerm],
    refused: Collection[Name] = (),
) -> tuple[tuple[ModelTerm, ...], tuple[Decision, ...]]:
    """Search on from a set where generic terms of all places compete with names.

    Several names that imitate a mechanism without one are worth less than the generic
    term of its place: that explains as much with fewer numbers, or more.

    Args:
        case: What may be looked at.
        terms: The set.
        fine: What else comes with a shape of its own.
        refused: Names that are left out.
    """
    fit = fit_model(case.data, case.situation, case.nominal, terms, case.split)
    held = {term.name for term in terms}
    blocks = [
        block
        for block in significant_blocks(case, fit)
        if _generic_term(block).name not in held
    ]
    if not blocks:
        return terms, ()
    search = Search.of(case, [*terms, *fine], refused, blocks)
    selected = select_groups(search.problem, range(len(terms)))
    return fit_shapes(case, _one_each(search, selected.groups)), selected.decisions


# --- The selected model ---------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SelectedModel:
    """A set of names, each with one shape.

    Attributes:
        case: As laid out under everything that was found.
        fit: The set.
        fine: Fine shapes of its names and of what could stand in their place.
        refused: Names that would be physically impossible here.
        parameters: Of each term, with 95 % intervals.
        drop_one_gains: What each term explains that the others do not.
        lost: What each term's leaving costs each training pose, left out.
        statistics: What poses say of the set.
        dispersion: Variance of the coefficients by fits that leave a pose out, over the
            one that the stated errors make; 1 at least.
        share: Of the mismatch that is explained on poses left out.
        decisions: Of all gates on all candidates.
    """

    case: SelectionProblem
    fit: ModelFit
    fine: tuple[ModelTerm, ...]
    refused: frozenset[Name]
    parameters: tuple[dict[str, Interval], ...]
    drop_one_gains: tuple[float, ...]
    lost: tuple[Float[np.ndarray, " poses"], ...]
    statistics: PoseStatistics
    dispersion: float
    share: float
    decisions: tuple[Decision, ...]

    def share_without(self, k: int) -> float:
        """Return the share of the mismatch that is not explained without a member."""
        return self.statistics.share_of(self.lost[k])


def _drop_one_gains(
    found: PoseStatistics, members: Sequence[ModelTerm]
) -> tuple[float, ...]:
    """Return what each of some terms explains that others do not, springs adapting.

    Args:
        found: What poses say of these terms, or of more.
        members: The terms.
    """
    place = {term.name: own for term, own in zip(found.terms, found.owned, strict=True)}
    blocks = [place[member.name] for member in members]
    used = np.concatenate([found.nominal, *blocks]).astype(int)
    some = found.units.fold >= 0
    gram = found.units.gram[some].sum(axis=0)[np.ix_(used, used)]
    score = found.units.score[some].sum(axis=0)[used]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram * scale * scale[:, None], rcond=1e-10)
    fitted = inverse @ (score * scale)
    gains, at = [], len(found.nominal)
    for block in blocks:
        own = np.arange(at, at + len(block))
        at += len(block)
        step = np.linalg.lstsq(inverse[np.ix_(own, own)], fitted[own], rcond=None)
        gains.append(max(float(fitted[own] @ step[0]), 0.0))
    return tuple(gains)


def exchange_search(model: SelectedModel) -> Search:
    """Lay out a set beside fine shapes of what could stand in each name's place.

    Args:
        model: The set; its members come first.
    """
    fine = [term for term in model.fine if term.name not in model.refused]
    return Search.of(model.case, [*model.fit.members, *fine], model.refused)


def select_model(
    case: SelectionProblem, prepared: Prepared, hypotheses: Sequence[Hypothesis]
) -> SelectedModel:
    """Search the set that explains best, and withhold what does not hold.

    A load that is withheld once columns were laid out under it acts no more on them.

    Args:
        case: As laid out where nothing is named.
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
    """

    def under(fit: ModelFit) -> SelectionProblem:
        softer = total_softening(case, prepared, fit)
        return build_problem(prepared, hypotheses, softer, fit)

    search = Search.of(case)
    selected = _first_search(search.problem)
    own = [search.terms[k] for k in selected.groups]
    loads: frozenset[Name] = frozenset()
    terms: tuple[ModelTerm, ...] = ()
    fine: list[ModelTerm] = []
    for turn in range(AGAIN + 1):
        fine = _at_fine_shapes(search, selected.groups)
        search = Search.of(case, [*own, *fine])
        selected = _from_rivals(
            search, select_groups(search.problem, range(len(own))), len(own) + len(fine)
        )
        terms = fit_shapes(case, _one_each(search, selected.groups))
        fit = fit_model(case.data, case.situation, case.nominal, terms, case.split)
        if turn == AGAIN or not changes(case, prepared, fit):
            break
        own, loads = list(terms), loads_of(case, fit)
        case = under(fit)
    terms, searched = _with_generic_terms(case, terms, fine)
    model = _judged(case, terms, fine, [*selected.decisions, *searched])
    if loads <= {member.name for member in model.fit.members}:
        return model
    case = under(model.fit)
    terms = fit_shapes(case, model.fit.members)
    return _judged(case, terms, fine, model.decisions)


def select_again(model: SelectedModel, split: Split) -> SelectedModel:
    """Select from other poses, among a set's names and what could replace each.

    Columns stay as they were laid out under the set.

    Args:
        model: The set.
        split: Which poses may be looked at now.
    """
    first = model.case
    library = Library(first.nominal, first.library.nominal, (), ())
    found = normal_equations_of(first.data, library.jacobians, training(split))
    case = replace(first, library=library, normal_equations=found, split=split)
    fine = [term for term in model.fine if term.name not in model.refused]
    search = Search.of(case, [*model.fit.members, *fine])
    selected = _first_search(search.problem)
    terms = fit_shapes(case, _one_each(search, selected.groups))
    return _judged(case, terms, fine, selected.decisions)


def _judged(
    case: SelectionProblem,
    terms: tuple[ModelTerm, ...],
    fine: Sequence[ModelTerm],
    first: Sequence[Decision],
) -> SelectedModel:
    """Gate a set on poses left out and by its intervals, the weakest name first.

    Where a name is physically impossible, another is searched in its place.
    """
    decisions, refused = list(first), set[Name]()
    while True:
        statistics = pose_statistics(case, terms)
        gated, slight = gate_terms(statistics)
        decisions += [*gated.decisions, *slight]
        terms = tuple(term for term in terms if term.name in gated.names)
        slightest = second_order_name(case, terms, gated)
        if slightest is not None:
            decisions.append(slightest)
            terms = tuple(t for t in terms if t.name != slightest.candidate)
            continue
        look = evaluate_model(
            case.data, case.situation, case.nominal, terms, case.split
        )
        parameters = parameters_of(case.situation, case.springs, look, case.split)
        gains = _drop_one_gains(statistics, terms)
        columns = [len(own) for own in look.fit.coefficients]
        withheld = _withheld(case, terms, parameters, gains, columns)
        if not withheld:
            beside = _of_the_same_kinds(case, terms, refused)
            if beside:
                look = evaluate_model(
                    case.data, case.situation, case.nominal, terms, case.split, beside
                )
                parameters = parameters_of(
                    case.situation, case.springs, look, case.split
                )
            break
        z = dict(zip(gated.names, gated.z, strict=True))
        weakest = min(withheld, key=lambda decision: z[decision.candidate])
        decisions.append(weakest)
        terms = tuple(term for term in terms if term.name != weakest.candidate)
        if weakest.gate == "physical":
            refused.add(weakest.candidate)
            others = [term for term in fine if term.name not in refused]
            terms, searched = _with_generic_terms(case, terms, others, refused)
            decisions += searched
    return SelectedModel(
        case,
        look.fit,
        tuple(fine),
        frozenset(refused),
        tuple(parameters),
        gains,
        gated.lost,
        statistics,
        _dispersion(case, look),
        statistics.share(gated.gain),
        last_of_each(decisions),
    )


ALIKE = {"encoder_offset": "geometry_error"}
"""Effects that count as another kind: an axis' zero is a turn of the link before it."""


def _of_the_same_kinds(
    case: SelectionProblem, terms: Sequence[ModelTerm], refused: Collection[Name]
) -> list[ModelTerm]:
    """Return effects that were named at two sites at least, at their other sites.

    What several axes have the others may have too, though too little to be named; the
    intervals of what was named allow for it, and for an axis' zero that moves exactly
    as a geometry error that was named.
    """
    named = [term.name[0] for term in terms if not term.is_generic]
    count = Counter(ALIKE.get(name, name) for name in named)
    if not count.keys() & ALIKE.values() and max(count.values(), default=0) < 2:
        return []
    search = Search.of(case, terms, refused)
    here = FactorisedSet.of(search.problem, range(len(terms)))
    found = []
    for name, k in best_groups_beside(search.problem, range(len(terms))).items():
        sites = count[ALIKE.get(name[0], name[0])]
        alike = name[0] in ALIKE and sites
        if sites > 1 or (alike and _adds_nothing(search.problem, here, k)):
            found.append(search.terms[k])
    return found


def _adds_nothing(problem: GroupProblem, here: FactorisedSet, k: int) -> bool:
    return len(FactorisedSet.of(problem, [k], here).aim) == len(here.aim)


def _withheld(
    case: SelectionProblem,
    terms: Sequence[ModelTerm],
    parameters: Sequence[dict[str, Interval]],
    gains: Sequence[float],
    columns: Sequence[int],
) -> list[Decision]:
    """Return the names that hold nothing, or more than any arm has.

    A law of one size has no other part that could be within its limits.
    """
    found = []
    every = zip(terms, parameters, gains, columns, strict=True)
    for term, own, gain, count in every:
        if may_be_nothing(term.hypothesis, own):
            reason = "the intervals of all its magnitudes contain zero"
            found.append(Decision(term.name, "magnitude", False, 0.0, 0.0, reason, own))
            continue
        share = cost_of_limits(case.situation, term, own) / max(gain, 1e-12)
        if share > BEYOND or (share > 0.0 and count == 1):
            reason = "within its physical limits it explains much less"
            one = Decision(term.name, "physical", False, share, BEYOND, reason, own)
            found.append(one)
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


def last_of_each(decisions: Sequence[Decision]) -> tuple[Decision, ...]:
    """Return the last decision of each gate on each candidate."""
    return tuple({(d.candidate, d.gate): d for d in decisions}.values())
