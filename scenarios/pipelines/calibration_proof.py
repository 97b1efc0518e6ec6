"""Proves a calibration on held-out poses in the simulator, and summarises the residual.

`proved` simulates the nominal and the calibrated arm in MuJoCo. For both, the tracker's
frame is fitted on the poses that are not held out. Friction that depends on the side of
approach is played as what it does: an axis that stops short of where it was sent, on
the side it came from. `summarise_residual` tests the calibrated arm's residual on the
held-out poses and states its size and pattern, named or not.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bench.experiment import faulty
from bench.instruments import Instruments
from bench.patch import Patch, rig_of
from bench.proof.explained_share import (
    RESAMPLES,
    explained_share,
    percentile,
    resampled,
)
from bench.proof.setup import for_simulator, model_body, point_in_base
from bench.proof.simulation import reading_of
from bench.shared.recording import Recording
from bench.shared.settings import Interval
from scenarios.pipelines.patching import FROM_SIDES, patch_of_calibration
from scenarios.pipelines.schema import label
from stiffness.calibration.model import CalibrationState, Geometry, Readings
from stiffness.calibration.result import Calibrated, drift_term
from stiffness.calibration.selection import IMPOSSIBLE, MARGIN
from stiffness.regression.testing import SIGNIFICANCE
from stiffness.robot.tracker_frame import kabsch, rotations

# --- Proof on held-out poses ----------------------------------------------------------

HOUR = 3600.0
SETTLED = 1e-3
"""Duration of a simulated plateau, in s; short, since nothing creeps here."""
AT_ONCE = 2000
"""Rows that are simulated in one batch."""


@dataclass(frozen=True)
class CalibrationProof:
    """Residuals of the simulator on the held-out rows, before and after calibration.

    Attributes:
        before: Residual of the nominal arm, along the base's axes, in m.
        after: Residual of the calibrated arm, along the base's axes, in m.
        gain: Rms before less after, in m, and its 95 % interval over regions.
        p_value: Share of resamples of regions without any gain, of position and
            orientation in units of their noise; 1: the patch is empty.
        patch: The calibration as a patch of the simulator.
        explained: Share of the residual beyond noise that the patch explains; None
            where there is none.
        failed: Why the simulator could not do it: residuals are then those of the arm
            that was fitted, and nothing is proved. Empty where it could.
        rotations: The same of the orientation of 6D targets; None without.
        improves: Whether the 95 % interval of that gain, of both, is above zero.
    """

    poses: int
    before: Float[np.ndarray, "rows 3"]
    after: Float[np.ndarray, "rows 3"]
    gain: Interval
    p_value: float
    patch: Patch
    explained: Interval | None = None
    failed: str = ""
    rotations: "TurnProof | None" = None
    improves: bool = False


@dataclass(frozen=True)
class TurnProof:
    """Errors of 6D targets' orientation on the held-out rows that saw it.

    Attributes:
        before: Rotation vectors beside the nominal arm, along the base's axes, in rad.
        after: Beside the calibrated arm.
        gain: Rms before less after, in rad, and its 95 % interval over regions.
    """

    before: Float[np.ndarray, "rows 3"]
    after: Float[np.ndarray, "rows 3"]
    gain: Interval


def proved(found: Calibrated, recording: Recording, model: Path) -> CalibrationProof:
    """Simulate the nominal and the calibrated arm at all poses of a calibration.

    Raises:
        BenchError: Where the simulator cannot.
    """
    patch = for_simulator(recording, patch_of_calibration(found), model)
    springs = Patch(
        stiffness_nm_per_rad={a: k.estimate for a, k in found.springs[0].items()}
    )
    nominal = for_simulator(recording, springs, model)
    before = _residual(found, recording, model, nominal, found.before, 0.0)
    if not patch.effects:
        return _judged(found, patch, before, before)
    moving = tuple(e for e in patch.effects if e.effect not in FROM_SIDES)
    after = _residual(
        found,
        recording,
        model,
        replace(patch, effects=moving),
        found.corrected_geometry,
        _pose_repeatability(found),
    )
    return _judged(found, patch, before, after)


def unproved(found: Calibrated, why: str) -> CalibrationProof:
    """Return what the fitted arm leaves on held-out poses, where nothing is proved."""
    patch, turned = patch_of_calibration(found), found.readings.turned
    first, last = ((r[:, :3], turned(r)) for r in (found.nominal, found.residual))
    judged = _judged(found, patch, first, last)
    return replace(judged, failed=why, explained=None)


def _judged(
    found: Calibrated, patch: Patch, nominal: "_Residual", patched: "_Residual"
) -> CalibrationProof:
    held = found.held
    region = found.spatial_folds.region[held]
    poses = len(np.unique(found.readings.posture_id[held]))
    before, after = nominal[0][held], patched[0][held]
    first, last, turns = before, after, None
    noise = found.turns_at_last
    if nominal[1] is not None and patched[1] is not None and noise is not None:
        turned = nominal[1][held], patched[1][held]
        metres = found.at_last.noise / max(noise.noise, 1e-12)
        first = np.hstack([before, metres * np.nan_to_num(turned[0])])
        last = np.hstack([after, metres * np.nan_to_num(turned[1])])
        seen = np.isfinite(turned[0][:, 0])
        turned = turned[0][seen], turned[1][seen]
        turns = TurnProof(*turned, _gain(*turned, region[seen])[0])
    if not patch.effects:
        none = Interval(0.0, 0.0, 0.0)
        return CalibrationProof(
            poses, before, before, none, 1.0, patch, rotations=turns
        )
    gain, (of_both, p_value) = (
        _gain(before, after, region)[0],
        _gain(first, last, region),
    )
    index = np.unique(region, return_inverse=True)[1]
    count = np.bincount(index).astype(float)
    first, last = (np.bincount(index, np.sum(r**2, axis=1)) for r in (before, after))
    share = explained_share(first, last, found.at_last.noise**2 * count, count)
    return CalibrationProof(
        poses, before, after, gain, p_value, patch, share,
        rotations=turns, improves=of_both.low > 0.0,
    )  # fmt: skip


def rms(residual: Float[np.ndarray, "rows 3"]) -> float:
    """Return the root mean square of the distance, in m."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


