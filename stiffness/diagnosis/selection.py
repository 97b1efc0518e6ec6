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

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from bench.shared.settings import SETTINGS, Interval
from stiffness.diagnosis.gate import (
    PoseStatistics,
    budget_parts,
    cancelled_names,
    drop_one_gains,
    gate_terms,
    has_wrong_sign,
    held_by_nothing,
    pose_statistics,
    refused_by_sizes,
    second_order_name,
)
from stiffness.diagnosis.joint_fit import (
    Layout,
    OperatingPoint,
    unexplained,
)
from stiffness.diagnosis.model_evaluation import (
    ModelEvaluation,
    dispersion_of,
    evaluate_consistently,
    parameters_of,
)
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_model,
    fit_shapes,
)
from stiffness.diagnosis.relinearisation import (
    changes,
    loads_of,
)
from stiffness.diagnosis.search import (
    Search,
    at_fine_shapes,
    beyond_present_names,
    first_search,
    from_rivals,
    generic_term,
    of_the_same_kinds,
    one_each,
    replaced_by_forms,
    with_generic_terms,
    with_part_less,
    with_plain_law,
)
from stiffness.effects.candidates import Library
from stiffness.effects.residual_map import shows_everywhere
from stiffness.regression.group_selection import (
    GroupSelection,
    select_groups,
)
from stiffness.regression.intervals import FittedParameters
from stiffness.regression.predictive_gate import Decision, Name, last_of_each
from stiffness.regression.splits import Split

# --- The selected model ---------------------------------------------------------------

Pair = tuple[Name, Name]
"""A name of a set, and another that may take its place."""
AGAIN = 3
"""How often the search goes on at most where columns were laid out anew under a set;
chosen: the second time finds what the first one misled."""
MISLED = 0.5
"""Share of what a set did not explain that it does where columns were laid out anew,
from which the search goes on more than once; chosen: columns misled it mostly."""


@dataclass(frozen=True, eq=False)
class SelectedModel:
    """A set of names, each with one shape.

    Attributes:
        case: As laid out under everything that was found.
        fit: The set.
        fine: Fine shapes of its names and of what could stand in their place.
        refused: Names that are physically impossible here, or beside which others are.
        parameters: Of each term, with 95 % intervals.
        drop_one_gains: What each term explains that the others do not.
        lost: What each term's leaving costs each training pose, left out.
        statistics: What poses say of the set.
        dispersion: Variance of the coefficients by fits that leave a pose out, over the
            one that the stated errors make; 1 at least.
        share: Of the mismatch that is explained on poses left out.
        decisions: Of all gates on all candidates.
        exchange_losses: Of some names, by how much the set is worth less with another
            in its place when all is fitted anew.
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
    exchange_losses: Mapping[Pair, float] = field(default_factory=dict)

    @property
    def unexplained_square(self) -> float:
        """Whitened square of the mismatch on poses left out that is not explained."""
        return self.statistics.whole * (1.0 - self.share)

    def share_without(self, k: int) -> float:
        """Return the share of the mismatch that is not explained without a member."""
        return self.statistics.share_of(self.lost[k])


def exchange_search(model: SelectedModel) -> Search:
    """Lay out a set, and fine shapes of what could stand in each name's place after it.

    The same law elsewhere is tried at the shape of the name, too.
    """
    fine = [term for term in model.fine if term.name not in model.refused]
    alike = {
        (term.name, member.name): replace(term, shape=member.shape)
        for member in model.fit.members
        for term in fine
        if term.hypothesis is member.hypothesis
        and term.where != member.where
        and term.has_form_of(model.case.situation, member)
    }
    every = [*model.fit.members, *fine, *(t for t in alike.values() if len(t.shape))]
    return Search.of(model.case, every, model.refused)


SURE = SETTINGS.equivalent_log_bayes
"""Log Bayes factor from which one set is told from another."""
CLEAR = 100.0
"""Square that a set leaves, from which it is searched once more; chosen: a name's."""


