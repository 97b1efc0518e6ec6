"""Draws blind trials and generates their recordings and truths.

A trial follows from the sweep's seed, its stratum and its number alone, so trial 7 of a
stratum is the same however many are asked for, and whatever was run before. Trials with
a mechanism outside the vocabulary in a whole arm have the arms of the stratum without.

Every trial has the usual nuisance: an unknown tracker frame, markers beside their
nominal positions, noise and hidden readings. The stratum `null_nuisance` has the worst
instruments of a good cell, in turn; all errors are within what the recording states.

`generate_trial` draws sites and forms until one set can reach the χ² that the stratum
asks for; `calibrate_magnitude` finds the magnitudes by recordings on error-free
instruments, where the effect alone makes the difference. `whole_arm` takes them as they
were drawn, and finds out how large each is beside the others.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.effect import Effect
from bench.effects.joint_compliance import JointCompliance
from bench.effects.out_of_library import OUT_OF_LIBRARY_EFFECTS
from bench.effects.pulley_friction import PulleyFriction
from bench.effects.reading_lag import ReadingLag
from bench.effects.tracker_misalignment import TrackerMisalignment
from bench.experiment import record
from bench.instruments import Encoders, ForceSensor, Instruments, Markers, Tracker
from bench.instruments.encoders import ARRIVAL
from bench.instruments.force_sensor import SIZE, TURN
from bench.instruments.random_streams import streams
from bench.instruments.tracker import STILL
from bench.model_file import load, plain_mjcf
from bench.rig import Rig
from bench.shared.errors import BenchError
from bench.shared.plan import DEFAULT_PATH, Plan, parse_path
from bench.shared.recording import ASSUMED, Recording
from bench.standard_plans import tour
from scenarios.pipelines.synthetic_recording import truth_text
from scenarios.studies.blind_trials.arms import (
    THE_KR10,
    Arm,
    draw_twins,
    draw_whole_arm,
    springs_about,
    with_other_laws,
)
from scenarios.studies.blind_trials.effects import (
    FEWEST,
    Ground,
    OutOfReach,
    as_large_as,
    by_share,
    draw_site_and_form,
    knees_of,
    turning,
)
from scenarios.studies.blind_trials.oracle import (
    arm_oracle,
    as_strange_as,
    displaced,
    explained,
    log_bayes_factor,
    oracle_share,
    prepared_with,
)
from scenarios.studies.blind_trials.strata import (
    BY_SHARE,
    CARRIED,
    MISTAKEN,
    OUTLIERS,
    RELATIVE,
    REORDERED,
    STRATA,
    STUDY,
    Stratum,
)
from scenarios.studies.blind_trials.visibility import Visibility, scale_of
from scenarios.studies.damage import (
    as_differences,
    in_another_order,
    with_axis_mistaken,
    with_outliers,
)
from stiffness.diagnosis.nominal_fit import Prepared

# --- Instruments ----------------------------------------------------------------------

PLACEMENT, OCCLUSIONS = 5e-4, 0.02
"""One sigma of a marker's position error, in m; share of readings that are hidden."""
FIELD = 1.5e-5
"""Spatially correlated error of the tracker in m, in the stratum that has one."""
DEPTH = (1e-5, 1e-5, 2.5e-5)
"""Noise of a tracker that is worst in depth, along its axes, in m."""


def instruments_of(stratum: Stratum, number: int) -> Instruments:
    """Return instruments with the usual nuisance, or one of the worst in turn."""
    usual = Instruments(
        tracker=Tracker(occlusions=OCCLUSIONS),
        markers=Markers(
            "flange" if stratum.targets == "flange" else "all", placement=PLACEMENT
        ),
    )
    if stratum.name in MISTAKEN:  # differences need a frame and places that are stated
        exact = replace(usual.tracker, frame_error=STILL)
        return replace(usual, tracker=exact)
    if stratum.name != "null_nuisance":
        return usual
    tracker = usual.tracker
    worst = (
        replace(usual, force_sensor=ForceSensor(turn=TURN, size=SIZE)),
        replace(usual, tracker=replace(tracker, repeatability=DEPTH)),
        replace(usual, tracker=replace(tracker, field=FIELD)),
        replace(usual, encoders=Encoders(arrival=ARRIVAL)),
        replace(
            usual,
            tracker=replace(tracker, repeatability=DEPTH, field=FIELD),
            force_sensor=ForceSensor(turn=TURN, size=SIZE),
            encoders=Encoders(arrival=ARRIVAL),
        ),
    )
    return worst[number % len(worst)]


