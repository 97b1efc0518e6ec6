"""Gauss-Newton fit of the geometry, restricted to identifiable parameters.

==========  ==========================================================================
Equation    Gauss-Newton on seen − said; a column is kept when what the kept ones before
            it leave of it can be seen
Source      Khalil, Gautier, Enguehard 1991, "Identifiable parameters and optimum
            configurations for robots calibration", Robotica 9, 63
Valid       errors of the drawing that are small beside the arm
Ignores     everything but a rigid arm
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from stiffness.calibration.model import CalibrationState, Geometry, Readings, entries_of
from stiffness.robot.tracker_frame import kabsch

LEAST = 1e-3
"""What a column must have of its own, rms in m per rad (m per m), and as a share of its
size; chosen: a milliradian that moves a target by a micrometre is beyond a tracker."""
ROUNDS = 6
STILL = 1e-9
"""Step in m and rad below which a fit has come to rest."""


@dataclass(frozen=True)
class RigidFit:
    """A rigid arm, its drawing corrected or not.

    Attributes:
        geometry: What the arm is taken to be.
        kept: Which entries, frame and places the data can see on their own.
    """

    geometry: Geometry
    kept: Bool[np.ndarray, " silent"]


def fitted(readings: Readings, redraw: bool) -> RigidFit:
    """Fit frame and places, and the drawing where asked."""
    count = len(entries_of(readings.arm.chain))
    start = Geometry(np.zeros(count), np.eye(4), readings.places)
    stance = CalibrationState.of(readings, start)
    start = Geometry(start.values, kabsch(readings.seen, stance.point), start.places)
    fit = _fit_until_stable(readings, start, redraw=False)
    return _fit_until_stable(readings, fit.geometry, redraw=True) if redraw else fit


def _fit_until_stable(readings: Readings, start: Geometry, redraw: bool) -> RigidFit:
    """Fit what shows from where things stand: a place taken for zero hides links."""
    count = len(start.values)
    a = (
        CalibrationState.of(readings, start)
        .nuisance_jacobian()
        .reshape(3 * len(readings.seen), -1)
    )
    fit = RigidFit(start, identifiable(a, count, redraw))
    for _ in range(ROUNDS):
        stance = CalibrationState.of(readings, fit.geometry)
        a = stance.nuisance_jacobian().reshape(3 * len(readings.seen), -1)
        step = np.zeros(a.shape[1])
        step[fit.kept] = np.linalg.lstsq(
            a[:, fit.kept], stance.residual.ravel(), rcond=None
        )[0]
        fit = RigidFit(fit.geometry.stepped(step), fit.kept)
        if np.abs(step).max() < STILL:
            break
    return fit


def identifiable(
    a: Float[np.ndarray, "n silent"], entries: int, redraw: bool
) -> Bool[np.ndarray, " silent"]:
    """Return which columns show: frame and places first, then the drawing in order."""
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
