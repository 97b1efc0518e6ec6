"""Noise of force sensor and encoders, estimated without a load and averaged in visits.

What a force sensor reads without a load is its own noise, and no load.

==========  ==========================================================================
Equation    w of rows without a load = their mean, along the sensor's axes; a row is
            one where |w - median|^2 in units of the stated noise is below the 99.99 %
            quantile of chi-square with six degrees of freedom
Source      a regressor that errs leans on its own error: Fuller 1987, "Measurement
            Error Models", section 1.1
Valid       sensors whose noise is stated; a tare that stays along the sensor's axes
Ignores     the noise of rows under a load, which is small beside it
==========  ==========================================================================

An arm does not turn by what noise feigns. Where nothing pulls, that looks like a gear
with play: no turn about no torque, and the springs' beyond.

A pull at one point is three numbers; what six channels say beyond them is noise.

==========  ==========================================================================
Equation    w / sigma = U S V' over all rows; kept are directions with S > sqrt(n) +
            sqrt(6) + 4
Source      what noise alone leaves of n rows and 6 channels: Davidson, Szarek 2001,
            "Local operator theory, random matrices and Banach spaces", theorem II.13;
            a regressor that errs leans on its own error: Fuller 1987, "Measurement
            Error Models", section 1.1
Valid       sensors whose noise is stated
Ignores     what is said no louder than the noise, in all rows together
==========  ==========================================================================

A direction that is noise alone moves no axis, and yet the readings answer to it: by
just what the nominal arm was thought to do under it.

Within a visit the arm stays where it is: what its encoders read besides is noise.

==========  ==========================================================================
Equation    angle of a visit = mean of its rows' readings, sigma_mean = sigma / sqrt(n),
            where readings scatter by no more than their stated sigma lets them
Source      definition of a plateau; the mean of repeated readings: JCGM 100:2008, 4.2.3
Valid       hinges of plateaus whose encoders are stated
Ignores     an axis that creeps within its encoder's noise
==========  ==========================================================================
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import chi2

from bench.shared.instrument_specs import WrenchSpec
from bench.shared.recording import UNLOADED, Recording
from stiffness.experiment.visits import held_at_mean
from stiffness.robot.wrench import turned

# --- Force sensor without a load ------------------------------------------------------

FEWEST = 5
"""Rows that make a tare; chosen."""
ALIKE = 0.9
"""Share of the unloaded rows that must read it within the noise, or it is none; chosen:
what hangs on an unloaded sensor turns along its axes with the arm."""
BEYOND = 1e-4
"""Share of a sensor's readings without a load that its noise takes further."""


def tared(
    recording: Recording,
    wrench: Float[np.ndarray, "rows 6"],
    axes: Float[np.ndarray, "rows 3 3"],
) -> Float[np.ndarray, "rows 6"]:
    """Return wrenches, noise taken from rows without a load.

    Args:
        recording: With a sensor whose noise is stated.
        wrench: Along the base's axes, the tool's weight taken off, in N and N m.
        axes: The sensor's own, as columns.
    """
    spec, rest = recording.wrench_sensor, recording.stage == UNLOADED
    if spec is None or rest.sum() < FEWEST:
        return wrench
    noise = spec.sigma
    if not np.all(noise > 0.0):
        return wrench
    own = turned(wrench, axes.swapaxes(1, 2))
    away = np.sum(((own - np.median(own[rest], axis=0)) / noise) ** 2, axis=1)
    idle = away < chi2.isf(BEYOND, wrench.shape[1])
    if np.mean(idle[rest]) < ALIKE:
        return wrench
    own[idle] = own[idle].mean(axis=0)
    return np.where(idle[:, None], turned(own, axes), wrench)


# --- Noise subspace of the force sensor -----------------------------------------------

LOUDER = 4.0
"""By how much a direction must be longer than noise is on average: noise is so once in
3,000 recordings."""


def clear_channels(
    spec: WrenchSpec,
    wrench: Float[np.ndarray, "rows 6"],
    axes: Float[np.ndarray, "rows 3 3"],
) -> Float[np.ndarray, "rows 6"]:
    """Return wrenches without the directions along which a sensor reads noise alone.

    Args:
        spec: Its stated noise.
        wrench: Along the base's axes, in N and N m.
        axes: The sensor's own, as columns.
    """
    noise = spec.sigma
    rows, channels = wrench.shape
    if rows < channels or not np.all(noise > 0.0):
        return wrench
    own = turned(wrench, axes.swapaxes(1, 2)) / noise
    left, size, right = np.linalg.svd(own, full_matrices=False)
    clear = size > np.sqrt(rows) + np.sqrt(channels) + LOUDER
    return turned((left[:, clear] * size[clear]) @ right[clear] * noise, axes)


# --- Encoders within a visit ----------------------------------------------------------

NEARLY = 1.5
"""Scatter over the stated sigma up to which it is the encoder's; chosen: a stated sigma
is seldom truer."""


def average_encoders(recording: Recording) -> Recording:
    """Return a recording in which axes stand still where only their encoders differ.

    Args:
        recording: With angles that a controller reported, row by row.
    """
    if not _noisy(recording):
        return recording
    posture = recording.posture
    mean = held_at_mean(recording.visit, posture)
    freedom = max(len(posture) - len(np.unique(recording.visit)), 1)
    scatter = np.sqrt(np.sum((posture - mean) ** 2, axis=0) / freedom)
    sigma = recording.encoder_repeatability or 0.0
    still = (scatter <= NEARLY * sigma) & ~_slides(recording)
    return replace(recording, posture=np.where(still, mean, posture))


def left_of_encoders(recording: Recording) -> Float[np.ndarray, " axes"]:
    """Return one sigma of a visit's mean angles by their encoders, in rad."""
    axes = recording.posture.shape[1]
    if not _noisy(recording):
        return np.zeros(axes)
    visits = len(np.unique(recording.visit))
    sigma = (recording.encoder_repeatability or 0.0) * np.sqrt(
        visits / len(recording.visit)
    )
    return np.where(_slides(recording), 0.0, sigma)


def _noisy(recording: Recording) -> bool:
    """Return whether it is the controller's encoders whose noise is stated."""
    stated = recording.encoder_repeatability is not None
    behind = recording.link_posture is not None
    return stated and not behind and recording.rows == "plateaus"


def _slides(recording: Recording) -> Bool[np.ndarray, " axes"]:
    axes = recording.posture.shape[1]
    return np.array(recording.slides or (False,) * axes)