# --- Trials ---------------------------------------------------------------------------

SPREAD = 3.0
"""True stiffness over the model's: up to this factor either way, by the bars' rule."""


@dataclass(frozen=True)
class BlindTrial:
    """The draws of one trial that precede any simulation.

    Attributes:
        number: Number within its stratum, from 0.
        name: Name that does not disclose stratum and number; used for files.
        seed: Of the instruments.
        stiffness: True stiffness over the model's, axis by axis.
        chance: Seed sequence of all further draws.
    """

    stratum: Stratum
    robot: Path
    number: int
    name: str
    seed: int
    stiffness: Float[np.ndarray, " axes"]
    instruments: Instruments
    chance: np.random.SeedSequence

    @property
    def label(self) -> str:
        """Stratum and number, for logs and reports."""
        return f"{self.stratum.name} {self.number}"


def trial_of(seed: int, stratum: str, number: int, arm: Arm = THE_KR10) -> BlindTrial:
    """Draw one trial."""
    kind = list(STRATA).index(STRATA[stratum].arm_of or stratum)
    chance = np.random.SeedSequence(seed, spawn_key=(kind, number))
    nuisance, further = chance.spawn(2)
    draw = np.random.default_rng(nuisance)
    return BlindTrial(
        stratum=STRATA[stratum],
        robot=arm.file,
        number=number,
        name=name_of(seed, stratum, number),
        seed=int(draw.integers(2**31)),
        stiffness=SPREAD ** draw.uniform(-1.0, 1.0, arm.axes),
        instruments=instruments_of(STRATA[stratum], number),
        chance=further,
    )


def name_of(seed: int, stratum: str, number: int) -> str:
    """Return a trial's name, which does not disclose what it is."""
    return hashlib.sha256(f"{seed}/{stratum}/{number}".encode()).hexdigest()[:12]


def kinds_of(
    trial: BlindTrial, draw: np.random.Generator, attempt: int
) -> list[type[Effect]]:
    """Return the kinds of effects of a trial, in turn, so that all are as frequent.

    Every fourth attempt goes on to the next kind.
    """
    if not trial.stratum.least:
        return []
    pool = pool_of(trial.stratum)
    turn = trial.number + attempt // 4
    first = pool[turn % len(pool)]
    if len(trial.stratum.least) == 1:
        return [first]
    others = [kind for kind in pool if kind is not first]
    return [first, others[int(draw.integers(len(others)))]]


def pool_of(stratum: Stratum) -> list[type[Effect]]:
    """Return the mechanisms that the trials of a stratum conceal, in turn."""
    mechanisms = {
        "vocabulary": EFFECTS,
        "other_laws": OTHER_LAWS,
        "outside": OUT_OF_LIBRARY_EFFECTS,
    }[stratum.mechanisms]
    by_name = {kind.name: kind for kind in mechanisms}
    return [by_name[name] for name in stratum.pool]


# --- Magnitudes on ideal instruments --------------------------------------------------


