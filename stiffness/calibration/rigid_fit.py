"""Gauss-Newton fit of the geometry, shrunk towards the drawing.

==========  ==========================================================================
Equation    Gauss-Newton on |observed − predicted|² / s² + |correction / size|², s² the
            mean square left, size one sigma of the drawing; of columns that do the same
            one is kept: a column stays when its component orthogonal to the columns
            before it is visible
Source      Tikhonov 1963 (the prior); Khalil, Gautier, Enguehard 1991, "Identifiable
            parameters and optimum configurations for robots calibration", Robotica 9,
            63 (the choice of columns)
Valid       errors of the geometry that are small beside the arm
Ignores     everything but a rigid arm
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from stiffness.calibration.model import (
    NAMES,
    CalibrationState,
    Entry,
    Geometry,
    Readings,
    entries_of,
)
from stiffness.experiment.outliers import FEW, RARE, far_off
from stiffness.robot.tracker_frame import MARKER_POSITION_SIGMA, kabsch

LEAST = 1e-3
"""Minimum rms of a column's orthogonal component, in m per rad (m per m), and as a
share of the column's size; chosen: a milliradian that moves a target by a micrometre is
beyond a tracker."""
ROUNDS = 6
SWEEPS = 3
"""Fits that look for outliers; chosen: each leaves out what the last found."""
STILL = 1e-9
"""Step in m and rad below which a fit has converged."""


@dataclass(frozen=True)
class RigidFit:
    """Fitted rigid arm, with or without corrections of its geometry.

    Attributes:
        kept: Mask of the identifiable parameters, frame and target positions.
    """

    geometry: Geometry
    kept: Bool[np.ndarray, " silent"]


def fitted(readings: Readings, redraw: bool) -> RigidFit:
    """Fit tracker frame and target positions, and the geometry where asked."""
    count = len(entries_of(readings.arm.chain))
    start = Geometry(np.zeros(count), np.eye(4), readings.places)
    state = CalibrationState.of(readings, start)
    start = replace(start, base_from_tracker=kabsch(readings.seen, state.point))
    start = replace(start, mounts=_mounts(readings, start))
    fit = _fit_until_stable(readings, start, redraw=False)
    return _fit_until_stable(readings, fit.geometry, redraw=True) if redraw else fit


def rigid_outlier_distances(readings: Readings) -> Float[np.ndarray, " rows"]:
    """Return how far outliers are from the fitted rigid arm, in m; 0: none is.

    An outlier is far beyond nearly all readings of its target, and such are rare; the
    arm is fitted again without them, and all are judged once more.
    """
    size = np.zeros(len(readings.seen))
    for _ in range(SWEEPS):
        arm = fitted(readings.take(size == 0.0), redraw=True)
        found = far_from(readings, CalibrationState.of(readings, arm.geometry).residual)
        settled = np.array_equal(found > 0.0, size > 0.0)
        size = found
        if settled:
            break
    return size


def far_from(
    readings: Readings, residual: Float[np.ndarray, "rows coordinates"]
) -> Float[np.ndarray, " rows"]:
    """Return how far outliers are from a fitted arm, in m; 0: none is.

    The residual is what a fit leaves, see `CalibrationState.residual`.
    """
    found = np.zeros(len(residual))
    for part in (residual[:, :3], residual[:, 3:]):  # position, orientation as a length
        away = np.linalg.norm(part, axis=1)
        for m in range(len(readings.names)):
            own = np.flatnonzero(readings.marker == m)
            far = own[far_off(away[own])]
            if len(far) <= max(RARE * len(own), FEW):
                found[far] = np.maximum(found[far], away[far])
    return found


def _fit_until_stable(readings: Readings, start: Geometry, redraw: bool) -> RigidFit:
    """Repeat the fit until the identifiable columns no longer change."""
    count = len(start.values)
    a = _flat(CalibrationState.of(readings, start))
    fit = RigidFit(start, identifiable(a, count, redraw))
    size = prior_sizes(readings)[fit.kept]
    for _ in range(ROUNDS):
        state = CalibrationState.of(readings, fit.geometry)
        a = _flat(state)
        left = state.residual.ravel()
        weight = np.sqrt(np.mean(left**2)) / size  # of the drawing beside a reading
        away = -weight * corrections_of(readings, fit.geometry)[fit.kept]
        step = np.zeros(a.shape[1])
        step[fit.kept] = np.linalg.lstsq(
            np.vstack([a[:, fit.kept], np.diag(weight)]),
            np.concatenate([left, away]),
            rcond=None,
        )[0]
        fit = RigidFit(fit.geometry.stepped(step), fit.kept)
        if np.abs(step).max() < STILL:
            break
    return fit


BLIND = 0.9
"""Share of what is stated to which a number's sigma has to fall to count as seen;
chosen: what readings say is then a fifth of what both say."""
ANYWHERE = 200
"""Postures at random that show what an arm could show."""


def not_seen(readings: Readings, fit: RigidFit) -> tuple[Entry, ...]:
    """Return the numbers of the drawing that other postures show, and these do not.

    Their sigma stays as stated, or another number does nearly the same here.
    """
    entries, count = entries_of(readings.arm.chain), len(fit.geometry.values)
    state = CalibrationState.of(readings, fit.geometry)
    a, size = _flat(state)[:, fit.kept], prior_sizes(readings)[fit.kept]
    known = a.T @ a / np.mean(state.residual**2) + np.diag(1.0 / size**2)
    sigma = np.zeros(len(fit.kept))
    sigma[fit.kept] = np.sqrt(np.diag(np.linalg.inv(known))) / size
    some = readings.take(np.arange(ANYWHERE) % len(readings.posture))
    angles = np.random.default_rng(0).uniform(-np.pi, np.pi, some.posture.shape)
    anywhere = CalibrationState.of(replace(some, posture=angles), fit.geometry)
    could = identifiable(_flat(anywhere), count, redraw=True)
    blind = could & (~fit.kept | (sigma > BLIND))
    return tuple(e for e, unseen in zip(entries, blind, strict=False) if unseen)


def _flat(state: CalibrationState) -> Float[np.ndarray, "n silent"]:
    return state.nuisance_jacobian().reshape(state.residual.size, -1)


def _mounts(
    readings: Readings, start: Geometry
) -> Float[np.ndarray, "markers 3 3"] | None:
    """Return how 6D targets are mounted, as far as the drawn arm and a frame say."""
    turns = readings.orientations
    if turns is None:
        return None
    drawn = readings.arm.at(readings.posture)
    seen = start.base_from_tracker[:3, :3] @ turns.turn
    mounts = np.tile(np.eye(3), (len(readings.bodies), 1, 1))
    for m, body in enumerate(readings.bodies):
        own = (readings.marker == m) & turns.seen
        if own.any() and not turns.stated[m]:
            on_body = drawn.turn(body)[own].swapaxes(1, 2) @ seen[own]
            mounts[m] = Rotation.from_matrix(on_body).mean().as_matrix()
    return mounts


def prior_sizes(readings: Readings) -> Float[np.ndarray, " silent"]:
    """Return one sigma of geometry, frame and target positions before the readings.

    Infinite where nothing is stated: the tracker's frame, targets without a place, and
    the mounts of those in 6D.
    """
    drawing = readings.drawing
    of_kind = {"offset_rad": drawing.offset, "offset_m": drawing.length}
    of_kind |= dict.fromkeys(NAMES[:3], drawing.length)
    of_kind |= dict.fromkeys(NAMES[3:], drawing.angle)
    sizes = [of_kind[e.parameter] for e in entries_of(readings.arm.chain)]
    places = np.where(np.repeat(readings.placed, 3), MARKER_POSITION_SIGMA, np.inf)
    mounts = np.full(_mount_count(readings), np.inf)
    return np.concatenate([sizes, np.full(6, np.inf), places, mounts])


def corrections_of(
    readings: Readings, geometry: Geometry
) -> Float[np.ndarray, " silent"]:
    """Return how far a geometry is from what is stated; 0 where nothing is."""
    moved = np.where(readings.placed[:, None], geometry.places - readings.places, 0.0)
    mounts = np.zeros(_mount_count(readings))
    return np.concatenate([geometry.values, np.zeros(6), moved.ravel(), mounts])


def _mount_count(readings: Readings) -> int:
    return 0 if readings.orientations is None else 3 * len(readings.bodies)


def identifiable(
    a: Float[np.ndarray, "n silent"], entries: int, redraw: bool
) -> Bool[np.ndarray, " silent"]:
    """Return which columns are identifiable: frame and targets first, then geometry."""
    total = a.shape[1]
    order = [*range(entries, total), *(range(entries) if redraw else ())]
    kept = np.zeros(total, dtype=bool)
    gram = a.T @ a
    size = np.sqrt(np.diag(gram))
    chosen: list[int] = []
    for j in order:
        if size[j] == 0.0:
            continue
        own = gram[j, j]
        if chosen:
            block = gram[np.ix_(chosen, chosen)]
            scale = size[chosen]
            inner = np.linalg.lstsq(
                block / np.outer(scale, scale), gram[chosen, j] / scale, rcond=1e-13
            )[0]
            own = gram[j, j] - (gram[chosen, j] / scale) @ inner
        if own > LEAST**2 * max(size[j] ** 2, len(a) / 3.0):
            chosen.append(j)
            kept[j] = True
    return kept
