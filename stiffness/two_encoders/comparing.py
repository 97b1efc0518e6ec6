"""What is found of several axes is compared on motions that it was not fitted to."""

from collections.abc import Mapping

import numpy as np

from stiffness.two_encoders.fitting import left_out
from stiffness.two_encoders.found import Between
from stiffness.two_encoders.judging import gain_of
from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.noise import noise_of

Axes = Mapping[int, tuple[Motion, ...]]
"""Motions of every axis."""


def gain_between(
    axes: Axes, before: Mapping[int, Between], after: Mapping[int, Between]
) -> tuple[float, float]:
    """Return what is gained over stretches of all axes, and its standard error."""
    squares = [
        both
        for k, m in axes.items()
        for both in zip(_squares(m, before[k]), _squares(m, after[k]), strict=True)
    ]
    return gain_of(*zip(*squares, strict=True))


def left(motions: tuple[Motion, ...], found: Between) -> float:
    """Return the mean square that is left of motions left out, in rad^2."""
    return float(np.mean(np.concatenate(_squares(motions, found))))


def is_quiet(
    motions: tuple[Motion, ...], found: Between, stated: float | None, times: float
) -> bool:
    """Return whether no more is left of an axis than some times its noise."""
    return left(motions, found) <= (times * noise_of(motions, found, stated)) ** 2


def _squares(motions: tuple[Motion, ...], found: Between) -> list[np.ndarray]:
    return left_out(found.terms, [found.then(m) for m in motions])
