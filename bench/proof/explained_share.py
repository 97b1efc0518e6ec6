"""Explained share of each channel, with intervals over poses and the noise floor.

What the instruments' stated noise leaves of a marker (`floor_of`):

==========  ==========================================================================
Equation    var = sum of the tracker's variances per frame (1 - 1/n where the mean over
            n rows of a visit is taken off) + trace(A W A'), A = Σ c_k s_k(p) t_k' how a
            marker answers to the wrench, W the sensor's covariance
Source      propagation of errors to first order
Valid       springs that are nearly linear
Ignores     errors of a whole visit, such as arrival and the force's direction, which
            no instrument here states; what states of gears that nobody knows do to
            encoders and turns of bodies
==========  ==========================================================================

The gain's interval is a bootstrap over poses (BCa: Efron 1987), because readings of one
pose share its errors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Num
from scipy.stats import bootstrap

from bench.proof.comparison import (
    ComparisonMode,
    less_means,
    residual_of,
    turns_of,
)
from bench.proof.nominal_fit import turned_by
from bench.proof.proof_checks import squares
from bench.proof.simulation import (
    STARTS,
    NominalState,
    ReplaySimulation,
    SimulatedReadings,
)
from bench.rig import RIGID
from bench.shared.settings import SETTINGS, Interval

# --- Noise floor ----------------------------------------------------------------------


def floor_of(
    simulation: ReplaySimulation,
    assumed: NominalState,
    seen: SimulatedReadings,
    mode: ComparisonMode,
) -> tuple[Float[np.ndarray, " rows"], float]:
    """Return the mean square that noise leaves on a marker and on an encoder.

    Of the wrench's noise, and of what states of gears do that nobody knows, by the
    patch, as much counts as the rows that were fitted have room for.

    Returns:
        Of a marker in every row, 3-D, in m²; of an angle, in rad².
    """
    recording = simulation.recording
    rows = simulation.replay.rows
    frames = np.ones(rows) if recording.frames is None else recording.frames
    square = np.zeros(rows)
    if recording.tracker is not None:
        square = np.sum(np.asarray(recording.tracker.repeatability) ** 2) / frames
    share = np.ones(rows)
    if not mode.absolute:
        _, counts = np.unique(simulation.replay.visit, return_counts=True)
        share = 1.0 - 1.0 / counts[simulation.replay.visit]
    square = square * share
    gears = _through_the_gears(simulation, assumed, mode)
    square = square + gears * _true_part(simulation, seen, mode, square, gears)
    wrench = _through_the_wrench(simulation, assumed, seen) * share
    square = square + wrench * _true_part(simulation, seen, mode, square, wrench)
    angle = recording.encoder_repeatability or 0.0
    return square, float(np.mean(angle**2 * share))


def _true_part(
    simulation: ReplaySimulation,
    seen: SimulatedReadings,
    mode: ComparisonMode,
    sure: Float[np.ndarray, " rows"],
    more: Float[np.ndarray, " rows"],
) -> float:
    """Return which part of the square of more noise can be true, at most 1.

    What noise that is sure leaves room for of the residual where it was fitted, over
    what more there should be, by a ratio of sums over poses; 1 within two standard
    errors.
    """
    if not more.any():
        return 1.0
    points = 3 * len(simulation.recording.markers)
    left = residual_of(simulation, seen, mode)[mode.keep, :points] ** 2
    read = np.isfinite(left).sum(axis=1) / 3.0
    pose = np.unique(simulation.recording.posture_id[mode.keep], return_inverse=True)[1]
    room = np.bincount(pose, np.nansum(left, axis=1) - read * sure[mode.keep])
    stated = np.bincount(pose, read * more[mode.keep])
    if len(room) < 2 or not stated.any():
        return 1.0
    part = float(room.sum() / stated.sum())
    error = float(np.sqrt(np.sum((room - part * stated) ** 2)) / stated.sum())
    return max(part, 0.0) if part + 2.0 * error < 1.0 else 1.0


def _through_the_wrench(
    simulation: ReplaySimulation, assumed: NominalState, seen: SimulatedReadings
) -> np.ndarray:
    spec = simulation.recording.wrench_sensor
    rows, markers = seen.point.shape[:2]
    if spec is None or simulation.recording.wrench is None or not markers:
        return np.zeros(rows)
    rig, states = assumed.rig, seen.states
    base, turn = simulation.base
    sensor = states.position[:, states.bodies.index("load_point")]
    sensor = (sensor - base) @ turn
    unit = np.ones((rows, len(rig.springs)))
    answer = np.zeros((rows, markers, 3, 6))
    for k in simulation.order:
        if rig.springs[k] >= RIGID:
            continue
        screw = turned_by(simulation, rig, seen, int(k), unit)
        joint = rig.nominal.joint(rig.anatomy.axes[k])
        b = states.bodies.index(rig.anatomy.links[k])
        along = states.rotation[:, b] @ joint.axis @ turn
        at = states.position[:, b] + states.rotation[:, b] @ joint.pos
        lever = sensor - (at - base) @ turn
        if rig.anatomy.slides[k]:
            torque = np.hstack([along, np.zeros_like(along)])
        else:
            torque = np.hstack([np.cross(along, lever), along])
        answer += screw[..., None] * torque[:, None, None] / rig.springs[k]
    return np.mean(np.sum((answer * spec.sigma) ** 2, axis=(2, 3)), axis=1)


def _through_the_gears(
    simulation: ReplaySimulation, assumed: NominalState, mode: ComparisonMode
) -> Float[np.ndarray, " rows"]:
    """Return the mean square that unknown states of gears at arrival make, in m².

    Of a marker, 3-D, about the mean over `STARTS`; gears arrive independently.
    """
    square, untold = np.zeros(simulation.replay.rows), simulation.untold(assumed.rig)
    if not untold:
        return square
    rig, rest = assumed.rig, dict.fromkeys(untold, 0.0)
    told = simulation.states(rig).initial

    def points(start: Mapping[str, float]) -> np.ndarray:
        states = simulation.responded(rig, simulation.begun(rig, told, start))
        return simulation.points(rig, states, assumed.marker_positions)

    at_rest = points(rest)
    for axis in untold:
        every = [points({**rest, axis: s}) if s else at_rest for s in STARTS]
        for moved in every - np.mean(every, axis=0):
            away = less_means(moved, simulation, mode)
            square += np.mean(np.sum(away**2, axis=2), axis=1) / len(STARTS)
    return square


# --- Explained share ------------------------------------------------------------------

RESAMPLES = SETTINGS.resamples


def resampled(
    sums: Num[np.ndarray, "*kinds groups"],
) -> Num[np.ndarray, "*kinds draws"]:
    """Return totals over groups that are drawn anew, `RESAMPLES` times.

    Every call with as many groups draws the same ones, so that totals of several calls
    belong together.
    """
    groups = sums.shape[-1]
    drawn = np.random.default_rng(0).integers(groups, size=(RESAMPLES, groups))
    return sums[..., drawn].sum(axis=-1)


def percentile(estimate: float, draws: Float[np.ndarray, " draws"]) -> Interval:
    """Return an estimate with the percentile interval of its draws."""
    low, high = np.quantile(draws, [0.025, 0.975])
    return Interval(float(estimate), float(low), float(high))


@dataclass(frozen=True)
class Channel:
    """Before and after, over the poses held out.

    Attributes:
        before: Rms without the patch, in m (3-D of a marker) or rad.
        noise: What the stated noise alone would leave.
        gain: Before less after.
        low: Of its 95 % interval (BCa over poses: Efron 1987).
        high: Likewise.
        before_of: Rms of each pose.
        explained: Share of what noise does not explain; None where nothing is left
            beyond the noise that a share could be of.
    """

    before: float
    after: float
    noise: float
    gain: float
    low: float
    high: float
    posture_id: Int[np.ndarray, " poses"]
    before_of: Float[np.ndarray, " poses"]
    after_of: Float[np.ndarray, " poses"]
    explained: Interval | None = None


def explained_share(
    before: Float[np.ndarray, " groups"],
    after: Float[np.ndarray, " groups"],
    noise: Float[np.ndarray, " groups"],
    count: Float[np.ndarray, " groups"],
) -> Interval | None:
    """Return which share of the mismatch a patch explains on what was kept back.

    (before² - after²) / (before² - noise²), a percentile bootstrap over groups (Efron &
    Tibshirani 1993, section 13.3). Groups are poses, regions or stretches of time. Sums
    of squares are in any unit; noise is what it alone would leave, `count` the number
    of readings.

    Returns:
        The share; None where the interval of before² - noise² reaches zero.
    """
    sums = np.stack([before, after, noise]) / count.sum()
    groups = len(count)
    again = resampled(sums)  # the common count of a draw cancels
    mismatch = again[0] - again[2]
    one = sums.sum(axis=1)
    if groups < 2 or np.quantile(mismatch, 0.025) <= 0.0 or one[0] <= one[2]:
        return None
    share = (one[0] - one[1]) / (one[0] - one[2])
    return percentile(share, (again[0] - again[1]) / mismatch)


@dataclass(frozen=True)
class FoldPrediction:
    """Both arms as fitted without some rows, which they are judged on.

    Attributes:
        mode: How readings are compared, with the rows that were fitted.
        held: The rows that are judged.
    """

    nominal: NominalState
    patched: NominalState
    mode: ComparisonMode
    held: Bool[np.ndarray, " rows"]


def channels_of(
    simulation: ReplaySimulation, predictions: Sequence[FoldPrediction]
) -> tuple[Channel | None, Channel | None, Channel | None]:
    """Return what markers, encoders and bodies' turns say on the rows held out.

    All folds count together. No row is held out of two folds.
    """
    if not any(fold.held.any() for fold in predictions):
        return None, None, None
    pieces: tuple[list, list, list] = ([], [], [])
    for fold in predictions:
        held, bare, seen = (
            fold.held,
            simulation.see(fold.nominal),
            simulation.see(fold.patched),
        )
        first, last = (residual_of(simulation, x, fold.mode) for x in (bare, seen))
        turned, quiet_turns = turns_of(simulation, seen, last, fold.mode)
        before = (
            *squares(simulation, first),
            turns_of(simulation, bare, first, fold.mode)[0],
        )
        after = (*squares(simulation, last), turned)
        floor = (*floor_of(simulation, fold.patched, seen, fold.mode), quiet_turns)
        pose = simulation.recording.posture_id[held]
        for own, one, other, noise in zip(pieces, before, after, floor, strict=True):
            each = noise if np.ndim(noise) == 2 else np.reshape(noise, (-1, 1))
            quiet = np.broadcast_to(each, one.shape)
            own.append((one[held], other[held], quiet[held], pose))
    together = [map(np.concatenate, zip(*own, strict=True)) for own in pieces]
    markers, angles, turns = (channel_of(*channel) for channel in together)
    return markers, angles, turns


def channel_of(
    before: Float[np.ndarray, "rows readings"],
    after: Float[np.ndarray, "rows readings"],
    noise: Float[np.ndarray, "rows readings"],
    pose: Int[np.ndarray, " rows"],
) -> Channel | None:
    """Return before and after, with intervals over poses; None where nothing was seen.

    Squares are in m² or rad², NaN where not seen; noise is what the stated noise alone
    would leave.
    """
    good = np.isfinite(before) & np.isfinite(after)
    if not good.any():
        return None
    ids, index = np.unique(pose, return_inverse=True)
    sums = [
        np.bincount(index, np.where(good, values, 0.0).sum(axis=1))
        for values in (before, after, noise, np.ones(good.shape))
    ]
    sums = [s[sums[3] > 0] for s in sums]
    one, other, quiet, count = sums

    def gain(b, a, n, axis=-1):
        total = n.sum(axis=axis)
        return np.sqrt(b.sum(axis=axis) / total) - np.sqrt(a.sum(axis=axis) / total)

    low = high = float(gain(one, other, count))
    if len(count) > 1 and np.any(one != other):
        interval = bootstrap(
            (one, other, count),
            gain,
            paired=True,
            n_resamples=RESAMPLES,
            method="BCa",
            rng=np.random.default_rng(0),
        ).confidence_interval
        low, high = float(interval.low), float(interval.high)
    total = count.sum()
    before_rms, after_rms = (float(np.sqrt(s.sum() / total)) for s in (one, other))
    return Channel(
        before=before_rms,
        after=after_rms,
        noise=float(np.sqrt(quiet.sum() / total)),
        gain=before_rms - after_rms,
        low=low,
        high=high,
        posture_id=ids[np.bincount(index, good.sum(axis=1)) > 0],
        before_of=np.sqrt(one / count),
        after_of=np.sqrt(other / count),
        explained=explained_share(one, other, quiet, count),
    )
