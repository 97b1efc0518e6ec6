"""Oracle of a whole arm: the χ² of each effect on its own, and what the truth explains.

An effect's own χ² is what is lost of the noise-free readings when it alone is removed
and all others are fitted again, so that no method can find one whose own χ² is small.
Names and places are the true ones; sizes and shapes are fitted. All columns are the
diagnosis' own, its selection is not used.

==========  ==========================================================================
Equation    own χ² = loss of a name (`linear_model`) in readings of instruments without
            errors, weighted by the true errors of the trial's
Source      as there
Valid       effects that the library has a law of
Ignores     that laws of the library are not those of the simulator: what they leave of
            noise-free readings is `left`
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.effects.effect import Effect
from bench.shared.recording import Recording
from scenarios.pipelines.inputs import arm_of
from scenarios.studies.blind_trials.linear_model import (
    explained_share,
    linear_model_of,
    losses_of,
)
from stiffness.diagnosis.model_fit import ModelTerm
from stiffness.diagnosis.nominal_fit import (
    Prepared,
    blocks,
    prepare,
    residuals_of,
)
from stiffness.effects import HYPOTHESES
from stiffness.experiment.residuals import bodies_of
from stiffness.experiment.static_state import StaticState, static_state_of
from stiffness.experiment.visits import visits_of


@dataclass(frozen=True)
class ArmOracle:
    """What can be known of the effects of a whole arm.

    Attributes:
        own: χ² of each effect on its own; 0 where the library has no law at its place.
        share: Of the mismatch on poses kept back that the true names explain.
        left: χ² of noise-free readings that the true names do not explain.
    """

    own: tuple[float, ...]
    share: float
    left: float


def arm_oracle(
    recording: Recording, quiet: Recording, model: Path, effects: Sequence[Effect]
) -> ArmOracle:
    """Return what can be known of a whole arm.

    Args:
        recording: The recording that is diagnosed.
        quiet: The same arm and plan by instruments without errors.
        model: Model file of the nominal arm.
        effects: The true effects.
    """
    arm = arm_of(model).for_recording(recording)
    prepared = prepare(recording, arm)
    choices = [true_terms(effect, prepared.situation) for effect in effects]
    known = [own for own in choices if own]
    share = explained_share(linear_model_of(prepared, known, with_shapes=True))
    clean = linear_model_of(noise_free(prepared, quiet), known, with_shapes=True)
    lost, left = losses_of(clean)
    each = iter(lost)
    own = tuple(float(next(each)) if choice else 0.0 for choice in choices)
    return ArmOracle(own, share, left)


def log_bayes_factor(
    recording: Recording, quiet: Recording, model: Path, effect: Effect, twin: str
) -> float:
    """Return what noise-free readings say for an effect against its twin.

    Half of the difference of the whitened squares that either leaves. Both have as many
    sizes and shapes, so that nothing else counts.

    Args:
        recording: The recording that is diagnosed.
        quiet: The same arm and plan by instruments without errors.
        model: Model file of the nominal arm.
        effect: The only effect.
        twin: Place of the twin.
    """
    arm = arm_of(model).for_recording(recording)
    clean = noise_free(prepare(recording, arm), quiet)
    left = []
    for one in (effect, replace(effect, where=twin)):
        terms = true_terms(one, clean.situation)
        model_of_one = linear_model_of(clean, [terms] if terms else [], True)
        left.append(losses_of(model_of_one)[1])
    return 0.5 * (left[1] - left[0])


def noise_free(prepared: Prepared, quiet: Recording) -> Prepared:
    """Return a recording's weights with the readings of instruments without errors.

    Weights are those of the errors that the instruments state; axes arrive exactly.

    Args:
        prepared: The recording against its nominal model.
        quiet: The same arm and plan by instruments without errors.
    """
    before = prepared.situation
    told = before.recording.base_from_tracker
    quiet = replace(quiet, base_from_tracker=told, link_posture=None)
    names, _ = bodies_of(before.arm, quiet)
    situation = replace(
        static_state_of(before.arm, quiet, before.compliance, names),
        tracker=before.tracker,
        marker_positions=before.marker_positions,
    )
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

    Args:
        effect: The effect.
        situation: Static state of the arm.
    """
    stated, found = effect.parameters(), []
    for law in (h for h in HYPOTHESES if h.effect == effect.name):
        if effect.where not in law.places(situation):
            continue
        grid = law.shapes(situation, effect.where).copy()
        for j, name in enumerate(law.shape_names[: grid.shape[1]]):
            value = stated.get(name)
            if isinstance(value, float | int):
                grid[:, j] = value
        shapes = np.unique(grid, axis=0)
        found += [ModelTerm(law, effect.where, shape) for shape in shapes]
    return found
