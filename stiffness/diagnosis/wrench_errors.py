"""A wrong wrench feigns a deflection, row by row and visit by visit.

==========  ==========================================================================
Equation    turn_k = c_k J_k' dw;  dw = white noise per row;
            dw = [phi x F; phi x T] + g [F; T] with phi, g per visit
Source      propagation of errors, JCGM 100:2008, 5.2; sizes: the sensor's stated
            accuracy, or 0.3 degrees and 0.5 %, whichever is larger (chosen: what
            mounting and cables do to a careful measurement)
Valid       the fitted springs carry most of the deflection
Ignores     errors that stay the same over the whole recording: these are findings
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.visits import Visits

COMMON = 4
"""Errors that a whole visit shares: three turns of the force and a gain."""
TURN = np.deg2rad(0.3)
GAIN = 0.005


def feigned_turns(
    situation: Situation, visits: Visits
) -> Float[np.ndarray, "visits turns errors"]:
    """Return the turns that one sigma of each error feigns; index order axis, row.

    The first errors belong to the whole visit (three turns of the force and a gain),
    six more to each row.
    """
    recording = situation.recording
    spec = recording.wrench_sensor
    rows, axes = situation.rest.shape
    stays, longest = visits.row.shape
    if recording.wrench is None or spec is None:
        return np.zeros((stays, axes * longest, 1))
    jacobian = situation.arm.at(situation.rest).jacobian(spec.body, spec.position)
    give = jacobian.swapaxes(1, 2) * situation.compliance[:, None]  # (rows, axes, 6)
    force, torque = situation.wrench[:, :3], situation.wrench[:, 3:]
    strongest = max(float(np.max(np.linalg.norm(force, axis=1))), 1e-9)
    turn = max(TURN, spec.accuracy_force / strongest)
    gain = max(GAIN, spec.accuracy_force / strongest)
    whole = np.zeros((rows, 6, COMMON))
    for i in range(3):
        whole[:, :3, i] = turn * np.cross(np.eye(3)[i], force)
        whole[:, 3:, i] = turn * np.cross(np.eye(3)[i], torque)
    whole[:, :, 3] = gain * situation.wrench
    common = visits.gather(give @ whole)  # (visits, longest, axes, 4)
    own = visits.gather(give * spec.sigma)
    errors = np.zeros((stays, axes, longest, COMMON + 6 * longest))
    errors[..., :COMMON] = common.transpose(0, 2, 1, 3)
    for r in range(longest):
        errors[:, :, r, COMMON + 6 * r : COMMON + 6 * r + 6] = own[:, r]
    return errors.reshape(stays, axes * longest, -1)
