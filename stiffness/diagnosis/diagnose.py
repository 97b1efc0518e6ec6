"""A recording is asked in turn: is it set up right, is something there, where, what.

Nothing here knows how an effect is built into a simulator; the proof is made elsewhere,
with the mechanism and never with the columns that found it.
"""

import time
from collections.abc import Sequence

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.confounding import confounded_with
from stiffness.diagnosis.detect import ALARM, WOULD_SHOW, Found, detect
from stiffness.diagnosis.diagnosis import (
    Detection,
    Diagnosis,
    Located,
    Name,
    NamedEffect,
    Nominal,
    Unexplained,
    Warned,
)
from stiffness.diagnosis.evidence import evidence_of
from stiffness.diagnosis.hypotheses import HYPOTHESES
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.judge import (
    SURE,
    alone,
    contradicted,
    equivalents,
    left_over,
    posterior,
    probability_of,
    rivals_of,
)
from stiffness.diagnosis.library import library_of
from stiffness.diagnosis.member import solve, training
from stiffness.diagnosis.naming import Case, Named, name
from stiffness.diagnosis.places import places_of_map, places_of_names
from stiffness.diagnosis.prepare import Prepared, prepare
from stiffness.diagnosis.remarks import noise_rms, remarks, residual_rms
from stiffness.diagnosis.set_up import mistakes_of_set_up
from stiffness.diagnosis.sets import white_candidates
from stiffness.diagnosis.split import seed_of, split_of
from stiffness.diagnosis.unnamed import law_of


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
    arm = arm.for_recording(recording)
    mistakes = mistakes_of_set_up(recording, arm)
    if mistakes:
        return _stopped(recording, mistakes, started)
    prepared = prepare(recording, arm)
    if prepared.mistake is not None:
        return _stopped(recording, (prepared.mistake,), started)
    case = case_of(prepared, hypotheses)
    nominal = np.arange(case.library.nominal)
    everyone = np.ones(len(case.split.fold), dtype=bool)
    found = detect(
        case.library, case.evidence, case.evidence.score, nominal, everyone, case.seed
    )
    detection = _detection(prepared, found)
    ids = np.unique(recording.pose)
    common = {
        "recording": recording.name,
        "detection": detection,
        "warnings": remarks(prepared),
        "held_out": tuple(int(p) for p in ids[case.split.held_out]),
        "doubtful": tuple(
            (r, recording.markers[m].name, s) for r, m, s in prepared.doubtful
        ),
    }
    if found.p_value >= ALARM:
        return Diagnosis(
            verdict="no_mismatch",
            nominal=_nominal(prepared, np.zeros(len(prepared.springs))),
            seconds=time.perf_counter() - started,
            **common,
        )
    named = name(case, found)
    answer = _answer(case, prepared, found, named)
    return Diagnosis(**common, **answer, seconds=time.perf_counter() - started)


def case_of(prepared: Prepared, hypotheses: Sequence[Hypothesis]) -> Case:
    """Lay out everything that naming looks at.

    Args:
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
    """
    recording = prepared.situation.recording
    split = split_of(recording)
    library = library_of(prepared.situation, prepared.springs, hypotheses)
    data = prepared.data
    springs = library.signatures[: library.nominal]
    if springs:
        evidence = evidence_of(data, springs, training(split))
        beta = solve(evidence.gram.sum(axis=0), evidence.score.sum(axis=0))
        data = data.less(springs, beta)
        moved = prepared.situation.compliance.copy()
        moved[list(prepared.springs)] += beta
    else:
        moved = prepared.situation.compliance
    evidence = evidence_of(data, library.signatures, training(split))
    situation = prepared.situation.with_compliance(moved)
    return Case(
        data, situation, prepared.springs, library, evidence, split, seed_of(recording)
    )