def search_model(
    case: SelectionProblem, layout: Layout, start: Sequence[ModelTerm] = ()
) -> SelectedModel:
    """Search the set that explains best, and withhold what does not hold.

    What shows everywhere competes from the first: many names would share it out. Other
    forms of a law come with fine shapes: coarse ones of two laws may cancel each other.

    Args:
        case: What may be looked at, as laid out where nothing is named.
        layout: How columns are laid out.
        start: A set to search from; empty: from nothing.
    """
    if start:
        point = layout.fitted_jointly(case, fit_model(case, start))
        return searched_on(layout, point, point.fit.members)
    common = [generic_term(b) for b in case.library.map.blocks if b.shows_everywhere]
    search = Search.of(case, common, every_form=False)
    return _selected_under(layout, search, first_search(search.problem))


def fitted_jointly(
    layout: Layout, case: SelectionProblem, terms: Sequence[ModelTerm]
) -> OperatingPoint:
    """Fit a set with its columns, generic terms beyond the names that it has."""
    return layout.fitted_jointly(case, fit_model(case, beyond_present_names(terms)))


@dataclass(frozen=True, eq=False)
class _Selection:
    """A set as it was selected in one layout of columns, before it is gated.

    Attributes:
        terms: The set.
        fine: Fine shapes of its names and of what could stand in their place.
        decisions: Of the search.
    """

    terms: tuple[ModelTerm, ...]
    fine: Sequence[ModelTerm]
    decisions: Sequence[Decision]


def _selected_in(
    search: Search, selected: GroupSelection, refused: Collection[Name]
) -> _Selection:
    """Search on from a set among fine shapes, with rivals and with generic terms.

    Args:
        search: What the set was selected from.
        selected: The set.
        refused: Names that are left out.
    """
    own = [search.terms[k] for k in selected.groups]
    fine = at_fine_shapes(search, selected.groups)
    search = Search.of(search.case, [*own, *fine], refused)
    selected = select_groups(search.problem, range(len(own)))
    selected = from_rivals(search, selected, len(own) + len(fine))
    terms = fit_shapes(search.case, one_each(search, selected.groups))
    terms, searched = with_generic_terms(search.case, terms, fine, refused)
    return _Selection(terms, fine, (*selected.decisions, *searched))


def _selected_under(
    layout: Layout,
    search: Search,
    selected: GroupSelection,
    refused: Collection[Name] = (),
    again: int = AGAIN,
    before: OperatingPoint | None = None,
) -> SelectedModel:
    """Search on from a set, gate what comes out, and lay columns out under that.

    Another set of names than columns are laid out under is gated in its own, as theirs
    would gate against it. The search goes on from there; of the sets the one that
    predicts poses left out best is kept. A load that is withheld once columns were laid
    out under it acts no more. A set that does less under its own columns than the one
    before was misled by that one's columns; where that one still holds it stays.

    Args:
        layout: How columns are laid out.
        search: What the set was selected from.
        selected: The set.
        refused: Names that are left out.
        again: How often the search may go on.
        before: What columns are laid out under; None: under nothing that was named.
    """
    found, case = _selected_in(search, selected, refused), search.case
    terms, fine = found.terms, found.fine
    names = {term.name for term in terms}
    named = not any(term.is_generic for term in terms)
    if before is not None and named and names != before.fit.names:
        point = layout.fitted_jointly(case, fit_model(case, terms))
        if before.over(point, case.poses) > SURE:
            terms = before.fit.members
        else:
            case, terms = layout.at(point), point.fit.members
    model = _judged(case, terms, fine, found.decisions)
    acting = frozenset[Name]() if case.named is None else loads_of(case, case.named)
    held = acting <= model.fit.names
    if held and not changes(model.case, layout.prepared, model.fit):
        return model
    point = layout.fitted_jointly(case, model.fit)
    left = unexplained(model.case, model.fit)
    if case.named is not None and point.square - left > CLEAR:
        lost = [m for m in case.named.members if m.name in acting - names]
        point = _with_loads_put_back(layout, case, point, lost)
    if before is not None and before.over(point, case.poses) > SURE:
        back = _judged(case, before.fit.members, fine, model.decisions)
        if back.fit.names <= before.fit.names:
            model, held, again = back, True, 0
    changed = before is None or point.fit.names != before.fit.names
    misled, start = left - point.square > max(MISLED * left, CLEAR), point
    if again == AGAIN and misled:
        start = _better_without_generic_terms(layout, point, refused)
    terms, gated = start.fit.members, start is point
    if again and (changed or misled):
        other = searched_on(layout, start, terms, refused, again - 1, gated)
    else:
        other = _judged(layout.at(point), terms, fine, ())
    kept = held and model.unexplained_square < other.unexplained_square
    best, beaten = (model, other) if kept else (other, model)
    decisions = last_of_each([*beaten.decisions, *best.decisions])
    return replace(best, decisions=decisions)