@dataclass(frozen=True)
class Bench:
    """The true arm and plan of a trial without its effects; records any effects."""

    trial: BlindTrial
    rig: Rig
    plan: Plan
    stated: bool
    hook: bool

    def seen(self, effects: tuple[Effect, ...], instruments: Instruments) -> Recording:
        """Return a recording of the arm with effects, by some instruments."""
        rig, of = replace(self.rig, effects=effects), self.trial
        memory = "carried" if of.stratum.name in CARRIED else "forgotten"
        seen = record(rig, self.plan, instruments, of.seed, of.name, memory)
        if not self.hook:
            return seen
        quiet = error_free_instruments(self.trial.instruments)
        weight = record(self.rig, self.plan, quiet, self.trial.seed).wrench
        return replace(seen, wrench=weight)  # computed from the hook's load

    def quiet(self, effects: tuple[Effect, ...]) -> Recording:
        """Return a recording of the arm with effects, by error-free instruments."""
        return self.seen(effects, error_free_instruments(self.trial.instruments))

    def place_chi2(
        self, effects: Sequence[Effect], prepared: Prepared
    ) -> dict[str, float]:
        """Return χ² of what the effects at each place together displace, simulated."""
        places = dict.fromkeys(effect.where for effect in effects)
        parts = {w: tuple(e for e in effects if e.where == w) for w in places}
        return displaced(prepared, {w: self.quiet(some) for w, some in parts.items()})

    def weighing(self) -> Callable[[Effect], Visibility]:
        """Return a function that simulates an effect alone and weighs it."""
        scale = scale_of(
            self.rig,
            self.quiet(()),
            self.trial.instruments.tracker.repeatability,
            self.stated,
        )
        return lambda effect: scale.visibility(self.quiet((effect,)))


def calibrate_magnitude(
    bench: Bench, effects: Sequence[Effect], draw: np.random.Generator
) -> tuple[tuple[Effect, ...], tuple[Visibility, ...]]:
    """Return every effect scaled to the χ² of its stratum, and its visibility."""
    if not effects:
        return (), ()
    trial, weigh = bench.trial, bench.weighing()
    watching = replace(trial.instruments.tracker, occlusions=0.0)  # as in `visibility`

    def captured(effect: Effect) -> float:
        seen = bench.seen((effect,), replace(trial.instruments, tracker=watching))
        return explained(seen, Path(bench.rig.arm_file), (effect.name,))

    fewest = min(FEWEST, len(bench.plan.posture) / 4)
    found, weights = [], []
    for effect, smallest in zip(effects, trial.stratum.least, strict=True):
        least = smallest
        if trial.stratum.most:
            least *= (trial.stratum.most / smallest) ** draw.uniform(0.0, 1.0)
        if trial.stratum.known:
            larger, weight = as_large_as(effect, least, weigh, fewest)
        else:
            larger, weight = as_strange_as(effect, least, weigh, captured, draw)
        found.append(larger)
        weights.append(weight)
    return tuple(found), tuple(weights)


def error_free_instruments(instruments: Instruments) -> Instruments:
    """Return instruments that make no error, with encoders after the gears."""
    quiet = instruments.without_noise()
    frame_error = quiet.tracker.frame_error or STILL
    return replace(
        quiet,
        tracker=replace(quiet.tracker, frame_error=frame_error),
        encoders=Encoders(link_side=True, noise=0.0),
    )


# --- Whole arms -----------------------------------------------------------------------

OUTSIDE_CHI2 = (2e3, 2e4)
"""Projected χ² of a mechanism outside the vocabulary in a whole arm; chosen: as large
as the larger effects of such arms are."""
LEAST_LEFT = 400.0
"""Least χ² of it that all true names together do not explain; chosen: one effect of
that size is named."""
REDRAWN = 24
"""Draws of it before the arm is given up; chosen: four of each mechanism."""


