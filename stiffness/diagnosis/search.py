"""Search over sets of effects on normal equations, at coarse and at fine shapes.

A set is searched at coarse shapes of all effects at all places, once more among fine
shapes of its names and of what could stand in their place, and on from there where
generic terms compete with the names.

==========  ==========================================================================
Equation    worth of a set: `regression.group_selection`
Source      forward selection with exchange: Miller 2002, "Subset Selection in
            Regression", 2nd ed., chapter 3
Valid       poses that err independently
Ignores     sets that differ by two names at once from all that were tried
==========  ==========================================================================
"""

import inspect
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.detection import blocks_beside
from stiffness.diagnosis.model_fit import (
    LAW_ACCURACY,
    WHOLE,
    HeldTerms,
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_model,
    fit_shapes,
)
from stiffness.effects.base import Hypothesis, site_number
from stiffness.effects.candidates import Library, Mapped
from stiffness.effects.residual_map import SENSOR
from stiffness.regression.group_selection import (
    LIVE,
    RISES,
    GroupSelection,
    best_groups_beside,
    exchange_worths,
    first_of_best,
    gains_beside,
    select_groups,
)
from stiffness.regression.group_sets import (
    ColumnGroup,
    FactorisedSet,
    GroupProblem,
)
from stiffness.regression.predictive_gate import Decision, Name
from stiffness.regression.testing import SIGNIFICANCE

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
        every_form: bool = True,
    ) -> "Search":
        """Lay out a few terms with shapes of their own beside the library.

        Args:
            case: What may be looked at.
            first: Terms that come before those of the library. Of a generic term that
                is there whole and beyond a name, the one that comes first counts.
            refused: Names of the library that are left out.
            every_form: Whether forms of a law other than its first may be selected.
        """
        less = {t.name: t.beyond for t in first[::-1]}
        found = tuple(
            t for t in first if not t.is_generic or bool(t.beyond) == bool(less[t.name])
        )
        of_library = [
            one
            for one in terms_of(case.library)
            if one[0].name not in refused and (every_form or one[0].is_first_form)
        ]
        equations, of_first = case.augmented.by(
            [term.key for term in found],
            lambda k: found[k].jacobian(case.situation),
        )
        gram, width = equations.gram[0], sum(map(len, of_first))
        asked = equations.score[~case.split.held_out].sum(axis=0)
        owned = list(of_first)
        owned += [columns + width for _, columns in of_library]
        terms = (*found, *(term for term, _ in of_library))
        groups = [
            ColumnGroup(
                term.name,
                columns,
                term.degrees_of_freedom,
                term.hypothesis.log_prior,
                term.hypothesis.counted_as,
            )
            for term, columns in zip(terms, owned, strict=True)
        ]
        prior = np.zeros(len(gram))
        for term, columns in zip(terms, owned, strict=True):
            sigma = term.hypothesis.prior_sigma(case.situation, term.where)
            if sigma is not None:
                prior[columns] = sigma**-2.0
        nominal = width + np.arange(case.library.nominal)
        own = gram, asked, equations.raw
        problem = GroupProblem.of(*own, nominal, groups, case.poses, prior)
        return cls(case, terms, problem)


def terms_of(library: Library) -> list[tuple[ModelTerm, Int[np.ndarray, " columns"]]]:
    """Return the library's terms at all coarse shapes, with their columns."""
    return [
        (ModelTerm(candidate.hypothesis, candidate.where, shape), columns)
        for candidate in library.candidates
        for shape, columns in zip(candidate.shapes, candidate.columns, strict=True)
    ]


def generic_term(block: Mapped) -> ModelTerm:
    """Return a block of the residual map as a term without a name."""
    return ModelTerm(block.hypothesis, block.where, np.zeros(0))


# --- Search ---------------------------------------------------------------------------

