"""Friction inside a gear slips once its torque has turned round far enough.

==========  ==========================================================================
Equation    wind-up = C τ - w/2 z; z in -1 … 1, |dz| = |dτ| / slip until it slips
Source      Visintin 1994, "Differential Models of Hysteresis", chapter III (stop);
            several add up (Iwan 1966)
Valid       slow loads; rate-independent
Ignores     where the contact stood when a motion began: taken as slack
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float


def stop(torque: Float[np.ndarray, " rows"], slip: float) -> Float[np.ndarray, " rows"]:
    """Return the stop operator of a torque, in -1 … 1.

    Args:
        torque: Of one motion, in the order of time, in N m.
        slip: Torque from the middle to where it slips, in N m.
    """
    state, found = 0.0, []
    for change in np.diff(torque, prepend=torque[0]).tolist():
        state = min(slip, max(-slip, state + change))
        found.append(state)
    return np.array(found) / slip
