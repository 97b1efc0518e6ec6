"""Calibrates an arm on absolute positions, proves it, and fills in diagnosis.json.

Probability and share of a named effect, in `answer_of`:

==========  ==========================================================================
Equation    probability of a name = Phi(z), z = its loss when taken out over the loss'
            standard error over regions left out; share = its loss over all losses
Source      paired differences over clusters, taken as normal
Valid       ten regions or more
Ignores     that losses of confounded names overlap
==========  ==========================================================================
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from scipy.stats import norm

from bench.patch import Patch
from bench.proof.setup import why_not_simulated
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.errors import BenchError
from bench.shared.recording import Recording
from bench.shared.settings import MM, MRAD, SETTINGS, UM
from scenarios.pipelines.calibration_proof import (
    CalibrationProof,
    ResidualSummary,
    proved,
    rms,
    summarise_residual,
    unproved,
)
from scenarios.pipelines.patching import digests_of
from scenarios.pipelines.schema import (
    Answer,
    At,
    Called,
    Detected,
    Findings,
    Interval,
    Left,
    OutlierEntry,
    Placed,
    Proved,
    Refused,
    Remark,
    interval_of,
    label,
    large_corrections,
    said_of_turns,
    verdict_of,
    wave_of,
    why_not,
)
from stiffness.calibration.columns import Key
from stiffness.calibration.model import readings_of
from stiffness.calibration.result import (
    Calibrated,
    calibrated,
    is_told,
    mean_lag,
    outlier_distances,
)
from stiffness.calibration.selection import (
    BELIEVED,
    DRAWING,
    IMPOSSIBLE,
    MARGIN,
    NO_GAIN,
    spatial_folds_of,
)
from stiffness.diagnosis.result import Decision
from stiffness.experiment.outliers import (
    Outlier,
    outlier_text,
    outliers_of,
    without_outliers,
)
from stiffness.regression.testing import SIGNIFICANCE
from stiffness.robot.arm import Arm

# --- The entry in schema 1 ------------------------------------------------------------

LIKE = {"hysteresis": ("lost_motion",), "reading_lag": ("hysteresis", "lost_motion")}
"""Effects that cannot be told apart at rest: all depend on the side of approach, and
moves between the poses are not known. Commanded angles may tell a lag."""
IMPOSSIBLE_FIT = "the best fit is a size that the effect cannot have"
NOT_MISSED = "fitted with the others, but taken out alone it is not missed"
NOT_PROVED = "not proved: on regions kept back the simulator is not surely better by it"
GONE = "taken out again: with all others in, it is not surely missed"


def answer_of(
    name: str,
    found: Calibrated,
    proof: CalibrationProof,
    residual: ResidualSummary,
    seconds: float,
    rejected: float = 1.0,
) -> Answer:
    """Return a calibration as an answer in schema 1.

    `rejected` is the p-value of the nominal arm from a test made before; 1: none was
    made.
    """
    first, last = found.at_first, found.at_last
    tests = [first.p_value, proof.p_value]
    if found.turns_at_first is not None and proof.rotations is not None:
        tests.append(found.turns_at_first.p_value)
    p_value = min(1.0, rejected, len(tests) * min(tests))
    something = p_value < SIGNIFICANCE or proof.improves
    names = found.named if proof.improves else ()
    entry = (
        None
        if proof.failed
        else Proved(
            simulator="mujoco",
            held_out_poses=proof.poses,
            before_rms_mm=MM * rms(proof.before),
            after_rms_mm=MM * rms(proof.after),
            noise_rms_mm=MM * last.noise,
            gain_mm=interval_of(proof.gain, MM),
            **_of_turns(found, proof),
        )
    )
    share = proof.explained
    explained = share and interval_of(share)
    passes = residual.p_value >= SIGNIFICANCE
    improves = proof.improves and not proof.failed
    verdict = verdict_of(
        Findings(something, bool(names), passes, True, entry, explained, improves)
    )
    left = None
    if verdict in ("partly_explained", "unexplained"):
        left = Left(residual.where, residual.signature, {}, MM * rms(proof.after))
    called = tuple(_called(found, key) for key in names)
    return Answer(
        recording=name,
        verdict=verdict,
        detection=Detected(
            p_value, MM * first.rms, MM * last.noise, MM * last.smallest
        ),
        located=_located(found, names),
        explained_share=explained,
        named=called,
        unexplained=left,
        confounded=tuple(
            (At(e.effect, e.where), other) for e in called for other in e.equivalents
        ),
        warnings=(*_not_seen(found), *large_corrections(called)),
        proof=entry,
        seconds=round(seconds, 1),
        refused=tuple(_refused(found, names)),
    )


def _refused(found: Calibrated, names: tuple[Key, ...]) -> Iterator[Refused]:
    """Yield what would help at an impossible size, and what is fitted but not named."""
    for step in found.selected.steps:
        if step.verdict == IMPOSSIBLE and step.gain > MARGIN * step.error:
            sizes = zip(step.parameters, step.values, strict=True)
            parameters = {name: Interval(v, None, None) for name, v in sizes}
            yield Refused(*step.key, parameters, IMPOSSIBLE_FIT)
    for key, why in without_a_name(found, names).items():
        known = found.estimates.get(key, {})
        yield Refused(*key, {n: interval_of(e) for n, e in known.items()}, why)


def without_a_name(found: Calibrated, names: tuple[Key, ...]) -> dict[Key, str]:
    """Return what was believed or fitted and has no name, and why."""
    tables = [("transmission_error", axis) for axis in found.error_tables]
    fitted = {*found.estimates, *tables}
    taken = [s.key for s in found.selected.steps if s.verdict == BELIEVED]
    gone = {k: GONE for k in taken if k not in fitted and k != DRAWING}
    kept = {
        key: NOT_PROVED if key in found.named else NOT_MISSED
        for key in (*found.estimates, *tables)
        if key not in names
    }
    return gone | kept


def names_of(answer: Answer) -> tuple[Key, ...]:
    """Return effect and place of what an answer names."""
    return tuple((n.effect, n.where) for n in answer.named)


def names_told(found: Calibrated, answer: Answer) -> str:
    """Say which names stand in the end, and what was believed before and has none."""
    named = [f"{n.effect}@{n.where}" for n in answer.named]
    said = f"Named in the end: {', '.join(named) or 'nothing'}."
    every = without_a_name(found, names_of(answer))
    for why in (GONE, NOT_PROVED, NOT_MISSED):
        listed = ", ".join(f"{e}@{w}" for (e, w), own in every.items() if own == why)
        said += f" No name, {why}: {listed}." if listed else ""
    return said


def not_seen_text(found: Calibrated) -> str:
    """Say which numbers of the drawing the readings do not show; empty: none."""
    places: dict[str, list[str]] = {}
    for e in found.selected.not_seen:
        places.setdefault(f"{e.effect} at {e.where}", []).append(label(e.parameter))
    listed = "; ".join(f"{at} ({', '.join(own)})" for at, own in places.items())
    return f"Not seen by these data, and left as drawn: {listed}." if listed else ""


def _not_seen(found: Calibrated) -> Iterator[Remark]:
    if text := not_seen_text(found):
        yield Remark("not_seen", "arm", text)


def _of_turns(found: Calibrated, proof: CalibrationProof) -> dict[str, Any]:
    """Return the entry's numbers in mrad, of 6D targets."""
    turns, last = proof.rotations, found.turns_at_last
    if turns is None or last is None:
        return {}
    return {
        "before_rms_mrad": MRAD * rms(turns.before),
        "after_rms_mrad": MRAD * rms(turns.after),
        "noise_rms_mrad": MRAD * last.noise,
        "gain_mrad": interval_of(turns.gain, MRAD),
    }