def _with_loads_put_back(
    layout: Layout,
    case: SelectionProblem,
    point: OperatingPoint,
    lost: Sequence[ModelTerm],
) -> OperatingPoint:
    """Return a set with loads that columns were laid out under, if surely worth more.

    A term may have taken what a load displaces while others still felt its torque.

    Args:
        layout: How columns are laid out.
        case: As laid out under the loads.
        point: The set, fitted in columns of its own.
        lost: The loads that were not selected.
    """
    if not lost:
        return point
    own = point.fit.members
    whole = fitted_jointly(layout, case, [*own, *lost])
    if whole.over(point, case.poses) <= SURE:
        return point
    for term in (t for t in own if t.where in {m.where for m in lost}):
        rest = [m for m in whole.fit.members if m.name != term.name]
        less = fitted_jointly(layout, case, rest)
        whole = less if less.over(whole, case.poses) > 0.0 else whole
    return whole


def _better_without_generic_terms(
    layout: Layout, point: OperatingPoint, refused: Collection[Name]
) -> OperatingPoint:
    """Return names alone, searched in columns of a point, if they are worth more.

    Generic terms took what columns were wrong by, too. What shows everywhere stays.
    """
    own = point.fit.members
    some = [
        t for t in own if not t.is_generic or shows_everywhere(t.where, t.depends_on)
    ]
    if len(some) == len(own):
        return point
    case = layout.at(point)
    search = Search.of(case, some, refused)
    selected = select_groups(search.problem, range(len(some)))
    fit = fit_model(case, fit_shapes(case, one_each(search, selected.groups)))
    more = unexplained(case, fit) - point.square
    if more > 3.0 * CLEAR:  # chosen: where the fit anew helped it was 110
        return point
    alone = layout.fitted_jointly(case, fit)
    return alone if alone.over(point, case.poses) > 0.5 * CLEAR else point


def searched_on(
    layout: Layout,
    point: OperatingPoint,
    terms: Sequence[ModelTerm],
    refused: Collection[Name] = (),
    again: int = AGAIN,
    gated: bool = True,
) -> SelectedModel:
    """Search on from a set in columns that are laid out at an operating point."""
    before = point if gated else None
    search = Search.of(layout.at(point), terms, refused)
    selected = select_groups(search.problem, range(len(terms)))
    return _selected_under(layout, search, selected, refused, again, before)


