"""Diagnoses a recording, proves what was named in the simulator, and states both.

The engine is asked first, then the simulator. Without a load, or where names do not
explain the difference, many small errors of geometry are likely: calibration is asked.
`answer_of` states the outcome in the form of diagnosis.json, `Result` holds all that
story, report and playback show.
"""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from bench.patch import Patch
from bench.proof.comparison import residual_of
from bench.proof.explained_share import Channel
from bench.proof.nominal_fit import joint_rotation_estimates, torques_of
from bench.proof.proof import Channel as ProofChannel
from bench.proof.proof import Fold, Proof, prove
from bench.shared.effect_catalogue import on_slide
from bench.shared.errors import BenchError
from bench.shared.recording import Recording
from bench.shared.settings import MM, MRAD, SETTINGS, UM, URAD
from bench.shared.settings import Interval as Estimated
from scenarios.pipelines.patching import (
    left_neutral,
    patch_of_diagnosis,
    sigmas_of,
    within_bounds,
)
from scenarios.pipelines.schema import (
    Answer,
    At,
    Called,
    Detected,
    Findings,
    Interval,
    Left,
    Next,
    Number,
    Open,
    Other,
    OutlierEntry,
    Placed,
    Proved,
    Refused,
    Remark,
    interval_of,
    large_corrections,
    number,
    proved_in,
    verdict_of,
    where_known,
)
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.nominal_fit import (
    springs_warning,
    states_no_springs,
    with_load_springs,
)
from stiffness.diagnosis.result import (
    Decision,
    Diagnosis,
    Name,
    NamedEffect,
    Unexplained,
    Warned,
    in_words,
    other_causes,
    refused_with_size,
)
from stiffness.experiment.outliers import without_outliers
from stiffness.robot.arm import Arm
from stiffness.setup.check import setup_errors

if TYPE_CHECKING:
    from scenarios.pipelines.calibration import CalibrationOutcome

# --- Engine and simulator -------------------------------------------------------------

ODD_NUMBERS = (ArithmeticError, np.linalg.LinAlgError)
"""What arithmetic raises on numbers that no sensor gives; all else is a defect here."""


@contextmanager
def _told_of(recording: Recording) -> Iterator[None]:
    """Say of which recording the numbers are that break the engine's arithmetic."""
    try:
        yield
    except ODD_NUMBERS as error:
        raise BenchError(
            f"Recording {recording.name!r} cannot be diagnosed: its numbers lead to "
            f"{type(error).__name__} ({error}). Look for values that no sensor gives."
        ) from error


def asked(recording: Recording, arm: Arm) -> Diagnosis:
    """Ask the engine.

    Raises:
        BenchError: Where the recording has nothing to compare, or its numbers break the
            engine's arithmetic.
    """
    with _told_of(recording):
        return diagnose(recording, arm)


