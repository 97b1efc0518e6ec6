"""Model selection: exhaustive up to three effects, then forward with exchange.

Which few effects together explain best is found by trying all of them.

==========  ==========================================================================
Equation    gain(S) = b_S' G_SS^-1 b_S after the nominal columns are projected out;
            log evidence = gain / 2 - k ln(poses) / 2 + log prior(size)
Source      unit-information prior (Kass & Wasserman 1995) with the pose as the unit of
            information; k counts coefficients and shape parameters
Valid       columns that are not multiples of each other
Ignores     the shape parameters' own priors beyond their count
==========  ==========================================================================

Beyond three effects a set grows by one at a time, and any member may be exchanged.

All sets of so many cannot be tried. What is left beside the set as it was refined names
the next member; then each member in turn is taken out and what is left names another,
for the first few may have stood in for what came later.

A name is given when it clearly predicts poses it has not seen.

A set grows by one effect at a time: the best set of the next size replaces the present
one only if poses left out are predicted better, by what two standard errors would be,
and if the present residual speaks at all, of more than how true a law is.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.candidates import Library
from stiffness.diagnosis.detection import Found
from stiffness.diagnosis.model_evaluation import (
    Scored,
    beyond_limits,
    earns,
    log_prior,
    score,
)
from stiffness.diagnosis.model_fit import (
    Case,
    Member,
    SetFit,
    refined,
    shape_columns,
    solve,
)
from stiffness.diagnosis.residual_checks import alone, is_own, what_is_left
from stiffness.diagnosis.sufficient_statistics import beside_many, cross_of
from stiffness.regression.elimination import left_of, white_turn, without
from stiffness.regression.normal_equations import Evidence
from stiffness.regression.testing import ALARM, white_scores

# --- Exhaustive search ----------------------------------------------------------------

SHORT_LIST = 30
"""Candidates whose triples are all tried; pairs are tried of all. Chosen: 4060 sets."""
RIDGE = 1e-8


@dataclass(frozen=True)
class Ranked:
    """Sets of candidates with what they explain.

    Attributes:
        sets: Numbers of candidates; the empty set comes first.
        shape: Which of each member's shapes is meant.
        gain: Whitened square that each set explains beyond what is nominal.
        log_evidence: With the prior of its size.
    """

    sets: tuple[tuple[int, ...], ...]
    shape: tuple[tuple[int, ...], ...]
    gain: Float[np.ndarray, " sets"]
    log_evidence: Float[np.ndarray, " sets"]


@dataclass(frozen=True)
class White:
    """Candidates' columns at their best shapes, each candidate's own made white."""

    product: Float[np.ndarray, "m m"]
    score: Float[np.ndarray, " m"]
    owned: tuple[Int[np.ndarray, " _"], ...]
    shape: tuple[int, ...]
    alone: Float[np.ndarray, " candidates"]


def white_candidates(library: Library, evidence: Evidence) -> White:
    """Choose every candidate's best shape and make its columns white.

    Args:
        library: Nominal columns, candidates and map.
        evidence: Over the poses that may be looked at.
    """
    gram, score = evidence.gram.sum(axis=0), evidence.score.sum(axis=0)
    nominal = np.arange(library.nominal)
    share = without(gram, nominal)
    score = score - score[nominal] @ share
    turns, owned, shape, alone, start = [], [], [], [], 0
    used: list[np.ndarray] = []
    for candidate in library.candidates:
        best: tuple[float, int, np.ndarray] = (-1.0, 0, np.zeros((0, 0)))
        for s, block in enumerate(candidate.columns):
            left = left_of(gram, nominal, share, block)
            turn = white_turn(left, evidence.raw[block])
            gain = float(np.sum((turn.T @ score[block]) ** 2))
            if gain > best[0]:
                best = (gain, s, turn)
        gain, s, turn = best
        alone.append(gain)
        shape.append(s)
        used.append(candidate.columns[s])
        turns.append(turn)
        owned.append(np.arange(start, start + turn.shape[1]))
        start += turn.shape[1]
    columns = np.concatenate(used) if used else np.zeros(0, dtype=int)
    mix = np.zeros((len(columns), start))
    row = 0
    for turn, own in zip(turns, owned, strict=True):
        mix[row : row + len(turn), own] = turn
        row += len(turn)
    left = left_of(gram, nominal, share, columns)
    return White(
        mix.T @ left @ mix,
        mix.T @ score[columns],
        tuple(owned),
        tuple(shape),
        np.array(alone),
    )


def gains(white: White, sets: Sequence[tuple[int, ...]]) -> Float[np.ndarray, " sets"]:
    """Return what sets of candidates explain together, all sets of one size at once."""
    if not sets or not sets[0]:
        return np.zeros(len(sets))
    widest = max(len(own) for own in white.owned)
    pad = np.full((len(white.owned), widest), -1)
    for k, own in enumerate(white.owned):
        pad[k, : len(own)] = own
    total = np.empty(len(sets))
    members = np.array(sets)
    for at in range(0, len(sets), 4096):
        index = pad[members[at : at + 4096]].reshape(len(members[at : at + 4096]), -1)
        real = index >= 0
        inner = white.product[index[:, :, None], index[:, None, :]]
        inner = np.where(real[:, :, None] & real[:, None, :], inner, 0.0)
        inner[:, range(inner.shape[1]), range(inner.shape[1])] = np.where(
            real, 1.0 + RIDGE, 1.0
        )
        ask = np.where(real, white.score[index], 0.0)
        solved = np.linalg.solve(inner, ask[:, :, None])[:, :, 0]
        total[at : at + 4096] = np.sum(ask * solved, axis=1)
    return total


def ranked(library: Library, white: White, poses: int, largest: int = 3) -> Ranked:
    """Try all sets up to a size and rank them by evidence, the empty set first.

    Args:
        library: The candidates.
        white: Their white columns.
        poses: How many units of information there are.
        largest: Most members of a set.
    """
    count = len(library.candidates)
    every: list[tuple[int, ...]] = [()]
    total = [np.zeros(1)]
    some = np.flatnonzero([len(own) > 0 for own in white.owned])
    singles = [(int(k),) for k in some]
    total.append(gains(white, singles))
    every += singles
    if largest > 1:
        pairs = list(combinations((int(k) for k in some), 2))
        pairs = [p for p in pairs if _distinct(library, p)]
        total.append(gains(white, pairs))
        every += pairs
    if largest > 2 and len(some) > 2:
        listed = _short_list(library, every, np.concatenate(total), poses)
        triples = [t for t in combinations(listed, 3) if _distinct(library, t)]
        total.append(gains(white, triples))
        every += triples
    gain = np.concatenate(total)
    freedom = np.array([sum(library.candidates[k].freedom for k in s) for s in every])
    rarer = [c.hypothesis.log_prior for c in library.candidates]
    prior = np.array(
        [log_prior(len(s), count) + sum(rarer[k] for k in s) for s in every]
    )
    log_evidence = 0.5 * gain - 0.5 * freedom * np.log(poses) + prior
    shape = tuple(tuple(white.shape[k] for k in s) for s in every)
    return Ranked(tuple(every), shape, gain, log_evidence)


def _distinct(library: Library, members: Sequence[int]) -> bool:
    """Return whether no name comes twice."""
    names = {library.candidates[k].name for k in members}
    return len(names) == len(members)


def _short_list(
    library: Library, sets: list[tuple[int, ...]], gain: np.ndarray, poses: int
) -> list[int]:
    """Return the candidates that come up in the best sets so far."""
    freedom = np.array([sum(library.candidates[k].freedom for k in s) for s in sets])
    order = np.argsort(-(gain - freedom * np.log(poses)))
    listed: list[int] = []
    for at in order:
        listed.extend(k for k in sets[at] if k not in listed)
        if len(listed) >= SHORT_LIST:
            break
    return sorted(listed[:SHORT_LIST])


# --- Forward steps and exchange -------------------------------------------------------

Front = list[tuple[float, tuple[Member, ...]]]
"""Sets with their log evidence, the best first."""
TRIED = 6
"""Candidates that are looked at as the next member; chosen for time."""


@dataclass(frozen=True)
class _Beside:
    """What readings say of a set's laws beside all candidates.

    Attributes:
        gram: Of the training poses: nominal columns, the members', the library's.
        score: The same.
        raw: Each column's information before the unknown was projected out.
        laws: Columns of each member's law.
        owned: These, slopes of its shape and other forms.
        library: Number of the library's first column.
    """

    gram: Float[np.ndarray, "columns columns"]
    score: Float[np.ndarray, " columns"]
    raw: Float[np.ndarray, " columns"]
    laws: tuple[Int[np.ndarray, " _"], ...]
    owned: tuple[Int[np.ndarray, " _"], ...]
    library: int


def extended(case: Case, fit: SetFit) -> Front:
    """Return sets of one member more, at coarse shapes.

    Args:
        case: What may be looked at.
        fit: The set so far, refined.
    """
    every = range(len(fit.members))
    return _with_another(case, _beside(case, fit), fit.members, every)[:TRIED]


def exchanged(case: Case, fit: SetFit) -> Front:
    """Return sets in which a member, but for the last, gives way to another candidate.

    Args:
        case: What may be looked at.
        fit: The set, refined.
    """
    beside, found = _beside(case, fit), Front()
    for out, member in enumerate(fit.members[:-1]):
        rest = [k for k in range(len(fit.members)) if k != out]
        front = _with_another(case, beside, fit.members, rest)
        found += [one for one in front if one[1][-1].name != member.name][:TRIED]
    return sorted(found, key=lambda one: -one[0])


def _beside(case: Case, fit: SetFit) -> _Beside:
    known, laws, owned = list(case.nominal), [], []
    end = case.library.nominal
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        law = member.signature(case.situation)
        slopes = shape_columns(case.situation, member, coefficients)
        forms = member.hypothesis.variants(case.situation, member.where, member.shape)
        kind = [s for s in (law, *slopes, forms) if s.columns]
        known += kind
        start, end = end, end + sum(s.columns for s in kind)
        laws.append(np.arange(start, start + law.columns))
        owned.append(np.arange(start, end))
    every, fold = [*known, *case.library.signatures], case.evidence.fold
    side, score = cross_of(case.data, known, every, fold)
    mask = ~case.split.held_out
    gram = beside_many(side, case.evidence.gram)[np.unique(fold[mask])].sum(axis=0)
    raw = np.concatenate([np.diag(gram)[:end], case.evidence.raw])
    total = score[mask].sum(axis=0)
    return _Beside(gram, total, np.maximum(raw, 0.0), tuple(laws), tuple(owned), end)


def _with_another(
    case: Case, beside: _Beside, members: Sequence[Member], kept: Sequence[int]
) -> Front:
    """Return some members with each candidate that is not among them, best first."""
    rest = tuple(members[k] for k in kept)
    nominal = np.arange(case.library.nominal)
    laws = np.concatenate([nominal, *(beside.laws[k] for k in kept)])
    known = np.concatenate([nominal, *(beside.owned[k] for k in kept)])
    gain = _explained(beside, laws) - _explained(beside, nominal)
    freedom = len(laws) - len(nominal) + sum(m.freedom for m in rest)
    named = {member.name for member in rest}
    free = [c for c in case.library.candidates if c.name not in named]
    blocks = [block + beside.library for c in free for block in c.columns]
    share = solve(beside.gram[np.ix_(known, known)], beside.score[known])
    left = (beside.score - share @ beside.gram[known])[None]
    white = white_scores(beside.gram, left, known, blocks, beside.raw)
    captured = iter([float(np.sum(w**2)) for w in white])
    prior = log_prior(len(rest) + 1, len(case.library.candidates))
    found = Front()
    for candidate in free:
        own = [next(captured) for _ in candidate.columns]
        shape = candidate.shapes[int(np.argmax(own))]
        new = Member(candidate.hypothesis, candidate.where, shape)
        paid = 0.5 * (freedom + candidate.freedom) * np.log(case.poses) - prior
        paid -= sum(m.hypothesis.log_prior for m in (*rest, new))
        found.append((float(0.5 * (gain + max(own)) - paid), (*rest, new)))
    return sorted(found, key=lambda one: -one[0])


def _explained(beside: _Beside, columns: np.ndarray) -> float:
    """Return the whitened square that some columns explain."""
    score = beside.score[columns]
    return float(score @ solve(beside.gram[np.ix_(columns, columns)], score))


# --- Selection ------------------------------------------------------------------------

ALIKE = 3.0
"""Log Bayes factor within which names are equivalent; the rule of the answer."""
LIVE = 12.0
"""Log Bayes factor within which a rival is refined like the winner; chosen: refining a
coarse shape rarely gains more."""
FORMS = 0.1
"""Or share of the log evidence; chosen: what another form of a strong law may add."""
LARGEST = 3
"""Most effects of which all sets are tried."""
MOST = 8
"""Most that a set grows to; chosen: what needs more is another machine."""
REFINED = 10
"""Most sets of one size that are refined; chosen for time."""


@dataclass(frozen=True)
class Named:
    """The best set, its rivals of the same or a smaller size, and what is left.

    Attributes:
        best: The set that won; empty where nothing could be named.
        rivals: Refined rivals, best first, the winner included.
        ranked: All sets at their coarse shapes.
        left: The test of what is left after the best set.
        inflation: Noise variance over the stated one, as left.
        path: The residual tests on the way, from nothing named on.
    """

    best: Scored
    rivals: tuple[Scored, ...]
    ranked: Ranked
    left: Found
    inflation: float
    path: tuple[Found, ...]


def name(case: Case, first: Found) -> Named:
    """Grow the set of names as long as each new one earns its place.

    Args:
        case: What may be looked at.
        first: The test before anything is named.
    """
    training = np.flatnonzero(np.arange(len(case.evidence.gram)) > 0)
    mask = ~case.split.held_out
    seen = replace(
        case.evidence,
        gram=case.evidence.gram[training],
        score=case.evidence.score[mask],
        fold=case.evidence.fold[mask] - 1,
    )
    white = white_candidates(case.library, seen)
    every = ranked(case.library, white, case.poses, LARGEST)
    best = score(case, ())
    rivals, left, path = [best], first, [first]
    while len(best.fit.members) < MOST and left.p_value < ALARM:
        if is_own(left, best.fit, alone(case, best.fit)):
            break
        found = _next_size(case, every, best)
        if not found or found[0].vain or not earns(best, found[0], case.seed):
            break
        best, rivals = found[0], found
        left = what_is_left(case, best.fit)
        path.append(left)
    return Named(
        best, tuple(rivals), every, left, max(1.0, left.dispersion), tuple(path)
    )


def _next_size(case: Case, every: Ranked, before: Scored) -> list[Scored]:
    """Return sets of one member more, refined, the best first."""
    size = len(before.fit.members) + 1
    if size <= LARGEST:
        order = np.flatnonzero([len(s) == size for s in every.sets])
        order = order[np.argsort(-every.log_evidence[order])]
        return _best_of(case, _front(case, every, order))
    front = extended(case, before.fit)
    found = _best_of(case, front, passes=1)
    if not found:
        return []
    others = exchanged(case, found[0].fit)
    live = [one for one in others if one[0] > front[0][0] - _reach(front)]
    return _ordered([*found, *_best_of(case, live, passes=1)])


def _reach(front: Front) -> float:
    """Return by how much coarse log evidence may trail the best and be looked at."""
    return max(LIVE, FORMS * front[0][0])


def _front(case: Case, every: Ranked, order: np.ndarray) -> Front:
    """Return the front runners of one size with their coarse log evidence."""
    front = Front()
    for at in order[: 4 * REFINED]:
        own = [case.library.candidates[k] for k in every.sets[at]]
        members = tuple(
            Member(c.hypothesis, c.where, c.shapes[s])
            for c, s in zip(own, every.shape[at], strict=True)
        )
        front.append((float(every.log_evidence[at]), members))
    return front


def _best_of(case: Case, front: Front, passes: int = 2) -> list[Scored]:
    """Refine front runners of one size, the likeliest first; return the best first."""
    scored: list[Scored] = []
    for log_evidence, coarse in front:
        if scored and log_evidence < front[0][0] - _reach(front):
            break
        if len(scored) >= REFINED:
            break
        members = refined(
            case.data, case.situation, case.nominal, coarse, case.split, passes
        )
        one = score(case, members)
        if max(one.zero) < ALARM and not any(
            beyond_limits(case.situation, m, p)
            for m, p in zip(one.fit.members, one.parameters, strict=True)
        ):
            scored.append(one)
    return _ordered(scored)


def _ordered(scored: list[Scored]) -> list[Scored]:
    """Return the best first; what may be nothing stays a rival, but wins nothing."""
    return sorted(
        scored, key=lambda s: (s.vain, -round(s.log_evidence, 1), s.fit.freedom)
    )
