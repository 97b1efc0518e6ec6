"""Channels that see one motion are shifted against each other by their lag.

==========  ==========================================================================
Equation    lag = argmax over d of sum |v_a(t)| |v_b(t + d)|, speeds about their means;
            interval: Student's t over the lags of stretches of time
Source      Knapp & Carter 1976, "The generalized correlation method for estimation of
            time delay"
Valid       an arm that starts and stops; a lag below `LONGEST`
Ignores     clocks that drift apart
==========  ==========================================================================
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

LONGEST = 1.0
"""Largest lag looked for, in s; chosen."""
STEPS = 4000
"""Most points of the common clock in a second of lag and in all; chosen for time."""
PARTS = 8
"""Most stretches whose lags are compared; chosen."""
ALIKE = 0.5
"""Correlation of two speeds from which they are of one motion; chosen."""

BETWEEN = 0.05
"""Share of the slower channel's step by which all lags can be wrong alike; chosen: when
motions begin at the same place between readings, trials were wrong by half of it."""


@dataclass(frozen=True)
class Lag:
    """By how much one channel comes after another.

    Attributes:
        seconds: The estimate.
        half_width: Of its 95 % interval, in s; infinite where one stretch alone moves.
    """

    seconds: float
    half_width: float

    def __str__(self) -> str:
        """Say it in ms, with its interval."""
        return f"{1e3 * self.seconds:+.1f} ms ({self.within()})"

    def within(self) -> str:
        """Say how sure it is."""
        if np.isfinite(self.half_width):
            return f"±{1e3 * self.half_width:.1f} ms at 95 %"
        return "too few motions for an interval"


def said(lag: Lag | None) -> str:
    """Say a lag, or that there is none to tell."""
    return "nothing moves enough to tell" if lag is None else str(lag)


def lag_between(
    time_a: Float[np.ndarray, " a"],
    values_a: Float[np.ndarray, "a m"],
    time_b: Float[np.ndarray, " b"],
    values_b: Float[np.ndarray, "b n"],
) -> Lag | None:
    """Return by how much b comes after a, with an interval.

    Args:
        time_a: In s, ascending.
        values_a: One row each.
        time_b: In s, ascending.
        values_b: One row each.

    Returns:
        None where nothing moves that both see.
    """
    whole = lag_of(time_a, values_a, time_b, values_b)
    if whole is None:
        return None
    start, end = max(time_a[0], time_b[0]), min(time_a[-1], time_b[-1])
    edges = _pauses(time_a, values_a, start, end)
    lags = []
    for low, high in pairwise(edges):
        a, b = ((t >= low) & (t <= high) for t in (time_a, time_b))
        lag = lag_of(time_a[a], values_a[a], time_b[b], values_b[b])
        lags += [] if lag is None else [lag]
    if len(lags) < 2:
        return Lag(whole, np.inf)
    error = np.std(lags, ddof=1) / np.sqrt(len(lags))
    wide = student.ppf(0.975, len(lags) - 1) * error
    slow = max(np.median(np.diff(time_a)), np.median(np.diff(time_b)))
    return Lag(whole, float(np.hypot(wide, slow * BETWEEN)))


def _pauses(
    time: np.ndarray, values: np.ndarray, start: float, end: float
) -> np.ndarray:
    """Cut a time into stretches where the least moves, that no motion is cut."""
    parts = min(PARTS, int((end - start) / (3.0 * LONGEST)))
    edges = np.linspace(start, end, parts + 1)
    clock = np.arange(start, end, LONGEST / 20.0)
    moved = speed(clock, time, values)
    moved = np.convolve(moved, np.ones(20), "same")
    for k in range(1, parts):
        near = np.abs(clock - edges[k]) < (end - start) / parts / 2.5
        edges[k] = clock[near][np.argmin(moved[near])]
    return edges


def lag_of(
    time_a: Float[np.ndarray, " a"],
    values_a: Float[np.ndarray, "a m"],
    time_b: Float[np.ndarray, " b"],
    values_b: Float[np.ndarray, "b n"],
) -> float | None:
    """Return by how much b comes after a, in s; None where nothing moves alike."""
    if len(time_a) < 4 or len(time_b) < 4:
        return None
    start, end = max(time_a[0], time_b[0]), min(time_a[-1], time_b[-1])
    if not end - start > 2 * LONGEST:
        return None
    step = step_of(time_a, time_b, end - start)
    clock = np.arange(start, end, step)
    a, b = (speed(clock, t, v) for t, v in ((time_a, values_a), (time_b, values_b)))
    if not (a.std() > 0 and b.std() > 0):
        return None
    size = 2 ** int(np.ceil(np.log2(2 * len(clock))))
    spectrum = np.conj(np.fft.rfft(a - a.mean(), size)) * np.fft.rfft(
        b - b.mean(), size
    )
    match = np.fft.irfft(spectrum, size)
    most = int(LONGEST / step)
    shifts = np.arange(-most, most + 1)
    around = match[shifts % size]
    best = int(np.argmax(around))
    if around[best] < ALIKE * a.std() * b.std() * len(clock):
        return None
    if 0 < best < len(around) - 1:  # the top of a parabola through three points
        low, mid, high = around[best - 1 : best + 2]
        bend = low - 2 * mid + high
        return float(step * (shifts[best] + (0.5 * (low - high) / bend if bend else 0)))
    return float(step * shifts[best])


def step_of(time_a: np.ndarray, time_b: np.ndarray, length: float) -> float:
    """Return the step of a clock for both, in s."""
    step = min(np.median(np.diff(time_a)), np.median(np.diff(time_b)))
    return float(max(step, 1e-3, length / (STEPS * 50)))


def speed(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return how fast values change, at the instants of another clock."""
    columns = np.stack([np.interp(clock, time, v) for v in values.T], axis=1)
    return np.linalg.norm(np.gradient(columns, clock, axis=0), axis=1)
