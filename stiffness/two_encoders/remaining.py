"""What is left after everything that was believed is measured, not guessed.

==========  ==========================================================================
Equation    share = 1 − |left − f(x)|² / |left|² of the judged motion, f the mean of
            what is left of the fitted motions by x: angle, torque, speed
Source      binned regression (Tukey 1961), judged on another motion
Valid       motions that pass the same angles, torques and speeds
Ignores     what depends on several of them at once
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from stiffness.two_encoders.motions import Motion

BINS = 20
SHOWS = 0.1
"""Share of what is left below which it goes with nothing; chosen."""


def followed(
    left: Sequence[Float[np.ndarray, " _"]],
    motions: Sequence[Motion],
    judged_left: Float[np.ndarray, " rows"],
    judged: Motion,
) -> dict[str, float]:
    """Return which share of what is left of a motion goes with what, as in others."""
    shares = {}
    for name in ("angle", "torque", "speed"):
        others = [getattr(m, name) for m in motions]
        own = getattr(judged, name)
        if own is None or any(x is None for x in others):
            continue
        shares[name] = _share(
            np.concatenate(others), np.concatenate(list(left)), own, judged_left
        )
    return shares


def lasting(left: Float[np.ndarray, " rows"], motion: Motion) -> float:
    """Return after which time what is left no longer resembles itself, in s."""
    y = left - left.mean()
    spectrum = np.abs(np.fft.rfft(y, 2 * len(y))) ** 2
    alike = np.fft.irfft(spectrum)[: len(y)]
    gone = np.flatnonzero(alike < alike[0] / np.e)
    rows = gone[0] if len(gone) else len(y)
    return float(rows * (motion.time[-1] - motion.time[0]) / (len(y) - 1))


def _share(x: np.ndarray, y: np.ndarray, own: np.ndarray, seen: np.ndarray) -> float:
    edges = np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    place = np.searchsorted(edges, x)
    count = np.bincount(place, minlength=BINS)
    mean = np.bincount(place, y, minlength=BINS) / np.maximum(count, 1)
    seen = seen - seen.mean()
    guess = mean[np.searchsorted(edges, own)]
    rest = seen - (guess - guess.mean())
    return float(1.0 - rest @ rest / max(float(seen @ seen), np.finfo(float).tiny))
