"""Normal equations of groups of columns, and sets of them with a basis of their span.

Columns come in groups; groups that share a name are shapes of one law.

==========  ==========================================================================
Equation    price(S) = (rank + shapes) ln(n) / 2 - sum over names of log prior - sum
            over kinds of ln [B(c + m, c N + M - m) / B(c, c N + M)]; n the units of
            information, N names, of a kind m named of M sites, c = `COMMON`
Source      unit-information prior: Kass and Wasserman 1995; names: Scott and Berger
            2010, "Bayes and empirical-Bayes multiplicity adjustment", an inclusion rate
            for each kind of effect
Valid       a set of less rank than its units of information
Ignores     priors of shapes beyond their count; that errors may be misstated; the cost
            of a direction of which the units say less than its prior
==========  ==========================================================================

Adding a group is a step of block Gram-Schmidt on the Gram matrix. Leaving one out gives
back the directions of the span that no other group has, so every exchange is tried
without factorising anew.

==========  ==========================================================================
Equation    X_S = Q A, A' = H T with H'H = 1 (QR); what a group g alone explains is u =
            orth(T^-1 w), w the right singular vectors of H_g whose leverage, the
            squared singular value, is one: A_h' u = 0 for every other group h; the gain
            falls by |u'y|^2, y = Q'b
Source      leverage: Hoaglin and Welsch 1978, "The hat matrix in regression and ANOVA"
Valid       sets of any rank
Ignores     a direction of which others have less than `SURVIVES`
==========  ==========================================================================
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import qr, solve_triangular
from scipy.special import betaln

from stiffness.regression.normal_equations import (
    projection_coefficients,
    schur_complement,
)
from stiffness.regression.predictive_gate import Name

SURVIVES = 1e-7
"""Share of a direction's raw information that must survive what is known; chosen: ten
thousand times above what rounding leaves of a hundred columns."""
COMMON = 0.05
"""First parameter of the Beta prior of how often an effect occurs at its sites; its
mean is one in all names. Chosen: one name of an effect makes it ten times as likely at
its other sites, as gears of one arm are alike."""
BEYOND_PRIOR = 3.0
"""Information of a new direction over that of its prior from which it counts. Chosen:
of two columns that the units cannot tell apart, the second has twice its prior's, so
that the rank of a set does not depend on the order of its groups."""
RECENT = 4
"""Factorised sets that are kept; chosen: most sets begin as one of the last did."""
NOTHING = np.zeros(1, dtype=int)
"""Where the rows of an empty set begin and end."""


# --- Groups --------------------------------------------------------------------------


@dataclass(frozen=True)
class ColumnGroup:
    """Columns that come in together.

    Attributes:
        name: Of the law; groups of one name are shapes of it.
        columns: Their numbers.
        shape_parameters: How many numbers the shape has that were searched.
        log_prior: How much rarer than others the name is, as a log.
        kind: What is as frequent at its sites as at others of one arm; the effect
            where it is empty.
    """

    name: Name
    columns: Int[np.ndarray, " columns"]
    shape_parameters: int = 0
    log_prior: float = 0.0
    kind: str = ""


# --- Normal equations beyond the nominal columns --------------------------------------


@dataclass(frozen=True, eq=False)
class GroupProblem:
    """Normal equations of all groups, nominal columns projected out, columns scaled.

    Attributes:
        gram: Of the groups' columns, each scaled to a raw information of one.
        score: The same.
        groups: With numbers of columns as they stand here.
        units: How many units of information there are.
        prior: Prior information of each column, which is part of its Gram matrix; of a
            group all or none have one.
    """

    gram: Float[np.ndarray, "columns columns"]
    score: Float[np.ndarray, " columns"]
    groups: tuple[ColumnGroup, ...]
    units: int
    prior: Float[np.ndarray, " columns"]

    @classmethod
    def of(
        cls,
        gram: Float[np.ndarray, "all all"],
        score: Float[np.ndarray, " all"],
        raw: Float[np.ndarray, " all"],
        nominal: Int[np.ndarray, " nominal"],
        groups: Sequence[ColumnGroup],
        units: int,
        prior: Float[np.ndarray, " all"] | None = None,
    ) -> "GroupProblem":
        """Project nominal columns out and scale the others.

        Args:
            gram: X' S^-1 X of all columns.
            score: X' S^-1 y.
            raw: Information of each column before anything was projected out.
            nominal: Columns that explain for free.
            groups: What may be selected.
            units: Independent observations, such as poses.
            prior: Information of each column beyond `gram`; None: of no column.
        """
        prior = np.zeros(len(gram)) if prior is None else prior
        used = [group.columns for group in groups]
        columns = np.concatenate([np.zeros(0, dtype=int), *used])
        live = raw > 0.0
        scale = np.where(live, 1.0 / np.sqrt(np.where(live, raw, 1.0)), 0.0)
        prior = prior * scale**2
        gram = gram * scale
        gram *= scale[:, None]
        np.einsum("cc->c", gram)[:] += prior
        score = score * scale
        share = projection_coefficients(gram, nominal)
        inner = schur_complement(gram, nominal, share, columns)
        asked = score[columns] - score[nominal] @ share[:, columns]
        ends = np.cumsum([0, *(len(c) for c in used)])
        own = tuple(
            replace(g, columns=np.arange(a, b))
            for g, a, b in zip(groups, ends[:-1], ends[1:], strict=True)
        )
        inner = inner + inner.T
        inner *= 0.5
        return cls(inner, asked, own, units, prior[columns])

    @cached_property
    def recent(self) -> "deque[KeptBasis]":
        """Bases of the sets that were factorised last, of the empty set at first."""
        rows, none = self.score[None][:0], np.zeros(0, dtype=int)
        return deque(
            [KeptBasis((), rows, np.zeros(0), none, NOTHING, ((0, 0),))], RECENT
        )

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
    def unit(self) -> Float[np.ndarray, " columns"]:
        """Size of each column's coefficient at which its prior information is one."""
        known = self.prior > 0.0
        return np.where(known, 1.0 / np.sqrt(np.where(known, self.prior, 1.0)), 1.0)

    def counts(
        self,
        information: Float[np.ndarray, "*some directions"],
        columns: Int[np.ndarray, "*some width"],
    ) -> Bool[np.ndarray, "*some directions"]:
        """Return which directions of groups count, by their information beyond a set.

        Args:
            information: Of each direction, with coefficients in units.
            columns: Of each group.
        """
        known = self.prior[columns[..., :1]] > 0.0
        return information > np.where(known, BEYOND_PRIOR, SURVIVES * columns.shape[-1])

    @cached_property
    def kind_of_name(self) -> Int[np.ndarray, " names"]:
        """Number of the kind of each name, wherever it is."""
        kinds = {group.name: group.kind or group.name[0] for group in self.groups}
        number = {kind: k for k, kind in enumerate(dict.fromkeys(kinds.values()))}
        return np.array([number[kinds[name]] for name in self.names], dtype=int)

    @cached_property
    def sites_of_kind(self) -> Int[np.ndarray, " kinds"]:
        """How many names each kind has."""
        return np.bincount(self.kind_of_name)

    def named_of_kind(self, groups: Sequence[int]) -> Int[np.ndarray, " kinds"]:
        """Return how many names of each kind a set has."""
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

    def worth(self, groups: Sequence[int], gain: float, rank: int) -> float:
        """Return what a set explains less its price.

        Args:
            groups: The set.
            gain: Whitened square that it explains.
            rank: Of its columns together.
        """
        return 0.5 * gain - self.price(groups, rank)


