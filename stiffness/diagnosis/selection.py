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
from stiffness.diagnosis.detection import DetectionTest
from stiffness.diagnosis.model_evaluation import (
    EvaluatedModel,
    beyond_limits,
    evaluate,
    improves_prediction,
    log_prior,
)
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    refined,
    shape_columns,
    solve,
)
from stiffness.diagnosis.residual_checks import (
    drop_one_gains,
    is_same_law_residual,
    residual_test,
)
from stiffness.diagnosis.sufficient_statistics import cross_gram, given_many
from stiffness.regression.elimination import (
    projection_coefficients,
    schur_complement,
    whitening_transform,
)
from stiffness.regression.normal_equations import NormalEquations
from stiffness.regression.testing import SIGNIFICANCE, white_scores

# --- Exhaustive search ----------------------------------------------------------------

SHORT_LIST = 30
"""Candidates whose triples are all tried; pairs are tried of all. Chosen: 4060 sets."""
RIDGE = 1e-8


@dataclass(frozen=True)
class RankedModels:
    """Sets of candidates with what they explain.

    Attributes:
        models: Numbers of candidates; the empty set comes first.
        shape: Which of each member's shapes is meant.
        gain: Whitened square that each set explains beyond what is nominal.
        log_evidence: With the prior of its size.
    """

    models: tuple[tuple[int, ...], ...]
    shape: tuple[tuple[int, ...], ...]
    gain: Float[np.ndarray, " models"]
    log_evidence: Float[np.ndarray, " models"]


@dataclass(frozen=True)
class WhitenedCandidates:
    """Candidates' columns at their best shapes, each candidate's own made white."""

    product: Float[np.ndarray, "m m"]
    score: Float[np.ndarray, " m"]
    owned: tuple[Int[np.ndarray, " _"], ...]
    shape: tuple[int, ...]
    single_gains: Float[np.ndarray, " candidates"]


def whiten_candidates(
    library: Library, evidence: NormalEquations
) -> WhitenedCandidates:
    """Choose every candidate's best shape and make its columns white.

    Args:
        library: Nominal columns, candidates and map.
        evidence: Over the poses that may be looked at.
    """
    gram, score = evidence.gram.sum(axis=0), evidence.score.sum(axis=0)
    nominal = np.arange(library.nominal)
    share = projection_coefficients(gram, nominal)
    score = score - score[nominal] @ share
    turns, owned, shape, alone, start = [], [], [], [], 0
    used: list[np.ndarray] = []
    for candidate in library.candidates:
        best: tuple[float, int, np.ndarray] = (-1.0, 0, np.zeros((0, 0)))
        for s, block in enumerate(candidate.columns):
            left = schur_complement(gram, nominal, share, block)
            turn = whitening_transform(left, evidence.raw[block])
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
    left = schur_complement(gram, nominal, share, columns)
    return WhitenedCandidates(
        mix.T @ left @ mix,
        mix.T @ score[columns],
        tuple(owned),
        tuple(shape),
        np.array(alone),
    )


def chi_square_gains(
    white: WhitenedCandidates, models: Sequence[tuple[int, ...]]
) -> Float[np.ndarray, " sets"]:
    """Return what sets of candidates explain together, all sets of one size at once."""
    if not models or not models[0]:
        return np.zeros(len(models))
    widest = max(len(own) for own in white.owned)
    pad = np.full((len(white.owned), widest), -1)
    for k, own in enumerate(white.owned):
        pad[k, : len(own)] = own
    total = np.empty(len(models))
    members = np.array(models)
    for at in range(0, len(models), 4096):
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


def rank_models(
    library: Library, white: WhitenedCandidates, poses: int, largest: int = 3
) -> RankedModels:
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
    total.append(chi_square_gains(white, singles))
    every += singles
    if largest > 1:
        pairs = list(combinations((int(k) for k in some), 2))
        pairs = [p for p in pairs if _distinct(library, p)]
        total.append(chi_square_gains(white, pairs))
        every += pairs
    if largest > 2 and len(some) > 2:
        listed = _short_list(library, every, np.concatenate(total), poses)
        triples = [t for t in combinations(listed, 3) if _distinct(library, t)]
        total.append(chi_square_gains(white, triples))
        every += triples
    gain = np.concatenate(total)
    freedom = np.array(
        [sum(library.candidates[k].degrees_of_freedom for k in s) for s in every]
    )
    rarer = [c.hypothesis.log_prior for c in library.candidates]
    prior = np.array(
        [log_prior(len(s), count) + sum(rarer[k] for k in s) for s in every]
    )
    log_evidence = 0.5 * gain - 0.5 * freedom * np.log(poses) + prior
    shape = tuple(tuple(white.shape[k] for k in s) for s in every)
    return RankedModels(tuple(every), shape, gain, log_evidence)


def _distinct(library: Library, members: Sequence[int]) -> bool:
    """Return whether no name comes twice."""
    names = {library.candidates[k].name for k in members}
    return len(names) == len(members)


