"""Exchanges in a selected set: what imitates its names, tried in their place.

A load and a term that turns an axis alike differ by what others feel of the load alone,
which columns that are laid out without it do not have. So sets with the one in place of
the other are fitted anew, each in columns of its own.

==========  ==========================================================================
Equation    worth of a set in its own columns: `joint_fit.worth_of`
Source      exchanges: Miller 2002, "Subset Selection in Regression", 2nd ed., chapter 3
Valid       poses that err independently
Ignores     two loads that are imitated at once
==========  ==========================================================================
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stiffness.diagnosis.joint_fit import (
    Layout,
    OperatingPoint,
    unexplained,
    worth_of,
)
from stiffness.diagnosis.model_fit import ModelTerm, SelectionProblem, fit_model
from stiffness.diagnosis.relinearisation import (
    acts_on_others,
    changes_torques,
    is_load_of_one_axis,
)
from stiffness.diagnosis.search import (
    FORMS,
    Search,
    best_of_names,
    beyond_present_names,
    terms_of,
)
from stiffness.diagnosis.selection import (
    CLEAR,
    SURE,
    Pair,
    SelectedModel,
    exchange_search,
    fitted_jointly,
    searched_on,
)
from stiffness.regression.group_selection import (
    LIVE,
    exchange_worths,
    gains_beside,
)

MUCH_OPEN = 0.01
"""Share of the mismatch that a set does not explain on poses left out, from which loads
that are little like a term are tried in its place, too; chosen: a tenth of its
amplitude, squared."""
IMITATED = 0.5
"""Largest share of a term's gain that a load in its place may lose; chosen."""
MOST_LOADS = 6
"""Loads that are tried in place of terms, the most alike first; chosen for time."""
MOST_LAWS = 2
"""Laws of a gear that are tried with a load of its axis; chosen for time."""


def with_exchanges(model: SelectedModel, layout: Layout) -> SelectedModel:
    """Search again from a set with what imitates its names in their place.

    The search runs again under loads in the place of terms that all others do as well
    with, or terms in the place of loads that they do better with. At last a term of no
    name goes where the names of its gear do better without it. What surely predicts
    poses left out better is kept.

    Args:
        model: The set.
        layout: How columns are laid out.
    """
    tried = _exchange_step(layout, model)
    if tried.point is not None:
        refused = model.fit.names - tried.point.fit.names
        # what has no name there may be what came
        at = {where for _, where in refused}
        own = tried.point.fit.members
        first = tuple(m for m in own if not (m.is_generic and m.where in at))
        model = _better(model, searched_on(layout, tried.point, first, refused))
    model = _without_needless_terms(layout, model)
    return replace(model, exchange_losses=tried.losses)


def _without_needless_terms(layout: Layout, model: SelectedModel) -> SelectedModel:
    """Search again without a term of no name, where names of its gear do better so.

    It takes what a law of its gear leaves at a wrong shape, and holds it there.
    """
    case, members = model.case, model.fit.members
    worth = worth_of(model.fit, unexplained(case, model.fit), case.poses)
    for term in (m for m in members if _is_of_a_gear(m)):
        rest = [m for m in members if m.name != term.name]
        names = (m for m in rest if m.where == term.where and not m.is_generic)
        if not any("torque" in m.depends_on for m in names):
            continue
        point = fitted_jointly(layout, case, rest)
        if point.worth(case.poses) > worth + SURE:
            other = searched_on(layout, point, point.fit.members, [term.name])
            return _better(model, other)
    return model


def _better(model: SelectedModel, other: SelectedModel) -> SelectedModel:
    """Return the other set if it surely predicts poses left out better."""
    gained = 0.5 * (model.unexplained_square - other.unexplained_square)
    return other if gained > SURE else model


@dataclass(frozen=True, eq=False)
class _ExchangeStep:
    """A set with what came into the place of others, all fitted anew.

    Attributes:
        point: The set; None: nothing came.
        losses: By how much it is worth less with the second name of a pair in the place
            of the first.
    """

    point: OperatingPoint | None
    losses: Mapping[Pair, float]


def _exchange_step(layout: Layout, model: SelectedModel) -> _ExchangeStep:
    """Put loads in the place of terms that all do as well with; of loads, terms.

    Where much stays open, a load of one axis comes with a law of its gear, too, which
    feels it; in the place of what has no name there as well.
    """
    case, best, less = model.case, None, dict[Pair, float]()
    here, members, tried = case.situation, model.fit.members, _imitators(model)
    much = model.unexplained_square > CLEAR
    unknown = [m for m in members if much and _is_of_a_gear(m)]
    if not tried and not unknown:
        return _ExchangeStep(best, less)
    most = layout.fitted_jointly(case, model.fit).worth(case.poses)
    loaded = list[tuple[str, OperatingPoint]]()
    for pair in sorted(tried, key=lambda pair: tried[pair][0])[:MOST_LOADS]:
        name, other = pair[0], tried[pair][1]
        names = {member.name for member in members}
        if name not in names or other.name in names:
            continue
        some = [other if m.name == name else m for m in members]
        point = fitted_jointly(layout, case, some)
        found = point.worth(case.poses)
        less |= {(name, other.name): most - found, (other.name, name): found - most}
        if found > most + (-SURE if acts_on_others(here, other) else SURE):
            best, members, most = point, point.fit.members, found
        if is_load_of_one_axis(here, other):
            loaded.append((other.where, point))
    for term in unknown:
        load = load_of_axis(case, term.where)
        if load is not None and load.name not in {m.name for m in members}:
            rest = [m for m in members if m.name != term.name]
            loaded.append((term.where, fitted_jointly(layout, case, [*rest, load])))
    for where, point in loaded if much else ():
        for whole in _with_laws(layout, point, where, most):
            if whole.worth(case.poses) > most + SURE:
                best, most = whole, whole.worth(case.poses)
    return _ExchangeStep(best, less)


