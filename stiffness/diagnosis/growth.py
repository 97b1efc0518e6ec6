"""Beyond three effects a set grows by one at a time, and any member may be exchanged.

All sets of so many cannot be tried. What is left beside the set as it was refined names
the next member; then each member in turn is taken out and what is left names another,
for the first few may have stood in for what came later.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.crossing import beside_many, cross_of
from stiffness.diagnosis.flips import white_scores
from stiffness.diagnosis.member import Member, SetFit, solve
from stiffness.diagnosis.refine import shape_columns
from stiffness.diagnosis.sets import log_prior

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