def _located(found: Calibrated, names: tuple[Key, ...]) -> tuple[Placed, ...]:
    budget = found.selected.budget
    total = sum(max(loss, 0.0) for loss, _ in budget.values())
    places: dict[str, list[Key]] = {}
    for key in names:
        places.setdefault(key[1], []).append(key)
    placed = []
    for where, own in places.items():
        share = sum(budget[k][0] for k in own) / max(total, 1e-30)
        p = min(float(norm.sf(budget[k][0] / budget[k][1])) for k in own)
        depends = dict.fromkeys(d for k in own for d in CATALOGUE[k[0]].depends_on)
        placed.append(Placed(where, p, float(share), tuple(depends), _zone(found, own)))
    return tuple(sorted(placed, key=lambda p: -p.share))


def _zone(found: Calibrated, own: list[Key]) -> str:
    where = own[0][1]
    if not (where[:1] == "a" and where[1:].isdigit()):
        return "everywhere"
    k = int(where[1:]) - 1
    if found.readings.arm.slides[k]:
        low, high = MM * np.quantile(found.readings.posture[:, k], [0.01, 0.99])
        return f"from {low:.0f} mm to {high:.0f} mm"
    angle = np.degrees(found.readings.posture[:, k])
    low, high = np.quantile(angle, [0.01, 0.99])
    if where in found.error_tables:
        grid = np.radians(np.linspace(low, high, 721))
        worst = np.degrees(grid[np.argmax(np.abs(found.error_tables[where].at(grid)))])
        return f"from {low:.0f}° to {high:.0f}°, most at {worst:.0f}°"
    return f"from {low:.0f}° to {high:.0f}°"


def _called(found: Calibrated, key: Key) -> Called:
    loss, error = found.selected.budget[key]
    effect, where = key
    parameters = {
        name: interval_of(e) for name, e in found.estimates.get(key, {}).items()
    }
    if effect == "transmission_error":
        wave = found.harmonics[where]
        order = Interval(*[float(wave.order)] * 3)
        parameters |= wave_of(wave.size, wave.half, order, wave.phase)
    equivalents = [At(*other) for other in found.selected.equivalents.get(key, ())]
    if effect in LIKE and not _is_the_reports(found, key):
        equivalents += [At(other, where) for other in LIKE[effect]]
    elif effect == "drift":
        equivalents.append(At("drift", "tracker"))
    elif effect == "encoder_offset":
        links = found.readings.arm.chain.links.items()
        before = [link for link, axis in links if f"a{axis + 1}" == where]
        equivalents += [At("geometry_error", link) for link in before]
    sure = float(np.clip(norm.cdf(loss / error), 0.0, 0.9999))
    return Called(effect, where, sure, tuple(dict.fromkeys(equivalents)), parameters)


