"""Localisation: sites of named effects, confounded names, residuals without a name.

Where an arm differs: what is named has a place, and the map finds the others.

==========  ==========================================================================
Equation    place by place: the place of the map that captures most is taken, its
            columns count as known, the rest is tested again, until none is significant
Source      forward selection with a max-T test by sign flips at each step (Holm-like:
            the family shrinks by what was found)
Valid       markers on every body; with a flange target alone a place is an inference
Ignores     places without columns in the map (force sensor, markers): these are named
==========  ==========================================================================

Two effects that move the markers alike cannot be told apart by any method.

==========  ==========================================================================
Equation    cosine of two signatures after the nominal columns are projected out; for
            several columns the largest over directions (first canonical correlation)
            of the smaller signature's fitted direction
Source      Hotelling 1936, "Relations between two sets of variates"
Valid       at the shapes that were found
Ignores     that a third effect may confound two
==========  ==========================================================================

What has no name still has a place, dependences, and perhaps a law known elsewhere.

==========  ==========================================================================
Equation    extra turn = sum over knots of (loading + unloading) hats of torque, fitted
            with everything known; claimed where poses left out gain by two standard
            errors, and its loop where they gain by that once more
Source      piecewise linear regression; leave-groups-out validation
Valid       about an axis; other places get words alone
Ignores     what the law does beyond the torques seen
==========  ==========================================================================
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    training,
)
from stiffness.diagnosis.result import Located, Name, UnexplainedPlace
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    normal_equations_of,
    per_pose_scores,
)
from stiffness.effects.candidates import Library, Mapped
from stiffness.effects.jacobian import (
    EffectJacobian,
    JointRotation,
    hstack,
    mixture,
)
from stiffness.effects.residual_map import KNOTS, hats
from stiffness.experiment.static_state import StaticState
from stiffness.regression.normal_equations import (
    NormalEquations,
    projection_coefficients,
    schur_complement,
    solve,
    whitening_transform,
)
from stiffness.regression.testing import (
    SIGNIFICANCE,
    is_significant,
    sign_flip_test,
    white_scores,
)

# --- Sites ----------------------------------------------------------------------------

FAINT = 1e-3
"""Share of the largest torque on any axis below which there is none; chosen."""
MAX_SITES = 4
"""Places that are looked for at most; chosen: more is no finding but a bad model."""

WORDS = {"geometry": "angle"}


def places_of_map(
    blocks: Sequence[Mapped],
    evidence: NormalEquations,
    known: np.ndarray,
    seed: int,
) -> list[tuple[str, float, float, tuple[str, ...]]]:
    """Return significant places, strongest first: where, p, captured, depends on."""
    gram, score = evidence.gram.sum(axis=0), evidence.score
    names = tuple(dict.fromkeys(m.where for m in blocks))
    columns = {
        n: np.concatenate([m.columns for m in blocks if m.where == n]) for n in names
    }
    found: list[tuple[str, float, float, tuple[str, ...]]] = []
    left = list(names)
    for _ in range(MAX_SITES):
        white = white_scores(
            gram, score, known, [columns[n] for n in left], evidence.raw
        )
        tested = sign_flip_test(white, seed)
        best = int(np.argmax(tested.z))
        if tested.together[best] >= SIGNIFICANCE:
            break
        where = left.pop(best)
        parts = [m for m in blocks if m.where == where]
        of_parts = sign_flip_test(
            white_scores(gram, score, known, [m.columns for m in parts], evidence.raw),
            seed,
        )
        strong = of_parts.captured > 0.5 * of_parts.captured.max()
        words = [WORDS.get(m.depends_on, m.depends_on) for m in parts]
        words = tuple(dict.fromkeys(w for w, s in zip(words, strong, strict=True) if s))
        p, captured = float(tested.together[best]), float(tested.captured[best])
        found.append((where, p, captured, words))
        known = np.concatenate([known, columns[where]])
    return found


def located_by_map(case: SelectionProblem) -> tuple[Located, ...]:
    """Return places of the map, strongest first, beside the nominal arm alone."""
    known = np.arange(case.library.nominal)
    of_map = places_of_map(
        case.library.map.blocks, case.map_equations, known, case.seed
    )
    total = max(sum(float(captured) for _, _, captured, _ in of_map), 1e-12)
    found = (Located(w, p, float(c) / total, d, "") for w, p, c, d in of_map)
    return tuple(sorted(found, key=lambda place: -place.share))


def joined_places(places: Iterable[UnexplainedPlace]) -> tuple[UnexplainedPlace, ...]:
    """Add up the shares of each place, the largest first; together one at most."""
    joined: dict[str, UnexplainedPlace] = {}
    for one in places:
        old = joined.get(one.where, replace(one, share=0.0))
        words = tuple(dict.fromkeys((*old.depends_on, *one.depends_on)))
        p, share = min(one.p_value, old.p_value), min(old.share + one.share, 1.0)
        joined[one.where] = UnexplainedPlace(one.where, p, share, words)
    most = max(1.0, sum(max(place.share, 0.0) for place in joined.values()))
    less = (replace(place, share=place.share / most) for place in joined.values())
    return tuple(sorted(less, key=lambda place: -place.share))


def displaced_by_places(
    case: SelectionProblem, data: SufficientStatistics, fit: ModelFit
) -> dict[str, float]:
    """Return the whitened square of what each place of a set displaces.

    ==========  ======================================================================
    Equation    b_B' (G_BB - G_BN G_NN^+ G_NB) b_B, b_B the sizes of all terms at a
                place and N the nominal columns
    Source      the square of a least-squares residual
    Valid       sizes and shapes as found, which are taken for true
    Ignores     what other places displace alike: two effects of one motion have each
                all of it; and how well axes return to a posture: of that many readings
                of a visit say as little as one, and what hangs on angles would count
                for a fraction
    ==========  ======================================================================

    Args:
        case: As laid out under the set.
        data: Readings with the weights of the instruments alone.
        fit: The set.
    """
    done: dict[str, list[EffectJacobian]] = {}
    for term, size in zip(fit.members, fit.coefficients, strict=True):
        law = mixture(term.jacobian(case.situation), size[:, None])
        done.setdefault(term.where, []).append(law)
    places = [mixture(hstack(own), np.ones((len(own), 1))) for own in done.values()]
    every = np.zeros(len(case.split.fold), dtype=int)
    gram = normal_equations_of(data, [*case.nominal, *places], every).gram[0]
    nominal, own = np.split(np.arange(len(gram)), [case.library.nominal])
    share = projection_coefficients(gram, nominal)
    left = np.diag(schur_complement(gram, nominal, share, own))
    return dict(zip(done, left.tolist(), strict=True))


def places_of_names(
    members: Sequence[ModelTerm],
    displaced: Mapping[str, float],
    p_value: float,
    situation: StaticState,
) -> tuple[Located, ...]:
    """Return where the named effects sit, strongest first.

    Args:
        members: The set, the strongest first.
        displaced: Whitened square of what the terms at each place alone displace.
        p_value: Of the mismatch.
        situation: For the zone in words.
    """
    total = max(sum(displaced.values()), 1e-12)
    found = []
    for where, square in displaced.items():
        own = [member for member in members if member.where == where]
        words = tuple(dict.fromkeys(w for member in own for w in member.depends_on))
        zone = zone_of(situation, own[0])
        found.append(Located(where, p_value, square / total, words, zone))
    return tuple(sorted(found, key=lambda place: -place.share))


def zone_of(situation: StaticState, member: ModelTerm) -> str:
    """Say in words where an axis' effect is largest."""
    if member.where not in situation.axes:
        return ""
    parts = member.jacobian(situation).parts
    if not parts or not hasattr(parts[0], "law"):
        return ""
    k = situation.axis(member.where)
    law = np.abs(parts[0].law).sum(axis=1)  # type: ignore[union-attr]
    if np.ptp(law) < 1e-9 * max(law.max(), 1e-300):
        return "everywhere"
    strong = law >= 0.7 * law.max()
    stages, count = np.unique(situation.recording.stage[strong], return_counts=True)
    words = []
    stage = situation.recording.stage
    if count.max() > 0.6 * count.sum() and np.any(stage != stage[0]):
        words.append(str(stages[np.argmax(count)]))
    low, high = np.quantile(situation.torque[strong, k], [0.05, 0.95])
    least = FAINT * max(float(np.abs(situation.torque).max()), 1e-9)
    if "torque" in member.depends_on and max(abs(low), abs(high)) > least:
        load, unit = ("force", "N") if situation.arm.slides[k] else ("torque", "N m")
        words.append(f"{load} {low:.3g} to {high:.3g} {unit}")
    return ", ".join(words)