STARTS = 4
"""Names from which the search starts, beside nothing; chosen: a name that imitates the
sum of two is left by starting at one of these."""
SMALL_SET = 6
"""Groups of columns up to which a set is searched from several starts; chosen: larger
sets were exchanged many times."""
FORMS = 0.1
"""Or, beside `LIVE`, share of what the name explains; chosen: what a coarse shape may
lose."""
MOST_LIVE = 8
"""Names that are tried in the place of one; chosen for time."""
MOST_FINE = 40
"""Names that are tried at fine shapes in all, the closest first; chosen for time."""
POINTS, POINTS_OF_MANY = 7, 3
"""Fine shapes of a name; of each of more than a dozen. Chosen: the best is fitted."""


def first_search(problem: GroupProblem) -> GroupSelection:
    """Search from nothing and, a small set, from the strongest single names."""
    best = select_groups(problem)
    if not 0 < len(best.groups) <= SMALL_SET:
        return best
    strongest = best_of_names(problem, gains_beside(problem, []))
    starts = strongest[1 : STARTS + 1]
    for k in starts:
        if k not in best.groups:
            best = _worth_more(best, select_groups(problem, [k]))
    return best


def best_of_names(
    problem: GroupProblem, gains: Float[np.ndarray, " groups"]
) -> list[int]:
    """Return of each name the group that explains most, the strongest name first."""
    best = dict[Name, tuple[float, int]]()
    for k, gain in enumerate(gains):
        name = problem.groups[k].name
        if gain > best.get(name, (0.0, 0))[0]:
            best[name] = float(gain), k
    return [k for _, k in sorted(best.values(), reverse=True)]


def _worth_more(one: GroupSelection, other: GroupSelection) -> GroupSelection:
    """Return the set that is worth more; the first where rounding would decide."""
    return other if other.log_evidence > one.log_evidence + RISES else one


def from_rivals(search: Search, selected: GroupSelection, fine: int) -> GroupSelection:
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
    held = dict.fromkeys(terms[k].name for k in groups)
    best = selected
    for name in held:
        rest = [k for k in groups if terms[k].name != name]
        gains = gains_beside(problem, rest)[:fine]
        rivals = (k for k in best_of_names(problem, gains) if terms[k].name not in held)
        for k in islice(rivals, STARTS):
            best = _worth_more(best, select_groups(problem, [*rest, k]))
    return best


def at_fine_shapes(search: Search, groups: Sequence[int]) -> list[ModelTerm]:
    """Return fine shapes of the names of a set and of what could replace each."""
    problem, terms = search.problem, search.terms
    here = FactorisedSet.of(problem, groups)
    close: dict[int, float] = {}
    for name in dict.fromkeys(terms[k].name for k in groups):
        rest = [k for k in groups if terms[k].name != name]
        own = [p for p, k in enumerate(groups) if terms[k].name == name]
        lost = 0.5 * here.own_gain(own)
        gains = gains_beside(problem, rest)
        worth = exchange_worths(problem, groups, name).worth
        margin = max(LIVE, FORMS * lost)
        behind = {n: worth[name] - w for n, w in worth.items() if n != name}
        live = sorted((n for n in behind if behind[n] < margin), key=behind.__getitem__)
        for other in live[:MOST_LIVE]:
            every = [k for k, term in enumerate(terms) if term.name == other]
            best = every[int(np.argmax(gains[every]))]
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
    for j, name in enumerate(term.shape_names):
        own = term.grid(case.situation, j)
        if name in WHOLE or len(own) < 2:
            continue
        factor = name in term.hypothesis.logarithmic
        values = tried(float(term.shape[j]), own, factor, points)
        shapes = (float(np.exp(v)) if factor else float(v) for v in values)
        return [term.with_parameter(j, value) for value in shapes]
    return [term]


def tried(
    here: float, grid: Float[np.ndarray, " points"], factor: bool, count: int
) -> Float[np.ndarray, " count"]:
    """Return values between the nearest grid value's neighbours; logarithms of factors.

    Args:
        here: The best so far.
        grid: Coarse values, in order.
        factor: Whether an error is a factor.
        count: How many values, the neighbours themselves left out.
    """
    if factor:
        here, grid = float(np.log(here)), np.log(grid)
    nearest = int(np.argmin(np.abs(grid - here)))
    low, high = grid[max(nearest - 1, 0)], grid[min(nearest + 1, len(grid) - 1)]
    return np.linspace(low, high, count + 2)[1:-1]


