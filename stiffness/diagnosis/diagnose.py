"""Diagnoses a recording: set-up, nominal fit, detection, selection, verdict.

A recording is asked in turn: is it set up right, is something there, where, what.

Nothing here knows how an effect is built into a simulator; the proof is made elsewhere,
with the mechanism and never with the columns that found it.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from threadpoolctl import threadpool_limits

from bench.shared.recording import Recording
from stiffness.diagnosis.detection import (
    FEWEST_POSES,
    MEASURED,
    WOULD_SHOW,
    DetectionTest,
    detect,
    residual_after,
    scatter_of,
)
from stiffness.diagnosis.exchanges import with_exchanges
from stiffness.diagnosis.joint_fit import Layout
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    fit_model,
)
from stiffness.diagnosis.nominal_fit import Prepared, prepare, with_noise
from stiffness.diagnosis.relinearisation import (
    KINEMATIC,
    build_problem,
    curvature,
    prepared_about,
)
from stiffness.diagnosis.result import (
    Decision,
    Detection,
    Diagnosis,
    Located,
    Name,
    Outlier,
    SplitNames,
    Unexplained,
    UnexplainedPlace,
    Warned,
    remarks_on,
    scattered,
)
from stiffness.diagnosis.selection import (
    SelectedModel,
    search_model,
    select_again,
)
from stiffness.diagnosis.unknown_noise import (
    arrives_unknown,
    data_warnings,
    held_out_misfit,
    is_odd,
    noise_ratio_of,
    noise_text,
    reading_noise,
    rms_summary,
    scatter_of_readings,
    scattering_axes,
    smaller_noise,
    unknown_arrivals,
)
from stiffness.diagnosis.verdict import (
    SURE,
    ExchangePosterior,
    JudgedModel,
    answer_of,
    exchange_posteriors,
    judge,
    nominal_of,
)
from stiffness.effects import HYPOTHESES
from stiffness.effects.base import Hypothesis
from stiffness.experiment.outliers import (
    MOST_ODD,
    odd_poses,
    odd_text,
    outlier_text,
    outliers_at,
    outliers_of,
    without_outliers,
)
from stiffness.experiment.sensor_noise import (
    average_encoders,
    with_measured_noise,
    wrench_noise_text,
)
from stiffness.regression.splits import other_splits
from stiffness.regression.testing import SIGNIFICANCE, SMALLEST
from stiffness.robot.arm import Arm
from stiffness.setup.check import setup_errors

# --- Names over splits of few poses ---------------------------------------------------

MOST_SPLITS = 0.5
"""Share of the splits that a name must exceed to be given; chosen: what another draw of
the same poses would more likely not give is no finding."""


def split_names(
    model: SelectedModel, ids: Int[np.ndarray, " poses"]
) -> tuple[SplitNames, ...]:
    """Return which of a set's names other splits of its poses give too.

    Args:
        model: The set.
        ids: Of the poses.

    Returns:
        One for each split, the set's own first; none where its poses are many.
    """
    members = [m.name for m in model.fit.members if not m.is_generic]
    others = list(other_splits(model.case.split)) if members else []
    if not others:
        return ()
    own = _declared(model, exchange_posteriors(model), 0.0)
    every = frozenset(Name(*name) for name in members)
    found = [SplitNames(_ids(ids, model.case.split.held_out), every)]
    for split in others:
        again = select_again(model, split)
        given = _declared(again, exchange_posteriors(again), SURE)
        agreed = {
            name
            for name, alike in own.items()
            if any(name in some or other in alike for other, some in given.items())
        }
        found.append(SplitNames(_ids(ids, split.held_out), frozenset(agreed)))
    return tuple(found)


def _ids(
    ids: Int[np.ndarray, " poses"], mask: Bool[np.ndarray, " poses"]
) -> tuple[int, ...]:
    return tuple(int(p) for p in ids[mask])


def _declared(
    model: SelectedModel, posteriors: Sequence[ExchangePosterior], least: float
) -> dict[Name, set[Name]]:
    """Return the names of a set that are as probable, each with its equivalents."""
    return {
        Name(*member.name): {Name(*member.name), *one.equivalents}
        for member, one in zip(model.fit.members, posteriors, strict=True)
        if one.probability >= least and not member.is_generic
    }


def _share(name: Name, splits: Sequence[SplitNames]) -> float:
    return sum(name in split.names for split in splits) / len(splits)


def _of_most_splits(judged: JudgedModel, splits: Sequence[SplitNames]) -> JudgedModel:
    """Withhold the names that most splits do not give."""
    if not splits:
        return judged
    reason = "other draws of the poses that are fitted do not name it"
    withheld, decisions = list(judged.withheld), list(judged.decisions)
    for k, member in enumerate(judged.model.fit.members):
        if member.is_generic:
            continue
        share = _share(Name(*member.name), splits)
        if share <= MOST_SPLITS:
            withheld[k] = True
            gate = ("splits", False, share, MOST_SPLITS, reason)
            decisions.append(Decision(member.name, *gate))
    return replace(judged, withheld=tuple(withheld), decisions=tuple(decisions))


def _with_split_shares(answer: dict, splits: tuple[SplitNames, ...]) -> dict:
    """Return the entries of an answer that say how many splits give names and places.

    A place counts in a split that gives any name of the answer there.
    """
    if not splits:
        return {}
    named = [
        replace(effect, split_share=_share(effect.name, splits))
        for effect in answer["named"]
    ]
    given = {effect.name for effect in named}
    at = [{name.where for name in split.names & given} for split in splits]
    located = [
        replace(place, split_share=sum(place.where in own for own in at) / len(at))
        if any(name.where == place.where for name in given)
        else place
        for place in answer["located"]
    ]
    return {"named": tuple(named), "located": tuple(located), "splits": splits}


# --- Diagnose -------------------------------------------------------------------------


@threadpool_limits.wrap(limits=1, user_api="blas")
def diagnose(
    recording: Recording, arm: Arm, hypotheses: Sequence[Hypothesis] = HYPOTHESES
) -> Diagnosis:
    """Compare a recording with an arm's nominal model.

    Args:
        recording: With markers.
        arm: The nominal arm.
        hypotheses: What may be named.

    Raises:
        Unusable: Where the recording has nothing to compare, with all reasons.
    """
    started = time.perf_counter()
    arm, recording = arm.for_recording(recording), average_encoders(recording)
    recording, unstated = with_measured_noise(recording)
    mistakes = setup_errors(recording, arm)
    if mistakes:
        return _stopped(recording, mistakes, started)
    read = _read(recording, arm, hypotheses)
    recording, first = read.recording, _with_arrivals(read.looked, hypotheses)
    looked, scattering = _with_scattering_axes(first, hypotheses)
    own = looked.layout.prepared, looked.last, bool(looked.members)
    ratio = noise_ratio_of(*own, bool(unstated))
    if ratio != 1.0:
        arrival = looked.layout.prepared.pose_repeatability if scattering else None
        about = with_noise(looked.layout.prepared, ratio, arrival)
        looked = _look(about, hypotheses, looked.members).with_exchanges()
    prepared, case = looked.layout.prepared, looked.case
    found = first.found if scattering else looked.found
    detection = _detection(prepared, case, found)
    ids = np.unique(recording.posture_id)
    left_out = (
        ("outliers", "tracker", outlier_text, read.outliers),
        ("odd_poses", "rig", odd_text, read.odd),
    )
    remarks = [Warned(code, at, text(own)) for code, at, text, own in left_out if own]
    if unstated and (prepared.degrees_of_freedom or ratio == 1.0):
        remarks.append(Warned("noise_statement", "tracker", unstated))
    noise = reading_noise(prepared) if unstated or is_odd(prepared) else None
    scatter = scatter_of_readings(detection.noise_rms, ratio)
    told = noise_text(prepared, looked.last, scatter, ratio, bool(unstated))
    said = data_warnings(prepared)
    if prepared.degrees_of_freedom and recording.wrench is not None and ratio == 1.0:
        text = wrench_noise_text(smaller_noise(prepared, looked.last))
        remarks += [Warned("noise_statement", "wrench_sensor", text)] * bool(text)
    if told:
        told = Warned("noise_statement", "tracker", told)
        said = (told, *(w for w in said if w.code != told.code))
    common = {
        "recording": recording.name,
        "detection": detection,
        "warnings": (*remarks, *said),
        "held_out": _ids(ids, case.split.held_out & ~read.is_odd(ids)),
        "downweighted": tuple(
            (r, recording.markers[m].name, s) for r, m, s in prepared.downweighted
        ),
        "outliers": (*read.outliers, *read.odd),
        "scatter": scatter,
        "reading_noise": noise,
    }
    if looked.judged is None:
        if found.dispersion >= MEASURED:
            common["warnings"] += (scattered(found.dispersion),)
        return Diagnosis(
            **{"verdict": "no_mismatch"} | _left_by_scattering({}, scattering),
            nominal=nominal_of(prepared, np.zeros(len(prepared.springs))),
            seconds=time.perf_counter() - started,
            **common,
        )
    splits = split_names(looked.judged.model, ids)
    judged = _of_most_splits(looked.judged, splits)
    answer = answer_of(judged, prepared, found)
    answer |= _with_split_shares(answer, splits)
    answer |= _left_by_scattering(answer, scattering)
    if answer["verdict"] != "explained":
        places = answer["unexplained_places"]
        common["warnings"] += remarks_on(answer["decisions"], places)
    without_place = {
        "readings scatter by more than their measured noise, along no law": scatter
        and prepared.degrees_of_freedom,
        "some poses are left out, of which more is left": read.odd,
    }
    answer |= _of_no_place(answer, [t for t, holds in without_place.items() if holds])
    return Diagnosis(**common, **answer, seconds=time.perf_counter() - started)


@dataclass(frozen=True, eq=False)
class _Looked:
    """A recording under one noise: what was found, and the set if anything was."""

    layout: Layout
    case: SelectionProblem
    found: DetectionTest
    model: SelectedModel | None

    @cached_property
    def judged(self) -> JudgedModel | None:
        """The set and what contradicts its names."""
        return None if self.model is None else judge(self.model)

    @property
    def members(self) -> tuple[ModelTerm, ...]:
        """What was found."""
        return () if self.model is None else self.model.fit.members

    @property
    def last(self) -> DetectionTest:
        """The last test: of the set's residual, or of everything."""
        return self.found if self.judged is None else self.judged.residual

    def with_exchanges(self) -> "_Looked":
        """Return the same with names in the place of those that they imitate."""
        model = self.model and with_exchanges(self.model, self.layout)
        return replace(self, model=model)


