"""Proposes the measurements that discriminate best between competing models.

A competing effect is fitted in the simulator in place of the named one; then both
models simulate the candidate experiments, and the expected log Bayes factor of their
readings ranks these.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from bench.effects import EFFECTS
from bench.patch import PatchEffect, can_build, effect_of
from bench.proof.model_discrimination import Experiment, candidates, expected
from bench.proof.proof import Proof
from bench.proof.proof_checks import some_of
from bench.proof.refinement import refined, with_effects
from bench.proof.simulation import NominalState
from bench.shared.errors import BenchError
from bench.shared.models import axis_unit
from scenarios.pipelines.schema import Next
from stiffness.diagnosis.result import Diagnosis, Name

MOST_PAIRS, PER_PAIR = 2, 3
"""Pairs of rivals compared, and experiments proposed for each; chosen for time."""
TELLING = 1.0
"""Expected log Bayes factor below which an experiment is not proposed; chosen."""


def proposed(diagnosis: Diagnosis, proof: Proof | None) -> tuple[Next, ...]:
    """Return the measurements that discriminate best between rivals, best first.

    Rivals are equivalents and confounded pairs; without a proof nothing can be
    proposed.
    """
    if proof is None or not proof.simulation.recording.markers:
        return ()
    found: list[Next] = []
    for own, rival in list(_pairs(diagnosis))[:MOST_PAIRS]:
        try:
            found += _between(proof, own, rival)
        except (
            BenchError,
            ArithmeticError,
            ValueError,
        ):  # a rival that cannot be simulated
            continue
    return tuple(sorted(found, key=lambda n: -n.expected_log_bayes_factor))


def _pairs(diagnosis: Diagnosis) -> Iterator[tuple[Name, Name]]:
    """Yield each named effect with a rival of it: equivalents, then confounded ones."""
    named = {n.name for n in diagnosis.named}
    seen = set()
    pairs = [(n.name, rival) for n in diagnosis.named for rival in n.equivalents]
    pairs += [(a, b) if a in named else (b, a) for a, b in diagnosis.confounded]
    for own, rival in pairs:
        fresh = (own, rival) not in seen and rival not in named and own in named
        seen.add((own, rival))
        if fresh and can_build(own.effect) and can_build(rival.effect):
            yield own, rival


def _between(proof: Proof, own: Name, rival: Name) -> list[Next]:
    some = some_of(proof.simulation, np.zeros(proof.simulation.replay.rows, dtype=bool))
    simulation = proof.simulation.part(some)
    mode = replace(proof.mode, keep=proof.mode.keep[some])
    effects = proof.patched.rig.effects
    others = [e for e in effects if (e.name, e.where) != (own.effect, own.where)]
    start = effect_of(PatchEffect(rival.effect, rival.where, usual_size(rival)))
    rival_arm = with_effects(proof.patched, [*others, start])
    known = None if proof.sensitivity is None else proof.sensitivity.part(some)
    other = refined(simulation, rival_arm, mode, known=known).assumed
    experiments = candidates(simulation, proof.patched)
    factor = expected(simulation, proof.patched, other, experiments, mode.sigma)
    why = f"tells {own.effect} from {rival.effect} on {own.where}"
    if own.where != rival.where:
        why = f"tells {own.effect} on {own.where} from {rival.effect} on {rival.where}"
    listed, poses = [], set()
    for i in np.argsort(-factor):
        pose = experiments[i].posture.tobytes()
        if factor[i] < TELLING or pose in poses or len(listed) == PER_PAIR:
            continue
        poses.add(pose)
        listed.append(_said(experiments[i], why, float(factor[i]), proof.patched))
    return listed


def usual_size(name: Name) -> dict[str, float | str | None]:
    """Return the parameters of an effect of catalogue size, as the fit's start."""
    kind = next(kind for kind in EFFECTS if kind.name == name.effect)
    return {
        k: v if isinstance(v, str) or np.isfinite(v) else None
        for k, v in kind(where=name.where).parameters().items()
    }


def _said(experiment: Experiment, why: str, factor: float, arm: NominalState) -> Next:
    pose = pose_at_border(experiment.posture, arm.rig.anatomy.slides)
    return Next(why, pose, experiment.path, round(factor, 2))


def pose_at_border(
    posture: Float[np.ndarray, " axes"], slides: Sequence[bool]
) -> tuple[float, ...]:
    """Return a posture in degrees, in mm where an axis slides."""
    pairs = zip(posture, slides, strict=True)
    return tuple(round(float(axis_unit(s)[1] * x), 3) for x, s in pairs)