@dataclass(frozen=True, eq=False)
class KeptBasis:
    """What a problem keeps of a factorised set; all but the problem, as there.

    Rows and aim may go on behind the set's own.
    """

    groups: tuple[int, ...]
    rows: Float[np.ndarray, "some columns"]
    aim: Float[np.ndarray, " some"]
    columns: Int[np.ndarray, " own"]
    widths: Int[np.ndarray, " _"]
    ends: tuple[tuple[int, int], ...]

    def common_count(self, groups: Sequence[int]) -> int:
        """Return how many of the first groups are the same."""
        pairs = zip(self.groups, groups, strict=False)
        return int(np.sum(np.cumprod([one == other for one, other in pairs])))


@dataclass(frozen=True, eq=False)
class FactorisedSet:
    """A set of groups with an orthonormal basis Q of its span.

    Attributes:
        problem: Where its groups are from.
        groups: In the order of the basis.
        rows: Q'X of every column.
        aim: Q'y.
        rank: Directions that count.
        columns: Of the groups, in their order.
        widths: Where each group's columns begin among these, and the end.
        ends: Basis and rank without any group, and with each one more.
    """

    problem: GroupProblem
    groups: tuple[int, ...]
    rows: Float[np.ndarray, "basis columns"]
    aim: Float[np.ndarray, " basis"]
    rank: int
    columns: Int[np.ndarray, " own"]
    widths: Int[np.ndarray, " _"]
    ends: tuple[tuple[int, int], ...]

    @classmethod
    def of(
        cls,
        problem: GroupProblem,
        groups: Sequence[int],
        start: "FactorisedSet | None" = None,
    ) -> "FactorisedSet":
        """Factorise a set, group by group; what adds no direction counts nothing.

        Args:
            problem: The normal equations.
            groups: What comes in.
            start: A set that comes before them; None: nothing.
        """
        before = start
        if before is None:
            before = cls._begun(problem, tuple(groups))
            groups = groups[len(before.groups) :]
        own = [problem.groups[k].columns for k in groups]
        width = len(before.aim) + sum(map(len, own))
        rows, aim = np.zeros((width, len(problem.score))), np.zeros(width)
        rows[: len(before.aim)], aim[: len(before.aim)] = before.rows, before.aim
        at, rank, ends = len(before.aim), before.rank, [*before.ends]
        for columns in own:
            known, unit = rows[:at, columns], problem.unit[columns]
            inner = problem.gram[np.ix_(columns, columns)] - known.T @ known
            value, vector = np.linalg.eigh(inner * unit * unit[:, None])
            keep = value > SURVIVES * len(columns)
            turn = unit[:, None] * vector[:, keep] / np.sqrt(value[keep])
            end = at + turn.shape[1]
            rows[at:end] = turn.T @ (problem.gram[columns] - known.T @ rows[:at])
            aim[at:end] = turn.T @ (problem.score[columns] - known.T @ aim[:at])
            at, rank = end, rank + int(problem.counts(value, columns).sum())
            ends.append((at, rank))
        widths = np.cumsum([before.widths[-1], *map(len, own)])
        columns = np.concatenate([before.columns, *own])
        widths = np.concatenate([before.widths[:-1], widths])
        groups = (*before.groups, *groups)
        kept = KeptBasis(groups, rows, aim, columns, widths, tuple(ends))
        problem.recent.append(kept)
        return cls(
            problem, groups, rows[:at], aim[:at], rank, columns, widths, tuple(ends)
        )

    @classmethod
    def _begun(cls, problem: GroupProblem, groups: tuple[int, ...]) -> "FactorisedSet":
        """Return as many of the first groups as a recent set began with."""
        common = [kept.common_count(groups) for kept in problem.recent]
        count = max(common)
        best = problem.recent[common.index(count)]
        end, rank = best.ends[count]
        widths = best.widths[: count + 1]
        first = groups[:count], best.rows[:end], best.aim[:end], rank
        own = best.columns[: widths[-1]]
        return cls(problem, *first, own, widths, best.ends[: count + 1])

    @property
    def own(self) -> Float[np.ndarray, "basis own"]:
        """Q'X of the groups' own columns."""
        return self.rows[:, self.columns]

    @property
    def gain(self) -> float:
        """Whitened square that the set explains."""
        return float(self.aim @ self.aim)

    @property
    def worth(self) -> float:
        """What the set explains less its price."""
        return self.problem.worth(self.groups, self.gain, self.rank)

    @cached_property
    def leverage(self) -> "_Leverage":
        """QR factorisation of the groups' own columns in the basis."""
        return _Leverage(*np.linalg.qr(self.own.T))

    def reduced(self, places: Sequence[int]) -> "ReducedSet":
        """Return what the set is once some of its groups have gone.

        Args:
            places: Places of the groups in the set; groups of one name.
        """
        some = np.concatenate([np.arange(*self.widths[p : p + 2]) for p in places])
        _, value, vector = np.linalg.svd(self.leverage.span[some], full_matrices=False)
        alone = vector[value**2 > 1.0 - SURVIVES]
        turned = solve_triangular(self.leverage.upper, alone.T)
        own = np.asarray(qr(turned, mode="economic")[0])
        rank, columns = own.shape[1], self.columns[some]
        if np.any(self.problem.prior[columns] > 0.0):
            seen = self.problem.unit[columns, None] * (self.rows[:, columns].T @ own)
            value = np.linalg.svd(seen, compute_uv=False) ** 2
            rank = int(self.problem.counts(value, columns).sum())
        rest = tuple(k for p, k in enumerate(self.groups) if p not in places)
        lost = float(np.sum((own.T @ self.aim) ** 2))
        return ReducedSet(self.problem, rest, own, self.gain - lost, self.rank - rank)

    def own_gain(self, places: Sequence[int]) -> float:
        """Return the whitened square that these groups explain and no others do."""
        return self.gain - self.reduced(places).gain


@dataclass(frozen=True, eq=False)
class ReducedSet:
    """What a set is once some of its groups have gone.

    Attributes:
        problem: Where its groups are from.
        groups: That stay.
        directions: Of the whole set's basis: what only those that went explain.
        gain: Whitened square that the rest explains.
        rank: Of the rest.
    """

    problem: GroupProblem
    groups: tuple[int, ...]
    directions: Float[np.ndarray, "basis own"]
    gain: float
    rank: int

    @property
    def worth(self) -> float:
        """What the rest explains less its price."""
        return self.problem.worth(self.groups, self.gain, self.rank)


@dataclass(frozen=True, eq=False)
class _Leverage:
    """A' = H T of a set's own columns A in its basis.

    Attributes:
        span: H, whose squared rows are leverages.
        upper: T.
    """

    span: Float[np.ndarray, "columns rank"]
    upper: Float[np.ndarray, "rank rank"]