def _look(
    prepared: Prepared,
    hypotheses: Sequence[Hypothesis],
    start: Sequence[ModelTerm] = (),
) -> _Looked:
    layout, case = Layout(prepared, hypotheses), build_problem(prepared, hypotheses)
    found = detect(
        case.library,
        case.normal_equations,
        case.map_equations,
        np.arange(case.library.nominal),
        case.seed,
        scatter_of(case.data, case.dispersion_limit),
    )
    model = search_model(case, layout, start) if found.p_value < SIGNIFICANCE else None
    return _Looked(layout, case, found, model)


CURVED, FAR = 2.0, 30.0
"""Sigmas of a second order that is nothing, as it changes evidence by two at most, less
than a name costs, and of one beside which only kinematic laws are asked; chosen."""
LOOKS = 6
"""How often a recording is looked at about other kinematics at most; chosen: what one
look misses by moves the next."""


def _about_kinematics(
    about: Prepared, recording: Recording, arm: Arm, hypotheses: Sequence[Hypothesis]
) -> _Looked:
    """Look about the kinematic errors that are found, until no curve is seen."""
    asked = every = tuple(hypotheses)
    looked, exchanged = _look(about, hypotheses), False
    for look in range(LOOKS):
        fit = looked.model and looked.model.fit
        curve = 0.0 if fit is None else curvature(recording, arm, about, fit)
        if curve <= CURVED and asked == every:
            if exchanged:
                break
            looked, exchanged = looked.with_exchanges(), True
            continue
        kinematic = tuple(h for h in every if h in KINEMATIC)
        asked = kinematic if curve > FAR and look < LOOKS - 1 else every
        about = about if fit is None else prepared_about(recording, arm, fit)
        looked, exchanged = _look(about, asked, looked.members), False
    return looked if exchanged else looked.with_exchanges()


