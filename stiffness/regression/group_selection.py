"""Selection of groups of columns on normal equations alone, without a limit of size.

A set of groups is worth what it explains less its size. The search adds, drops and
exchanges groups until nothing raises that worth; a gate on observations that were left
out follows.

==========  ==========================================================================
Equation    worth(S) = gain(S) / 2 - price(S); gain = b_S' G_SS^+ b_S with the nominal
            columns projected out; price: `regression.group_sets`
Source      forward selection with exchange: Miller 2002, "Subset Selection in
            Regression", 2nd ed., chapter 3; groups: Yuan and Lin 2006
Valid       a set of less rank than its units of information
Ignores     that errors may be misstated
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.regression.group_sets import (
    SURVIVES,
    FactorisedSet,
    GroupProblem,
    ReducedSet,
)
from stiffness.regression.predictive_gate import Decision, Name

RISES = 0.01
"""By how much the worth must rise for a change; chosen: a factor of 1.01 of probability
is no reason, and of 10^6 that a strong mechanism is worth rounding stays below."""
MANY_COLUMNS, AT_MOST_FOR_ONE = 3, 4
"""Columns of a name from which several others are tried in its place, and how many;
chosen: a length, a mass or a drift imitates two or three offsets."""
TOGETHER = 2.0
"""By how much more several groups may explain together than each alone, as a factor;
chosen: what one of many columns imitates rarely cancels between its causes."""
MOST_SHAPES = 3
"""Groups of one name in a set at most; chosen: more of them follow what is no law."""
OF_AN_ARM = 40
"""Groups that a set may have however few units there are; chosen: an arm of six axes
whose gears, bearings and links all err has as many."""
LIVE = 12.0
"""Log Bayes factor within which another name is tried at fine shapes in the place of a
name of the set; chosen: refining a coarse shape rarely gains more."""
ROUNDS = 50
"""Rounds of drops, exchanges and additions at most; a few do."""


@dataclass(frozen=True)
class GroupSelection:
    """A set of groups that no single change makes worth more.

    Attributes:
        groups: Numbers of the groups, in the order of their coming in.
        gain: Whitened square that they explain beyond the nominal columns.
        log_evidence: Their worth; 0 for none.
        decisions: On every name, by its own worth beside the others of the set.
    """

    groups: tuple[int, ...]
    gain: float
    log_evidence: float
    decisions: tuple[Decision, ...]


# --- Search ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Residual:
    """Normal equations of every group with a set projected out.

    Attributes:
        groups: The set.
        worth: Of the set.
        score: Of each column.
        blocks: Gram matrix of each group beside the set, by width.
    """

    groups: tuple[int, ...]
    worth: float
    score: Float[np.ndarray, " columns"]
    blocks: tuple[Float[np.ndarray, "_ _ _"], ...]


def select_groups(problem: GroupProblem, start: Sequence[int] = ()) -> GroupSelection:
    """Search the set that is worth most.

    Args:
        problem: The normal equations.
        start: A set to begin with, such as the last solution.

    Returns:
        A set that no group's leaving, coming or exchange makes worth more; of as many
        groups as a set may have, one that no group's leaving does.
    """
    groups = tuple(start)
    for _ in range(ROUNDS):
        before = groups
        grown = _grown(problem, groups)
        groups = _pruned(problem, grown)
        if len(grown) >= _most(problem):
            break
        groups = _with_exchanges(problem, groups)
        groups = _with_several_for_one(problem, groups)
        if groups == before:
            break
    here = FactorisedSet.of(problem, groups)
    decisions = _decisions(here)
    return GroupSelection(groups, here.gain, here.worth, decisions)


def first_of_best(values: Float[np.ndarray, " n"], slack: float = RISES) -> int:
    """Return the number of the first value that is the largest but for some slack.

    Of two laws that nothing tells apart, rounding would choose: another on each kind of
    processor.
    """
    return int(np.argmax(values >= np.max(values) - slack))


def _residual(here: FactorisedSet) -> Residual:
    """Return what a set leaves of every group."""
    problem = here.problem
    score = problem.score - here.aim @ here.rows
    blocks = []
    for _, index in problem.by_width:
        inner = problem.gram[index[:, :, None], index[:, None, :]]
        known = np.moveaxis(here.rows[:, index], 0, 1)  # (groups, rank, width)
        blocks.append(inner - known.swapaxes(1, 2) @ known)
    return Residual(here.groups, here.worth, score, tuple(blocks))


def _residual_without(
    here: FactorisedSet, whole: Residual, less: ReducedSet
) -> Residual:
    """Return what a set leaves once some of its groups have gone."""
    rows, aim = less.directions.T @ here.rows, less.directions.T @ here.aim
    blocks = []
    for (_, index), block in zip(here.problem.by_width, whole.blocks, strict=True):
        back = np.moveaxis(rows[:, index], 0, 1)
        blocks.append(block + back.swapaxes(1, 2) @ back)
    score = whole.score + aim @ rows
    return Residual(less.groups, less.worth, score, tuple(blocks))


def gains_beside(
    problem: GroupProblem, groups: Sequence[int]
) -> Float[np.ndarray, " groups"]:
    """Return the whitened square that each group explains beside a set."""
    left = _residual(FactorisedSet.of(problem, groups))
    return _chi_square_gains(problem, left)[0]


def _chi_square_gains(
    problem: GroupProblem, left: Residual
) -> tuple[Float[np.ndarray, " groups"], Int[np.ndarray, " groups"]]:
    """Return what each group explains beside a set, and along how many directions."""
    gain, rank = np.zeros(len(problem.groups)), np.zeros(len(problem.groups), dtype=int)
    for (some, index), block in zip(problem.by_width, left.blocks, strict=True):
        unit = problem.unit[index]
        value, vector = np.linalg.eigh(block * unit[:, None] * unit[:, :, None])
        keep = value > SURVIVES * index.shape[1]
        aimed = (unit * left.score[index])[..., None]
        asked = (vector.swapaxes(1, 2) @ aimed)[..., 0]
        own = np.where(keep, asked**2 / np.where(keep, value, 1.0), 0.0)
        gain[some] = own.sum(axis=1)
        rank[some] = problem.counts(value, index).sum(axis=1)
    return gain, rank


def _additions(problem: GroupProblem, left: Residual) -> Float[np.ndarray, " groups"]:
    """Return by how much the worth rises with each group; less than 0: it falls."""
    return _rises(problem, left, *_chi_square_gains(problem, left))


def _rises(
    problem: GroupProblem,
    left: Residual,
    gain: Float[np.ndarray, " groups"],
    rank: Int[np.ndarray, " groups"],
) -> Float[np.ndarray, " groups"]:
    """Return the same from what each group explains, and along how many directions."""
    rise = np.where(rank > 0, 0.5 * gain - _size_costs(problem, rank), -np.inf)
    own = problem.number_of_name[list(left.groups)]
    shapes = np.bincount(own, minlength=len(problem.names))[problem.number_of_name]
    rise -= np.where(shapes > 0, 0.0, problem.prices(left.groups))
    rise[shapes >= MOST_SHAPES] = -np.inf
    rise[list(left.groups)] = -np.inf
    return rise


def _size_costs(
    problem: GroupProblem, rank: Int[np.ndarray, " groups"]
) -> Float[np.ndarray, " groups"]:
    """Return what the numbers of each group cost: its directions and its shapes."""
    return 0.5 * (rank + problem.shape_parameters) * np.log(problem.units)


def _most(problem: GroupProblem) -> int:
    """Return how many groups a set may have."""
    return max(problem.units, OF_AN_ARM)


def _grown(problem: GroupProblem, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Add the group that is worth most, as long as one is worth anything.

    Not beyond as many as there are units, by which they are judged, or as an arm has.
    """
    here = FactorisedSet.of(problem, groups)
    while len(here.groups) < min(len(problem.groups), _most(problem)):
        rise = _additions(problem, _residual(here))
        best = first_of_best(rise)
        if rise[best] <= RISES:
            break
        here = FactorisedSet.of(problem, [best], here)
    return here.groups