def one_each(search: Search, groups: Sequence[int]) -> tuple[ModelTerm, ...]:
    """Return one term of each name: of several shapes the one that explains most.

    Reported parameters are of one law; what a second shape mends is left to the other
    forms of the law, which the residual test allows. Shapes of a law that is a sum are
    joined. Of a law that is at two places which nothing tells apart, one stays.
    """
    several: dict[Name, list[int]] = {}
    for k in groups:
        term = search.terms[k]
        several.setdefault((term.name[0], _site(term)), []).append(k)
    best = {name: own[0] for name, own in several.items()}
    found = {}
    for name, found_first in several.items():
        own = sorted(found_first)
        others = [k for n, k in best.items() if n != name]
        gain = [FactorisedSet.of(search.problem, [*others, k]).gain for k in own]
        most = own[first_of_best(np.array(gain), 2.0 * RISES)]
        order = [own[i] for i in np.argsort(-np.array(gain), kind="stable")]
        order.insert(0, order.pop(order.index(most)))
        best[name] = most
        term = search.terms[order[0]]
        every = (search.terms[k] for k in order)
        shapes = [other.shape for other in every if other.name == term.name]
        shape = term.hypothesis.joined(shapes) if len(shapes) > 1 else None
        found[name] = term if shape is None else replace(term, shape=shape)
        if any(search.terms[k].degrees_of_freedom > 1 for k in own):
            fit = _fit_of_laws(search, term.name, others)
            found[name] = found[name] if fit is None else fit.members[-1]
    return tuple(found.values())


def with_part_less(
    case: SelectionProblem, terms: Sequence[ModelTerm], name: Name
) -> tuple[ModelTerm, ...]:
    """Return a set where a sum has one part of each coarse shape; empty: it has one.

    Of parts nearest to the same one readings hold the sum, and not their sizes.
    """
    term = next(term for term in terms if term.name == name)
    if not term.hypothesis.is_sum:
        return ()
    grid = np.log(term.grid(case.situation, 0))
    near = [int(np.argmin(np.abs(grid - one))) for one in np.log(term.shape)]
    parts = np.sort(np.unique(near, return_index=True)[1])
    less = replace(term, shape=term.shape[parts])
    every = tuple(less if t is term else t for t in terms)
    return every if len(parts) < len(near) else ()


def with_plain_law(
    case: SelectionProblem, terms: Sequence[ModelTerm], name: Name
) -> tuple[ModelTerm, ...]:
    """Return a set where a form of a law is the law itself; empty: it is that.

    Where a form is impossible the law that it extends may still hold.
    """
    term = next(term for term in terms if term.name == name)
    plain = type(term.hypothesis).__mro__[1]
    if not issubclass(plain, Hypothesis) or inspect.isabstract(plain):
        return ()
    law, values = plain(), dict(zip(term.shape_names, term.shape, strict=True))
    shape = np.array([values[n] for n in law.shape_names if n in values])
    less = replace(term, hypothesis=law, shape=shape)
    return fit_shapes(case, [less if t is term else t for t in terms])


STARTS_OF_LAW = 4
"""Shapes from which each law of a name that has several is fitted; chosen: a wave and
its mirror image are alike at coarse ones."""


