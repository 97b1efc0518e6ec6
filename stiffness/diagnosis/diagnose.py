"""A recording is asked in turn: is it set up right, is something there, where, what.

Nothing here knows how an effect is built into a simulator; the proof is made elsewhere,
with the mechanism and never with the columns that found it.
"""

import time
from collections.abc import Sequence

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.answer import answer_of, nominal_of
from stiffness.diagnosis.case import Case
from stiffness.diagnosis.detect import (
    ALARM,
    FEWEST,
    WOULD_SHOW,
    Found,
    detect,
)
from stiffness.diagnosis.diagnosis import (
    Detection,
    Diagnosis,
    Unexplained,
    Warned,
)
from stiffness.diagnosis.flips import SMALLEST
from stiffness.diagnosis.hypotheses import HYPOTHESES
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.layout import case_of, settled
from stiffness.diagnosis.misfit import held_out_misfit, misfit_of
from stiffness.diagnosis.prepare import Prepared, prepare
from stiffness.diagnosis.remarks import remarks, scattered
from stiffness.diagnosis.scatter import scatter_of
from stiffness.diagnosis.set_up import mistakes_of_set_up
from stiffness.diagnosis.steady import steadied


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
    arm, recording = arm.for_recording(recording), steadied(recording)
    mistakes = mistakes_of_set_up(recording, arm)
    if mistakes:
        return _stopped(recording, mistakes, started)
    prepared = prepare(recording, arm)
    case = case_of(prepared, hypotheses)
    nominal = np.arange(case.library.nominal)
    everyone = np.ones(len(case.split.fold), dtype=bool)
    found = detect(
        case.library,
        case.evidence,
        case.evidence.score,
        nominal,
        everyone,
        case.seed,
        scatter_of(case.data, case.wild),
    )
    detection = _detection(prepared, case, found)
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
        common["warnings"] = remarks(prepared) + scattered(found.dispersion)
        return Diagnosis(
            verdict="no_mismatch",
            nominal=nominal_of(prepared, np.zeros(len(prepared.springs))),
            seconds=time.perf_counter() - started,
            **common,
        )
    case, named = settled(case, prepared, hypotheses, found)
    answer = answer_of(case, prepared, found, named)
    return Diagnosis(**common, **answer, seconds=time.perf_counter() - started)


def _detection(prepared: Prepared, case: Case, found: Found) -> Detection:
    misfit = misfit_of(prepared, case)
    one = float(np.sqrt(np.trace(np.linalg.inv(prepared.readings.inverse))))
    frames = max(float(np.sum(prepared.readings.weight)), 1.0)
    smallest = one * np.sqrt(WOULD_SHOW / (3.0 * frames))
    if found.poses < FEWEST:
        smallest = misfit.noise * np.sqrt(case.wild)
    held_out = held_out_misfit(prepared, case)
    return Detection(
        found.p_value,
        misfit.rms,
        misfit.noise,
        smallest,
        held_out.within,
        held_out.whole,
    )


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
