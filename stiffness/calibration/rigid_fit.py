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

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from stiffness.calibration.model import (
    CalibrationState,
    Geometry,
    Readings,
    corrections_of,
    entries_of,
    prior_sizes,
)
from stiffness.experiment.outliers import FEW, RARE, far_off
from stiffness.robot.tracker_frame import kabsch

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
        geometry: The fitted parameters.
        kept: Mask of the identifiable parameters, frame and target positions.
    """

    geometry: Geometry
    kept: Bool[np.ndarray, " silent"]


def fitted(readings: Readings, redraw: bool) -> RigidFit:
    """Fit tracker frame and target positions, and the geometry where asked."""
    count = len(entries_of(readings.arm.chain))
    start = Geometry(np.zeros(count), np.eye(4), readings.places)
    stance = CalibrationState.of(readings, start)
    start = Geometry(start.values, kabsch(readings.seen, stance.point), start.places)
    fit = _fit_until_stable(readings, start, redraw=False)
    return _fit_until_stable(readings, fit.geometry, redraw=True) if redraw else fit


def outlier_distances(readings: Readings) -> Float[np.ndarray, " rows"]:
    """Return how far outliers are from the fitted rigid arm, in m; 0: none is.

    An outlier is far beyond nearly all readings of its target, and such are rare; the
    arm is fitted again without them, and all are judged once more.
    """
    size = np.zeros(len(readings.seen))
    for _ in range(SWEEPS):
        arm = fitted(readings.take(size == 0.0), redraw=True)
        left = CalibrationState.of(readings, arm.geometry).residual
        away, found = np.linalg.norm(left, axis=1), np.zeros_like(size)
        for m in range(len(readings.names)):
            own = np.flatnonzero(readings.marker == m)
            far = own[far_off(away[own])]
            if len(far) <= max(RARE * len(own), FEW):
                found[far] = away[far]
        settled = np.array_equal(found > 0.0, size > 0.0)
        size = found
        if settled:
            break
    return size


def _fit_until_stable(readings: Readings, start: Geometry, redraw: bool) -> RigidFit:
    """Repeat the fit until the identifiable columns no longer change."""
    count = len(start.values)
    a = (
        CalibrationState.of(readings, start)
        .nuisance_jacobian()
        .reshape(3 * len(readings.seen), -1)
    )
    fit = RigidFit(start, identifiable(a, count, redraw))
    size = prior_sizes(readings)[fit.kept]
    for _ in range(ROUNDS):
        stance = CalibrationState.of(readings, fit.geometry)
        a = stance.nuisance_jacobian().reshape(3 * len(readings.seen), -1)
        left = stance.residual.ravel()
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