def _fit_of_laws(search: Search, name: Name, others: Sequence[int]) -> ModelFit | None:
    """Return others with the law of a name that is worth most beside them, the last.

    Of a name that has several laws: the one with more numbers may hold the other, and
    a grid over several shapes says little of it. None: it has one law. Waves at its
    place are left out: they do what a wrong shape leaves. Other shapes stay.

    Args:
        search: With all shapes of the laws.
        name: Whose laws.
        others: The set without it.
    """
    laws: dict[Hypothesis, list[int]] = {}
    for k, term in enumerate(search.terms):
        if term.name == name:
            laws.setdefault(term.hypothesis, []).append(k)
    if len(laws) < 2:
        return None
    terms = {k: search.terms[k] for k in others}
    waves = [k for k, t in terms.items() if t.hypothesis.is_sum and t.where == name[1]]
    others = [k for k in others if k not in waves]
    beside = HeldTerms.of(search.case, [terms[k] for k in others])
    gains = gains_beside(search.problem, others)
    fits, worth = list[ModelFit](), list[float]()
    for own in laws.values():
        for k in sorted(own, key=lambda k: -round(gains[k], 6))[:STARTS_OF_LAW]:
            fits.append(beside.fitted_with(search.terms[k]))
            numbers = fits[-1].degrees_of_freedom
            worth.append(fits[-1].gain - numbers * np.log(search.case.poses))
    return fits[first_of_best(np.array(worth), RISES)]


