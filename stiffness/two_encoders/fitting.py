"""Terms are fitted to motions together, each motion's own constant aside.

==========  ==========================================================================
Equation    least squares; intervals: sandwich over stretches with Student's t
Source      Liang, Zeger 1986
Valid       stretches longer than what is left hangs together
Ignores     what was looked for on the motions that are fitted: orders, slips
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from stiffness.two_encoders.motions import STRETCHES, Motion
from stiffness.two_encoders.terms import Term

RESTS = 0.1
"""Share of a motion's mean speed below which a stretch is at rest and tells nothing."""


def columns(terms: Sequence[Term], motion: Motion) -> Float[np.ndarray, "rows columns"]:
    """Return the columns of several terms."""
    none = np.zeros((len(motion.time), 0))
    return np.concatenate([none, *(t.columns(motion) for t in terms)], axis=1)


def coefficients(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> Float[np.ndarray, " columns"]:
    """Return what `fitted` does, without intervals."""
    sheets = [columns(terms, m) for m in motions]
    aims = [a.T @ m.apart for a, m in zip(sheets, motions, strict=True)]
    return solved(np.sum([a.T @ a for a in sheets], axis=0), np.sum(aims, axis=0))


def fitted(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients and half the width of their intervals."""
    a = np.concatenate([columns(terms, m) for m in motions])
    y = np.concatenate([m.apart for m in motions])
    if a.shape[1] == 0:
        return np.zeros(0), np.zeros(0)
    gram = a.T @ a
    x = solved(gram, a.T @ y)
    inverse = np.linalg.pinv(gram)
    left = y - a @ x
    cut = [STRETCHES * i + m.stretches() for i, m in enumerate(motions)]
    stretch = np.concatenate(cut)
    names = np.unique(stretch)
    scores = np.stack([a[stretch == c].T @ left[stretch == c] for c in names])
    count = len(names)
    spread = inverse @ (scores.T @ scores) @ inverse * count / (count - 1)
    return x, student.ppf(0.975, count - 1) * np.sqrt(np.diag(spread))


def solved(
    gram: Float[np.ndarray, "columns columns"], aim: Float[np.ndarray, " columns"]
) -> Float[np.ndarray, " columns"]:
    """Return the coefficients of columns as different in size as torque and waves."""
    if not len(aim):
        return aim
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    return (
        np.linalg.lstsq(gram / np.outer(size, size), aim / size, rcond=1e-12)[0] / size
    )


def left_out(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> list[Float[np.ndarray, " _"]]:
    """Return mean squares of each motion's moving stretches, fitted to the others."""
    sheets = [columns(terms, m) for m in motions]
    grams = [a.T @ a for a in sheets]
    aims = [a.T @ m.apart for a, m in zip(sheets, motions, strict=True)]
    gram, aim = sum(grams), sum(aims)
    found = []
    for own, a, m in zip(range(len(motions)), sheets, motions, strict=True):
        x = solved(gram - grams[own], aim - aims[own])
        found.append(moving_squares(m.apart - a @ x, m))
    return found


def moving_squares(
    left: Float[np.ndarray, " rows"], motion: Motion
) -> Float[np.ndarray, " stretches"]:
    """Return mean squares of the stretches of a motion that move."""
    stretch, moves = motion.stretches(), np.abs(motion.speed)
    count = np.bincount(stretch)
    fast = np.bincount(stretch, moves) / np.maximum(count, 1) > RESTS * moves.mean()
    return np.bincount(stretch, left**2)[fast] / count[fast]