def _with_laws(
    layout: Layout, point: OperatingPoint, where: str, most: float
) -> Iterator[OperatingPoint]:
    """Yield a set with a load of an axis, and with one more law of its gear, fitted.

    Of laws that could make the set worth more than another. They do little in columns
    that are not laid out under the load. What has no name at the gear goes.

    Args:
        layout: How columns are laid out.
        point: The set with the load.
        where: The axis.
        most: What the other set is worth.
    """
    own = [m for m in point.fit.members if not (_is_of_a_gear(m) and m.where == where)]
    case = layout.at(point)
    fit = fit_model(case, beyond_present_names(own))
    worth = worth_of(fit, unexplained(case, fit), case.poses)
    for gain, law in laws_of_gear_beside(case, fit.members, where)[:MOST_LAWS]:
        if worth + 0.5 * gain > most:
            yield fitted_jointly(layout, case, [*fit.members, law])


def _is_of_a_gear(term: ModelTerm) -> bool:
    """Return whether a term has no name and depends on the torque of an axis."""
    return term.is_generic and "torque" in term.depends_on


def load_of_axis(case: SelectionProblem, where: str) -> ModelTerm | None:
    """Return the simplest load of an axis; None: there is none."""
    own = (term for term, _ in terms_of(case.library) if term.where == where)
    loads = [term for term in own if is_load_of_one_axis(case.situation, term)]
    return min(loads, key=lambda term: len(term.shape), default=None)


def laws_of_gear_beside(
    case: SelectionProblem, terms: Sequence[ModelTerm], where: str
) -> list[tuple[float, ModelTerm]]:
    """Return the laws of a gear that a set is without, what does most beside it first.

    Args:
        case: As laid out under the set.
        terms: The set.
        where: The axis.

    Returns:
        Of each law the whitened square that it explains, and its best shape.
    """
    search = Search.of(case, terms)
    held = {term.name for term in terms}
    gains = gains_beside(search.problem, range(len(terms)))
    every = (
        (float(gains[k]), search.terms[k]) for k in best_of_names(search.problem, gains)
    )
    return [
        (gain, term)
        for gain, term in every
        if term.where == where and "torque" in term.depends_on
        if term.name not in held and not term.is_generic
    ]


def _imitators(
    model: SelectedModel,
) -> dict[Pair, tuple[float, ModelTerm]]:
    """Return the loads that do best alone what each term does; of loads a term, too.

    The best of all and the best of a single axis, each with what it does less. A load:
    no more than what stays unexplained, which what it does to others may make up for;
    where that is little, than half of it all.
    """
    found = dict[Pair, tuple[float, ModelTerm]]()
    here, members = model.case.situation, model.fit.members
    left = 0.5 * max(model.unexplained_square, 0.0)
    asked = [m for m in members if left or changes_torques(here, m)]
    if not asked:
        return found
    search = exchange_search(model)
    acting = [acts_on_others(here, term) for term in search.terms]
    every_term = zip(search.terms, acting, strict=True)
    on_axis = [acts and is_load_of_one_axis(here, term) for term, acts in every_term]
    no_load = [not acts for acts in acting]
    for member in asked:
        every = exchange_worths(search.problem, range(len(members)), member.name)
        alone = {n: w + every.price[n] for n, w in every.worth.items()}
        rest = [j for j, other in enumerate(members) if other is not member]
        gains = gains_beside(search.problem, rest)
        gain, of_load = alone[member.name] - every.none, left
        if model.share > 1.0 - MUCH_OPEN:
            of_load = min(left, IMITATED * gain)
        of_term = max(LIVE, FORMS * gain) if changes_torques(here, member) else 0.0
        for some, most in ((acting, of_load), (on_axis, of_load), (no_load, of_term)):
            alike = [
                (alone[term.name], float(gain), term)
                for gain, term, tried in zip(gains, search.terms, some, strict=True)
                if tried and term.name != member.name and term.name in alone
            ]
            best = max(alike, key=lambda one: one[:2], default=None)
            less = np.inf if best is None else alone[member.name] - best[0]
            if best is not None and less < most:
                found[member.name, best[2].name] = less, best[2]
    return found