def select_again(model: SelectedModel, split: Split) -> SelectedModel:
    """Select from other poses, among a set's names and what could replace each.

    Columns stay as they were laid out under the set.

    Args:
        model: The set.
        split: Which poses may be looked at now.
    """
    first = model.case
    library = Library(first.nominal, first.library.nominal)
    case = replace(first, library=library, split=split)
    fine = [term for term in model.fine if term.name not in model.refused]
    search = Search.of(case, [*model.fit.members, *fine])
    selected = first_search(search.problem)
    terms = fit_shapes(case, one_each(search, selected.groups))
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
    decisions, refused = list(first), dict[Name, Name]()  # and for whose sake
    while True:
        terms = beyond_present_names(terms)
        statistics = pose_statistics(case, terms)
        gated, slight = gate_terms(statistics)
        decisions += [*gated.decisions, *slight]
        terms = tuple(term for term in terms if term.name in gated.names)
        slightest = second_order_name(case, terms, gated)
        slightest = slightest or replaced_by_forms(case, terms)
        if slightest is not None:
            decisions.append(slightest)
            terms = tuple(t for t in terms if t.name != slightest.candidate)
            continue
        gains = drop_one_gains(statistics, terms)
        own = _with_parameters(case, terms, gains, refused)
        look, of_sizes = own.look, own.decisions
        less = {d.candidate: with_part_less(case, terms, d.candidate) for d in of_sizes}
        withheld = [d for d in of_sizes if not d.accepted or less[d.candidate]]
        if not withheld:
            parts = budget_parts(statistics, look.fit)
            withheld = cancelled_names(look.fit.members, parts)
        if not withheld:
            break
        z = dict(zip(gated.names, gated.z, strict=True))
        weakest = min(withheld, key=lambda decision: z[decision.candidate])
        wrong = weakest.candidate
        if weakest.gate == "magnitude" and less[wrong]:
            terms = fit_shapes(case, less[wrong])
            continue
        if weakest.gate == "physical":
            if plain := with_plain_law(case, terms, wrong):
                terms = plain
                continue
            weakest = _needed_least(case, look.fit, weakest)
        decisions.append(weakest)
        terms = tuple(term for term in terms if term.name != weakest.candidate)
        if weakest.gate == "physical":
            if weakest.candidate == wrong:  # what went for its sake may come back
                refused = {n: sake for n, sake in refused.items() if sake != wrong}
            refused[weakest.candidate] = wrong
            others = [term for term in fine if term.name not in refused]
            terms, searched = with_generic_terms(case, terms, others, refused)
            decisions += searched
    # its sizes are those beside what they change of each other, what it explains is not
    linear = fit_model(case, terms)
    return SelectedModel(
        case,
        replace(look.fit, gain=linear.gain, nominal_gain=linear.nominal_gain),
        tuple(fine),
        frozenset(refused),
        tuple(one.intervals for one in own.parameters),
        gains,
        gated.lost,
        statistics,
        dispersion_of(case, look),
        statistics.share(gated.gain),
        last_of_each([*decisions, *of_sizes]),
    )


@dataclass(frozen=True, eq=False)
class _WithParameters:
    """A set with its parameters, as reported.

    Attributes:
        look: The fitted set.
        parameters: Of each term.
        decisions: On names by their sizes.
    """

    look: ModelEvaluation
    parameters: Sequence[FittedParameters]
    decisions: Sequence[Decision]


def _with_parameters(
    case: SelectionProblem,
    terms: Sequence[ModelTerm],
    gains: Sequence[float],
    refused: Collection[Name],
) -> _WithParameters:
    """Return the parameters of a set, and which names they withhold.

    Beside terms of the same kinds only where none is withheld by the set's own.

    Args:
        case: What may be looked at.
        terms: The set.
        gains: What each term explains that the others do not.
        refused: Names that are left out.
    """
    here = case.situation, case.springs
    beside = of_the_same_kinds(case, terms, refused)
    look = evaluate_consistently(case, terms, beside)
    parameters = parameters_of(*here, look.selected_alone, case.split)
    columns = [len(own) for own in look.fit.coefficients]
    decisions = refused_by_sizes(case, terms, parameters, gains, columns)
    if beside and all(d.accepted for d in decisions):
        parameters = parameters_of(*here, look, case.split)
        decisions = held_by_nothing(terms, parameters)
    return _WithParameters(look, parameters, decisions)


def _needed_least(case: SelectionProblem, fit: ModelFit, wrong: Decision) -> Decision:
    """Return which law goes where one at its place would be physically impossible.

    Two laws of one gear may take each other's part, the true one with the wrong sign:
    of those whose leaving gives all others their sign back, the one goes that costs
    least.
    """
    where, found = wrong.candidate[1], dict[tuple[str, str], float]()
    k = [m.name for m in fit.members].index(wrong.candidate)
    if not has_wrong_sign(case, fit.members[k], fit.coefficients[k]):
        return wrong
    for term in fit.members:
        if term.where != where or term.is_generic:
            continue
        rest = beyond_present_names([m for m in fit.members if m is not term])
        less = fit_model(case, fit_shapes(case, rest))
        every = zip(less.members, less.coefficients, strict=True)
        if not any(has_wrong_sign(case, m, c) for m, c in every if m.where == where):
            price = less.degrees_of_freedom * np.log(case.poses)
            found[term.name] = less.gain - price
    least = max(found, key=found.__getitem__, default=wrong.candidate)
    if least == wrong.candidate:
        return wrong
    reason = f"beside it {wrong.candidate[0]} there would be physically impossible"
    return replace(wrong, candidate=least, reason=reason, parameters={})