def setup_errors_of(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Ask for the mistakes of the set-up alone.

    Raises:
        BenchError: Where the recording's numbers break the engine's arithmetic.
    """
    with _told_of(recording):
        return setup_errors(recording, arm)


def springs_warning_of(recording: Recording, arm: Arm) -> Warned | None:
    """Return what a diagnosis will fit where the model states no joint stiffness.

    None where the model states some, or nothing shows how the arm gives way to a load.

    Raises:
        BenchError: Where the recording's numbers break the engine's arithmetic.
    """
    seen = recording.markers and recording.tracker is not None
    if not seen or not states_no_springs(recording, arm):
        return None
    with _told_of(recording):
        try:
            stiffness = with_load_springs(recording, arm).stiffness
        except BenchError:  # no diagnosis of it, and its own reason there
            return None
    return springs_warning(np.flatnonzero(stiffness).tolist(), len(stiffness))


def proved(
    found: Diagnosis, recording: Recording, arm: Arm, robot: Path
) -> tuple[Proof | None, str]:
    """Put what was named into the simulator.

    Returns:
        The simulated arms, nominal and patched; and why nothing was proved, empty where
        something was.
    """
    if found.nominal is None:
        return None, "a mistake of the set-up has to be mended first."
    recording = _with_noise(without_outliers(recording, found.outliers), found)
    patch = patch_of_diagnosis(found, recording, arm)
    why = ""
    if not (patch.effects or patch.laws):
        why = "nothing was named." if not found.named else (
            "the simulator has no mechanism for what was named."
        )  # fmt: skip
    elif not found.held_out:
        why = "too few poses to keep any back."
    try:
        sigmas, folds, held = sigmas_of(found), _folds_of(found), found.held_out
        return prove(recording, robot, patch, held, sigmas=sigmas, folds=folds), why
    except (BenchError, *ODD_NUMBERS) as error:
        why = why or f"the simulator cannot do it ({error})."
    try:  # pictures need the nominal arm alone
        bare = replace(patch, effects=(), laws=())
        return prove(recording, robot, bare, found.held_out), why
    except (BenchError, *ODD_NUMBERS):
        return None, why


def _with_noise(recording: Recording, found: Diagnosis) -> Recording:
    """Return a recording with the noise that was found where another was stated."""
    if found.reading_noise is None or recording.tracker is None:
        return recording
    sigma = np.full(3, found.reading_noise)
    return replace(recording, tracker=replace(recording.tracker, repeatability=sigma))


def _folds_of(found: Diagnosis) -> list[Fold]:
    """Return the other splits of few poses, with the answer's names that each gives."""
    given = {effect.name for effect in found.named}
    return [
        Fold(s.held_out, frozenset((n.effect, n.where) for n in s.names & given))
        for s in found.splits[1:]
    ]


# --- Where another engine is called for -----------------------------------------------


def calls_for_comparison(recording: Recording) -> bool:
    """Return whether a stream has second encoders and no target that was tracked."""
    from stiffness.dual_encoder.motions import axes_read_twice

    return (
        recording.rows == "stream"
        and not recording.markers
        and bool(axes_read_twice(recording))
    )


def calls_for_calibration(recording: Recording, found: Diagnosis) -> bool:
    """Return whether positions without a load differ and a few names do not do."""
    return (
        recording.wrench is None
        and recording.displacement == "absolute"
        and recording.rows == "plateaus"
        and found.nominal is not None
        and found.verdict in ("unexplained", "partly_explained")
    )


def try_calibration(
    recording: Recording,
    arm: Arm,
    robot: Path,
    said: Callable[[str], object],
    rejected: float,
) -> "CalibrationOutcome | None":
    """Calibrate, or say why that cannot be and return None.

    `rejected` is the p-value of the nominal arm in the test that found the difference.
    """
    from scenarios.pipelines.calibration import calibrate_and_prove

    said("No few effects explain it: calibrating on positions.")
    try:
        return calibrate_and_prove(recording, arm, robot, said=said, rejected=rejected)
    except (BenchError, *ODD_NUMBERS) as error:
        said(f"It cannot be calibrated on: {error}")
        return None


# --- The entry in schema 1 ------------------------------------------------------------

USUAL_M, HEAVIEST_KG = 0.1, 100.0
"""How far from its body's origin an added mass sits usually, and how heavy it is at
most; chosen: wider than any arm's."""
MOST_POSES = 3
"""Poses that are named at most where the patched simulator misses; chosen."""


def answer_of(
    diagnosis: Diagnosis,
    simulated: Proof | None,
    unproved: str,
    experiments: Sequence[Next],
    seconds: float,
    proof_requested: bool = True,
    slides: Sequence[bool] = (),
) -> Answer:
    """Put a diagnosis and its proof into the fixed form.

    `unproved` says why nothing was proved, empty where something was.
    """
    sliding = {f"a{k}" for k, slide in enumerate(slides, start=1) if slide}
    d, open_ = diagnosis, diagnosis.unexplained
    found, within = d.detection, simulated is not None and not simulated.absolute
    missed, noise = (number(size, MM) for size in found.rms_and_noise(within))
    proof = None if unproved else simulated
    best = proof and proof.markers
    few = missed_poses(best) if best is not None and not open_ else ""
    entry, share = proof_entry(proof), explained_share_of(proof)
    remarks = (*d.warnings, *other_causes(d.named), *disagreements(d, simulated))
    remarks += () if proof is None else tuple(left_neutral(d))
    told = tuple(Remark(w.code, w.where, w.text) for w in remarks)
    called = tuple(_called(n, sliding) for n in d.named)
    return Answer(
        recording=d.recording,
        verdict=verdict_of(
            Findings(
                mismatch=d.verdict != "no_mismatch",
                named=bool(d.named),
                residual_passes=d.verdict == "explained" and not few,
                proof_requested=proof_requested,
                proof=entry,
                explained_share=share,
            )
        ),
        detection=Detected(
            float(found.p_value), missed, noise, number(found.smallest_effect, MM)
        ),
        located=tuple(
            Placed(
                *(x.where, x.p_value, x.share, tuple(x.depends_on), x.zone),
                split_share=where_known(x.split_share),
            )
            for x in d.located
        ),
        explained_share=share,
        named=called,
        rivals=tuple(
            Other(float(r.probability), tuple(map(_at, r.effects))) for r in d.rivals
        ),
        unexplained=_residual_entry(open_ or Unexplained("", few, {}), best, missed)
        if open_ or few
        else None,
        confounded=tuple((_at(a), _at(b)) for a, b in d.confounded),
        warnings=(*told, *large_corrections(called)),
        proof_requested=proof_requested,
        proof=entry,
        next_experiments=tuple(experiments),
        seconds=round(float(seconds), 3),
        unexplained_places=tuple(
            Open(p.where, float(p.share), tuple(p.depends_on), p.law)
            for p in d.unexplained_places
        ),
        outliers=tuple(OutlierEntry(o.pose, o.marker, MM * o.size) for o in d.outliers),
        refused=tuple(
            Refused(
                *stop.candidate, _stated(*stop.candidate, stop.parameters, sliding), why
            )
            for stop in refused_with_size(d)
            for why in [in_words(stop)]
        ),
        scatter_rms_mm=None if d.scatter is None else number(d.scatter, MM),
    )


def _residual_entry(open_: Unexplained, best: Channel | None, missed: Number) -> Left:
    law = {k: tuple(map(float, v)) for k, v in open_.law.items()}
    left = missed if best is None else number(best.after, MM)
    return Left(open_.where, open_.signature, law, left)


def missed_poses(channel: Channel) -> str:
    """Say which poses the patched simulator misses; empty where it is near the noise.

    A test over poses, whose scores could have had the other sign, cannot see what acts
    in two or three of them, such as a gear that only they load beyond its knee.
    """
    noise = channel.noise
    if not channel.after > SETTINGS.simulator_ratio * noise:
        return ""
    worst = np.argsort(-channel.after_of)[:MOST_POSES]
    worst = worst[channel.after_of[worst] > SETTINGS.simulator_ratio * noise]
    told = [
        f"pose {channel.posture_id[k]} by {UM * channel.after_of[k]:.0f} µm"
        for k in worst
    ]
    return (
        f"the patched simulator misses {', '.join(told)}, where noise leaves "
        f"{UM * noise:.0f} µm; what acts in few poses has no law"
    )


UNACCOUNTED = 0.02
"""Share of a mismatch that no sentence accounts for and that need not be; chosen."""


def disagreements(diagnosis: Diagnosis, simulated: Proof | None) -> Iterator[Warned]:
    """Say where the simulator's arms are not those of the search."""
    if simulated is None or simulated.markers is None:
        return
    found, share = diagnosis.detection, simulated.markers.explained
    left = sum(max(place.share, 0.0) for place in diagnosis.unexplained_places)
    if diagnosis.named and share and share.high < 1.0 - left - UNACCOUNTED:
        yield Warned(
            "not_in_patch",
            "arm",
            f"{1.0 - share.estimate - left:.0%} of the mismatch are neither explained "
            "by the patch nor said to be open at a place: the search lets laws have "
            "other forms, and gears other states, than mechanisms of the simulator.",
        )
    fitted = found.fitted_rms(simulated.absolute, held_out=simulated.folds == 1)
    before = simulated.markers.before
    if before > SETTINGS.simulator_ratio * fitted:
        yield Warned(
            "simulator_disagrees",
            "arm",
            f"on the poses kept back the simulator's nominal arm misses by "
            f"{UM * before:.1f} µm, the arm that was fitted to the readings by "
            f"{UM * fitted:.1f} µm. They are not the same arm: look at frames, tool "
            "and springs of the model, and do not rely on the proof or on model.xml.",
        )


def explained_share_of(proof: Proof | None) -> Interval | None:
    """Return the share that the proof's first channel explains, as it is written."""
    channel = None if proof is None else proof.markers or proof.angles
    share = None if channel is None else channel.explained
    return share and interval_of(share)


def proof_entry(proof: Proof | None) -> Proved | None:
    """Return the proof's entry; None where nothing was proved."""
    if proof is None or (proof.markers is None and proof.angles is None):
        return None
    folds = {"folds": proof.folds} if proof.folds > 1 else {}
    return Proved(
        simulator="mujoco",
        held_out_poses=len(proof.held_out),
        **folds,
        **proved_in(proof.markers, MM, "mm"),
        **proved_in(proof.angles, URAD, "urad"),
        **proved_in(proof.rotations, MRAD, "mrad"),
    )


def _called(named: NamedEffect, slides: Collection[str]) -> Called:
    known = within_bounds(named)
    parameters = _stated(named.name.effect, named.name.where, known, slides)
    if "with" in parameters:  # a number of an axis, but a name in the vocabulary
        partner = f"a{round(named.parameters['with'].estimate)}"
        parameters["with"] = Interval(partner, partner, partner)
    words = {k: v for k, v in named.settings.items() if isinstance(v, str)}
    parameters |= {k: Interval(v, v, v) for k, v in words.items()}
    if named.name.effect == "gravity_load":
        parameters = _with_mass(parameters)
    return Called(
        named.name.effect,
        named.name.where,
        float(np.clip(named.probability, 0.0, 1.0)),
        tuple(map(_at, named.equivalents)),
        parameters,
        where_known(named.share),
        where_known(named.split_share),
        where_known(named.budget_share),
    )


def _stated(
    effect: str, where: str, known: Mapping[str, Estimated], sliding: Collection[str]
) -> dict[str, Interval]:
    """Return parameters as they are written, along a slide in m."""
    names = [on_slide(effect, n) if where in sliding else n for n in known]
    ends = [map(number, (p.estimate, p.low, p.high)) for p in known.values()]
    return {n: Interval(*three) for n, three in zip(names, ends, strict=True)}


def _with_mass(parameters: dict[str, Interval]) -> dict[str, Interval]:
    """Add mass and centre to first moments that show no mass: one of many pairs.

    A turn about a level axis feels mass x distance alone. The pair given has its centre
    at a usual distance, or as far as the heaviest mass asks for; neither has ends, for
    the data do not hold them, and the moments, which are known, stay beside them.
    """
    moment = {
        name: p.estimate
        for name, p in parameters.items()
        if name.startswith("moment_") and isinstance(p.estimate, float)
    }
    size = math.hypot(*moment.values())
    if "mass_kg" in parameters or not size:
        return parameters
    mass = min(size / USUAL_M, HEAVIEST_KG)
    found = {"mass_kg": Interval(mass, None, None)}
    for name, value in moment.items():
        centre = name.replace("moment", "com").replace("_kg_m", "_m")
        found[centre] = Interval(value / mass, None, None)
    return parameters | found


def _at(name: Name) -> At:
    return At(name.effect, name.where)


# --- The finding with its proof -------------------------------------------------------


@dataclass(frozen=True)
class Result:
    """A diagnosis with its proof.

    Attributes:
        simulated: The nominal arm and the patched one in the simulator; None where the
            recording cannot be simulated.
        unproved: Why nothing was proved; empty where something was.
        replicates: Scatter of replicates along x, y, z of the tracker in m, and degrees
            of freedom; None without replicates.
    """

    recording: Recording
    diagnosis: Diagnosis
    simulated: Proof | None
    unproved: str
    replicates: tuple[Float[np.ndarray, "3"], int] | None
    answer: Answer

    @property
    def proof(self) -> Proof | None:
        """The proof, where something was put into the simulator."""
        return None if self.unproved else self.simulated

    @property
    def patch(self) -> Patch | None:
        """What the simulator was given, as refined there; None: nothing was."""
        return None if self.simulated is None else self.simulated.patch

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """The verdict of each gate on each candidate."""
        return self.diagnosis.decisions

    def why_not(self, effect: str, where: str) -> str:
        """Say why an effect was not named at a place; see `Diagnosis.why_not`."""
        return self.diagnosis.why_not(effect, where)


@dataclass(frozen=True)
class Curves:
    """What each axis turned beyond the nominal arm, against its torque.

    Attributes:
        torque: Of nominal springs, in N m.
        before: Turn that markers show beyond the nominal arm, in rad.
        law: The same of the patched arm, simulated and without noise.
        held: Rows that nothing was fitted to.
        slides: Whether each axis slides (then N, and m).
        noise: One sigma of an axis' turn that noise of the marks makes, in rad.
        angle: Of the axes, in rad (m on a slide).
        absolute: Whether positions counted, or differences within visits alone.
        folds: Number of fits that judged; `held` is of the first one.
    """

    axes: tuple[str, ...]
    torque: Float[np.ndarray, "rows axes"]
    before: Float[np.ndarray, "rows axes"]
    law: Float[np.ndarray, "rows axes"]
    held: np.ndarray
    visit: np.ndarray
    slides: tuple[bool, ...]
    noise: Float[np.ndarray, " axes"]
    angle: Float[np.ndarray, "rows axes"]
    absolute: bool = True
    folds: int = 1

    @property
    def visible(self) -> tuple[bool, ...]:
        """Whether noise makes less than half of the square of each axis' turn."""
        square = np.mean(self.before**2, axis=0)
        return tuple(bool(x) for x in square > 2.0 * self.noise**2)


def curves_of(simulated: Proof) -> Curves:
    """Return the residual per axis against torque, and the named law in it."""
    simulation, mode = simulated.simulation, simulated.mode
    seen, patched = simulation.see(simulated.nominal), simulation.see(simulated.patched)
    markers = len(simulation.recording.markers)
    shape = (simulation.replay.rows, markers, 3)
    before = residual_of(simulation, seen, mode)[:, : 3 * markers].reshape(shape)
    after = residual_of(simulation, patched, mode)[:, : 3 * markers].reshape(shape)
    assumed = simulated.nominal
    arm = assumed.rig.anatomy
    chance = np.random.default_rng(0).normal(0.0, simulated.mode.sigma, shape)
    errors = joint_rotation_estimates(simulation, assumed, seen, chance)
    return Curves(
        axes=tuple(f"a{k + 1}" for k in range(len(simulation.order))),
        torque=torques_of(simulation, assumed, seen),
        before=joint_rotation_estimates(simulation, assumed, seen, before),
        law=joint_rotation_estimates(simulation, assumed, seen, before - after),
        held=~mode.keep,
        visit=simulation.replay.visit,
        slides=tuple(arm.slides[k] for k in simulation.order),
        noise=np.sqrt(np.mean(errors**2, axis=0)),
        angle=simulation.recording.posture,
        absolute=simulated.absolute,
        folds=simulated.folds,
    )


@dataclass(frozen=True)
class Course:
    """What an axis did during one visit, from where the law begins.

    Attributes:
        measured: Turn beyond the nominal arm, in rad.
        law: The same, simulated.
    """

    torque: Float[np.ndarray, " rows"]
    measured: Float[np.ndarray, " rows"]
    law: Float[np.ndarray, " rows"]


def courses_of(curves: Curves, name: str, count: int = 3) -> list[Course]:
    """Return the visits in which an axis' torque varies most, widest first."""
    k = curves.axes.index(name)
    torque, measured, law = curves.torque[:, k], curves.before[:, k], curves.law[:, k]
    stays = [np.flatnonzero(curves.visit == v) for v in np.unique(curves.visit)]
    stays.sort(key=lambda rows: -np.ptp(torque[rows]))
    found = []
    for rows in stays[:count]:  # means say nothing, so both have the same one
        offset = measured[rows].mean() - law[rows].mean() + law[rows[0]]
        found.append(
            Course(torque[rows], measured[rows] - offset, law[rows] - law[rows[0]])
        )
    return found


def channel_of(proof: Proof) -> tuple[ProofChannel | None, str]:
    """Return the channel that is spoken of, and its unit times a million."""
    both = (proof.markers, "µm"), (proof.angles, "µrad")
    return both[proof.markers is None]