@dataclass(frozen=True, eq=False)
class _Read:
    """A recording as it is looked at, and what was found first.

    Attributes:
        recording: Without outliers and odd poses.
        outliers: Of single marks.
        odd: All readings of odd poses.
        looked: What was found.
    """

    recording: Recording
    outliers: tuple[Outlier, ...]
    odd: tuple[Outlier, ...]
    looked: _Looked

    def is_odd(self, ids: Int[np.ndarray, " poses"]) -> Bool[np.ndarray, " poses"]:
        """Return which poses were left out."""
        return np.isin(ids, [o.pose for o in self.odd])


def _read(recording: Recording, arm: Arm, hypotheses: Sequence[Hypothesis]) -> _Read:
    """Look at a recording, again where poses are odd beside what was found."""
    recording, prepared, outliers = _prepared(recording, arm)
    looked = _about_kinematics(prepared, recording, arm, hypotheses)
    odd = tuple[Outlier, ...]()
    while more := _of_odd_poses(looked, recording, odd):
        odd += more
        recording, prepared, late = _prepared(without_outliers(recording, more), arm)
        outliers = (*outliers, *late)
        looked = _about_kinematics(prepared, recording, arm, hypotheses)
    return _Read(recording, outliers, odd, looked)


def _of_odd_poses(
    looked: _Looked, recording: Recording, before: Sequence[Outlier]
) -> tuple[Outlier, ...]:
    """Return the readings of poses that a set leaves far beyond all others.

    Some poses that were read wrongly hold every name, as no law does what they do.

    Args:
        looked: What was found.
        recording: In which it was looked for.
        before: Readings of odd poses that are left out of it already.
    """
    judged = looked.judged
    if judged is None or judged.residual.p_value >= SIGNIFICANCE:
        return ()
    left, ids = judged.beyond.after.data, np.unique(recording.posture_id)
    prepared = looked.layout.prepared
    seen, pose = prepared.readings.weight > 0.0, prepared.situation.posture_index
    odd = odd_poses(left.mismatch_of_poses, np.bincount(pose, seen.sum(axis=1)))
    if len({o.pose for o in before}) + odd.sum() > MOST_ODD * len(odd):
        return ()
    return outliers_at(recording, _ids(ids, odd), prepared.readings.value)


