"""Oracles: how far an effect is from the library, and the gain of knowing the truth.

`explained` fits an effect by the best set of up to three names of the library; what
these do not explain makes it an effect outside the library. The library is the
diagnosis' own, for its names are those that must not be given. The fit is made on an
effect so large that the χ² by chance, some fifty at most, is small beside it. The size
of the effect itself comes from `visibility`, without the diagnosis.

`oracle_gain_mm` is the gain of the true mechanism on held-out poses, an upper bound.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bench.effects.effect import Effect
from bench.patch import Patch, can_build, named
from bench.proof.proof import prove
from bench.rig import RIGID, Rig
from bench.shared.errors import BenchError
from bench.shared.recording import Recording
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.studies.blind_trials.magnitudes import OutOfReach, as_large_as
from scenarios.studies.blind_trials.visibility import Visibility
from stiffness.diagnosis.model_fit import (
    ModelTerm,
    SelectionProblem,
    other_forms,
    refined,
)
from stiffness.diagnosis.nominal_fit import Prepared, blocks, prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.selection import RankedModels, rank_models, whiten_candidates
from stiffness.diagnosis.sufficient_statistics import normal_equations_of
from stiffness.effects import HYPOTHESES
from stiffness.experiment.visits import visits_of
from stiffness.regression.elimination import minimum_norm_fit
from stiffness.regression.splits import split_of

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
    """Return the χ² that the best set of up to three names of the library explains.

    Args:
        recording: Recording with the effect.
        model: Model file of the nominal arm.
        without: Names that are taken out of the library.
    """
    arm = arm_of(model).for_recording(recording)
    names = [h for h in HYPOTHESES if h.effect not in without]
    case = build_problem(_returning(prepare(recording, arm)), names)
    white = whiten_candidates(case.library, case.normal_equations)
    sets = rank_models(case.library, white, len(np.unique(recording.posture_id)))
    size = np.array([len(members) for members in sets.models])
    best = [np.flatnonzero(size == s)[np.argsort(-sets.gain[size == s])] for s in SIZES]
    return max(_at_its_best(case, sets, int(k)) for of in best for k in of[:FRONT])


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

    Args:
        effect: Of a catalogue's size.
        least: The least unexplained χ².
        weigh: Simulates an effect and returns its visibility.
        captured: Simulates an effect and returns the χ² that the library explains.
        draw: Random numbers, for the factor above the least.

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

MM = 1e3


def oracle_gain_mm(folder: Path, model: Path, rig: Rig) -> float | None:
    """Return the gain of the true mechanism on held-out poses, in mm.

    It is proved as a diagnosis' patch is: tracker frame and marker positions start at
    the diagnosis' values, springs and parameters at the true ones.

    Args:
        folder: Folder of the recording.
        model: Model file of the nominal arm.
        rig: The true arm.

    Returns:
        The gain; None where the simulator has no such mechanism or no equilibrium.
    """
    if not rig.effects or not all(can_build(e.name) for e in rig.effects):
        return None
    recording, arm, _ = read_for(folder, arm_of(model))
    frames = prepare(recording, arm).frames
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = frames.turn, frames.shift
    held_out = np.unique(recording.posture_id)[split_of(recording).held_out]
    springs = zip(rig.anatomy.axes, rig.springs, strict=True)
    patch = Patch(
        stiffness_nm_per_rad={a: None if k >= RIGID else float(k) for a, k in springs},
        effects=tuple(named(effect) for effect in rig.effects),
        base_from_tracker=tuple((a, b, c, d) for a, b, c, d in transform.tolist()),
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