def _answer(case: Case, prepared: Prepared, found: Found, named: Named) -> dict:
    gains = alone(case, named.best.fit)
    taken_back = contradicted(named, gains)
    kept = [k for k, gone in enumerate(taken_back) if not gone]
    weights, sets = posterior(named, named.inflation)
    effects = []
    for k in kept:
        member = named.best.fit.members[k]
        alike = equivalents(named, k)
        effects.append(
            NamedEffect(
                name=Name(*member.name),
                probability=probability_of(member.name, alike, weights, sets),
                equivalents=tuple(alike),
                parameters=named.best.parameters[k],
                shape=tuple(float(v) for v in member.shape),
                coefficients=tuple(float(v) for v in named.best.fit.coefficients[k]),
            )
        )
    sure = [e for e in effects if e.probability >= SURE]
    rejects = named.left.p_value < ALARM
    whole = bool(sure) and len(sure) == len(taken_back)
    verdict = "unexplained"
    if sure:
        verdict = "explained" if whole and not rejects else "partly_explained"
    last = named.left if sure else found
    nominal = np.arange(case.library.nominal)
    white = white_candidates(case.library, case.evidence)
    located = places_of_names(named.best.fit, gains, found.p_value, case.situation)
    if not whole:
        of_map = places_of_map(
            case.library, case.evidence, case.evidence.score, nominal, case.seed
        )
        total = max(sum(c for _, _, c, _ in of_map), 1e-12)
        mapped = [Located(w, p, c / total, d, "") for w, p, c, d in of_map]
        sure_places = [
            one for one in located if one.where in {e.name.where for e in sure}
        ]
        known = {one.where for one in sure_places}
        located = tuple(sure_places + [one for one in mapped if one.where not in known])
    unexplained = None
    if verdict != "explained":
        unexplained = _unexplained(case, prepared, last, named, bool(sure), located)
    return {
        "verdict": verdict,
        "located": located,
        "named": tuple(sorted(sure, key=lambda e: -e.probability)),
        "rivals": rivals_of(named, weights, sets),
        "unexplained": unexplained,
        "confounded": confounded_with(
            case.library, white, {(e.name.effect, e.name.where) for e in sure}
        ),
        "nominal": _nominal(prepared, named.best.fit.springs, case),
    }


def _unexplained(
    case: Case,
    prepared: Prepared,
    last: Found,
    named: Named,
    some: bool,
    located: tuple[Located, ...],
) -> Unexplained:
    where = left_over(last)
    if not some and located:
        where = located[0].where
    known = list(case.nominal)
    if some:
        known += [m.signature(case.situation) for m in named.best.fit.members]
    law, look = law_of(case, tuple(known), where)
    words = [look] if look else []
    depends = next((one.depends_on for one in located if one.where == where), ())
    if depends:
        words.append("depends on " + ", ".join(depends))
    return Unexplained(where, "; ".join(words), law, residual_rms(prepared))


def _detection(prepared: Prepared, found: Found) -> Detection:
    noise = noise_rms(prepared)
    count = max(float(np.sum(prepared.readings.weight > 0)), 1.0)
    smallest = noise * np.sqrt(WOULD_SHOW / (3.0 * count))
    return Detection(found.p_value, residual_rms(prepared), noise, smallest)


def _nominal(
    prepared: Prepared, springs: np.ndarray, case: Case | None = None
) -> Nominal:
    compliance = (case or prepared).situation.compliance.copy()
    sigma = np.zeros(len(compliance))
    if prepared.springs:
        compliance[list(prepared.springs)] += springs
        sigma[list(prepared.springs)] = prepared.sigma
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = prepared.frames.turn, prepared.frames.shift
    return Nominal(
        compliance,
        sigma,
        tuple(f"a{k + 1}" for k in prepared.blind),
        transform,
        prepared.frames.place,
        prepared.noise,
        prepared.arrival,
    )


def _stopped(
    recording: Recording, mistakes: tuple[Warned, ...], started: float
) -> Diagnosis:
    """Name no effect while a mistake of the set-up stands."""
    detection = Detection(1.0 / 5000.0, np.nan, np.nan, np.nan)
    where = Unexplained(mistakes[0].where, mistakes[0].text, {}, np.nan)
    return Diagnosis(
        recording.name,
        "unexplained",
        detection,
        unexplained=where,
        warnings=mistakes,
        seconds=time.perf_counter() - started,
    )
