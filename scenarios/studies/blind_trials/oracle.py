"""Oracles: how far an effect is from the library, and the gain of knowing the truth.

`explained` fits an effect by the best set of up to three names of the library; what
these do not explain makes it an effect outside the library. The library has the
diagnosis' own hypotheses, for their names are those that must not be given, as far as
`strata.LIBRARY` lists them: a new hypothesis changes no trial. The fit is made on an
effect so large that the χ² by chance, some fifty at most, is small beside it. The size
of the effect itself comes from `visibility`, without the diagnosis.

`oracle_gain_mm` is the gain of the true mechanism on held-out poses, an upper bound.

`arm_oracle` knows the names of a whole arm. An effect's own χ² is what is lost of the
noise-free readings when it alone is removed and all others are fitted again, so that no
method can find one whose own χ² is small. Names and places are the true ones; sizes and
shapes are fitted. All columns are the diagnosis' own, its selection is not used.

==========  ==========================================================================
Equation    own χ² = loss of a name (`linear_model`) in readings of instruments without
            errors, weighted by the true errors of the trial's
Source      as there
Valid       effects that the library has a law of
Ignores     that laws of the library are not those of the simulator: what they leave of
            noise-free readings is `residual`
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

from bench.effects.effect import Effect
from bench.patch import Patch, can_build, named
from bench.proof.proof import prove
from bench.rig import RIGID, Rig
from bench.shared.errors import BenchError
from bench.shared.recording import Recording
from bench.shared.settings import MM
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.studies.blind_trials.effects import OutOfReach, as_large_as
from scenarios.studies.blind_trials.linear_model import (
    explained_share,
    linear_model_of,
    losses_of,
    with_its_columns,
)
from scenarios.studies.blind_trials.strata import LIBRARY
from scenarios.studies.blind_trials.visibility import Visibility
from stiffness.diagnosis.localisation import WhitenedCandidates, whiten_candidates
from stiffness.diagnosis.model_fit import (
    WHOLE,
    ModelTerm,
    SelectionProblem,
    other_forms,
    training,
)
from stiffness.diagnosis.nominal_fit import Prepared, blocks, prepare, residuals_of
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    normal_equations_of,
)
from stiffness.effects import HYPOTHESES
from stiffness.effects.base import Hypothesis
from stiffness.effects.candidates import Library
from stiffness.effects.jacobian import EffectJacobian
from stiffness.experiment.residuals import bodies_of
from stiffness.experiment.static_state import StaticState, static_state_of
from stiffness.experiment.visits import visits_of
from stiffness.regression.normal_equations import (
    minimum_norm_fit,
    projection_coefficients,
    solve,
)
from stiffness.regression.splits import Split, split_of

# --- Best sets of up to three effects -------------------------------------------------

PRIOR_OF_SIZE = (0.4, 0.35, 0.2, 0.05)
"""Prior of none, one, two or three effects; chosen: few causes, each as likely."""
ONE_MORE = 0.25
"""Prior of each further effect; chosen: as three are to two."""


def log_prior(size: int, candidates: int) -> float:
    """Return the prior of one set of a size: the size's prior over the sets' number."""
    if size > candidates:
        return -np.inf
    ways = gammaln(candidates + 1) - gammaln(size + 1) - gammaln(candidates - size + 1)
    small = min(size, len(PRIOR_OF_SIZE) - 1)
    of_size = np.log(PRIOR_OF_SIZE[small]) + (size - small) * np.log(ONE_MORE)
    return float(of_size - ways)


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
    library: Library, white: WhitenedCandidates, poses: int
) -> RankedModels:
    """Try all sets of up to three and rank them by evidence, the empty set first."""
    count = len(library.candidates)
    some = [k for k, own in enumerate(white.owned) if len(own)]
    singles = [(k,) for k in some]
    pairs = [p for p in combinations(some, 2) if _distinct(library, p)]
    every: list[tuple[int, ...]] = [(), *singles, *pairs]
    total = [np.zeros(1)]
    total += [chi_square_gains(white, sets) for sets in (singles, pairs)]
    if len(some) > 2:
        listed = _short_list(library, every, np.concatenate(total), poses)
        triples = [t for t in combinations(listed, 3) if _distinct(library, t)]
        total.append(chi_square_gains(white, triples))
        every += triples
    gain = np.concatenate(total)
    freedom = _degrees_of_freedom(library, every)
    rarer = [c.hypothesis.log_prior for c in library.candidates]
    prior = np.array(
        [log_prior(len(s), count) + sum(rarer[k] for k in s) for s in every]
    )
    log_evidence = 0.5 * gain - 0.5 * freedom * np.log(poses) + prior
    shape = tuple(tuple(white.shape[k] for k in s) for s in every)
    return RankedModels(tuple(every), shape, gain, log_evidence)


def _degrees_of_freedom(
    library: Library, models: Sequence[tuple[int, ...]]
) -> np.ndarray:
    own = [c.degrees_of_freedom for c in library.candidates]
    return np.array([sum(own[k] for k in s) for s in models])


def _distinct(library: Library, members: Sequence[int]) -> bool:
    """Return whether no name comes twice."""
    names = {library.candidates[k].name for k in members}
    return len(names) == len(members)


def _short_list(
    library: Library, models: list[tuple[int, ...]], gain: np.ndarray, poses: int
) -> list[int]:
    """Return the candidates that come up in the best sets so far."""
    order = np.argsort(-(gain - _degrees_of_freedom(library, models) * np.log(poses)))
    listed: list[int] = []
    for at in order:
        listed.extend(k for k in models[at] if k not in listed)
        if len(listed) >= SHORT_LIST:
            break
    return sorted(listed[:SHORT_LIST])


# --- Refinement of their shapes -------------------------------------------------------

TRIES = 9
"""Values that are tried at once."""


def refined(
    data: SufficientStatistics,
    situation: StaticState,
    nominal: Sequence[EffectJacobian],
    members: Sequence[ModelTerm],
    split: Split,
) -> tuple[ModelTerm, ...]:
    """Move each shape parameter to where the set explains most, in turn, twice."""
    members = list(members)
    for sweep in range(2 if sum(m.degrees_of_freedom for m in members) else 0):
        for k in range(len(members)):
            first, law = members[k], members[k].hypothesis
            grid = law.shapes(situation, first.where)
            for j, name in enumerate(law.shape_names[: first.degrees_of_freedom]):
                if name in WHOLE:
                    continue
                here, factor = members[k], name in law.logarithmic
                tries = tried(
                    float(here.shape[j]), np.unique(grid[:, j]), sweep, factor
                )
                if tries[-1] - tries[0] < 1e-12 * max(1.0, abs(tries[0])):
                    continue
                others = [m for i, m in enumerate(members) if i != k]
                gain = _chi_square_gains(
                    data,
                    [*nominal, *(m.jacobian(situation) for m in others)],
                    [
                        _shaped(here, j, value, factor).jacobian(situation)
                        for value in tries
                    ],
                    split,
                )
                members[k] = _shaped(here, j, _vertex(tries, gain), factor)
    return tuple(members)


def _shaped(term: ModelTerm, j: int, value: float, factor: bool) -> ModelTerm:
    """Return a term with another shape parameter, or with another logarithm of it."""
    shape = term.shape.copy()
    shape[j] = np.exp(value) if factor else value
    return ModelTerm(term.hypothesis, term.where, shape)


def _chi_square_gains(
    data: SufficientStatistics,
    known: Sequence[EffectJacobian],
    tries: Sequence[EffectJacobian],
    split: Split,
) -> Float[np.ndarray, " tries"]:
    """Return what each of some laws explains beside known ones, poses learnt from."""
    evidence = normal_equations_of(data, [*known, *tries], training(split))
    gram, score = evidence.gram[1], evidence.score[~split.held_out].sum(axis=0)
    n, width = sum(s.columns for s in known), tries[0].columns
    before = np.arange(n)
    share = projection_coefficients(gram, before)
    score = score - score[before] @ share
    gram = gram - gram[:, before] @ share
    gains = []
    for start in range(n, len(score), width):
        block = np.arange(start, start + width)
        gains.append(score[block] @ solve(gram[np.ix_(block, block)], score[block]))
    return np.array(gains)


def _vertex(
    tries: Float[np.ndarray, " tries"], gain: Float[np.ndarray, " tries"]
) -> float:
    """Return the best try, moved to the vertex of a parabola through neighbours."""
    best = int(np.argmax(gain))
    if 0 < best < len(tries) - 1:
        a, b, c = gain[best - 1 : best + 2]
        bend = a - 2 * b + c
        if bend < 0:
            return tries[best] + 0.5 * (a - c) / bend * (tries[1] - tries[0])
    return tries[best]


def tried(
    here: float, grid: Float[np.ndarray, " points"], sweep: int, factor: bool
) -> Float[np.ndarray, "9"]:
    """Return values that are tried, or their logarithms where an error is a factor.

    The first sweep goes from neighbour to neighbour of the grid's nearest, later ones a
    step of these to either side.
    """
    if factor:
        here, grid = float(np.log(here)), np.log(grid)
    nearest = int(np.argmin(np.abs(grid - here)))
    low, high = grid[max(nearest - 1, 0)], grid[min(nearest + 1, len(grid) - 1)]
    if sweep:
        step = (high - low) / (TRIES - 1)
        low, high = max(low, here - step), min(high, here + step)
    return np.linspace(low, high, TRIES)


# --- Distance from the library --------------------------------------------------------

PROBE = 20_000.0
"""χ² of the effect that the library is fitted to; chosen: its noise is 2 √χ², 1.4 %."""
LEAST_SHARE = 0.04
"""Least unexplained share that exceeds that noise; chosen: three times."""
MAX_CHI_SQUARE = 40_000.0
"""χ² above which an effect counts as explained by the library; chosen."""
LEFT = 1.3
"""Factor on the unexplained χ² that is asked for, as only few models are refined."""
SIZES, FRONT = (1, 2, 3), 3
"""Sizes of models, and how many of the best of each are refined; chosen for time."""
SPAN = 4.0
"""Ratio of the largest drawn unexplained χ² to the least; chosen."""


def explained(recording: Recording, model: Path, without: Sequence[str]) -> float:
    """Return the χ² that the best set of up to three names of the library explains."""
    prepared = prepared_with(model, recording)
    case = build_problem(_returning(prepared), library(without))
    white = whiten_candidates(case.library, case.normal_equations)
    sets = rank_models(case.library, white, len(np.unique(recording.posture_id)))
    size = np.array([len(members) for members in sets.models])
    best = [np.flatnonzero(size == s)[np.argsort(-sets.gain[size == s])] for s in SIZES]
    return max(_at_its_best(case, sets, int(k)) for of in best for k in of[:FRONT])


def library(without: Sequence[str]) -> list[Hypothesis]:
    """Return the hypotheses that `strata.LIBRARY` lists, without some names."""
    names = set(LIBRARY) - set(without)
    return [hypothesis for hypothesis in HYPOTHESES if hypothesis.effect in names]


def _at_its_best(case: SelectionProblem, sets: RankedModels, number: int) -> float:
    """Return a model's χ² on all poses, refined and with its laws' other forms."""
    candidates = [case.library.candidates[k] for k in sets.models[number]]
    members = [
        ModelTerm(c.hypothesis, c.where, c.shapes[s])
        for c, s in zip(candidates, sets.shape[number], strict=True)
    ]
    every = replace(case.split, fold=np.ones_like(case.split.fold), count=1)
    members = refined(case.data, case.situation, case.nominal, members, every)
    laws = [m.jacobian(case.situation) for m in members]
    columns = [*case.nominal, *laws, *other_forms(case, members)]
    found = normal_equations_of(
        case.data, columns, np.zeros(len(every.fold), dtype=int)
    )
    gram, score = found.gram[0], found.score.sum(axis=0)
    known = case.library.nominal
    before = score[:known] @ minimum_norm_fit(gram[:known, :known], score[:known])
    gain = float(score @ minimum_norm_fit(gram, score) - before)
    return max(gain, float(sets.gain[number]))


def _returning(prepared: Prepared) -> Prepared:
    """Set the pose repeatability to zero, as it is where visibility is computed.

    Otherwise the scatter of an effect over visits counts as repeatability, and the
    library would explain too little of it.
    """
    situation, exact = prepared.situation, np.zeros(len(prepared.pose_repeatability))
    visits = visits_of(situation.visit, situation.posture_index)
    data, _ = blocks(situation, visits, prepared.readings, exact)
    return replace(prepared, data=data, pose_repeatability=exact)


def as_strange_as(
    effect: Effect,
    least: float,
    weigh: Callable[[Effect], Visibility],
    captured: Callable[[Effect], float],
    draw: np.random.Generator,
) -> tuple[Effect, Visibility]:
    """Find a size of which the library leaves at least a given χ² unexplained.

    `captured` simulates an effect and returns the χ² that the library explains.

    Raises:
        OutOfReach: Where the library explains nearly all of it, or no size will do.
    """
    probe, weight = as_large_as(effect, PROBE, weigh)
    share = 1.0 - captured(probe) / (weight.within + weight.between)
    wanted = LEFT * least * SPAN ** draw.uniform(0.0, 1.0)
    if share < LEAST_SHARE or share * MAX_CHI_SQUARE < wanted:
        raise OutOfReach(f"The library explains {effect.name} at {effect.where}.")
    larger, weight = as_large_as(probe, wanted / share, weigh)
    return larger, replace(weight, left=share * weight.chi2)


# --- Gain of knowing the truth --------------------------------------------------------


def oracle_gain_mm(folder: Path, model: Path, rig: Rig) -> float | None:
    """Return the gain of the true mechanism on held-out poses, in mm.

    It is proved as a diagnosis' patch is: tracker frame and marker positions start at
    the diagnosis' values, springs and parameters at the true ones.

    Returns:
        The gain; None where the simulator has no such mechanism or no equilibrium.
    """
    if not rig.effects or not all(can_build(e.name) for e in rig.effects):
        return None
    recording, arm, _ = read_for(folder, arm_of(model))
    frames = prepare(recording, arm).frames
    frame = frames.transform.tolist()
    held_out = np.unique(recording.posture_id)[split_of(recording).held_out]
    springs = zip(rig.anatomy.axes, rig.springs, strict=True)
    patch = Patch(
        stiffness_nm_per_rad={a: None if k >= RIGID else float(k) for a, k in springs},
        effects=tuple(named(effect) for effect in rig.effects),
        base_from_tracker=tuple((a, b, c, d) for a, b, c, d in frame),
        markers={
            marker.name: (float(x), float(y), float(z))
            for marker, (x, y, z) in zip(
                recording.markers, frames.marker_positions, strict=True
            )
        },
    )
    try:
        proof = prove(recording, model, patch, held_out.tolist(), thorough=False)
    except (BenchError, ArithmeticError, ValueError):
        return None
    return None if proof.markers is None else MM * proof.markers.gain


# --- Whole arms and twins -------------------------------------------------------------


@dataclass(frozen=True)
class ArmOracle:
    """What noise-free readings say of the effects of a whole arm.

    Attributes:
        own: χ² of each effect on its own; 0 where the library has no law at its place.
        residual: χ² of noise-free readings that the true names do not explain.
    """

    own: tuple[float, ...]
    residual: float


def prepared_with(model: Path, recording: Recording) -> Prepared:
    """Return a recording against a nominal model."""
    return prepare(recording, arm_of(model).for_recording(recording))


def arm_oracle(
    prepared: Prepared, quiet: Recording, effects: Sequence[Effect]
) -> ArmOracle:
    """Return what can be known of a whole arm.

    The quiet recording is of the same arm and plan by instruments without errors.
    """
    choices = [true_terms(effect, prepared.situation) for effect in effects]
    known = [own for own in choices if own]
    clean = linear_model_of(noise_free(prepared, quiet), known, with_shapes=True)
    lost = losses_of(clean)
    each = iter(lost.names)
    own = tuple(float(next(each)) if choice else 0.0 for choice in choices)
    return ArmOracle(own, lost.residual)


def oracle_share(prepared: Prepared, effects: Sequence[Effect]) -> float:
    """Return the share of the mismatch on poses kept back that true names explain."""
    choices = (true_terms(effect, prepared.situation) for effect in effects)
    known = [own for own in choices if own]
    model = linear_model_of(prepared, known, with_shapes=True)
    return explained_share(with_its_columns(prepared, model))


def displaced(prepared: Prepared, quiet: Mapping[str, Recording]) -> dict[str, float]:
    """Return χ² of what arms with a part of the effects each displace.

    It is what springs, frame and marks, fitted anew, leave of readings by instruments
    without errors, with the weights of the recording: no law is used.

    Args:
        prepared: The recording of the whole arm.
        quiet: Of arms with a part of its effects, same plan, by name of the part.
    """
    clean = {part: noise_free(prepared, seen) for part, seen in quiet.items()}
    fits = {part: linear_model_of(one, [], False) for part, one in clean.items()}
    return {part: losses_of(fit).residual for part, fit in fits.items()}


def log_bayes_factor(
    recording: Recording, quiet: Recording, model: Path, effect: Effect, twin: str
) -> float:
    """Return what noise-free readings say for an effect against its twin.

    Half of the difference of the whitened squares that either leaves. Both have as many
    sizes and shapes, so that nothing else counts. The quiet recording is of the same
    arm and plan by instruments without errors.
    """
    clean = noise_free(prepared_with(model, recording), quiet)
    left = []
    for one in (effect, replace(effect, where=twin)):
        terms = true_terms(one, clean.situation)
        model_of_one = linear_model_of(clean, [terms] if terms else [], True)
        left.append(losses_of(model_of_one).residual)
    return 0.5 * (left[1] - left[0])


def noise_free(prepared: Prepared, quiet: Recording) -> Prepared:
    """Return a recording's weights with the readings of instruments without errors.

    Weights are those of the errors that the instruments state; axes arrive exactly.
    """
    before = prepared.situation
    told = before.recording.base_from_tracker
    quiet = replace(quiet, base_from_tracker=told, link_posture=None)
    names, _ = bodies_of(before.arm, quiet)
    situation = static_state_of(before.arm, quiet, before.compliance, names)
    situation = replace(situation, frames=before.frames)
    readings = residuals_of(situation, prepared.frames)
    readings = replace(readings, weight=prepared.readings.weight)
    visits = visits_of(situation.visit, situation.posture_index)
    exact = np.zeros(len(before.compliance))
    data, _ = blocks(situation, visits, readings, exact)
    return replace(
        prepared,
        situation=situation,
        data=data,
        readings=readings,
        pose_repeatability=exact,
    )


def true_terms(effect: Effect, situation: StaticState) -> list[ModelTerm]:
    """Return the library's laws of an effect at its place, at all shapes it may have.

    Shapes that the effect states are at its values, all others on the library's grid.
    A form with a parameter that the effect does not have is not its law.
    """
    stated, found = effect.parameters(), []
    forms = {f.name for f in fields(effect) if f.metadata.get("optional")}
    for law in (h for h in HYPOTHESES if h.effect == effect.name):
        if effect.where not in law.places(situation):
            continue
        if law.limits.keys() & (forms - stated.keys()):
            continue
        grid = law.shapes(situation, effect.where).copy()
        for j, name in enumerate(law.shape_names[: grid.shape[1]]):
            value = stated.get(name)
            if isinstance(value, float | int):
                grid[:, j] = value
        shapes = np.unique(grid, axis=0)
        found += [ModelTerm(law, effect.where, shape) for shape in shapes]
    return found