def whole_arm(
    bench: Bench, effects: tuple[Effect, ...], ground: Ground, attempt: int
) -> tuple[tuple[Effect, ...], Recording, dict[str, Any]]:
    """Return the effects of a whole arm, its recording, and what can be known of it.

    Attempts count the arms that were given up before.

    Raises:
        OutOfReach: Where no mechanism outside the vocabulary can be added.
    """
    trial, model = bench.trial, Path(bench.rig.arm_file)
    if trial.stratum.mechanisms == "other_laws":
        effects = with_other_laws(effects, float(bench.plan.time[-1]))
    clean = bench.quiet(effects)
    if trial.stratum.known:
        recording = bench.seen(effects, trial.instruments)
        prepared = prepared_with(model, recording)
        oracle = arm_oracle(prepared, clean, effects)
        return effects, recording, {
            "own_chi2": oracle.own,
            "place_chi2": bench.place_chi2(effects, prepared),
            "oracle_share": oracle_share(prepared, effects),
        }  # fmt: skip
    key = (*trial.chance.spawn_key, 1, attempt)
    more = np.random.SeedSequence(trial.chance.entropy, spawn_key=key)
    draw, weigh, fault = np.random.default_rng(more), bench.weighing(), ""
    pool = STRATA["outside"].pool
    kinds = {kind.name: kind for kind in OUT_OF_LIBRARY_EFFECTS}
    without = None
    for again in range(REDRAWN):
        kind = kinds[pool[(trial.number + again) % len(pool)]]
        unknown = draw_site_and_form(kind, draw, ground)
        low, high = OUTSIDE_CHI2
        asked = low * (high / low) ** draw.uniform(0.0, 1.0)
        try:
            if weigh(unknown).poses < FEWEST:
                continue  # at no size more of them show it
            unknown, weight = as_large_as(unknown, asked, weigh)
            every = (*effects, unknown)
            quiet, recording = bench.quiet(every), bench.seen(every, trial.instruments)
        except BenchError as error:
            fault = str(error).partition("\n")[0]
            continue
        prepared = prepared_with(model, recording)
        oracle = arm_oracle(prepared, quiet, effects)
        without = without or arm_oracle(prepared, clean, effects)
        left = oracle.residual - without.residual
        if left >= LEAST_LEFT:
            return every, recording, {
                "own_chi2": (*without.own, left),
                "place_chi2": bench.place_chi2(every, prepared),
                "oracle_share": oracle_share(prepared, effects),
                "outside": {"where": unknown.where, "chi2": weight.chi2, "left": left},
            }  # fmt: skip
        fault = f"The names explain {unknown.name} at {unknown.where}."
    raise OutOfReach(fault or "Too few poses show a mechanism outside.")


# --- Recording and truth --------------------------------------------------------------

OUTLYING = 0.001
"""Share of the readings that are outliers where some are."""
REVISITS = 12
"""Visits that are repeated; chosen, so that replicates show the noise."""
ATTEMPTS = 40
"""Draws of sites and forms before a trial is given up."""


@dataclass(frozen=True)
class Made:
    """A generated trial: recording, model and truth.

    Attributes:
        recording: What the method under test is given.
        left_out: Names that are taken out of the diagnosis' library.
        truth: The same and how it was drawn, for JSON.
    """

    recording: Recording
    model: Path
    left_out: tuple[str, ...]
    rig: Rig
    truth: dict[str, Any]


def generate_trial(trial: BlindTrial, folder: Path, poses: int) -> Made:
    """Draw effects of a trial, scale and record them.

    Raises:
        BenchError: Where no draw can reach the χ² that is asked for.
    """
    draw = np.random.default_rng(trial.chance)
    faults = []
    for attempt in range(ATTEMPTS):
        kinds = kinds_of(trial, draw, attempt)
        try:
            return _simulate(trial, kinds, draw, folder, poses, attempt)
        except BenchError as error:  # out of reach, or no equilibrium under the load
            faults.append(str(error).partition("\n")[0])
    raise BenchError(f"Trial {trial.label} cannot be made: {'; '.join(faults[-3:])}")


