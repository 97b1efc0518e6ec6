"""Noise of force sensor and encoders, estimated without a load and averaged in visits.

Readings of an unloaded force sensor (`tared`):

==========  ==========================================================================
Equation    w of rows without a load = their mean, along the sensor's axes; a row is
            one where |w - median|^2 in units of the stated noise is below the 99.99 %
            quantile of chi-square with six degrees of freedom
Source      bias from errors in a regressor: Fuller 1987, "Measurement
            Error Models", section 1.1
Valid       sensors whose noise is stated; a tare that stays along the sensor's axes
Ignores     the noise of rows under a load, which is small beside it
==========  ==========================================================================

Noise in the wrench would appear as rotations of axes; without a load it mimics lost
motion: zero rotation at zero torque, and the springs' rotation beyond.

Directions of the wrench that contain noise only (`clear_channels`), since a force at
one point excites three of six channels:

==========  ==========================================================================
Equation    w / sigma = U S V' over all rows; kept are directions with S > sqrt(n) +
            sqrt(6) + 4
Source      singular values of noise in n rows and 6 channels: Davidson, Szarek 2001,
            "Local operator theory, random matrices and Banach spaces", theorem II.13;
            bias from errors in a regressor: Fuller 1987, "Measurement
            Error Models", section 1.1
Valid       sensors whose noise is stated
Ignores     signals that do not exceed the noise, in all rows together
==========  ==========================================================================

Such a direction moves no axis, yet a fit of the readings would respond to it, by the
deflection that the nominal arm has under it.

Encoders at rest (`average_encoders`):

==========  ==========================================================================
Equation    angle of a visit = mean of its rows' readings, sigma_mean = sigma / sqrt(n),
            where the readings' scatter agrees with their stated sigma
Source      definition of a plateau; the mean of repeated readings: JCGM 100:2008, 4.2.3
Valid       hinges of plateaus whose encoders are stated
Ignores     an axis that creeps within its encoder's noise
==========  ==========================================================================
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import chi2

from bench.shared.recording import UNLOADED, Recording, WrenchSpec
from stiffness.experiment.outliers import spread_of_bodies
from stiffness.experiment.visits import held_at_mean
from stiffness.robot.wrench import turned

# --- Tracker whose noise is not stated, or as good as none ----------------------------

ODD = 1.1
"""Noise over the one it was held for from which it is another; chosen: a tenth."""
FINEST = 1e-7
"""Least noise of a coordinate, averaged over its frames, that names are judged against,
in m; chosen: less than trackers resolve, and what lever arms leave out of a turn of
0.4 mrad at a metre, its square's half. Readings without noise would make a finding of
each such rest."""


def with_measured_noise(recording: Recording) -> tuple[Recording, str]:
    """Return a recording whose tracker has a noise, and what is said of it.

    Where none is stated it is that of the distances between marks of one body; where
    no body has three, and of relative readings, the recording's assumption stands.
    """
    tracker = recording.tracker
    if tracker is None or tracker.is_stated or recording.points is None:
        return recording, ""
    text = "the tracker's noise is not stated; "
    sigma = spread_of_bodies(recording)
    if sigma is None:
        assumed = 1e3 * float(np.mean(tracker.repeatability))
        why = "no body has three marks that show it"
        if recording.displacement == "relative":
            why = "relative readings show no distance"
        text += f"{assumed:.3g} mm was assumed: {why}."
        return recording, text
    text += f"distances between marks of one body give {1e3 * sigma:.3g} mm."
    frames = recording.frames
    if frames is not None:  # the tracker's own noise is that of one frame
        sigma *= float(np.sqrt(np.mean(frames)))
    measured = replace(tracker, repeatability=np.full(3, sigma))
    return replace(recording, tracker=measured), text


def measured_noise_text(ratio: float, stated: float, count: int, finest: bool) -> str:
    """Return what is said where marks measure another noise than the tracker's stated.

    Args:
        ratio: Measured noise over the stated one.
        stated: In m.
        count: Number of contrasts that measure it.
        finest: Whether it may be finer still.
    """
    return (
        f"the stated noise cannot be true: readings scatter {ratio:.2f} times as much, "
        f"{1e3 * ratio * stated:.3g} mm{' or less' * finest} ({count} contrasts); the "
        "measured noise was used."
    )


def wrench_noise_text(ratio: float) -> str:
    """Return what is said where the force sensor's stated noise is too large.

    Args:
        ratio: All scatter over what the tracker's measured and the force sensor's
            stated noise make of it together; one: no less.
    """
    if ratio == 1.0:
        return ""
    return (
        "the stated noise of the force sensor cannot be true: readings scatter "
        f"{ratio:.2f} times as much as with it; names are judged against the stated "
        "one. It is `accuracy_n` and `accuracy_nm` of the wrench's sensor."
    )


def no_finer(
    noise: float,
    weight: Float[np.ndarray, "rows markers"],
    inverse: Float[np.ndarray, "3 3"],
) -> float:
    """Return a noise over the stated one by which a reading has `FINEST` at least.

    Args:
        noise: Over the stated one.
        weight: Number of frames of each reading, which its noise averages over; 0 where
            it was not seen.
        inverse: Inverse covariance of one frame's reading, as stated, in 1/m^2.
    """
    stated = np.sqrt(np.trace(np.linalg.inv(inverse)) / 3.0)
    frames = np.median(weight[weight > 0.0]) if np.any(weight > 0.0) else 1.0
    return max(noise, FINEST * float(np.sqrt(frames) / stated))


# --- Force sensor without a load ------------------------------------------------------

FEWEST = 5
"""Minimum number of rows for a tare; chosen."""
ALIKE = 0.9
"""Minimum share of the unloaded rows that agree with it within noise; chosen: a load on
a sensor that should be unloaded changes direction along its axes with the arm."""
BEYOND = 1e-4
"""Probability that noise moves a reading without a load beyond the limit."""


def tared(
    recording: Recording,
    wrench: Float[np.ndarray, "rows 6"],
    axes: Float[np.ndarray, "rows 3 3"],
) -> Float[np.ndarray, "rows 6"]:
    """Return wrenches whose rows without a load are replaced by their mean.

    Args:
        recording: With a sensor whose noise is stated.
        wrench: Along the base's axes, the tool's weight subtracted, in N and N m.
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
"""Margin by which a direction must exceed the mean norm of noise: noise does so once in
3,000 recordings."""


