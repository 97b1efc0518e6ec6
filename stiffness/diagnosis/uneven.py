"""A law that holds is the same at all poses, loads, directions of pull and times.

==========  ==========================================================================
Equation    columns: the law as fitted, in each group of rows but one; known: nominal
            columns, laws, their shapes and other forms; all groups of a kind at once by
            sign flips of poses, the largest over kinds and laws
Source      Cochran 1954, "The combination of estimates from different experiments":
            Q as a score test of group and law
Valid       groups that each have some poses
Ignores     what differs within groups
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Int
from scipy.cluster.vq import kmeans2

from stiffness.diagnosis.case import Case
from stiffness.diagnosis.crossing import cross_of
from stiffness.diagnosis.flips import sign_flips, white_scores
from stiffness.diagnosis.leftover import without_set
from stiffness.diagnosis.member import Member, SetFit
from stiffness.diagnosis.signature import Signature, values, with_values
from stiffness.diagnosis.situation import Situation

GROUPS = 4
"""Groups of a kind; chosen: thirty poses of 120 in each."""


@dataclass(frozen=True)
class Uneven:
    """How a law differs between groups of one kind.

    Attributes:
        between: The kind of groups.
        p_value: Among all laws and kinds.
        captured: Whitened square beyond chance.
    """

    between: str
    p_value: float
    captured: float


def unevenness(case: Case, fit: SetFit) -> tuple[Uneven, ...]:
    """Return the kind of groups between which each member's law differs most.

    Args:
        case: What may be looked at.
        fit: The set.
    """
    if not fit.members:
        return ()
    kinds = groups_of(case.situation)
    after = without_set(case, fit)
    pieces = [
        [_in_groups(_as_fitted(case, m, c), group) for group in kinds.values()]
        for m, c in zip(fit.members, fit.coefficients, strict=True)
    ]
    flat = [piece for of_member in pieces for piece in of_member]
    mask = ~case.split.held_out
    every = [*after.known, *flat]
    gram, score = cross_of(after.data, every, every, case.evidence.fold)
    total = gram[1]
    start = after.evidence.gram.shape[1]
    ends = start + np.cumsum([0, *(piece.columns for piece in flat)])
    blocks = [np.arange(a, b) for a, b in pairwise(ends)]
    raw = np.maximum(np.diag(total), 0.0)
    white = white_scores(total, score[mask], np.arange(start), blocks, raw)
    tested = sign_flips(white, case.seed + 2)
    found = []
    for k in range(len(pieces)):
        mine = slice(k * len(kinds), (k + 1) * len(kinds))
        worst = int(np.argmin(tested.together[mine] - 1e-6 * tested.z[mine]))
        at = mine.start + worst
        excess = float(tested.captured[at] - tested.freedom[at])
        found.append(Uneven(list(kinds)[worst], float(tested.together[at]), excess))
    return tuple(found)


def groups_of(situation: Situation) -> Mapping[str, Int[np.ndarray, " rows"]]:
    """Return the group of each row, kind by kind; kinds with one group are left out."""
    recording = situation.recording
    first = np.unique(situation.pose, return_index=True)[1]
    posture = recording.posture[first]
    features = np.column_stack([np.cos(posture), np.sin(posture)])
    found = {
        "postures": _clusters(features)[situation.pose],
        "times": _ranks(recording.time),
    }
    if recording.wrench is not None:
        size = np.linalg.norm(situation.wrench[:, :3], axis=1)
        pulled = size > 0.05 * max(float(size.max()), 1e-12)
        direction = situation.wrench[:, :3] / np.maximum(size, 1e-12)[:, None]
        found["loads"] = _ranks(np.round(size, 1))
        if pulled.sum() > GROUPS:
            group = np.zeros(len(size), dtype=int)
            group[pulled] = _clusters(direction[pulled])
            found["directions of pull"] = group
    return {kind: g for kind, g in found.items() if len(np.unique(g)) > 1}


def _clusters(features: np.ndarray) -> Int[np.ndarray, " many"]:
    some = min(GROUPS, len(np.unique(features, axis=0)))
    if some < 2:
        return np.zeros(len(features), dtype=int)
    return kmeans2(features, some, minit="++", rng=0, iter=20)[1]


def _ranks(of_rows: np.ndarray) -> Int[np.ndarray, " rows"]:
    edges = np.unique(np.quantile(of_rows, np.arange(1, GROUPS) / GROUPS))
    return np.searchsorted(edges, of_rows, side="right")


def _as_fitted(case: Case, member: Member, coefficients: np.ndarray) -> Signature:
    """Return a law with its coefficients as one column."""
    parts = []
    for part in member.signature(case.situation).parts:
        parts.append(with_values(part, values(part) @ coefficients[:, None]))
    return Signature(1, tuple(parts))


def _in_groups(law: Signature, group: Int[np.ndarray, " rows"]) -> Signature:
    """Return the law in every group but the first."""
    inside = (group[:, None] == np.unique(group)[1:]).astype(float)
    parts = []
    for part in law.parts:
        shape = (len(group), *(1,) * (values(part).ndim - 2), inside.shape[1])
        parts.append(with_values(part, values(part) * inside.reshape(shape)))
    return Signature(inside.shape[1], tuple(parts))
