"""Proof of a patch on poses, loads and places that it was not fitted to.

The patched simulator does again what was done in the poses held out, with the wrenches
that were read there, and what it leaves is compared with what the nominal arm leaves.
What is nominal is fitted on the other poses, for both. Both feel the wrench that was
read, turned as the patched arm holds the sensor: a soft arm turns it by tens of mrad.
Both are simulations: columns that found an effect are never its proof.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from threadpoolctl import threadpool_limits

from bench.effects.effect import Effect
from bench.patch import Patch, effects_of, named, rig_of, with_arm
from bench.proof.comparison import ComparisonMode, comparison_mode_of, means_count
from bench.proof.explained_share import Channel, FoldPrediction, channels_of
from bench.proof.nominal_fit import fitted
from bench.proof.proof_checks import ProofCheck, left_outs, placebos
from bench.proof.refinement import (
    NONE_KNOWN,
    Place,
    Sensitivity,
    refined,
    spring_errors,
    with_effects,
)
from bench.proof.setup import for_simulator, replay_simulation_of
from bench.proof.simulation import NominalState, ReplaySimulation
from bench.rig import RIGID
from bench.shared.recording import Recording, transform_of

MOST_ROWS = 3000
"""Rows that are simulated at most: whole visits (instants of a stream) are left out."""
FIRST_ROUNDS = 1
"""Simulations that the silent fit spends before the patch is refined; chosen:
refining fits the springs too."""


@dataclass(frozen=True)
class Fold:
    """Poses that a patch predicts which is fitted without them.

    Attributes:
        held_out: Ids of the poses.
        names: Effect and site of what of the patch is named without these poses.
    """

    held_out: tuple[int, ...]
    names: frozenset[tuple[str, str]]


@dataclass(frozen=True)
class Proof:
    """What the simulator says of a patch.

    Attributes:
        held_out: Ids of the poses that were judged, each by arms fitted without it.
        markers: Displacements; None without markers.
        angles: Encoders after the gears; None without.
        rotations: Turns of 6D targets and of bodies with three marks or more, in rad;
            None without.
        trials: Where the patch should hold and where it should fail.
        budget: How far each effect moves the readings beyond what is nominal, rms.
        patch: With parameters as refined in the simulator on the poses not held out.
        nominal: The arm without the patch, as fitted.
        patched: The arm with it.
        mode: How readings were compared, and which rows were fitted.
        sensitivity: What the patch's parameters do; None where there are none.
        folds: Number of fits that judged, each other poses; one where there was one.
        spring_errors: One sigma of each spring of the patched arm over the spring, 0
            where it is rigid; None where no patch was refined.
    """

    held_out: tuple[int, ...]
    markers: Channel | None
    angles: Channel | None
    rotations: Channel | None
    trials: tuple[ProofCheck, ...]
    budget: dict[str, float]
    patch: Patch
    nominal: NominalState
    patched: NominalState
    simulation: ReplaySimulation
    mode: ComparisonMode
    sensitivity: Sensitivity | None = None
    folds: int = 1
    spring_errors: Float[np.ndarray, " axes"] | None = None

    @property
    def absolute(self) -> bool:
        """Whether means of visits counted, or differences within them alone."""
        return self.mode.absolute


@threadpool_limits.wrap(limits=1, user_api="blas")
def prove(
    recording: Recording,
    arm_file: Path,
    patch: Patch,
    held_out: Sequence[int],
    thorough: bool = True,
    sigmas: Mapping[Place, float] = NONE_KNOWN,
    folds: Sequence[Fold] = (),
) -> Proof:
    """Prove a patch in the simulator.

    Args:
        recording: What was done and seen.
        arm_file: The nominal arm.
        patch: What was named, with springs, frame and places as first guesses; one
            without effects or laws is the nominal arm, and nothing is proved.
        held_out: Ids of the poses that nothing may be fitted to.
        thorough: Whether placebos and left-out loads are tried too.
        sigmas: By how much parameters of the patch may be wrong, by effect, where and
            name, one sigma in their units; 0: not refined. Others: as they are large.
        folds: Further poses that are held out in turn, each from a fit of its own.

    Raises:
        BenchError: Where the patch cannot be built or finds no rest.
    """
    carried = "carried" in (patch.memory, *patch.memories.values())
    recording = _thinned(recording, carried)
    placed = for_simulator(recording, patch, arm_file)
    pairs = zip(patch.effects, placed.effects, strict=True)
    now = {(old.effect, old.where): new.where for old, new in pairs}
    folds = [
        replace(f, names=frozenset((e, now.get((e, w), w)) for e, w in f.names))
        for f in folds
    ]
    sigmas = {(e, now.get((e, w), w), name): s for (e, w, name), s in sigmas.items()}
    patch = placed
    rig = rig_of(patch, arm_file)
    own = effects_of(patch)
    bare = rig_of(replace(patch, effects=(), laws=()), arm_file)
    simulation = replay_simulation_of(recording, rig, own)
    simulation = simulation.remembering(patch)
    held = np.isin(recording.posture_id, held_out)
    start = _start(recording, patch, rig)
    unpatched = replace(start, rig=bare)
    mode = comparison_mode_of(
        simulation, means_count(simulation, unpatched, start), ~held
    )
    nominal = fitted(simulation, unpatched, mode, FIRST_ROUNDS + 2)
    patched, sensitivity, errors = nominal, None, None
    if own:
        patched = fitted(simulation, start, mode, FIRST_ROUNDS)
        done = refined(simulation, patched, mode, sigmas)
        patched, sensitivity = done.assumed, done.sensitivity
        errors = spring_errors(simulation, done)
    tried = tuple(e for e in patched.rig.effects if e not in bare.effects)
    predictions = [FoldPrediction(nominal, patched, mode, held)]
    if sensitivity is not None:
        known = sigmas, sensitivity
        predictions += [
            _of_fold(simulation, nominal, patched, mode, f, *known) for f in folds
        ]
    markers, angles, turns = channels_of(simulation, predictions)
    judged = [*held_out, *(p for f in folds for p in f.held_out)]
    trials: list[ProofCheck] = []
    if thorough and sensitivity is not None:
        trials += placebos(simulation, patched, tried, mode, held)
        used = replace(mode, keep=np.ones(len(held), dtype=bool))
        trials += left_outs(simulation, nominal, patched, sensitivity.matrix, used)
    return Proof(
        held_out=tuple(int(p) for p in (judged if sensitivity else held_out)),
        markers=markers,
        angles=angles,
        rotations=turns,
        trials=tuple(trials),
        budget=_budget(trials, markers or angles),
        patch=_as_fitted(patch, patched, tried, simulation),
        nominal=nominal,
        patched=patched,
        simulation=simulation,
        mode=mode,
        sensitivity=sensitivity,
        folds=len(predictions),
        spring_errors=errors,
    )


def _of_fold(
    simulation: ReplaySimulation,
    nominal: NominalState,
    patched: NominalState,
    mode: ComparisonMode,
    fold: Fold,
    sigmas: Mapping[Place, float],
    known: Sensitivity,
) -> FoldPrediction:
    """Fit both arms again without a fold, the patch with what is named without it.

    Tables without a name were learnt from the fold too, and are left out of it.
    """
    held = np.isin(simulation.recording.posture_id, fold.held_out)
    mode = replace(mode, keep=~held)
    nominal = fitted(simulation, nominal, mode, 1)
    bare = nominal.rig.effects
    own = [
        e
        for e in patched.rig.effects
        if e not in bare and (e.name, e.where) in fold.names
    ]
    if own:
        start = with_effects(patched, (*bare, *own))
        patched = refined(simulation, start, mode, sigmas, known).assumed
    return FoldPrediction(nominal, patched if own else nominal, mode, held)


def _thinned(recording: Recording, carried: bool) -> Recording:
    """Return a recording of bearable length: every so many visits, evenly.

    Where gears remember the visit before, its first visits.
    """
    rows = len(recording.time)
    if rows <= MOST_ROWS:
        return recording
    every = -(-rows // MOST_ROWS)
    if recording.rows == "stream":
        return recording.take(np.arange(0, rows, every))
    visit = np.unique(recording.visit, return_inverse=True)[1]
    if carried:
        return recording.take(visit < (visit.max() + 1) // every)
    return recording.take(visit % every == 0)


def _start(recording: Recording, patch: Patch, rig) -> NominalState:
    frame = np.eye(4)
    if recording.base_from_tracker is not None:
        frame = recording.base_from_tracker
    elif patch.base_from_tracker is not None:
        frame = np.array(patch.base_from_tracker)
    places = [
        np.array(patch.markers[m.name])
        if m.name in patch.markers
        else (np.zeros(3) if m.position is None else m.position)
        for m in recording.markers
    ]
    place = np.array(places, dtype=float).reshape(-1, 3)
    return NominalState(rig, frame[:3, :3], frame[:3, 3], place)


def _budget(trials: Sequence[ProofCheck], channel: Channel | None) -> dict[str, float]:
    """Return the root of the square that comes back when an effect is taken out."""
    found = {
        t.what.removeprefix("without "): max(t.before**2 - t.after**2, 0.0) ** 0.5
        for t in trials
        if t.kind == "taken_out"
    }
    if channel is not None:
        found["instruments' noise"] = channel.noise
        rest = channel.after**2 - channel.noise**2
        found["not explained"] = float(np.sqrt(max(rest, 0.0)))
    return found


def _as_fitted(
    patch: Patch,
    patched: NominalState,
    own: Sequence[Effect],
    simulation: ReplaySimulation,
) -> Patch:
    rig = patched.rig
    frame = transform_of(patched.turn, patched.shift)
    named_now = tuple(named(e) for e in own if e.name != "tabled_law")
    springs = {
        axis: None if k >= RIGID else float(k)
        for axis, k in zip(rig.anatomy.axes, rig.springs, strict=True)
    }
    pairs = zip(simulation.recording.markers, patched.marker_positions, strict=True)
    fitted_now = replace(
        patch,
        stiffness_nm_per_rad=springs,
        effects=named_now,
        base_from_tracker=tuple(map(tuple, frame.tolist())),
        markers={marker.name: tuple(place.tolist()) for marker, place in pairs},
    )
    return with_arm(fitted_now, rig)
