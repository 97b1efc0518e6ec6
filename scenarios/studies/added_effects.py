"""Effects of known size added to the readings of a UR10 and a KR300, and recovered."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.experiment import faulty
from bench.instruments import Instruments
from bench.patch import Patch, PatchEffect, rig_of
from bench.proof.setup import point_in_base
from bench.proof.simulation import reading_of
from bench.shared.recording import Recording
from stiffness.calibration.model import Readings
from stiffness.calibration.result import Calibrated, calibrated
from stiffness.calibration.selection import SpatialFolds, spatial_folds_of
from stiffness.dual_encoder.delays import across
from stiffness.dual_encoder.fit import EncoderComparison
from stiffness.dual_encoder.motions import Motion, motions_of
from stiffness.dual_encoder.terms import DELAY, FRICTION, Term

# --- The KR300's second encoders ------------------------------------------------------


@dataclass(frozen=True)
class Added:
    """An effect that is added to one axis of the KR300.

    Attributes:
        axis: Its axis, counted from 0.
        parameter: Parameter that is compared, in SI.
        size: Added size of that parameter.
        change: Function from a motion to the change of the second encoder, in rad.
    """

    effect: str
    axis: int
    parameter: str
    size: float
    change: Callable[[Motion], Float[np.ndarray, " rows"]]


KR300_ORDER = 61.0
"""Order of the added harmonic; chosen: no multiple of those found."""
KR300_ADDED = tuple(
    Added(effect, axis, parameter, size, change)
    for axis in range(3)
    for effect, parameter, size, change in (
        ("channel_delay", "delay_s", 2e-3, lambda m: _delayed(m, 2e-3)),
        (
            "joint_compliance", "compliance_rad_per_nm", 5e-7,
            lambda m: -5e-7 * np.asarray(m.torque),
        ),
        (
            "lost_motion", "width_rad", 4e-4,
            lambda m: -2e-4 * np.sign(np.where(np.abs(m.speed) < 1e-3, 0.0, m.speed)),
        ),
        (
            "transmission_error", "amplitude_rad", 1.5e-4,
            lambda m: 1.5e-4 * np.sin(KR300_ORDER * m.angle + 0.5),
        ),
    )
)  # fmt: skip
"""Every effect, on every axis that has a second encoder."""


def kr300_rows(recording: Recording) -> Iterator[dict[str, object]]:
    """Yield sizes added to the second encoders and found, a row for each effect."""
    fit = {k: own[:-1] for k, own in motions_of(recording).items()}
    plain = across(fit)
    for added in KR300_ADDED:
        changed = tuple(
            replace(m, apart=_centred(m.apart + added.change(m)))
            for m in fit[added.axis]
        )
        found = across({**fit, added.axis: changed})
        yield _row(added, plain[added.axis], found[added.axis])


def _row(
    added: Added, before: EncoderComparison, after: EncoderComparison
) -> dict[str, object]:
    known = _kr300_size(before, added)[0]
    named, (value, half) = _is_there(after, added), _kr300_size(after, added)
    news = _effects(after) - _effects(before)
    return {
        "recording": "real_kr300",
        "effect": added.effect,
        "where": f"a{added.axis + 1}",
        "parameter": added.parameter,
        "added": added.size,
        "named": named,
        "found_more": value - known if named else 0.0,
        "low": value - half - known if named else 0.0,
        "high": value + half - known if named else 0.0,
        "before": known,
        "also_named": " ".join(sorted(news - {added.effect})),
    }


def _effects(found: EncoderComparison) -> set[str]:
    late = {DELAY.effect} if found.delay_step is not None else set()
    return {t.effect for t in found.terms} - {FRICTION} | late


def _is_there(found: EncoderComparison, added: Added) -> bool:
    late = added.effect == DELAY.effect and found.delay_step is not None
    return late or any(_same(term, added) for term in found.terms)


def _same(term: Term, added: Added) -> bool:
    near = not term.order or abs(term.order - KR300_ORDER) <= 1.0
    return term.effect == added.effect and near


def _kr300_size(found: EncoderComparison, added: Added) -> tuple[float, float]:
    """Return the size and half width of its interval; zeros where it was not found."""
    if added.effect == DELAY.effect:
        return found.delay, found.delay_half
    i = 0
    for term in found.terms:
        x = found.x[i : i + len(term.parameters)]
        own = found.half[i : i + len(x)]
        half = float(own.max() if term.order else own[0])
        i += len(x)
        if _same(term, added):
            return float(np.hypot(*x)) if term.order else float(x[0]), half
    return 0.0, 0.0


def _delayed(motion: Motion, delay: float) -> Float[np.ndarray, " rows"]:
    angle = motion.angle + motion.apart
    return np.interp(motion.time - delay, motion.time, angle) - angle


def _centred(values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    return values - values.mean()


# --- The UR10's target ----------------------------------------------------------------

EVERY, HIGHEST = 2, 129
"""One pose in so many is used, and error tables end at this order; chosen: three times
as fast, and the added harmonic is of a lower order."""
PLACE = np.array([0.0, 0.0, 0.093])
UR10_ORDER = 11.0
"""Order of the added harmonic; chosen: not the largest of those found."""
UR10_ADDED = (
    ("joint_compliance", "a2", "compliance_rad_per_nm", 1e-5, {}),
    ("drift", "base", "z_m_per_h", 3e-6, {}),
    ("bearing_tilt", "a2", "u_rad_per_nm", 4e-5, {}),
    ("bearing_tilt", "a1", "u_rad_per_nm", 1e-6, {}),
    ("hysteresis", "a3", "width_rad", 2e-4, {}),
    ("encoder_offset", "a3", "offset_rad", 5e-4, {}),
    ("transmission_error", "a1", "amplitude_rad", 1.5e-4,
     {"order": UR10_ORDER, "phase_rad": 0.5}),
)  # fmt: skip


@dataclass(frozen=True)
class Base:
    """The readings without added effects, and their calibration."""

    readings: Readings
    spatial_folds: SpatialFolds
    found: Calibrated


def base_of(readings: Readings) -> Base:
    """Calibrate on the readings without added effects."""
    part = readings.take(np.arange(0, len(readings.seen), EVERY))
    regions = spatial_folds_of(part)
    return Base(part, regions, calibrated(part, regions, highest=HIGHEST))


def ur10_rows(base: Base, model: Path) -> Iterator[dict[str, object]]:
    """Yield sizes added to the target, as MuJoCo displaces it, and found."""
    for effect, where, parameter, size, more in UR10_ADDED:
        named = PatchEffect(effect, where, {parameter: size, **more})
        moved = _displacement(base.readings, model, named)
        turn = base.found.before.base_from_tracker[:3, :3]
        changed = replace(base.readings, seen=base.readings.seen + moved @ turn)
        found = calibrated(changed, base.spatial_folds, highest=HIGHEST)
        value, low, high = _ur10_size(found, base.found, named, parameter)
        news = set(found.named) - set(base.found.named) - {(effect, where)}
        yield {
            "recording": "real_ur10",
            "effect": effect,
            "where": where,
            "parameter": parameter,
            "added": size,
            "named": (effect, where) in found.named,
            "found_more": value,
            "low": low,
            "high": high,
            "before": _estimate(base.found, effect, where, parameter)[0],
            "also_named": " ".join("@".join(key) for key in sorted(news)),
        }


def _estimate(
    found: Calibrated, effect: str, where: str, parameter: str
) -> tuple[float, float]:
    """Return an estimate and half width of its interval; zeros where it has none."""
    own = found.estimates.get((effect, where), {}).get(parameter)
    return (0.0, 0.0) if own is None else (own.estimate, (own.high - own.low) / 2)


def _ur10_size(
    found: Calibrated, base: Calibrated, named: PatchEffect, parameter: str
) -> tuple[float, float, float]:
    """Return the size found beyond that without the effect, and its interval."""
    if named.effect == "transmission_error":
        if named.where not in found.error_tables:
            return 0.0, 0.0, 0.0
        k = int(named.where[1:]) - 1
        angle = found.readings.posture[:, k]
        more = found.error_tables[named.where].at(angle) - base.error_tables[
            named.where
        ].at(angle)
        phase = UR10_ORDER * angle
        ones = np.ones_like(angle)
        a = np.stack([np.sin(phase), np.cos(phase), ones, angle], axis=1)
        x = np.linalg.lstsq(a, more, rcond=None)[0]
        size, half = float(np.hypot(x[0], x[1])), found.harmonics[named.where].half
        return size, size - half, size + half
    value, half = _estimate(found, named.effect, named.where, parameter)
    known = _estimate(base, named.effect, named.where, parameter)[0]
    return value - known, value - half - known, value + half - known


def _displacement(
    readings: Readings, model: Path, named: PatchEffect
) -> Float[np.ndarray, "rows 3"]:
    """Return how an effect moves the target, along the base's axes, in m."""
    short = np.zeros_like(readings.posture)
    if named.effect == "hysteresis":
        k = int(named.where[1:]) - 1
        width = named.parameters["width_rad"]
        assert isinstance(width, float)
        short[:, k] = -width / 2 * readings.moves.side[:, k]
        named = PatchEffect("encoder_offset", named.where, {"offset_rad": 0.0})
    with_it = _points(readings, model, Patch(effects=(named,)), short)
    return with_it - _points(readings, model, Patch(), np.zeros_like(short))


def _points(
    readings: Readings, model: Path, patch: Patch, short: Float[np.ndarray, "rows axes"]
) -> Float[np.ndarray, "rows 3"]:
    rig = rig_of(patch, model)
    count = len(readings.seen)
    still = np.zeros((count, 1, 6))
    states = rig.respond(readings.posture + short, still, np.full((count, 1), 1e-3))
    point = point_in_base(rig, states, "flange", PLACE)[:, None]
    tracker = faulty(Instruments(), rig).tracker
    seconds = (readings.hours - readings.hours.min()) * 3600.0
    return reading_of(tracker, (np.eye(3), np.zeros(3)), point, seconds)[:, 0]
