"""What a force sensor reads without a load is its own noise, and no load.

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
"""

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from bench.recording import UNLOADED, Recording
from stiffness.wrench import turned

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
