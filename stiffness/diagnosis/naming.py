"""A name is given when it clearly predicts poses it has not seen.

A set grows by one effect at a time: the best set of the next size replaces the present
one only if poses left out are predicted better, by what two standard errors would be,
and if the present residual speaks at all, of more than how true a law is.
"""

from dataclasses import dataclass, replace

import numpy as np

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.detect import ALARM, Found
from stiffness.diagnosis.growth import Front, exchanged, extended
from stiffness.diagnosis.intervals import beyond_limits
from stiffness.diagnosis.leftover import what_is_left
from stiffness.diagnosis.member import Member
from stiffness.diagnosis.own_leftover import alone, is_own
from stiffness.diagnosis.refine import refined
from stiffness.diagnosis.scored import Scored, earns, score
from stiffness.diagnosis.sets import Ranked, ranked, white_candidates

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