# --- Confounded effects ---------------------------------------------------------------


@dataclass(frozen=True)
class WhitenedCandidates:
    """Candidates' columns at their best shapes, each candidate's own made white."""

    product: Float[np.ndarray, "m m"]
    score: Float[np.ndarray, " m"]
    owned: tuple[Int[np.ndarray, " _"], ...]
    shape: tuple[int, ...]


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
    turns, owned, shape, start = [], [], [], 0
    used: list[np.ndarray] = []
    for candidate in library.candidates:
        best: tuple[float, int, np.ndarray] = (-1.0, 0, np.zeros((0, 0)))
        for s, block in enumerate(candidate.columns):
            left = schur_complement(gram, nominal, share, block)
            turn = whitening_transform(left, evidence.raw[block])
            gain = float(np.sum((turn.T @ score[block]) ** 2))
            if gain > best[0]:
                best = (gain, s, turn)
        _, s, turn = best
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
        mix.T @ left @ mix, mix.T @ score[columns], tuple(owned), tuple(shape)
    )


TOO_ALIKE = 0.95
"""The rule of the answer's goals: pairs above this cosine are confounded."""


def confounded_with(
    library: Library, white: WhitenedCandidates, names: set[tuple[str, str]]
) -> tuple[tuple[Name, Name], ...]:
    """Return the pairs with a named effect that these data hardly tell apart."""
    pairs = []
    for i, candidate in enumerate(library.candidates):
        if candidate.name not in names or not len(white.owned[i]):
            continue
        own = white.owned[i]
        direction = white.score[own]
        size = np.linalg.norm(direction)
        if size == 0.0:
            continue
        for j, other in enumerate(library.candidates):
            if other.name == candidate.name or not len(white.owned[j]):
                continue
            seen = white.product[np.ix_(white.owned[j], own)] @ (direction / size)
            if np.linalg.norm(seen) > TOO_ALIKE:
                pairs.append((Name(*candidate.name), Name(*other.name)))
    once = {
        frozenset(((a.effect, a.where), (b.effect, b.where))): (a, b) for a, b in pairs
    }
    return tuple(once.values())