def _with_arrivals(looked: _Looked, hypotheses: Sequence[Hypothesis]) -> _Looked:
    """Look again where gears that were found arrive in states that nothing tells."""
    if looked.model is None:
        return looked
    case, fit = looked.model.case, looked.model.fit
    left = residual_after(case, fit)
    turns, members = unknown_arrivals(case, left, fit)
    if not turns:
        return looked
    situation = looked.layout.prepared.situation.with_unknown(turns)
    about = with_noise(replace(looked.layout.prepared, situation=situation), 1.0)
    again = _look(about, hypotheses, members).with_exchanges()
    again = replace(again, found=looked.found)
    arriving = {m.name for m in members if arrives_unknown(m)}
    return again if arriving <= {m.name for m in again.members} else looked


def _with_scattering_axes(
    looked: _Looked, hypotheses: Sequence[Hypothesis]
) -> tuple[_Looked, tuple[UnexplainedPlace, ...]]:
    """Look again where axes scatter from pose to pose after no law; return those.

    What no law does at one axis would be held against the names of all others. What the
    second look names may be what seemed to scatter: an axis is said that still does.
    """
    judged = looked.judged
    if judged is None or judged.residual.p_value >= SIGNIFICANCE:
        return looked, ()
    case = judged.model.case

    def beside(fit: ModelFit) -> Float[np.ndarray, " axes"]:
        return scattering_axes(looked.layout.prepared, residual_after(case, fit))

    scatter = beside(judged.model.fit)
    if not np.any(scatter):
        return looked, ()
    arrival = np.maximum(scatter, looked.layout.prepared.pose_repeatability)
    about = with_noise(looked.layout.prepared, 1.0, arrival)
    again = _look(about, hypotheses, looked.members).with_exchanges()
    if again.members:
        scatter = beside(fit_model(case, again.members))
    excess = max(judged.residual.excess, 0.0)
    share = excess / max(excess + judged.model.fit.gain, 1e-12)
    p, places = judged.residual.p_value, []
    for k in np.flatnonzero(scatter):
        unit = "µm" if case.situation.arm.slides[k] else "µrad"
        look = f"{1e6 * scatter[k]:.3g} {unit} from pose to pose, after no law tried"
        places.append(UnexplainedPlace(f"a{k + 1}", p, share, (), look))
    return again, tuple(places)


