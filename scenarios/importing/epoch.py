"""Two logs of one motion show how far apart their clocks were set.

==========  ==========================================================================
Equation    shift = argmax over d of corr(|v_a(t)|, |v_b(t + d)|) where both speak
Source      Knapp & Carter 1976, "The generalized correlation method for estimation of
            time delay"; Pearson's correlation over what overlaps
Valid       clocks that run equally fast; motions and pauses that are not all alike
Ignores     a lag of the instrument itself, which becomes part of the shift
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from scenarios.importing.lag import ALIKE, LONGEST, Lag, lag_between, speed, step_of

RIVAL = 0.9
"""Correlation elsewhere, over the best, from which two shifts fit alike; chosen."""
COMMON = 0.5
"""Share of the motion in either log that both must have seen; chosen."""


def shift_of(
    time_a: Float[np.ndarray, " a"],
    values_a: Float[np.ndarray, "a m"],
    time_b: Float[np.ndarray, " b"],
    values_b: Float[np.ndarray, "b n"],
) -> Lag | str:
    """Return what b's time is ahead of a's, in s, with its interval.

    Args:
        time_a: In s, ascending.
        values_a: One row each.
        time_b: In s, ascending, since another epoch.
        values_b: One row each.

    Returns:
        Why it cannot be told, where it cannot.
    """
    if len(time_a) < 4 or len(time_b) < 4:
        return "there are fewer than four readings"
    first = time_b[0] - time_a[0]
    length = max(time_a[-1] - time_a[0], time_b[-1] - time_b[0])
    step = step_of(time_a, time_b, length)
    a, b = (
        speed(np.arange(t[0], t[-1] + step / 2, step), t, v)
        if t[-1] - t[0] > 2 * step
        else np.zeros(3)
        for t, v in ((time_a, values_a), (time_b, values_b))
    )
    if not (a.std() > 0 and b.std() > 0):
        return "nothing moves in it"
    shifts, match = _matches(a / a.std(), b / b.std())
    best = int(np.argmax(match))
    if match[best] < ALIKE:
        return "it saw no motion that the axes made"
    far = np.abs(shifts - shifts[best]) * step > LONGEST
    other = int(np.argmax(np.where(far, match, -1.0)))
    found = first + shifts[best] * step
    if far.any() and match[other] > RIVAL * match[best]:
        shown = f"{-found:+.1f} s and {-(first + shifts[other] * step):+.1f} s"
        return f"offsets of {shown} fit alike, the motions are too regular"
    lag = lag_between(time_a, values_a, time_b - found, values_b)
    if lag is None:
        return "it saw too little of the axes' motion"
    return Lag(found + lag.seconds, lag.half_width)


def _matches(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return shifts, in steps, and how alike a and the shifted b are, from -1 to 1."""
    size = 2 ** int(np.ceil(np.log2(len(a) + len(b))))
    spectrum = np.conj(np.fft.rfft(a, size)) * np.fft.rfft(b, size)
    shifts = np.arange(1 - len(a), len(b))
    product = np.fft.irfft(spectrum, size)[shifts % size]
    low, high = np.maximum(0, -shifts), np.minimum(len(a), len(b) - shifts)
    count = np.maximum(high - low, 1)

    def total(values: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        sums = np.concatenate([[0.0], np.cumsum(values)])
        return sums[end] - sums[start]

    mean_a, square_a = total(a, low, high) / count, total(a**2, low, high)
    mean_b = total(b, low + shifts, high + shifts) / count
    square_b = total(b**2, low + shifts, high + shifts)
    vary_a, vary_b = square_a - count * mean_a**2, square_b - count * mean_b**2
    size_ab = np.sqrt(np.maximum(vary_a, 1e-9) * np.maximum(vary_b, 1e-9))
    share = np.maximum(square_a / np.sum(a**2), square_b / np.sum(b**2))
    enough = (share >= COMMON) & (size_ab > 1e-3)
    match = (product - count * mean_a * mean_b) / size_ab
    return shifts, np.where(enough, match, -1.0)