def _short_list(
    library: Library, models: list[tuple[int, ...]], gain: np.ndarray, poses: int
) -> list[int]:
    """Return the candidates that come up in the best sets so far."""
    freedom = np.array(
        [sum(library.candidates[k].degrees_of_freedom for k in s) for s in models]
    )
    order = np.argsort(-(gain - freedom * np.log(poses)))
    listed: list[int] = []
    for at in order:
        listed.extend(k for k in models[at] if k not in listed)
        if len(listed) >= SHORT_LIST:
            break
    return sorted(listed[:SHORT_LIST])


# --- Forward steps and exchange -------------------------------------------------------

Shortlist = list[tuple[float, tuple[ModelTerm, ...]]]
"""Sets with their log evidence, the best first."""
TRIED = 6
"""Candidates that are looked at as the next member; chosen for time."""


@dataclass(frozen=True)
class _JointEquations:
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


def forward_step(case: SelectionProblem, fit: ModelFit) -> Shortlist:
    """Return sets of one member more, at coarse shapes.

    Args:
        case: What may be looked at.
        fit: The set so far, refined.
    """
    every = range(len(fit.members))
    return _with_another(case, _joint_equations(case, fit), fit.members, every)[:TRIED]


def exchange_step(case: SelectionProblem, fit: ModelFit) -> Shortlist:
    """Return sets in which a member, but for the last, gives way to another candidate.

    Args:
        case: What may be looked at.
        fit: The set, refined.
    """
    joint, found = _joint_equations(case, fit), Shortlist()
    for out, member in enumerate(fit.members[:-1]):
        rest = [k for k in range(len(fit.members)) if k != out]
        front = _with_another(case, joint, fit.members, rest)
        found += [one for one in front if one[1][-1].name != member.name][:TRIED]
    return sorted(found, key=lambda one: -one[0])


def _joint_equations(case: SelectionProblem, fit: ModelFit) -> _JointEquations:
    known, laws, owned = list(case.nominal), [], []
    end = case.library.nominal
    for member, coefficients in zip(fit.members, fit.coefficients, strict=True):
        law = member.jacobian(case.situation)
        slopes = shape_columns(case.situation, member, coefficients)
        forms = member.hypothesis.variants(case.situation, member.where, member.shape)
        kind = [s for s in (law, *slopes, forms) if s.columns]
        known += kind
        start, end = end, end + sum(s.columns for s in kind)
        laws.append(np.arange(start, start + law.columns))
        owned.append(np.arange(start, end))
    every, fold = [*known, *case.library.jacobians], case.normal_equations.fold
    side, score = cross_gram(case.data, known, every, fold)
    mask = ~case.split.held_out
    gram = given_many(side, case.normal_equations.gram)[np.unique(fold[mask])].sum(
        axis=0
    )
    raw = np.concatenate([np.diag(gram)[:end], case.normal_equations.raw])
    total = score[mask].sum(axis=0)
    return _JointEquations(
        gram, total, np.maximum(raw, 0.0), tuple(laws), tuple(owned), end
    )


def _with_another(
    case: SelectionProblem,
    joint: _JointEquations,
    members: Sequence[ModelTerm],
    kept: Sequence[int],
) -> Shortlist:
    """Return some members with each candidate that is not among them, best first."""
    rest = tuple(members[k] for k in kept)
    nominal = np.arange(case.library.nominal)
    laws = np.concatenate([nominal, *(joint.laws[k] for k in kept)])
    known = np.concatenate([nominal, *(joint.owned[k] for k in kept)])
    gain = _explained(joint, laws) - _explained(joint, nominal)
    freedom = len(laws) - len(nominal) + sum(m.degrees_of_freedom for m in rest)
    named = {member.name for member in rest}
    free = [c for c in case.library.candidates if c.name not in named]
    blocks = [block + joint.library for c in free for block in c.columns]
    share = solve(joint.gram[np.ix_(known, known)], joint.score[known])
    left = (joint.score - share @ joint.gram[known])[None]
    white = white_scores(joint.gram, left, known, blocks, joint.raw)
    captured = iter([float(np.sum(w**2)) for w in white])
    prior = log_prior(len(rest) + 1, len(case.library.candidates))
    found = Shortlist()
    for candidate in free:
        own = [next(captured) for _ in candidate.columns]
        shape = candidate.shapes[int(np.argmax(own))]
        new = ModelTerm(candidate.hypothesis, candidate.where, shape)
        paid = (
            0.5 * (freedom + candidate.degrees_of_freedom) * np.log(case.poses) - prior
        )
        paid -= sum(m.hypothesis.log_prior for m in (*rest, new))
        found.append((float(0.5 * (gain + max(own)) - paid), (*rest, new)))
    return sorted(found, key=lambda one: -one[0])


def _explained(joint: _JointEquations, columns: np.ndarray) -> float:
    """Return the whitened square that some columns explain."""
    score = joint.score[columns]
    return float(score @ solve(joint.gram[np.ix_(columns, columns)], score))


# --- Selection ------------------------------------------------------------------------