def _simulate(
    trial: BlindTrial,
    kinds: Sequence[type[Effect]],
    draw: np.random.Generator,
    folder: Path,
    poses: int,
    attempt: int,
) -> Made:
    nominal = Rig(trial.robot)
    path = parse_path(trial.stratum.path) if trial.stratum.path else DEFAULT_PATH
    plan = tour(nominal, poses, path, min(REVISITS, poses), trial.seed)
    arm, model = nominal.anatomy, nominal.nominal
    stuck = trial.instruments.markers.stick(model, arm, streams(trial.seed))
    marks = [s.marker.name for s in stuck]
    ground = Ground(
        arm, marks, float(plan.time[-1]), knees_of(nominal), turning(arm, plan.posture)
    )
    twin = ""
    if trial.stratum.effects:
        effects = draw_whole_arm(trial.stratum, draw, ground)
    elif trial.stratum.has_twin:
        effect, twin = draw_twins(kinds[0], draw, ground)
        effects = [effect]
    else:
        effects = [draw_site_and_form(kind, draw, ground) for kind in kinds]
    if trial.stratum.name in BY_SHARE:
        effects = [by_share(e) for e in effects if isinstance(e, ReadingLag)]
    if len({(e.name, e.where) for e in effects}) < len(effects):
        raise OutOfReach("The same effect was drawn twice.")
    rigid = [e.where for e in effects if isinstance(e, JointCompliance)]
    given = _given(trial, rigid, folder)
    rig = Rig(given)
    over_model = trial.stiffness
    if trial.stratum.effects == STUDY:
        over_model = springs_about(draw) / rig.nominal.jnt_stiffness
    rig = replace(rig, stiffness=rig.nominal.jnt_stiffness * over_model)
    bench = Bench(
        trial,
        rig,
        plan,
        stated=any(isinstance(e, TrackerMisalignment) for e in effects),
        hook=any(isinstance(e, PulleyFriction) for e in effects),
    )
    if trial.stratum.effects:
        effects, recording, facts = whole_arm(bench, tuple(effects), ground, attempt)
        facts["chi2"] = facts["own_chi2"]
    else:
        effects, weights = calibrate_magnitude(bench, effects, draw)
        recording = bench.seen(effects, trial.instruments)
        facts = {
            "chi2": [w.chi2 for w in weights],
            "weights": [asdict(w) for w in weights],
        }
    key = (*trial.chance.spawn_key, 2, attempt)
    apart = np.random.SeedSequence(trial.chance.entropy, spawn_key=key)
    recording, more = _as_told(
        as_stated(recording, trial.stratum), trial, turning(arm, plan.posture), apart
    )
    facts |= more
    if twin:
        quiet = bench.quiet(effects)
        factor = log_bayes_factor(recording, quiet, given, effects[0], twin)
        facts |= {"twin": twin, "log_bayes_factor": factor}
    without = tuple(e.name for e in effects) if trial.stratum.name == "removed" else ()
    true = replace(rig, effects=effects)
    text = truth_text(true, trial.name, trial.seed, trial.instruments)
    truth = json.loads(text) | {
        "stratum": trial.stratum.name,
        "number": trial.number,
        **facts,
        "stiffness_over_model": over_model.tolist(),
        "path": trial.stratum.path,
        "without": list(without),
        "drawn_again": attempt,
    }
    return Made(recording, given, without, true, truth)


def _as_told(
    recording: Recording,
    trial: BlindTrial,
    turn: tuple[str, ...],
    apart: np.random.SeedSequence,
) -> tuple[Recording, dict[str, Any]]:
    """Return a recording with what is told wrongly or not told, and what that is."""
    stratum = trial.stratum.name
    if stratum in OUTLIERS:
        return with_outliers(recording, OUTLYING, apart)
    if stratum in REORDERED:
        return in_another_order(recording, apart), {}
    if stratum in RELATIVE:
        recording = as_differences(recording)
    if stratum in MISTAKEN:
        return with_axis_mistaken(recording, turn, apart)
    return recording, {}


def as_stated(recording: Recording, stratum: Stratum) -> Recording:
    """Return a recording with the marks that are kept and the noise that is stated."""
    if stratum.marks and recording.points is not None:
        recording = replace(
            recording,
            markers=recording.markers[: stratum.marks],
            points=recording.points[:, : stratum.marks],
        )
    tracker = recording.tracker
    if tracker is None or stratum.stated == 1.0:
        return recording
    if stratum.stated:
        sigma = stratum.stated * tracker.repeatability
        said = replace(tracker, repeatability=sigma)
    else:
        said = replace(tracker, repeatability=np.full(3, ASSUMED), is_stated=False)
    return replace(recording, tracker=said)


def _given(trial: BlindTrial, rigid: Sequence[str], folder: Path) -> Path:
    """Return the given model file, rewritten where some axes are rigid in it."""
    if not rigid:
        return trial.robot
    file = folder / f"{trial.name}.xml"
    root = ElementTree.fromstring(plain_mjcf(load(trial.robot)))
    for joint in root.iter("joint"):
        if joint.get("name") in rigid:
            joint.set("stiffness", "0")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return file
