"""Within a visit the arm stays where it is: what its encoders read besides is noise.

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

from bench.recording import Recording
from stiffness.diagnosis.visits import held_at_mean

NEARLY = 1.5
"""Scatter over the stated sigma up to which it is the encoder's; chosen: a stated sigma
is seldom truer."""


def steadied(recording: Recording) -> Recording:
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