# --- Residual outside the library -----------------------------------------------------

EVEN = 0.3
"""Share of a law's square from which its even part is mentioned; chosen."""


def law_of(
    case: SelectionProblem, known: tuple[EffectJacobian, ...], where: str
) -> tuple[Mapping[str, tuple[float, ...]], str]:
    """Learn an axis' extra turn against torque, and say how it looks.

    Args:
        case: What may be looked at.
        known: Columns that are fitted beside it.
        where: The axis.

    Returns:
        Torque in N m and turn in rad while loading and unloading, and words; both
        empty where it does not hold at poses left out.
    """
    situation = case.situation
    if where not in situation.axes:
        return {}, ""
    k = situation.axis(where)
    torque = situation.torque[:, k]
    knots = hats(torque, KNOTS)
    if not knots.shape[1]:
        return {}, ""
    path = situation.load_torque[:, k][situation.steps]
    rise = np.diff(path, axis=1, prepend=path[:, :1])
    grows = situation.from_steps((np.sign(path) * np.sign(rise) >= 0).astype(float))
    width = knots.shape[1]
    plain = EffectJacobian(width, (JointRotation(k, knots),))
    both = np.concatenate([knots, knots * (2 * grows - 1)[:, None]], axis=1)
    looped = EffectJacobian(2 * width, (JointRotation(k, both),))
    at = np.unique(np.quantile(torque, np.linspace(0.0, 1.0, KNOTS)))
    without, single, double = (
        _gain_left_out(case, [*known, *law])[~case.split.held_out]
        for law in ((), (plain,), (looped,))
    )
    if is_significant(double - single):
        fit = _fitted(case, known, looped)
        mean, half = fit[:width], fit[width:]
    elif is_significant(single - without):
        mean, half = _fitted(case, known, plain), np.zeros(width)
    else:
        return {}, ""
    return {
        "torque_nm": tuple(float(v) for v in at),
        "loading_rad": tuple(float(v) for v in mean + half),
        "unloading_rad": tuple(float(v) for v in mean - half),
    }, _look(at, mean - np.interp(0.0, at, mean), half)


def _gain_left_out(
    case: SelectionProblem, columns: Sequence[EffectJacobian]
) -> Float[np.ndarray, " poses"]:
    """Return how much better each pose is predicted by fits that have not seen it.

    Half the fall in whitened square against the data as they are: an expected log
    predictive density, pose by pose; 0 for the poses of the hold-out.
    """
    split = case.split
    found = per_pose_scores(case.data, columns, training(split))
    whole = found.own[~split.held_out].sum(axis=0)
    score = found.score[~split.held_out].sum(axis=0)
    gain = np.zeros(len(found.own))
    for f in range(1, split.count + 1):
        inside = split.fold == f
        if not inside.any():
            continue
        own, asked = found.own[inside], found.score[inside]
        beta = solve(whole - own.sum(axis=0), score - asked.sum(axis=0))
        curve = np.einsum("i,pij,j->p", beta, own, beta)
        gain[inside] = asked @ beta - 0.5 * curve
    return gain


def _fitted(
    case: SelectionProblem, known: tuple[EffectJacobian, ...], law: EffectJacobian
) -> Float[np.ndarray, " columns"]:
    """Return a law's coefficients, bounded, for hats add up to what springs do."""
    evidence = normal_equations_of(case.data, [*known, law], training(case.split))
    n = sum(s.columns for s in known)
    gram = evidence.gram[1].copy()
    ridge = np.zeros(len(gram))
    ridge[n:] = 1e-6 * np.trace(gram[n:, n:]) / law.columns
    score = evidence.score[~case.split.held_out].sum(axis=0)
    return solve(gram + np.diag(ridge), score)[n:]


def _look(at: np.ndarray, mean: np.ndarray, half: np.ndarray) -> str:
    """Say whether a law is odd or even in torque and whether it has a loop."""
    mirrored = np.interp(-at, at, mean)
    odd, even = 0.5 * (mean - mirrored), 0.5 * (mean + mirrored)
    whole = float(np.sum(odd**2) + np.sum(even**2)) + 1e-300
    words = []
    if np.sum(odd**2) > EVEN * whole:
        words.append("odd in torque")
    if np.sum(even**2) > EVEN * whole:
        words.append("even in torque")
    if np.any(half):
        words.append("with a loop between loading and unloading")
    return ", ".join(words)