_Residual = tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"] | None]


def _residual(
    found: Calibrated,
    recording: Recording,
    model: Path,
    patch: Patch,
    geometry: Geometry,
    pose_repeatability: Float[np.ndarray, "rows axes"] | float,
) -> _Residual:
    """Return observed less simulated positions and orientations, in m and rad.

    Both along the base's axes, the orientation as a rotation vector; None without 6D
    targets.
    """
    readings = found.readings
    rig = rig_of(patch, model)
    order = [rig.anatomy.axes.index(name) for name in readings.arm.axes]
    posture = np.zeros((len(readings.seen), len(rig.anatomy.axes)))
    posture[:, order] = readings.posture + pose_repeatability
    moves = readings.moves.of_axes(np.array(order), posture.shape[1])
    mounts = np.zeros((len(readings.bodies), 0, 3))
    if geometry.mounts is not None:  # three points more, along the target's axes
        mounts = geometry.mounts.swapaxes(1, 2)
    point = np.empty((len(posture), 1 + mounts.shape[1], 3))
    for start in range(0, len(posture), AT_ONCE):
        rows = np.arange(start, min(start + AT_ONCE, len(posture)))
        still = np.zeros((len(rows), 1, 6))
        hold = np.full((len(rows), 1), SETTLED)
        states = rig.respond(posture[rows], still, hold, moves=moves.take(rows))
        for m, name in enumerate(readings.bodies):
            own = readings.marker[rows] == m
            body = model_body(recording, rig, name)
            for i, arm in enumerate([np.zeros(3), *mounts[m]]):
                at = point_in_base(rig, states, body, geometry.places[m] + arm)
                point[rows[own], i] = at[own]
    tracker = faulty(Instruments(), rig).tracker
    eye, none = np.eye(3), np.zeros(3)
    seconds = (readings.hours - readings.hours.min()) * HOUR
    point = reading_of(tracker, (eye, none), point, seconds)
    return _framed(readings, point, ~found.held)


