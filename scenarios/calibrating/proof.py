"""The simulator stands in the poses kept back, as drawn and as calibrated.

Frames are fitted on the other poses, for both. Friction's side is played as what it
does: an axis that stops short of where it was sent, on the side it came from.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from bench.experiment import faulty
from bench.instruments import Instruments
from bench.patch import Patch, rig_of
from bench.proving.channels import Share, explained_share
from bench.proving.laid_out import mounted_on, point_in_base
from bench.proving.sensing import reading_of
from bench.recording import Recording
from scenarios.calibrating.patching import FROM_SIDES, patch_of
from stiffness.calibration.calibrated import Calibrated
from stiffness.calibration.stance import Drawn
from stiffness.frames import kabsch

HOUR = 3600.0
RESAMPLES = 1999
SETTLED = 1e-3
"""How long a plateau stands, in s; nothing creeps here."""
AT_ONCE = 2000
"""Rows that are simulated together."""


@dataclass(frozen=True)
class Proof:
    """What the simulator leaves on the rows kept back.

    Attributes:
        poses: How many were kept back.
        before: Residual as drawn, in m.
        after: Residual as calibrated, in m.
        gain: Rms before less after, in m, and its 95 % interval over regions.
        p_value: Share of draws of regions without any gain; 1: nothing was put in.
        patch: What was put in.
        explained: Share of what noise does not explain; None where there is none.
    """

    poses: int
    before: Float[np.ndarray, "rows 3"]
    after: Float[np.ndarray, "rows 3"]
    gain: tuple[float, float, float]
    p_value: float
    patch: Patch
    explained: Share | None = None


def proved(found: Calibrated, recording: Recording, model: Path) -> Proof:
    """Simulate the arm as drawn and as calibrated on everything that was seen."""
    held = found.held
    carried = mounted_on(recording, rig_of(Patch(), model))
    patch = replace(patch_of(found), mounted=carried)
    nominal = Patch(stiffness_nm_per_rad=dict(found.springs[0]), mounted=carried)
    before = _left(found, model, nominal, found.before, 0.0)[held]
    moving = tuple(e for e in patch.effects if e.effect not in FROM_SIDES)
    after = _left(
        found, model, replace(patch, effects=moving), found.drawn, _arrival(found)
    )[held]
    region = found.regions.region[held]
    poses = len(np.unique(found.readings.pose[held]))
    if not patch.effects:
        return Proof(poses, before, before, (0.0, 0.0, 0.0), 1.0, patch)
    gain, p_value = _gain(before, after, region)
    index = np.unique(region, return_inverse=True)[1]
    count = np.bincount(index).astype(float)
    first, last = (np.bincount(index, np.sum(r**2, axis=1)) for r in (before, after))
    share = explained_share(first, last, found.at_last.noise**2 * count, count)
    return Proof(poses, before, after, gain, p_value, patch, share)


def rms(residual: Float[np.ndarray, "rows 3"]) -> float:
    """Return the root of the mean square of the distance, in m."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


def _left(
    found: Calibrated,
    model: Path,
    patch: Patch,
    drawn: Drawn,
    arrival: Float[np.ndarray, "rows axes"] | float,
) -> Float[np.ndarray, "rows 3"]:
    """Return seen less simulated along the base's axes, in m."""
    readings = found.readings
    rig = rig_of(patch, model)
    order = [rig.anatomy.axes.index(name) for name in readings.arm.axes]
    posture = np.zeros((len(readings.seen), len(rig.anatomy.axes)))
    posture[:, order] = readings.posture + arrival
    point = np.empty_like(readings.seen)
    for start in range(0, len(posture), AT_ONCE):
        rows = np.arange(start, min(start + AT_ONCE, len(posture)))
        still = np.zeros((len(rows), 1, 6))
        states = rig.respond(posture[rows], still, np.full((len(rows), 1), SETTLED))
        for m, body in enumerate(readings.bodies):
            own = readings.marker[rows] == m
            at = point_in_base(rig, states, body, drawn.places[m])
            point[rows[own]] = at[own]
    tracker = faulty(Instruments(), rig).tracker
    eye, none = np.eye(3), np.zeros(3)
    seconds = (readings.hours - readings.hours.min()) * HOUR
    point = reading_of(tracker, (eye, none), point[:, None], seconds)[:, 0]
    return _framed(readings.seen, point, ~found.held)


def _framed(
    seen: Float[np.ndarray, "rows 3"],
    point: Float[np.ndarray, "rows 3"],
    fitted: Bool[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows 3"]:
    frame = kabsch(seen[fitted], point[fitted])
    return seen @ frame[:3, :3].T + frame[:3, 3] - point


def _arrival(found: Calibrated) -> Float[np.ndarray, "rows axes"]:
    short = np.zeros_like(found.readings.posture)
    for (effect, where), numbers in found.estimates.items():
        if effect in FROM_SIDES:
            k = int(where[1:]) - 1
            width = numbers["width_rad"].value
            short[:, k] = -width / 2 * found.readings.side[:, k]
    return short


def _gain(before, after, region) -> tuple[tuple[float, float, float], float]:
    """Return gain, interval and p-value over regions drawn anew, whole ones."""
    names, index = np.unique(region, return_inverse=True)
    count = np.bincount(index)
    squares = [np.bincount(index, np.sum(r**2, axis=1)) for r in (before, after)]
    drawn = np.random.default_rng(0).integers(len(names), size=(RESAMPLES, len(names)))
    size = [np.sqrt(s[drawn].sum(axis=1) / count[drawn].sum(axis=1)) for s in squares]
    gain = size[0] - size[1]
    low, high = np.quantile(gain, [0.025, 0.975])
    p_value = float((1 + np.sum(gain <= 0.0)) / (1 + RESAMPLES))
    return (rms(before) - rms(after), float(low), float(high)), p_value
