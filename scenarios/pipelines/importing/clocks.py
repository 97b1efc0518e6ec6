"""Clocks of several channels: lags, offsets, and interpolation onto one clock.

Between two readings that are near in time the value lies on the line between them;
farther apart, nobody knows.

Channels that see one motion are shifted against each other by their lag (`lag_of`):

==========  ==========================================================================
Equation    lag = argmax over d of sum |v_a(t)| |v_b(t + d)|, speeds about their means;
            interval: Student's t over the lags of stretches of time
Source      Knapp & Carter 1976, "The generalized correlation method for estimation of
            time delay"
Valid       an arm that starts and stops; a lag below `LONGEST`
Ignores     clocks that drift apart
==========  ==========================================================================

Two logs of one motion show how far apart their clocks were set (`shift_of`):

==========  ==========================================================================
Equation    shift = argmax over d of corr(|v_a(t)|, |v_b(t + d)|) where both vary
Source      Knapp & Carter 1976, "The generalized correlation method for estimation of
            time delay"; Pearson's correlation over what overlaps
Valid       clocks that run equally fast; motions and pauses that are not all alike
Ignores     a lag of the instrument itself, which becomes part of the shift
==========  ==========================================================================
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import sem
from scipy.stats import t as student

from bench.shared.recording import Recording

# --- Interpolation onto one clock -----------------------------------------------------

GAP = 0.5
"""Longest time between two readings that is bridged, in s, unless said; chosen: an arm
that stops in between has moved by millimetres."""


@dataclass(frozen=True)
class Channel:
    """What one instrument said.

    Attributes:
        time: Of each reading by its own clock, in s, ascending.
        values: One row each; NaN where nothing was seen.
    """

    time: Float[np.ndarray, " readings"]
    values: Float[np.ndarray, "readings columns"]

    def at(self, time: Float[np.ndarray, " rows"]) -> Float[np.ndarray, "rows columns"]:
        """Return the values at other instants, the nearest beyond both ends."""
        columns = [np.interp(time, self.time, v) for v in self.values.T]
        return np.array(columns).reshape(-1, len(time)).T

    def covers(
        self, time: Float[np.ndarray, " rows"], gap: float
    ) -> Bool[np.ndarray, " rows"]:
        """Say which instants lie between readings no farther apart than a gap."""
        after = np.searchsorted(self.time, time)
        before = np.searchsorted(self.time, time, side="right") - 1
        inside = (before >= 0) & (after < len(self.time))
        last = len(self.time) - 1
        apart = self.time[np.minimum(after, last)] - self.time[np.maximum(before, 0)]
        return inside & (apart <= gap)


def rows_of(
    time: Float[np.ndarray, " rows"], stamps: Sequence[np.ndarray]
) -> Int[np.ndarray, " kept"]:
    """Return the rows that are nearest to the readings of the slowest instrument.

    More rows would count one reading more than once, as if its noise were new. Stamps
    say when each instrument read, by the rows' ascending clock; none: all rows.
    """
    if not stamps or len(time) < 2:
        return np.arange(len(time))
    slowest = min(stamps, key=len)
    after = np.clip(np.searchsorted(time, slowest), 1, len(time) - 1)
    early = slowest - time[after - 1] <= time[after] - slowest
    return np.unique(np.where(early, after - 1, after))


def on_one_side(
    quaternions: Float[np.ndarray, "readings _"],
) -> Float[np.ndarray, "readings _"]:
    """Return the same turns without jumps between q and -q."""
    seen = np.isfinite(quaternions).all(axis=1)
    turns, known = quaternions.copy(), quaternions[seen]
    along = np.sum(known[1:] * known[:-1], axis=1)
    sign = np.concatenate([np.ones(min(1, len(known))), np.where(along < 0, -1.0, 1.0)])
    turns[seen] = known * np.cumprod(sign)[: len(known), None]
    return turns


# --- Lags -----------------------------------------------------------------------------

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


def lag_text(lag: Lag | None) -> str:
    """Say a lag, or that there is none to tell."""
    return "nothing moves enough to tell" if lag is None else str(lag)


def lag_between(
    time_a: Float[np.ndarray, " a"],
    values_a: Float[np.ndarray, "a m"],
    time_b: Float[np.ndarray, " b"],
    values_b: Float[np.ndarray, "b n"],
) -> Lag | None:
    """Return by how much b comes after a, with an interval, on ascending times in s.

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
    wide = student.ppf(0.975, len(lags) - 1) * sem(lags)
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


# --- Clock offsets --------------------------------------------------------------------

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

    Times are in s, ascending, b's since another epoch.

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


def stream_lags(stream: Recording) -> Iterator[tuple[str, Lag | None]]:
    """Estimate how much the tracker and the wrench lag the axes."""
    time, points = stream.time, stream.points
    if points is not None:
        for m, marker in enumerate(stream.markers):
            seen = np.isfinite(points[:, m]).all(axis=1)
            if seen.sum() > 3:
                lag = lag_between(time, stream.posture, time[seen], points[seen, m])
                yield f"marker {marker.name}", lag
    if stream.wrench is not None:
        lag = lag_between(time, stream.posture, time, stream.wrench[:, :3])
        yield "the wrench", lag
