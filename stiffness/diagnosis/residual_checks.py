"""Checks of a fitted model: test of the residual, and homogeneity over groups.

After a name is given, everything is asked once more whether something is left.

A law that holds is the same at all poses, loads, directions of pull and times.

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
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from jaxtyping import Int
from scipy.cluster.vq import kmeans2

from stiffness.diagnosis.candidates import Library, Mapped
from stiffness.diagnosis.detection import DetectionTest, detect, scatter_of
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    other_forms,
    shape_columns,
)
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    cross_gram,
    given_many,
    normal_equations_of,
)
from stiffness.effects.jacobian import EffectJacobian, values, with_values
from stiffness.experiment.static_state import StaticState
from stiffness.regression.normal_equations import NormalEquations, minimum_norm_fit
from stiffness.regression.testing import SIGNIFICANCE, sign_flip_test, white_scores

# --- Test of the residual -------------------------------------------------------------


@dataclass(frozen=True)
class After:
    """A recording once a set is named.

    Attributes:
        known: Nominal columns, the set's laws, a little more of their shapes, their
            other forms.
        normal_equations: What the readings say of these.
        data: The readings without what these explain.
    """

    known: list[EffectJacobian]
    normal_equations: NormalEquations
    data: SufficientStatistics


def residual_after(case: SelectionProblem, fit: ModelFit) -> After:
    """Take what a set explains, in any accepted form, out of the readings."""
    members = [m.jacobian(case.situation) for m in fit.members]
    extra: list[EffectJacobian] = []
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        extra.extend(shape_columns(case.situation, member, coefficients))
    known = [*case.nominal, *members, *extra, *other_forms(case, fit.members)]
    own = normal_equations_of(case.data, known, case.normal_equations.fold)
    beta = minimum_norm_fit(own.gram[1], own.score[~case.split.held_out].sum(axis=0))
    return After(known, own, case.data.subtract(known, beta))


@dataclass(frozen=True)
class ResidualEquations:
    """Normal equations of all columns once a set is named.

    Attributes:
        after: The recording once the set is named.
        library: Candidates without the names of the set, and the map.
        normal_equations: Of the columns that the set explains with, then the library's.
        known: Numbers of the columns that the set explains with.
    """

    after: After
    library: Library
    normal_equations: NormalEquations
    known: Int[np.ndarray, " known"]


def residual_equations(case: SelectionProblem, fit: ModelFit) -> ResidualEquations:
    """Lay out what a set explains, in any accepted form, beside the library."""
    fold = case.normal_equations.fold
    after = residual_after(case, fit)
    known, own = after.known, after.normal_equations
    count = own.gram.shape[1]
    every = [*known, *case.library.jacobians]
    side, score = cross_gram(after.data, known, every, fold)
    gram = given_many(side, case.normal_equations.gram)
    raw = np.concatenate([own.raw, case.normal_equations.raw])
    joint = NormalEquations(gram, score, fold, raw)
    named = {member.name for member in fit.members}
    library = _with_offset_columns(case.library, count, named)
    return ResidualEquations(after, library, joint, np.arange(count))


def _with_offset_columns(
    library: Library, by: int, named: set[tuple[str, str]]
) -> Library:
    return replace(
        library,
        candidates=tuple(
            replace(c, columns=tuple(block + by for block in c.columns))
            for c in library.candidates
            if c.name not in named
        ),
        map=tuple(replace(m, columns=m.columns + by) for m in library.map),
    )


def residual_test(case: SelectionProblem, beyond: ResidualEquations) -> DetectionTest:
    """Test everything again after a set is named, other forms of its laws allowed.

    Other shapes of what is named are no candidates: a law is searched along a line, and
    what that leaves of a strong one is not news.

    Args:
        case: What may be looked at.
        beyond: Normal equations once the set is named.
    """
    equations = beyond.normal_equations
    return detect(
        beyond.library,
        equations,
        equations.score,
        beyond.known,
        ~case.split.held_out,
        case.seed + 1,
        scatter_of(beyond.after.data, case.dispersion_limit),
    )


def significant_blocks(case: SelectionProblem, fit: ModelFit) -> list[Mapped]:
    """Return the blocks of the map that are significant beside a set.

    A place's own constant motions are not asked: they have a name.

    Args:
        case: What may be looked at.
        fit: The set; other forms of its laws are allowed.
    """
    beyond = residual_equations(case, fit)
    given, mask = beyond.normal_equations, ~case.split.held_out
    some = [k for k, b in enumerate(beyond.library.map) if b.kind != "geometry"]
    columns = [beyond.library.map[k].columns for k in some]
    white = white_scores(
        given.gram[1], given.score[mask], beyond.known, columns, given.raw
    )
    tested = sign_flip_test(white, case.seed + 3)
    found = zip(some, tested.together, strict=True)
    return [case.library.map[k] for k, p in found if p < SIGNIFICANCE]


# --- Homogeneity over poses, loads, directions and times ------------------------------

GROUPS = 4
"""Groups of a kind; chosen: thirty poses of 120 in each."""


@dataclass(frozen=True)
class HomogeneityTest:
    """How a law differs between groups of one kind.

    Attributes:
        grouping: The kind of groups.
        p_value: Among all laws and kinds.
        captured: Whitened square beyond chance.
    """

    grouping: str
    p_value: float
    captured: float


def homogeneity_tests(
    case: SelectionProblem, fit: ModelFit, after: After
) -> tuple[HomogeneityTest, ...]:
    """Return the kind of groups between which each member's law differs most.

    Args:
        case: What may be looked at.
        fit: The set.
        after: The recording once the set is named.
    """
    if not fit.members:
        return ()
    kinds = groups_of(case.situation)
    pieces = [
        [_in_groups(_as_fitted(case, m, c), group) for group in kinds.values()]
        for m, c in zip(fit.members, fit.coefficients, strict=True)
    ]
    flat = [piece for of_member in pieces for piece in of_member]
    mask = ~case.split.held_out
    every = [*after.known, *flat]
    gram, score = cross_gram(after.data, every, every, case.normal_equations.fold)
    total = gram[1]
    start = after.normal_equations.gram.shape[1]
    ends = start + np.cumsum([0, *(piece.columns for piece in flat)])
    blocks = [np.arange(a, b) for a, b in pairwise(ends)]
    raw = np.maximum(np.diag(total), 0.0)
    white = white_scores(total, score[mask], np.arange(start), blocks, raw)
    tested = sign_flip_test(white, case.seed + 2)
    found = []
    for k in range(len(pieces)):
        mine = slice(k * len(kinds), (k + 1) * len(kinds))
        worst = int(np.argmin(tested.together[mine] - 1e-6 * tested.z[mine]))
        at = mine.start + worst
        excess = float(tested.captured[at] - tested.degrees_of_freedom[at])
        found.append(
            HomogeneityTest(list(kinds)[worst], float(tested.together[at]), excess)
        )
    return tuple(found)


def groups_of(situation: StaticState) -> Mapping[str, Int[np.ndarray, " rows"]]:
    """Return the group of each row, kind by kind; kinds with one group are left out."""
    recording = situation.recording
    first = np.unique(situation.posture_index, return_index=True)[1]
    posture = recording.posture[first]
    features = np.column_stack([np.cos(posture), np.sin(posture)])
    found = {
        "postures": _clusters(features)[situation.posture_index],
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


def _as_fitted(
    case: SelectionProblem, member: ModelTerm, coefficients: np.ndarray
) -> EffectJacobian:
    """Return a law with its coefficients as one column."""
    parts = []
    for part in member.jacobian(case.situation).parts:
        parts.append(with_values(part, values(part) @ coefficients[:, None]))
    return EffectJacobian(1, tuple(parts))


def _in_groups(law: EffectJacobian, group: Int[np.ndarray, " rows"]) -> EffectJacobian:
    """Return the law in every group but the first."""
    inside = (group[:, None] == np.unique(group)[1:]).astype(float)
    parts = []
    for part in law.parts:
        shape = (len(group), *(1,) * (values(part).ndim - 2), inside.shape[1])
        parts.append(with_values(part, values(part) * inside.reshape(shape)))
    return EffectJacobian(inside.shape[1], tuple(parts))