ALIKE = 3.0
"""Log Bayes factor within which names are equivalent; the rule of the answer."""
LIVE = 12.0
"""Log Bayes factor within which a rival is refined like the winner; chosen: refining a
coarse shape rarely gains more."""
FORMS = 0.1
"""Or share of the log evidence; chosen: what another form of a strong law may add."""
MAX_EXHAUSTIVE_SIZE = 3
"""Most effects of which all sets are tried."""
MAX_EFFECTS = 8
"""Most that a set grows to; chosen: what needs more is another machine."""
REFINED = 10
"""Most sets of one size that are refined; chosen for time."""


@dataclass(frozen=True)
class SelectedModel:
    """The best set, its rivals of the same or a smaller size, and what is left.

    Attributes:
        best: The set that won; empty where nothing could be named.
        rivals: Refined rivals, best first, the winner included.
        ranking: All sets at their coarse shapes.
        residual_test: The test of what is left after the best set.
        inflation: Noise variance over the stated one, as left.
        path: The residual tests on the way, from nothing named on.
    """

    best: EvaluatedModel
    rivals: tuple[EvaluatedModel, ...]
    ranking: RankedModels
    residual_test: DetectionTest
    inflation: float
    path: tuple[DetectionTest, ...]


def name(case: SelectionProblem, first: DetectionTest) -> SelectedModel:
    """Grow the set of names as long as each new one earns its place.

    Args:
        case: What may be looked at.
        first: The test before anything is named.
    """
    training = np.flatnonzero(np.arange(len(case.normal_equations.gram)) > 0)
    mask = ~case.split.held_out
    seen = replace(
        case.normal_equations,
        gram=case.normal_equations.gram[training],
        score=case.normal_equations.score[mask],
        fold=case.normal_equations.fold[mask] - 1,
    )
    white = whiten_candidates(case.library, seen)
    every = rank_models(case.library, white, case.poses, MAX_EXHAUSTIVE_SIZE)
    best = evaluate(case, ())
    rivals, left, path = [best], first, [first]
    while len(best.fit.members) < MAX_EFFECTS and left.p_value < SIGNIFICANCE:
        if is_same_law_residual(left, best.fit, drop_one_gains(case, best.fit)):
            break
        found = _next_size(case, every, best)
        if (
            not found
            or found[0].insignificant
            or not improves_prediction(best, found[0], case.seed)
        ):
            break
        best, rivals = found[0], found
        left = residual_test(case, best.fit)
        path.append(left)
    return SelectedModel(
        best, tuple(rivals), every, left, max(1.0, left.dispersion), tuple(path)
    )


def _next_size(
    case: SelectionProblem, every: RankedModels, before: EvaluatedModel
) -> list[EvaluatedModel]:
    """Return sets of one member more, refined, the best first."""
    size = len(before.fit.members) + 1
    if size <= MAX_EXHAUSTIVE_SIZE:
        order = np.flatnonzero([len(s) == size for s in every.models])
        order = order[np.argsort(-every.log_evidence[order])]
        return _best_of(case, _shortlist(case, every, order))
    front = forward_step(case, before.fit)
    found = _best_of(case, front, passes=1)
    if not found:
        return []
    others = exchange_step(case, found[0].fit)
    live = [one for one in others if one[0] > front[0][0] - _evidence_margin(front)]
    return _ordered([*found, *_best_of(case, live, passes=1)])


def _evidence_margin(front: Shortlist) -> float:
    """Return by how much coarse log evidence may trail the best and be looked at."""
    return max(LIVE, FORMS * front[0][0])


def _shortlist(
    case: SelectionProblem, every: RankedModels, order: np.ndarray
) -> Shortlist:
    """Return the front runners of one size with their coarse log evidence."""
    front = Shortlist()
    for at in order[: 4 * REFINED]:
        own = [case.library.candidates[k] for k in every.models[at]]
        members = tuple(
            ModelTerm(c.hypothesis, c.where, c.shapes[s])
            for c, s in zip(own, every.shape[at], strict=True)
        )
        front.append((float(every.log_evidence[at]), members))
    return front


def _best_of(
    case: SelectionProblem, front: Shortlist, passes: int = 2
) -> list[EvaluatedModel]:
    """Refine front runners of one size, the likeliest first; return the best first."""
    scored: list[EvaluatedModel] = []
    for log_evidence, coarse in front:
        if scored and log_evidence < front[0][0] - _evidence_margin(front):
            break
        if len(scored) >= REFINED:
            break
        members = refined(
            case.data, case.situation, case.nominal, coarse, case.split, passes
        )
        one = evaluate(case, members)
        if max(one.zero) < SIGNIFICANCE and not any(
            beyond_limits(case.situation, m, p)
            for m, p in zip(one.fit.members, one.parameters, strict=True)
        ):
            scored.append(one)
    return _ordered(scored)


def _ordered(scored: list[EvaluatedModel]) -> list[EvaluatedModel]:
    """Return the best first; what may be nothing stays a rival, but wins nothing."""
    return sorted(
        scored,
        key=lambda s: (
            s.insignificant,
            -round(s.log_evidence, 1),
            s.fit.degrees_of_freedom,
        ),
    )