def _framed(
    readings: Readings,
    point: Float[np.ndarray, "rows points 3"],
    fitted: Bool[np.ndarray, " rows"],
) -> _Residual:
    """Return residuals in the frame, and with the mounts, that suit the fitted rows."""
    seen, at, turns = readings.seen, point[:, 0], readings.orientations
    frame = kabsch(seen[fitted], at[fitted])
    left = seen @ frame[:3, :3].T + frame[:3, 3] - at
    if turns is None:
        return left, None
    simulated = rotations(np.eye(3), point[:, 1:] - point[:, :1])
    read = frame[:3, :3] @ turns.turn
    for m, stated in enumerate(turns.stated):
        own = turns.seen & (readings.marker == m)
        if not stated and (own & fitted).any():
            off = simulated[own & fitted].swapaxes(1, 2) @ read[own & fitted]
            simulated[own] @= Rotation.from_matrix(off).mean().as_matrix()
    vector = Rotation.from_matrix(read @ simulated.swapaxes(1, 2)).as_rotvec()
    return left, np.where(turns.seen[:, None], vector, np.nan)


def _pose_repeatability(found: Calibrated) -> Float[np.ndarray, "rows axes"]:
    short = np.zeros_like(found.readings.posture)
    for (effect, where), numbers in found.estimates.items():
        if effect in FROM_SIDES:
            k = int(where[1:]) - 1
            width = numbers["width_rad"].estimate
            short[:, k] = -width / 2 * found.readings.moves.side[:, k]
    return short


def _gain(before, after, region) -> tuple[Interval, float]:
    """Return gain in m, its interval and its p-value by a bootstrap over regions."""
    first, last = (np.sqrt(_resampled_mean_square(r, region)) for r in (before, after))
    gain = first - last
    return percentile(rms(before) - rms(after), gain), _p_value(gain <= 0.0)


def _resampled_mean_square(
    residual: Float[np.ndarray, "rows axes"], region: Int[np.ndarray, " rows"]
) -> Float[np.ndarray, " draws"]:
    """Return the mean square of a residual over regions that are drawn anew."""
    _, index = np.unique(region, return_inverse=True)
    squares = np.bincount(index, np.sum(residual**2, axis=1))
    return resampled(squares) / resampled(np.bincount(index))


def _p_value(against: Bool[np.ndarray, " draws"]) -> float:
    """Return the p-value of a bootstrap whose draws against the claim are true."""
    return float((1 + np.sum(against)) / (1 + RESAMPLES))


# --- Summary of the residual ----------------------------------------------------------

FAR = np.radians(1.0)
"""An angle further than this from every fitted one lies outside an error table, in rad;
chosen: a quarter of the shortest wave that matters."""


@dataclass(frozen=True)
class ResidualSummary:
    """The residual of the calibrated arm on the held-out poses, tested and described.

    Attributes:
        where: The site that it depends on most.
        signature: Its size and pattern, in words.
        p_value: Of its being noise; small where neighbouring poses are correlated or
            where it exceeds the stated noise.
        new_angle: Rows where some axis stands at an angle that was not fitted.
        by_region: Of each held-out region: its number, rms in m, readings, share of new
            angles.
    """

    where: str
    signature: str
    p_value: float
    new_angle: Bool[np.ndarray, " rows"]
    by_region: tuple[tuple[int, float, int, float], ...]