def _pruned(problem: GroupProblem, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Drop whole names, then single groups, the least worth first."""
    here = FactorisedSet.of(problem, groups)
    while (less := _with_one_dropped(here)) is not None:
        here = less
    return here.groups


def _with_one_dropped(here: FactorisedSet) -> FactorisedSet | None:
    """Return a set without the name or group that is least worth; None: all are worth.

    Of columns that are nearly multiples of others a set is worth less without some than
    the reduced set says: each drop is made, and taken back where the worth falls.
    """
    ways = [*_places_of_names(here.problem, here.groups).values()]
    ways += [[p] for p in range(len(here.groups)) if [p] not in ways]
    after = np.array([here.reduced(places).worth for places in ways])
    least = here.worth + RISES
    while len(after) and after[best := first_of_best(after)] > least:
        rest = [k for p, k in enumerate(here.groups) if p not in ways[best]]
        less = FactorisedSet.of(here.problem, rest)
        if less.worth > least:
            return less
        after[best] = -np.inf
    return None


def _with_exchanges(problem: GroupProblem, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Put the best group in each one's place, where that is worth more."""
    if not groups:
        return groups
    here = FactorisedSet.of(problem, groups)
    whole = _residual(here)
    for k in groups:
        place = here.groups.index(k)
        rest = _residual_without(here, whole, here.reduced([place]))
        rise = _additions(problem, rest)
        best = first_of_best(rise)
        if best != k and rest.worth + max(rise[best], 0.0) > whole.worth + RISES:
            more = (best,) if rise[best] > 0.0 else ()
            other = FactorisedSet.of(problem, (*rest.groups, *more))
            if other.worth <= whole.worth + RISES:
                continue
            here, whole = other, _residual(other)
            if not here.groups:
                break
    return here.groups


def _with_several_for_one(
    problem: GroupProblem, groups: tuple[int, ...]
) -> tuple[int, ...]:
    """Put several names in the place of one of many columns, where that is worth more.

    What many columns imitate can be several names, none of which alone does as well.
    """
    here = FactorisedSet.of(problem, groups)
    whole = _residual(here)
    wide = np.array([len(g.columns) >= MANY_COLUMNS for g in problem.groups])
    for k in groups:
        if k not in here.groups or not wide[k]:
            continue
        own = _places_of_names(problem, here.groups)[problem.groups[k].name]
        left, tried = _residual_without(here, whole, here.reduced(own)), None
        for _ in range(AT_MOST_FOR_ONE):
            rise = np.where(wide, -np.inf, _additions(problem, left))
            best = first_of_best(rise)
            most = np.sort(rise)[-AT_MOST_FOR_ONE:]
            hoped = left.worth + TOGETHER * float(most[most > 0.0].sum())
            if rise[best] <= RISES or hoped <= whole.worth + RISES:
                break
            tried = tried or FactorisedSet.of(problem, left.groups)
            tried = FactorisedSet.of(problem, [best], tried)
            left = _residual(tried)
            if left.worth > whole.worth + RISES:
                here, whole = tried, left
                break
    return here.groups


@dataclass(frozen=True)
class Exchanges:
    """What a set is worth with another name, or none, in the place of one.

    Attributes:
        worth: With each name.
        none: With none.
        price: Part of it that is prior: what each name costs beside the rest.
        size: Part of it that each name's numbers cost, without what it grows by.
    """

    worth: dict[Name, float]
    none: float
    price: dict[Name, float]
    size: dict[Name, float]


def exchange_worths(
    problem: GroupProblem, groups: Sequence[int], name: Name, live: float = 0.0
) -> Exchanges:
    """Return what a set is worth with each other name, or none, in the place of one.

    What another name would explain beside the whole set is no reason to exchange, and
    is taken off.

    Args:
        problem: The normal equations.
        groups: The set.
        name: Which of its names gives way.
        live: By how much a name may trail and grow by one more: two names may do
            together what one imitates. What the two do beside the whole set is taken
            off, too.

    Returns:
        With the best group of each name that the rest has not, the name itself among
        them.
    """
    here = FactorisedSet.of(problem, groups)
    whole = _residual(here)
    places = _places_of_names(problem, here.groups)
    rest = _residual_without(here, whole, here.reduced(places[name]))
    beside = _best_of_names(problem, _additions(problem, whole))
    anyway = np.array([max(beside[other], 0.0) for other in problem.names])
    gain, rank = _chi_square_gains(problem, rest)
    rise = _rises(problem, rest, gain, rank)
    instead = _best_of_names(problem, rise)
    found = {
        other: rest.worth + more - max(beside[other], 0.0)
        for other, more in instead.items()
        if other not in places
    }
    found[name] = max(whole.worth, rest.worth + instead[name])
    without = FactorisedSet.of(problem, rest.groups)
    close = [n for n, w in found.items() if n != name and w > found[name] - live]
    number, asked = problem.number_of_name, problem.names.index(name)
    prices = _best_of_names(problem, problem.prices(rest.groups))
    price = {other: prices[other] for other in found}
    costs = _size_costs(problem, rank)
    size = {n: float(costs[_best_group(problem, rise, n)]) for n in found}
    for other in close:
        best = _best_group(problem, rise, other)
        pair = _residual(FactorisedSet.of(problem, [best], without))
        both = _residual(FactorisedSet.of(problem, [best], here))
        own = _best_of_names(problem, _additions(problem, both))
        alone = both.worth - whole.worth + np.array([own[n] for n in problem.names])
        off = np.maximum(np.maximum(alone, anyway), beside[other])[number]
        grown = pair.worth + _additions(problem, pair) - off
        grown = np.where(number == asked, -np.inf, grown)
        found[other] = max(found[other], float(grown.max()))
    return Exchanges(found, rest.worth, price, size)


def best_groups_beside(problem: GroupProblem, groups: Sequence[int]) -> dict[Name, int]:
    """Return of each name that a set has not the group that would do most beside it.

    The first group of a name that adds no direction at all to the set's.
    """
    here = FactorisedSet.of(problem, groups)
    rise = _additions(problem, _residual(here))
    held, best = _places_of_names(problem, groups), dict[Name, int]()
    for k in np.argsort(-rise, kind="stable"):
        if k not in here.groups and problem.groups[k].name not in held:
            best.setdefault(problem.groups[k].name, int(k))
    return best


def _best_group(
    problem: GroupProblem, rise: Float[np.ndarray, " groups"], name: Name
) -> int:
    """Return the number of a name's group of the largest value."""
    own = problem.number_of_name == problem.names.index(name)
    return first_of_best(np.where(own, rise, -np.inf))


def _best_of_names(
    problem: GroupProblem, rise: Float[np.ndarray, " groups"]
) -> dict[Name, float]:
    """Return the largest value over the groups of each name."""
    best = np.full(len(problem.names), -np.inf)
    np.maximum.at(best, problem.number_of_name, rise)
    return dict(zip(problem.names, (float(b) for b in best), strict=True))


def _places_of_names(
    problem: GroupProblem, groups: Sequence[int]
) -> dict[Name, list[int]]:
    """Return the places of each name's groups in a set."""
    places: dict[Name, list[int]] = {}
    for p, k in enumerate(groups):
        places.setdefault(problem.groups[k].name, []).append(p)
    return places


def _decisions(here: FactorisedSet) -> tuple[Decision, ...]:
    """State of every name what the set is worth with it, over without it."""
    problem, found = here.problem, {}
    places = _places_of_names(problem, here.groups)
    for name, own in places.items():
        found[name] = here.worth - here.reduced(own).worth
    rise = _additions(problem, _residual(here))
    for name, best in _best_of_names(problem, rise).items():
        found.setdefault(name, best)
    return tuple(
        Decision(
            name,
            "log_evidence",
            name in places,
            float(found[name]),
            0.0,
            "the set is worth more with it"
            if name in places
            else "beside the other names it explains less than its own numbers cost",
        )
        for name in problem.names
    )