def with_generic_terms(
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
    fit = fit_model(case, terms)
    held = {term.name for term in terms}
    asked = [(generic_term(b), p) for b, p in blocks_beside(case, fit)]
    generic = [
        t
        for t, p in asked
        if t.name not in held and (p < SIGNIFICANCE or _may_replace(t, terms))
    ]
    if not generic and not any(t.is_generic and not t.beyond for t in terms):
        return terms, ()
    search = Search.of(case, [*terms, *fine, *generic], refused)
    search = _without_slight_terms(search, len(terms))
    selected = select_groups(search.problem, range(len(terms)))
    first = _names_before_generic_terms(search, selected.groups)
    if any(term.beyond for term in first):
        search = Search.of(case, [*first, *fine], refused)
        selected = select_groups(search.problem, range(len(first)))
    return fit_shapes(case, one_each(search, selected.groups)), selected.decisions


def _may_replace(term: ModelTerm, held: Sequence[ModelTerm]) -> bool:
    """Return whether a generic term is a course of the axis after a link with one.

    Courses of links compete from the first, those of axes do not.
    """
    return any(
        t.is_generic
        and t.where.startswith("link_")
        and t.depends_on == term.depends_on == ("time",)
        and term.where == f"a{site_number(t.where)}"
        for t in held
    )


def replaced_by_forms(
    case: SelectionProblem, terms: Sequence[ModelTerm]
) -> Decision | None:
    """Return the refusal of a term of the sensor that forms of laws replace, if any.

    It competes from the first, before any law may have another form than its own.

    Args:
        case: What may be looked at.
        terms: The set, as it was gated.
    """
    for term in terms:
        rest = [t for t in terms if t is not term]
        if rest and term.is_generic and term.where == SENSOR:
            every = blocks_beside(case, fit_model(case, rest))
            p = next((p for b, p in every if generic_term(b).name == term.name), 0.0)
            if p >= SIGNIFICANCE:
                reason = "other forms of named laws explain as much"
                return Decision(
                    term.name, "other_forms", False, p, SIGNIFICANCE, reason
                )
    return None


LEFT_BY_A_NAME = 0.1
"""Share of what a generic term explains that a name may leave of it and stand before
it. Chosen: as a name may stand beside an unknown effect that is ten times weaker."""
STILL = "base", "tracker"
"""Sites of the same columns: a motion of the base is one of the tracker."""


def _names_before_generic_terms(
    search: Search, groups: Sequence[int]
) -> tuple[ModelTerm, ...]:
    """Return a set where generic terms are what names at their places leave.

    The many columns of a generic term do what the true name does and a little more: it
    would take the place of a name whose law is not wholly true.

    Args:
        search: What the set was selected from.
        groups: The set.
    """
    terms, chosen, before = search.terms, list(groups), dict[int, ModelTerm]()
    for generic in groups:
        if not terms[generic].is_generic or terms[generic].beyond:
            continue
        left = _left_by_names(search, chosen, generic)
        best = min(left, key=lambda k: (round(left[k], 9), k), default=generic)
        if left.get(best, 1.0) <= LEFT_BY_A_NAME:
            before[generic] = terms[best]
            chosen += [best] if best not in chosen else []
    return tuple(
        replace(terms[k], beyond=(before[k],)) if k in before else terms[k]
        for k in chosen
    )


def _left_by_names(
    search: Search, groups: Sequence[int], generic: int
) -> dict[int, float]:
    """Return what each name at the place of a generic term leaves of it, as a share.

    Of those that depend on what it depends on: a strong law of another kind takes its
    part of what both imitate, but is not what it does.
    """
    problem, terms = search.problem, search.terms
    rest = [k for k in groups if k != generic]
    worth = FactorisedSet.of(problem, groups).own_gain([list(groups).index(generic)])
    beside, alone = (gains_beside(problem, some) for some in (groups, rest))
    left = dict[int, float]()
    for k, other in enumerate(terms):
        here = _site(other) == _site(terms[generic])
        alike = not set(other.depends_on).isdisjoint(terms[generic].depends_on)
        if other.is_generic or not (here and alike):
            continue
        if k in rest:
            less = [j for j in rest if j != k]
            without = float(gains_beside(problem, less)[generic])
            left[k] = worth / max(without, 1e-12)
        else:
            left[k] = float(worth + beside[k] - alone[k]) / max(worth, 1e-12)
    return left


def beyond_present_names(terms: Sequence[ModelTerm]) -> tuple[ModelTerm, ...]:
    """Return a set where generic terms leave out what its own names displace alone."""
    own = {(term.name[0], _site(term)): term for term in terms}
    sites = [[(n.name[0], _site(n)) for n in term.beyond] for term in terms]
    return tuple(
        replace(term, beyond=tuple(own[n] for n in names if n in own))
        for term, names in zip(terms, sites, strict=True)
    )


def _site(term: ModelTerm) -> str:
    """Return the place of a term; one for all that stand still."""
    return STILL[0] if term.where in STILL else term.where


LOADS = frozenset({"torque", "load", "direction", "history"})
"""What laws depend on that may take each other's part at one place."""


def _without_slight_terms(search: Search, held: int) -> Search:
    """Leave out generic terms that do less than what laws at their place may err by.

    Args:
        search: With a set first.
        held: Terms of the set.
    """
    problem, terms = search.problem, search.terms
    here = FactorisedSet.of(problem, range(held))
    gains = gains_beside(problem, range(held))
    laws: dict[str, list[int]] = {}
    for p, term in enumerate(terms[:held]):
        if not term.is_generic and not LOADS.isdisjoint(term.depends_on):
            laws.setdefault(term.where, []).append(p)
    most = {where: LAW_ACCURACY * here.own_gain(own) for where, own in laws.items()}
    keep = [
        k
        for k, term in enumerate(terms)
        if k < held
        or not term.is_generic
        or LOADS.isdisjoint(term.depends_on)
        or gains[k] > most.get(term.where, 0.0)
    ]
    groups = tuple(problem.groups[k] for k in keep)
    kept = tuple(terms[k] for k in keep)
    return Search(search.case, kept, replace(problem, groups=groups))


def of_the_same_kinds(
    case: SelectionProblem, terms: Sequence[ModelTerm], refused: Collection[Name]
) -> list[ModelTerm]:
    """Return effects that were named at two sites at least, at their other sites.

    What several axes have the others may have too, though too little to be named; the
    intervals of what was named allow for it, and for the zeros of all axes beside a
    geometry error that was named.
    """
    count = Counter(term.hypothesis.counted_as for term in terms if not term.is_generic)
    every = (candidate.hypothesis for candidate in case.library.candidates)
    alike = {h.effect for h in every if count[h.counted_as] > (not h.shares_rate_with)}
    if not alike:
        return []
    case = replace(case, library=case.library.of_effects(alike))
    search = Search.of(case, terms, refused)
    best = best_groups_beside(search.problem, range(len(terms)))
    return [search.terms[k] for name, k in best.items() if name[0] in alike]