def _is_the_reports(found: Calibrated, key: Key) -> bool:
    """Return whether an effect is a lag that commanded angles show."""
    if key[0] != "reading_lag":
        return False
    axis = int(key[1][1:]) - 1
    lag = mean_lag(found.estimates[key], found.readings, axis)
    return is_told(lag, found.readings.told_lag[axis])


# --- The report -----------------------------------------------------------------------


def first_sentence(answer: Answer, proof: CalibrationProof) -> str:
    """Return the error before and after, and the verdict, in one sentence."""
    low, high = UM * proof.gain.low, UM * proof.gain.high
    names = len(answer.named)
    before, after = UM * rms(proof.before), UM * rms(proof.after)
    falls = (
        f"error falls from {before:.1f} to {after:.1f} µm rms (gain {low:.1f} to "
        f"{high:.1f} µm over regions) with {names} effect{'s' * (names > 1)} named"
    )
    stays = f"error as drawn is {before:.1f} µm rms, and no effect earned a name"
    whose = "simulator's" if not proof.failed else "fitted arm's"
    why = f" Nothing was proved: {proof.failed}" if proof.failed else ""
    turned = said_of_turns(answer.proof) if answer.proof is not None else ""
    return (
        f"On {proof.poses} poses in regions that nothing was fitted to, the "
        f"{whose} {falls if names else stays}; "
        f"verdict: {answer.verdict.replace('_', ' ')}.{why}"
        f"{' ' + turned if turned else ''}"
    )


# --- The outcome ----------------------------------------------------------------------


@dataclass(frozen=True)
class CalibrationOutcome:
    """A calibration with its proof, its residual, its answer and the model file."""

    found: Calibrated
    proof: CalibrationProof
    residual: ResidualSummary
    answer: Answer
    model: Path

    @property
    def patch(self) -> Patch:
        """What the simulator was given."""
        return self.proof.patch

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """The verdict on each effect that was tried, at each site."""
        gate, least, nothing = "regions_left_out", SETTINGS.standard_errors, math.nan
        tried = [
            Decision(step.key, gate, True, z, least, "predicts regions left out")
            if step.verdict == BELIEVED
            else Decision(step.key, gate, False, z, least, "does not predict them")
            if step.verdict == NO_GAIN
            else Decision(step.key, "physical", False, nothing, nothing, IMPOSSIBLE_FIT)
            for step in self.found.selected.steps
            for z in [step.gain / max(step.error, 1e-30)]
        ]
        refused = without_a_name(self.found, names_of(self.answer))
        tried += [
            Decision(key, "magnitude", False, nothing, nothing, why)
            for key, why in sorted(refused.items())
        ]
        return tuple(tried)

    def why_not(self, effect: str, where: str) -> str:
        """Say why an effect was not named at a place; see `schema.why_not`."""
        return why_not(self.answer, self.decisions, effect, where)


def calibrate_and_prove(
    recording: Recording,
    arm: Arm,
    model: Path,
    draw: int = 0,
    said: Callable[[str], object] = lambda _: None,
    rejected: float = 1.0,
) -> CalibrationOutcome:
    """Calibrate an arm on a recording and prove it in the simulator.

    Only unloaded rows of absolute positions are used. `said` receives a line on each
    step; `rejected` is as in `answer_of`.

    Raises:
        Unusable: Where the recording does not allow a calibration.
    """
    started = time.perf_counter()
    why = why_not_simulated(recording, model)
    outliers = [*outliers_of(recording)]
    readings = readings_of(without_outliers(recording, outliers), arm)
    size, folds = outlier_distances(readings), spatial_folds_of(readings, draw)
    kept = size == 0.0
    used = replace(folds, region=folds.region[kept], fold=folds.fold[kept])
    found = calibrated(readings.take(kept), used, said)
    for row in np.flatnonzero(~kept):
        pose, name = readings.posture_id[row], readings.names[readings.marker[row]]
        outliers.append(Outlier(int(row), int(pose), name, float(size[row])))
    try:
        proof = unproved(found, why) if why else proved(found, recording, model)
    except BenchError as error:  # what was found stays found
        proof = unproved(found, str(error))
    seen = replace(proof.patch, readings=digests_of(recording))
    proof = replace(proof, patch=seen)
    residual = summarise_residual(found, proof)
    seconds = time.perf_counter() - started
    answer = answer_of(recording.name, found, proof, residual, seconds, rejected)
    said(names_told(found, answer))
    said(first_sentence(answer, proof))
    if outliers:
        text = outlier_text(outliers)
        said(text)
        answer = msgspec.structs.replace(
            answer,
            warnings=(Remark("outliers", "tracker", text), *answer.warnings),
            outliers=tuple(
                OutlierEntry(o.pose, o.marker, MM * o.size) for o in outliers
            ),
        )
    return CalibrationOutcome(found, proof, residual, answer, model)