def clear_channels(
    spec: WrenchSpec,
    wrench: Float[np.ndarray, "rows 6"],
    axes: Float[np.ndarray, "rows 3 3"],
) -> Float[np.ndarray, "rows 6"]:
    """Return wrenches without the directions that contain noise only.

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
"""Maximum ratio of scatter to stated sigma for noise of the encoder; chosen: a stated
sigma is seldom more accurate."""


def average_encoders(recording: Recording) -> Recording:
    """Return a recording with angles averaged in visits that scatter by encoder noise.

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
    """Return the standard deviation of a visit's mean angles from encoders, in rad."""
    axes = recording.posture.shape[1]
    if not _noisy(recording):
        return np.zeros(axes)
    visits = len(np.unique(recording.visit))
    sigma = (recording.encoder_repeatability or 0.0) * np.sqrt(
        visits / len(recording.visit)
    )
    return np.where(_slides(recording), 0.0, sigma)


def _noisy(recording: Recording) -> bool:
    """Return whether the stated noise is that of the controller's encoders."""
    stated = recording.encoder_repeatability is not None
    behind = recording.link_posture is not None
    return stated and not behind and recording.rows == "plateaus"


def _slides(recording: Recording) -> Bool[np.ndarray, " axes"]:
    axes = recording.posture.shape[1]
    return np.array(recording.slides or (False,) * axes)
