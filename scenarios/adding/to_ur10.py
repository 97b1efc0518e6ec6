"""What is added to the UR10's target, as MuJoCo moves it, and what is found of it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from bench.experiment import faulty
from bench.instruments import Instruments
from bench.patch import Patch, rig_of
from bench.patch_effects import Named
from bench.proving.laid_out import point_in_base
from bench.proving.sensing import reading_of
from stiffness.calibration.calibrated import Calibrated, calibrated
from stiffness.calibration.readings import Readings
from stiffness.calibration.regions import Regions, regions_of

EVERY, HIGHEST = 2, 129
"""One of so many poses is taken, and tables end at this order; chosen: three times as
quick, and what is added is slower than that."""
PLACE = np.array([0.0, 0.0, 0.093])
ORDER = 11.0
"""Of the wave that is added; chosen: not the largest of what was found."""
ADDED = (
    ("joint_compliance", "a2", "compliance_rad_per_nm", 1e-5, {}),
    ("drift", "base", "z_m_per_h", 3e-6, {}),
    ("bearing_tilt", "a2", "u_rad_per_nm", 4e-5, {}),
    ("bearing_tilt", "a1", "u_rad_per_nm", 1e-6, {}),
    ("hysteresis", "a3", "width_rad", 2e-4, {}),
    ("encoder_offset", "a3", "offset_rad", 5e-4, {}),
    ("transmission_error", "a1", "amplitude_rad", 1.5e-4,
     {"order": ORDER, "phase_rad": 0.5}),
)  # fmt: skip


@dataclass(frozen=True)
class Base:
    """The readings as they are, and what was found in them."""

    readings: Readings
    regions: Regions
    found: Calibrated


def base_of(readings: Readings) -> Base:
    """Calibrate on the readings as they are."""
    part = readings.take(np.arange(0, len(readings.seen), EVERY))
    regions = regions_of(part)
    return Base(part, regions, calibrated(part, regions, highest=HIGHEST))


def rows(base: Base, model: Path) -> Iterator[dict[str, object]]:
    """Yield a row of the table for each effect that is added."""
    for effect, where, parameter, size, more in ADDED:
        named = Named(effect, where, {parameter: size, **more})
        moved = _moved(base.readings, model, named)
        turn = base.found.before.base_from_tracker[:3, :3]
        changed = replace(base.readings, seen=base.readings.seen + moved @ turn)
        found = calibrated(changed, base.regions, highest=HIGHEST)
        value, low, high = _size(found, base.found, named, parameter)
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
    """Return a number and half its interval; none where it was not fitted."""
    own = found.estimates.get((effect, where), {}).get(parameter)
    return (0.0, 0.0) if own is None else (own.value, (own.high - own.low) / 2)


def _size(
    found: Calibrated, base: Calibrated, named: Named, parameter: str
) -> tuple[float, float, float]:
    """Return how much more is found, and its interval."""
    if named.effect == "transmission_error":
        if named.where not in found.tables:
            return 0.0, 0.0, 0.0
        k = int(named.where[1:]) - 1
        angle = found.readings.posture[:, k]
        more = found.tables[named.where].at(angle) - base.tables[named.where].at(angle)
        phase = ORDER * angle
        ones = np.ones_like(angle)
        a = np.stack([np.sin(phase), np.cos(phase), ones, angle], axis=1)
        x = np.linalg.lstsq(a, more, rcond=None)[0]
        size, half = float(np.hypot(x[0], x[1])), found.waves[named.where].half
        return size, size - half, size + half
    value, half = _estimate(found, named.effect, named.where, parameter)
    known = _estimate(base, named.effect, named.where, parameter)[0]
    return value - known, value - half - known, value + half - known


def _moved(
    readings: Readings, model: Path, named: Named
) -> Float[np.ndarray, "rows 3"]:
    """Return how an effect moves the target, along the base's axes, in m."""
    short = np.zeros_like(readings.posture)
    if named.effect == "hysteresis":
        k = int(named.where[1:]) - 1
        width = named.parameters["width_rad"]
        assert isinstance(width, float)
        short[:, k] = -width / 2 * readings.side[:, k]
        named = Named("encoder_offset", named.where, {"offset_rad": 0.0})
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
