"""A controller brings each axis back nearly, never exactly, to where it was.

==========  ==========================================================================
Equation    sigma_k^2 = spread of the visits' own angles of axis k (robust), less their
            estimation error; angles q_v = (A'A)^-1 A'r of each visit after a smooth
            trend over posture, torque and time; at most sigma / lever of the data
            sheet, and what the encoders' stated noise leaves of a mean angle
Source      method of moments for a variance component; ISO 9283 for repeatability;
            0.02 mm at the flange as three sigma (Wu et al. 2024, section 3.1)
Valid       visits that err independently
Ignores     that an axis returns better from one side
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.steady import left_of_encoders

AT_FLANGE = 0.02e-3 / 3
"""One sigma at the flange where nothing is stated, in m; a 10 kg arm's data sheet."""
SHORTEST_LEVER = 0.1
"""In m; chosen: a wrist's own size, for axes that go through the flange."""


def largest_arrival(situation: Situation) -> Float[np.ndarray, " axes"]:
    """Return the most by which a repeatable axis seems to miss its angle, in rad."""
    tip = situation.arm.at(situation.rest).point("flange", np.zeros(3))
    arm = tip[:, None] - situation.origin[:, 1:]
    along = situation.frame[:, 1:, :, 2]
    lever = np.sqrt(np.mean(np.sum(np.cross(along, arm) ** 2, axis=2), axis=0))
    returned = AT_FLANGE / np.maximum(lever, SHORTEST_LEVER)
    return np.hypot(returned, left_of_encoders(situation.recording))


def arrival_of(
    white: Float[np.ndarray, "visits n"],
    lever: Float[np.ndarray, "visits n axes"],
    trend: Float[np.ndarray, "visits terms"],
    largest: Float[np.ndarray, " axes"],
) -> Float[np.ndarray, " axes"]:
    """Estimate how well axes return, one sigma in rad.

    Args:
        white: Whitened mean residuals, without arrival in their covariance.
        lever: Whitened columns of a turn of each axis.
        trend: Smooth functions that effects, but not arrivals, may follow.
        largest: What must not be exceeded.
    """
    information = lever.swapaxes(1, 2) @ lever
    information += np.eye(information.shape[1]) * (0.1 / largest) ** 2
    inverse = np.linalg.inv(information)
    angle = np.einsum("vij,vnj,vn->vi", inverse, lever, white)
    variance = np.median(np.diagonal(inverse, axis1=1, axis2=2), axis=0)
    fit, *_ = np.linalg.lstsq(trend, angle, rcond=None)
    left = angle - trend @ fit
    freedom = max(1, len(left) - np.linalg.matrix_rank(trend))
    spread = (1.4826 * np.median(np.abs(left), axis=0)) ** 2 * len(left) / freedom
    return np.minimum(np.sqrt(np.maximum(spread - variance, 0.0)), largest)


def trend_of(
    posture: Float[np.ndarray, "visits axes"],
    torque: Float[np.ndarray, "visits axes"],
    time: Float[np.ndarray, " visits"],
) -> Float[np.ndarray, "visits terms"]:
    """Return smooth functions of posture, torque and time, of size one."""
    terms = [np.ones((len(time), 1)), np.sin(posture), np.cos(posture), torque]
    stacked = np.column_stack([*terms, time])
    scale = np.max(np.abs(stacked), axis=0)
    stacked = stacked[:, scale > 0] / scale[scale > 0]
    return stacked[:, : max(1, len(time) // 4)]
