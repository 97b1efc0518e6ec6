"""An uneven gear's waves are looked for at every order that an axis' travel can hold.

==========  ==========================================================================
Equation    gain of an order = |A' y|² / |A|², A the wave where it is not made of what
            is known already, y what is left; for waves that pass many times also in
            differences from row to row, where what is slow plays no part
Source      Lomb 1976 (periodogram of uneven samples)
Valid       orders in half steps
Ignores     angles between 2^17 places a double turn: 0.05 rad of the fastest wave
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Complex, Float

from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.terms import Term, wave

ORDER_STEP = 0.5
ORDERS = np.arange(1.0, 1025.0, ORDER_STEP)
"""Waves per turn of the axis that are looked for; chosen: four times a gear of 256."""
FEWEST_TURNS = 0.125
"""Periods of a wave that every motion must pass through; chosen: less is a line."""
MANY_TURNS = 1.0
"""Periods from which a wave is looked for in differences from row to row."""
PLACES = 2**17


def turns_of(term: Term, motions: tuple[Motion, ...]) -> float:
    """Return how many periods of a wave every motion passes through."""
    travel = min(float(np.ptp(m.angle)) for m in motions)
    return term.order * travel / (2.0 * np.pi)


def strongest_waves(
    motions: tuple[Motion, ...],
    left: tuple[Float[np.ndarray, " _"], ...],
    known: tuple[Float[np.ndarray, "_ columns"], ...],
) -> tuple[Term, ...]:
    """Return, of each octave, the waves that take most off what is left.

    Args:
        motions: Of one axis.
        left: Of each motion, in rad.
        known: Columns of what was believed, of each motion.
    """
    turns = ORDERS * turns_of(wave(1.0), motions)
    slow = turns < MANY_TURNS
    gains = np.where(
        slow, _in_levels(motions, left, known), _in_differences(motions, left)
    )
    gains[turns < FEWEST_TURNS] = -np.inf
    octave = np.floor(np.log2(ORDERS)).astype(int) + 100 * slow
    best = [own[np.argmax(gains[own])] for own in _groups(octave)]
    return tuple(wave(float(ORDERS[i])) for i in sorted(best) if gains[i] > 0.0)


def _groups(number: np.ndarray) -> list[np.ndarray]:
    return [np.flatnonzero(number == n) for n in np.unique(number)]


def _in_levels(
    motions: tuple[Motion, ...],
    left: tuple[np.ndarray, ...],
    known: tuple[np.ndarray, ...],
) -> Float[np.ndarray, " orders"]:
    """Return the gain of each order beside what is known."""
    count = known[0].shape[1]
    aim = np.zeros((len(ORDERS), 2))
    gram = np.zeros((len(ORDERS), 2, 2))
    across = np.zeros((len(ORDERS), 2, count))
    within = np.zeros((count, count))
    for m, y, a in zip(motions, left, known, strict=True):
        rows = len(y)
        aim += _pair(_sums(m.angle, y))
        within += a.T @ a
        for k in range(count):
            across[:, :, k] += _pair(_sums(m.angle, a[:, k]))
        mean = _pair(_sums(m.angle, np.ones(rows)))
        double = _pair(_sums(2.0 * m.angle, np.ones(rows)))
        gram[:, 0, 0] += 0.5 * (rows + double[:, 0]) - mean[:, 0] ** 2 / rows
        gram[:, 1, 1] += 0.5 * (rows - double[:, 0]) - mean[:, 1] ** 2 / rows
        gram[:, 0, 1] += 0.5 * double[:, 1] - mean[:, 0] * mean[:, 1] / rows
    gram[:, 1, 0] = gram[:, 0, 1]
    own = np.trace(gram, axis1=1, axis2=2)
    if count:
        gram = gram - across @ np.linalg.pinv(within) @ across.transpose(0, 2, 1)
    gram = gram + 1e-9 * own[:, None, None] * np.eye(2)  # what only repeats the known
    return np.einsum("oi,oi->o", aim, np.linalg.solve(gram, aim[:, :, None])[:, :, 0])


def _in_differences(
    motions: tuple[Motion, ...], left: tuple[np.ndarray, ...]
) -> Float[np.ndarray, " orders"]:
    """Return the gain of each order in differences from row to row."""
    aim = np.zeros((len(ORDERS), 2))
    size = np.zeros(len(ORDERS))
    for m, y in zip(motions, left, strict=True):
        step = np.diff(y)
        aim += _pair(_sums(m.angle, -np.diff(step, prepend=0.0, append=0.0)))
        still = _sums(np.diff(m.angle), np.ones(len(step)))
        size += len(step) - np.real(still)
    return (aim**2).sum(axis=1) / np.maximum(size, 1e-12)


def _sums(
    angle: Float[np.ndarray, " rows"], weight: Float[np.ndarray, " rows"]
) -> Complex[np.ndarray, " orders"]:
    """Return the sums of weight exp(i order angle)."""
    place = np.round(angle / (4.0 * np.pi) * PLACES).astype(int) % PLACES
    turned = np.fft.rfft(np.bincount(place, weight, PLACES))
    return np.conj(turned[np.round(2.0 * ORDERS).astype(int)])


def _pair(sums: Complex[np.ndarray, " orders"]) -> Float[np.ndarray, "orders 2"]:
    return np.stack([np.real(sums), np.imag(sums)], axis=1)
