"""Channels that see one motion are shifted against each other by their lag.

==========  ==========================================================================
Equation    lag = argmax over d of sum |v_a(t)| |v_b(t + d)|, speeds about their means
Source      Knapp & Carter 1976, "The generalized correlation method for estimation of
            time delay"
Valid       an arm that starts and stops; a lag below `LONGEST`
Ignores     clocks that drift apart
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

LONGEST = 1.0
"""Largest lag looked for, in s; chosen."""
STEPS = 4000
"""Most points of the common clock in a second of lag and in all; chosen for time."""


def lag_of(
    time_a: Float[np.ndarray, " a"],
    values_a: Float[np.ndarray, "a m"],
    time_b: Float[np.ndarray, " b"],
    values_b: Float[np.ndarray, "b n"],
) -> float | None:
    """Return by how much b comes after a, in s; None where nothing moves."""
    start, end = max(time_a[0], time_b[0]), min(time_a[-1], time_b[-1])
    if len(time_a) < 4 or len(time_b) < 4 or not end - start > 2 * LONGEST:
        return None
    step = max(min(np.median(np.diff(time_a)), np.median(np.diff(time_b))), 1e-3)
    step = max(step, (end - start) / (STEPS * 50))
    clock = np.arange(start, end, step)
    a, b = (_speed(clock, t, v) for t, v in ((time_a, values_a), (time_b, values_b)))
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
    if 0 < best < len(around) - 1:  # the top of a parabola through three points
        low, mid, high = around[best - 1 : best + 2]
        bend = low - 2 * mid + high
        return float(step * (shifts[best] + (0.5 * (low - high) / bend if bend else 0)))
    return float(step * shifts[best])


def _speed(clock: np.ndarray, time: np.ndarray, values: np.ndarray) -> np.ndarray:
    columns = np.stack([np.interp(clock, time, v) for v in values.T], axis=1)
    return np.linalg.norm(np.gradient(columns, clock, axis=0), axis=1)
