"""Selection of groups of columns on normal equations alone, without a limit of size.

Columns come in groups; groups that share a name are shapes of one law. A set of groups
is worth what it explains less its size. The search adds, drops and exchanges groups
until nothing raises that worth; a gate on observations that were left out follows.

==========  ==========================================================================
Equation    worth(S) = gain(S) / 2 - (rank + shapes) ln(n) / 2 + sum over names of log
            prior + sum over effects of ln [B(c + m, c N + M - m) / B(c, c N + M)]; gain
            = b_S' G_SS^+ b_S with the nominal columns projected out, n the units of
            information, N names, of an effect m named of M sites, c = `COMMON`
Source      unit-information prior: Kass and Wasserman 1995; forward selection with
            exchange: Miller 2002, "Subset Selection in Regression", 2nd ed., chapter 3;
            groups: Yuan and Lin 2006; names: Scott and Berger 2010, "Bayes and
            empirical-Bayes multiplicity adjustment", an inclusion rate for each effect
Valid       a set of less rank than its units of information
Ignores     priors of shapes beyond their count; that errors may be misstated
==========  ==========================================================================

Adding a group is a step of block Gram-Schmidt on the Gram matrix. Leaving one out gives
back the one direction of the span that no other group has, so every exchange is tried
without factorising anew.

==========  ==========================================================================
Equation    X_S = Q R; the rows of R^-1 that belong to a group span what it alone
            explains: u = orth(rows), gain falls by |u'y|^2, y = Q'b
Source      updating a QR factorisation: Golub and Van Loan 2013, "Matrix
            Computations", 4th ed., 6.5
Valid       groups whose directions survive in the set by more than `SURVIVES`
Ignores     nothing: else the set is factorised anew
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import qr
from scipy.special import betaln

from stiffness.regression.elimination import projection_coefficients, schur_complement
from stiffness.regression.predictive_gate import Decision, Name

SURVIVES = 1e-7
"""Share of a direction's raw information that must survive what is known; chosen: ten
thousand times above what rounding leaves of a hundred columns."""
RISES = 1e-6
"""By how much the worth must rise for a change; chosen: rounding is below."""
MANY_COLUMNS, AT_MOST_FOR_ONE = 3, 4
"""Columns of a name from which several others are tried in its place, and how many;
chosen: a length, a mass or a drift imitates two or three offsets."""
COMMON = 0.05
"""First parameter of the Beta prior of how often an effect occurs at its sites; its
mean is one in all names. Chosen: one name of an effect makes it ten times as likely at
its other sites, as gears of one arm are alike."""
ROUNDS = 50
"""Rounds of drops, exchanges and additions at most; a few do."""


# --- Groups --------------------------------------------------------------------------


@dataclass(frozen=True)
class ColumnGroup:
    """Columns that come in together.

    Attributes:
        name: Of the law; groups of one name are shapes of it.
        columns: Their numbers.
        shape_parameters: How many numbers the shape has that were searched.
        log_prior: How much rarer than others the name is, as a log.
    """

    name: Name
    columns: Int[np.ndarray, " columns"]
    shape_parameters: int = 0
    log_prior: float = 0.0


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


# --- Normal equations beyond the nominal columns --------------------------------------


@dataclass(frozen=True, eq=False)
class GroupProblem:
    """Normal equations of all groups, nominal columns projected out, columns scaled.

    Attributes:
        gram: Of the groups' columns, each scaled to a raw information of one.
        score: The same.
        groups: With numbers of columns as they stand here.
        units: How many units of information there are.
    """

    gram: Float[np.ndarray, "columns columns"]
    score: Float[np.ndarray, " columns"]
    groups: tuple[ColumnGroup, ...]
    units: int

    @classmethod
    def of(
        cls,
        gram: Float[np.ndarray, "all all"],
        score: Float[np.ndarray, " all"],
        raw: Float[np.ndarray, " all"],
        nominal: Int[np.ndarray, " nominal"],
        groups: Sequence[ColumnGroup],
        units: int,
    ) -> "GroupProblem":
        """Project nominal columns out and scale the others.

        Args:
            gram: X' S^-1 X of all columns.
            score: X' S^-1 y.
            raw: Information of each column before anything was projected out.
            nominal: Columns that explain for free.
            groups: What may be selected.
            units: Independent observations, such as poses.
        """
        used = [group.columns for group in groups]
        columns = np.concatenate([np.zeros(0, dtype=int), *used])
        live = raw > 0.0
        scale = np.where(live, 1.0 / np.sqrt(np.where(live, raw, 1.0)), 0.0)
        gram = gram * scale * scale[:, None]
        score = score * scale
        share = projection_coefficients(gram, nominal)
        inner = schur_complement(gram, nominal, share, columns)
        asked = score[columns] - score[nominal] @ share[:, columns]
        ends = np.cumsum([0, *(len(c) for c in used)])
        own = tuple(
            ColumnGroup(g.name, np.arange(a, b), g.shape_parameters, g.log_prior)
            for g, a, b in zip(groups, ends[:-1], ends[1:], strict=True)
        )
        return cls(0.5 * (inner + inner.T), asked, own, units)

    @cached_property
    def names(self) -> tuple[Name, ...]:
        """All names, each once."""
        return tuple(dict.fromkeys(group.name for group in self.groups))

    @cached_property
    def number_of_name(self) -> Int[np.ndarray, " groups"]:
        """Number of each group's name."""
        number = {name: k for k, name in enumerate(self.names)}
        return np.array([number[group.name] for group in self.groups], dtype=int)

    @cached_property
    def by_width(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Groups of equal width: their numbers, and their columns, one group a row."""
        width = np.array([len(group.columns) for group in self.groups], dtype=int)
        found = []
        for w in np.unique(width[width > 0]):
            some = np.flatnonzero(width == w)
            found.append((some, np.stack([self.groups[k].columns for k in some])))
        return tuple(found)

    @cached_property
    def kind_of_name(self) -> Int[np.ndarray, " names"]:
        """Number of the effect of each name, wherever it is."""
        number = {
            kind: k for k, kind in enumerate(dict.fromkeys(n[0] for n in self.names))
        }
        return np.array([number[name[0]] for name in self.names], dtype=int)

    @cached_property
    def sites_of_kind(self) -> Int[np.ndarray, " kinds"]:
        """How many names each effect has."""
        return np.bincount(self.kind_of_name)

    def named_of_kind(self, groups: Sequence[int]) -> Int[np.ndarray, " kinds"]:
        """Return how many names of each effect a set has."""
        named = np.unique(self.number_of_name[list(groups)])
        return np.bincount(self.kind_of_name[named], minlength=len(self.sites_of_kind))

    def prices(self, groups: Sequence[int]) -> Float[np.ndarray, " groups"]:
        """Return what each group's name costs beside a set that has it not.

        Args:
            groups: The set.
        """
        count = self.named_of_kind(groups)
        rest = np.maximum(self.sites_of_kind - count - 1, 0) + COMMON * len(self.names)
        price = np.log(rest / (COMMON + count))[self.kind_of_name[self.number_of_name]]
        return price - np.array([group.log_prior for group in self.groups])

    @cached_property
    def shape_parameters(self) -> Int[np.ndarray, " groups"]:
        """How many shape parameters each group has."""
        return np.array([g.shape_parameters for g in self.groups], dtype=int)

    def price(self, groups: Sequence[int], rank: int) -> float:
        """Return what the size of a set costs.

        Args:
            groups: The set.
            rank: Of its columns together.
        """
        first = {self.groups[k].name: k for k in reversed(groups)}
        rarer = sum(self.groups[k].log_prior for k in first.values())
        named, sites = self.named_of_kind(groups), self.sites_of_kind
        absent = COMMON * len(self.names)
        odds = betaln(COMMON + named, absent + sites - named)
        chosen = float(np.sum(betaln(COMMON, absent + sites) - odds))
        numbers = rank + int(self.shape_parameters[list(groups)].sum())
        return 0.5 * numbers * np.log(self.units) + chosen - rarer


@dataclass(frozen=True, eq=False)
class FactorisedSet:
    """A set of groups with an orthonormal basis Q of its span.

    Attributes:
        groups: In the order of the basis.
        rows: Q'X of every column.
        aim: Q'y.
        upper: R of the groups' own directions; None where some do not survive.
        ends: Where each group's rows begin, and the end.
    """

    groups: tuple[int, ...]
    rows: Float[np.ndarray, "rank columns"]
    aim: Float[np.ndarray, " rank"]
    upper: Float[np.ndarray, "rank rank"] | None
    ends: Int[np.ndarray, " _"]

    @classmethod
    def of(cls, problem: GroupProblem, groups: Sequence[int]) -> "FactorisedSet":
        """Factorise a set, group by group; what adds no direction counts nothing."""
        width = sum(len(problem.groups[k].columns) for k in groups)
        rows, aim = np.zeros((width, len(problem.score))), np.zeros(width)
        ends, turns, whole = [0], [], True
        for k in groups:
            own, at = problem.groups[k].columns, ends[-1]
            before, known = rows[:at], rows[:at, own]
            inner = problem.gram[np.ix_(own, own)] - known.T @ known
            value, vector = np.linalg.eigh(inner)
            keep = value > SURVIVES * len(own)
            whole = whole and bool(keep.all())
            turn = vector[:, keep] / np.sqrt(value[keep])
            end = at + turn.shape[1]
            rows[at:end] = turn.T @ (problem.gram[own] - known.T @ before)
            aim[at:end] = turn.T @ (problem.score[own] - known.T @ aim[:at])
            ends.append(end)
            turns.append(own)
        end = ends[-1]
        rows, aim = rows[:end], aim[:end]
        upper = None
        if whole and groups:
            upper = rows[:, np.concatenate(turns)]
        return cls(tuple(groups), rows, aim, upper, np.array(ends))

    @property
    def gain(self) -> float:
        """Whitened square that the set explains."""
        return float(self.aim @ self.aim)

    @cached_property
    def inverse(self) -> Float[np.ndarray, "rank rank"] | None:
        """R^-1, where every group's directions survive."""
        if self.upper is None:
            return None
        upper = self.upper.copy()
        for a, b in zip(self.ends[:-1], self.ends[1:], strict=True):
            upper[b:, a:b] = 0.0  # orthogonal but for rounding
        return np.linalg.inv(upper)

    def own_directions(self, places: Sequence[int]) -> np.ndarray | None:
        """Return the directions of the basis that these groups alone explain.

        Args:
            places: Places of the groups in the set.
        """
        if self.inverse is None:
            return None
        rows = np.concatenate([np.arange(*self.ends[p : p + 2]) for p in places])
        return np.asarray(qr(self.inverse[rows].T, mode="economic")[0])


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
        A set that no group's leaving, coming or exchange makes worth more.
    """
    groups = tuple(start)
    for _ in range(ROUNDS):
        before = groups
        groups = _grown(problem, groups)
        groups = _with_exchanges(problem, _pruned(problem, groups))
        groups = _with_several_for_one(problem, groups)
        if groups == before:
            break
    here = FactorisedSet.of(problem, groups)
    worth = _worth(problem, here)
    decisions = _decisions(problem, here, worth)
    return GroupSelection(groups, here.gain, worth, decisions)


def _worth(problem: GroupProblem, here: FactorisedSet) -> float:
    return 0.5 * here.gain - problem.price(here.groups, len(here.aim))


def _residual(problem: GroupProblem, here: FactorisedSet) -> Residual:
    """Return what a set leaves of every group."""
    score = problem.score - here.aim @ here.rows
    blocks = []
    for _, index in problem.by_width:
        inner = problem.gram[index[:, :, None], index[:, None, :]]
        known = np.moveaxis(here.rows[:, index], 0, 1)  # (groups, rank, width)
        blocks.append(inner - known.swapaxes(1, 2) @ known)
    return Residual(here.groups, _worth(problem, here), score, tuple(blocks))


def _residual_without(
    problem: GroupProblem, here: FactorisedSet, whole: Residual, places: Sequence[int]
) -> Residual:
    """Return what a set leaves once some of its groups have gone."""
    rest = tuple(k for p, k in enumerate(here.groups) if p not in places)
    own = here.own_directions(places)
    if own is None:
        return _residual(problem, FactorisedSet.of(problem, rest))
    rows, aim = own.T @ here.rows, own.T @ here.aim
    blocks = []
    for (_, index), block in zip(problem.by_width, whole.blocks, strict=True):
        back = np.moveaxis(rows[:, index], 0, 1)
        blocks.append(block + back.swapaxes(1, 2) @ back)
    gain, rank = here.gain - float(aim @ aim), len(here.aim) - len(aim)
    worth = 0.5 * gain - problem.price(rest, rank)
    return Residual(rest, worth, whole.score + aim @ rows, tuple(blocks))


def _worth_without(
    problem: GroupProblem, here: FactorisedSet, places: Sequence[int]
) -> float:
    """Return what a set is worth once some of its groups have gone."""
    rest = [k for p, k in enumerate(here.groups) if p not in places]
    own = here.own_directions(places)
    if own is None:
        return _worth(problem, FactorisedSet.of(problem, rest))
    lost = float(np.sum((own.T @ here.aim) ** 2))
    rank = len(here.aim) - own.shape[1]
    return 0.5 * (here.gain - lost) - problem.price(rest, rank)


def _additions(problem: GroupProblem, left: Residual) -> Float[np.ndarray, " groups"]:
    """Return by how much the worth rises with each group; less than 0: it falls."""
    rise = np.full(len(problem.groups), -np.inf)
    for (some, index), block in zip(problem.by_width, left.blocks, strict=True):
        value, vector = np.linalg.eigh(block)
        keep = value > SURVIVES * index.shape[1]
        asked = (vector.swapaxes(1, 2) @ left.score[index][..., None])[..., 0]
        gain = np.where(keep, asked**2 / np.where(keep, value, 1.0), 0.0).sum(axis=1)
        numbers = keep.sum(axis=1) + problem.shape_parameters[some]
        paid = 0.5 * numbers * np.log(problem.units)
        rise[some] = np.where(keep.any(axis=1), 0.5 * gain - paid, -np.inf)
    known = np.zeros(len(problem.names), dtype=bool)
    known[problem.number_of_name[list(left.groups)]] = True
    known_name = known[problem.number_of_name]
    rise -= np.where(known_name, 0.0, problem.prices(left.groups))
    rise[list(left.groups)] = -np.inf
    return rise


def _grown(problem: GroupProblem, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Add the group that is worth most, as long as one is worth anything."""
    while len(groups) < len(problem.groups):
        left = _residual(problem, FactorisedSet.of(problem, groups))
        rise = _additions(problem, left)
        best = int(np.argmax(rise))
        if rise[best] <= RISES:
            break
        groups = (*groups, best)
    return groups


def _pruned(problem: GroupProblem, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Drop whole names, then single groups, the least worth first."""
    while groups:
        here = FactorisedSet.of(problem, groups)
        worth = _worth(problem, here)
        ways = [*_places_of_names(problem, groups).values()]
        ways += [[p] for p in range(len(groups)) if [p] not in ways]
        after = [_worth_without(problem, here, places) for places in ways]
        best = int(np.argmax(after))
        if after[best] <= worth + RISES:
            break
        groups = tuple(k for p, k in enumerate(groups) if p not in ways[best])
    return groups


def _with_exchanges(problem: GroupProblem, groups: tuple[int, ...]) -> tuple[int, ...]:
    """Put the best group in each one's place, where that is worth more."""
    if not groups:
        return groups
    here = FactorisedSet.of(problem, groups)
    whole = _residual(problem, here)
    for k in groups:
        place = here.groups.index(k)
        rest = _residual_without(problem, here, whole, [place])
        rise = _additions(problem, rest)
        best = int(np.argmax(rise))
        if best != k and rest.worth + max(rise[best], 0.0) > whole.worth + RISES:
            more = (best,) if rise[best] > 0.0 else ()
            here = FactorisedSet.of(problem, (*rest.groups, *more))
            whole = _residual(problem, here)
            if not here.groups:
                break
    return here.groups


def _with_several_for_one(
    problem: GroupProblem, groups: tuple[int, ...]
) -> tuple[int, ...]:
    """Put several names in the place of one of many columns, where that is worth more.

    What many columns imitate can be several names, none of which alone does as well.
    """
    worth = _worth(problem, FactorisedSet.of(problem, groups))
    for k in groups:
        if k not in groups or len(problem.groups[k].columns) < MANY_COLUMNS:
            continue
        name = problem.groups[k].name
        tried = tuple(g for g in groups if problem.groups[g].name != name)
        for _ in range(AT_MOST_FOR_ONE):
            left = _residual(problem, FactorisedSet.of(problem, tried))
            rise = _additions(problem, left)
            rise[[len(g.columns) >= MANY_COLUMNS for g in problem.groups]] = -np.inf
            best = int(np.argmax(rise))
            if rise[best] <= RISES:
                break
            tried = (*tried, best)
            after = left.worth + float(rise[best])
            if after > worth + RISES:
                groups, worth = tried, after
                break
    return groups


@dataclass(frozen=True)
class Exchanges:
    """What a set is worth with another name, or none, in the place of one.

    Attributes:
        worth: With each name.
        none: With none.
        price: Part of it that is prior: what each name costs beside the rest.
    """

    worth: dict[Name, float]
    none: float
    price: dict[Name, float]


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
            together what one imitates.

    Returns:
        With the best group of each name that the rest has not, the name itself among
        them.
    """
    here = FactorisedSet.of(problem, groups)
    whole = _residual(problem, here)
    places = _places_of_names(problem, here.groups)
    rest = _residual_without(problem, here, whole, places[name])
    beside = _best_of_names(problem, _additions(problem, whole))
    rise = _additions(problem, rest)
    instead = _best_of_names(problem, rise)
    found = {
        other: rest.worth + more - max(beside[other], 0.0)
        for other, more in instead.items()
        if other not in places
    }
    found[name] = max(whole.worth, rest.worth + instead[name])
    close = [n for n, w in found.items() if n != name and w > found[name] - live]
    of_name = problem.number_of_name == problem.names.index(name)
    for other in close:
        own = problem.number_of_name == problem.names.index(other)
        best = int(np.argmax(np.where(own, rise, -np.inf)))
        with_it = FactorisedSet.of(problem, [*rest.groups, best])
        more = np.where(
            of_name, -np.inf, _additions(problem, _residual(problem, with_it))
        )
        found[other] += max(float(more.max()), 0.0)
    price = _best_of_names(problem, problem.prices(rest.groups))
    return Exchanges(found, rest.worth, {other: price[other] for other in found})


def best_groups_beside(problem: GroupProblem, groups: Sequence[int]) -> dict[Name, int]:
    """Return of each name that a set has not the group that would do most beside it."""
    here = FactorisedSet.of(problem, groups)
    rise = _additions(problem, _residual(problem, here))
    held, best = _places_of_names(problem, groups), dict[Name, int]()
    for k in np.argsort(-rise, kind="stable"):
        if np.isfinite(rise[k]) and problem.groups[k].name not in held:
            best.setdefault(problem.groups[k].name, int(k))
    return best


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


def _decisions(
    problem: GroupProblem, here: FactorisedSet, worth: float
) -> tuple[Decision, ...]:
    """State of every name what the set is worth with it, over without it."""
    found = {}
    places = _places_of_names(problem, here.groups)
    for name, own in places.items():
        found[name] = worth - _worth_without(problem, here, own)
    rise = _additions(problem, _residual(problem, here))
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
            else "what it explains beside the set is not worth its size",
        )
        for name in problem.names
    )