def _of_no_place(answer: Mapping, texts: Sequence[str]) -> dict[str, Any]:
    """Return the entries of an answer where all is explained but what has no place."""
    if not texts or answer["verdict"] != "explained":
        return {}
    left = Unexplained("", "; ".join(texts), {})
    return {"verdict": "partly_explained", "unexplained": left}


def _left_by_scattering(
    answer: Mapping, places: tuple[UnexplainedPlace, ...]
) -> dict[str, Any]:
    """Return the entries of an answer that say where axes scatter after no law."""
    if not places:
        return {}
    first = Unexplained(places[0].where, f"its angle differs: {places[0].law}", {})
    at = tuple(Located(p.where, p.p_value, p.share, (), "") for p in places)
    verdict = answer.get("verdict", "unexplained")
    return {
        "verdict": "partly_explained" if verdict == "explained" else verdict,
        "unexplained_places": (*answer.get("unexplained_places", ()), *places),
        "unexplained": answer.get("unexplained") or first,
        "located": answer.get("located") or at,
    }


def _prepared(
    recording: Recording, arm: Arm
) -> tuple[Recording, Prepared, tuple[Outlier, ...]]:
    """Make a recording ready, outliers left out: those it shows, and the rest."""
    outliers = outliers_of(recording)
    recording = without_outliers(recording, outliers)
    prepared = prepare(recording, arm)
    late = outliers_of(recording, prepared.readings.value, prepared.readings.point)
    if late:
        recording = without_outliers(recording, late)
        prepared = prepare(recording, arm)
    return recording, prepared, tuple(sorted((*outliers, *late), key=lambda o: o.row))


def _detection(
    prepared: Prepared, case: SelectionProblem, found: DetectionTest
) -> Detection:
    misfit = rms_summary(prepared, case)
    one = float(np.sqrt(np.trace(np.linalg.inv(prepared.readings.inverse))))
    frames = max(float(np.sum(prepared.readings.weight)), 1.0)
    smallest = one * np.sqrt(WOULD_SHOW / (3.0 * frames))
    if found.poses < FEWEST_POSES:
        smallest = misfit.noise * np.sqrt(case.dispersion_limit)
    held_out = held_out_misfit(prepared, case)
    errors = (misfit.rms, misfit.noise, smallest)
    missed = (held_out.within, held_out.whole, misfit.within, misfit.noise_within)
    return Detection(found.p_value, *errors, *missed)


def _stopped(
    recording: Recording, mistakes: tuple[Warned, ...], started: float
) -> Diagnosis:
    """Name no effect while a mistake of the set-up stands."""
    detection = Detection(SMALLEST, np.nan, np.nan, np.nan)
    where = Unexplained(mistakes[0].where, mistakes[0].text, {})
    return Diagnosis(
        recording.name,
        "unexplained",
        detection,
        unexplained=where,
        warnings=mistakes,
        seconds=time.perf_counter() - started,
    )