def summarise_residual(found: Calibrated, proof: CalibrationProof) -> ResidualSummary:
    """Test the residual on the held-out poses, and describe it in words."""
    held, readings = found.held, found.readings
    new = _new_angles(found)
    left, region = proof.after, found.spatial_folds.region[held]
    rows = tuple(
        (
            int(r),
            rms(left[region == r]),
            int(np.sum(region == r)),
            float(new[region == r].mean()),
        )
        for r in found.spatial_folds.held
    )
    last = found.at_last
    common = np.sqrt(max(last.share, 0.0)) * last.rms
    words, turned = [], found.turns_at_last
    tests = 1 if turned is None else 2
    if last.p_value < SIGNIFICANCE:
        words.append(
            f"neighbouring poses have {1e6 * common:.1f} µm rms in common and differ "
            f"by {1e6 * last.noise:.1f} µm: smooth in posture, not noise"
        )
    if turned is not None and tests * turned.p_value < SIGNIFICANCE:
        words.append(
            f"orientations of neighbouring poses have "
            f"{1e3 * np.sqrt(max(turned.share, 0.0)) * turned.rms:.3f} mrad rms in "
            f"common and differ by {1e3 * turned.noise:.3f} mrad"
        )
    floor, beyond = _beyond_stated(found, left, region)
    if beyond < SIGNIFICANCE:
        words.append(
            f"{1e6 * rms(left):.1f} µm are left where the stated noise leaves "
            f"{1e6 * floor:.1f} µm: something more, or more noise than is stated"
        )
    if new.any() and not new.all():
        words.append(
            f"{1e6 * rms(left[new]):.1f} µm where an axis stands at an angle that no "
            f"fitted pose had ({100 * new.mean():.0f} % of poses), "
            f"{1e6 * rms(left[~new]):.1f} µm elsewhere"
        )
    odd = [
        s
        for s in found.selected.steps
        if s.verdict == IMPOSSIBLE and s.gain > MARGIN * s.error
    ]
    words += [
        f"{s.key[0]} at {s.key[1]} would help ({s.gain / s.error:.1f} standard errors) "
        f"with a {label(s.parameters[0])} beyond what such a mechanism can have: "
        "not named"
        for s in odd
    ]
    state = CalibrationState.of(readings, found.corrected_geometry)
    if grown := drift_term(state, found.residual):
        words.append(
            f"{100 * grown.share:.0f} % of it grows with time as if {grown.where} "
            "changed its form, which no effect of the list does"
        )
    words = words or ["nothing beyond the noise shows on the poses kept back"]
    where = (
        odd[0].key[1] if odd else _most_significant_axis(found, readings.posture[held])
    )
    where = grown.where if grown else where
    every = [last.p_value, beyond, *([] if turned is None else [turned.p_value])]
    p_value = 0.0 if grown else min(1.0, len(every) * min(every))
    return ResidualSummary(where, "; ".join(words) + ".", p_value, new, rows)


def _beyond_stated(found: Calibrated, residual, region) -> tuple[float, float]:
    """Return the rms that stated noise makes, in m, and the p-value of no more than it.

    The variance of the fitted parameters counts twice: held-out poses lie at the edge.
    """
    if not np.isfinite(found.readings.stated):
        return np.nan, 1.0
    square = 3.0 * found.readings.stated**2 * (1.0 + 2.0 * found.used)
    p_value = _p_value(_resampled_mean_square(residual, region) <= square)
    return float(np.sqrt(square)), p_value


def _new_angles(found: Calibrated) -> Bool[np.ndarray, " rows"]:
    held = found.held
    posture = found.readings.posture
    new = np.zeros(int(held.sum()), dtype=bool)
    for axis in found.error_tables:
        k = int(axis[1:]) - 1
        known = np.sort(posture[~held, k])
        angle = posture[held, k]
        at = np.clip(np.searchsorted(known, angle), 1, len(known) - 1)
        near = np.minimum(np.abs(angle - known[at - 1]), np.abs(angle - known[at]))
        new |= near > FAR
    return new


def _most_significant_axis(
    found: Calibrated, posture: Float[np.ndarray, "rows axes"]
) -> str:
    """Return the axis over whose angle the squared residual varies most."""
    size = np.sum(found.residual[found.held] ** 2, axis=1)
    best, most = "flange", 0.0
    for k in range(posture.shape[1]):
        if np.ptp(posture[:, k]) == 0.0:
            continue
        edge = np.quantile(posture[:, k], np.linspace(0, 1, 13)[1:-1])
        part = np.searchsorted(edge, posture[:, k])
        means = np.array([size[part == b].mean() for b in np.unique(part)])
        if means.std() > most:
            best, most = f"a{k + 1}", float(means.std())
    return best
