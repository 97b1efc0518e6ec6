"""An axis shows only what its springs, its torques and its turns let it show."""

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.situation import Situation

ORDERS = np.array([1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0])
"""Periods per turn that are tried; chosen: postures of a bench, a radian or two apart,
cannot tell the hundreds of periods of a gear's teeth from chance."""
LEAST_PHASE = 1.0
"""How far a periodic law must go through its period to be one, in rad; chosen."""
LEAST_REVERSAL = 0.01
"""Torque of the weaker sign over the largest, from which on it counts; chosen."""


def sprung(situation: Situation) -> tuple[str, ...]:
    """Return the axes with a spring that is fitted silently."""
    soft = situation.compliance > 0.0
    return tuple(a for a, s in zip(situation.axes, soft, strict=True) if s)


def reversing(situation: Situation) -> tuple[str, ...]:
    """Return the axes whose torque comes with either sign."""
    high, low = situation.torque.max(axis=0), situation.torque.min(axis=0)
    both = np.minimum(high, -low) > LEAST_REVERSAL * np.maximum(high, -low)
    return tuple(a for a, b in zip(situation.axes, both, strict=True) if b)


def orders(situation: Situation, axis: int) -> Float[np.ndarray, " orders"]:
    """Return the periods per turn that an axis' postures go through far enough.

    None for a slide, which has no turn.
    """
    if situation.arm.slides[axis]:
        return ORDERS[:0]
    span = np.ptp(situation.recording.posture[:, axis])
    return ORDERS[ORDERS * span >= LEAST_PHASE]


def still(situation: Situation, axis: int) -> bool:
    """Return whether a hinge hardly turns, so that a law of its angle has one value."""
    return not situation.arm.slides[axis] and not len(orders(situation, axis))


def middle_angle(situation: Situation, axis: int) -> float:
    """Return the mean reported angle of an axis, in rad."""
    return float(np.mean(situation.recording.posture[:, axis]))


def absolute(situation: Situation) -> bool:
    """Return whether what stays the same throughout a visit can be seen."""
    return situation.recording.displacement == "absolute"
