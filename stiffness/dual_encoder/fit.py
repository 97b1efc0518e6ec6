"""Least-squares fit of terms to motions, and the result for an axis.

Each motion has a constant of its own, which is projected out. `EncoderComparison` holds
the selected terms of an axis and the steps of the selection.

==========  ==========================================================================
Equation    least squares; intervals: sandwich over stretches with Student's t
Source      Liang, Zeger 1986
Valid       stretches longer than the correlation time of the residual
Ignores     the search for orders and slip torques on the fitted motions
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from stiffness.dual_encoder.motions import STRETCHES, Motion
from stiffness.dual_encoder.terms import Term

# --- Fitting --------------------------------------------------------------------------

RESTS = 0.1
"""Share of a motion's mean speed below which a stretch is at rest and is ignored."""


def columns(terms: Sequence[Term], motion: Motion) -> Float[np.ndarray, "rows columns"]:
    """Return the columns of several terms."""
    none = np.zeros((len(motion.time), 0))
    return np.concatenate([none, *(t.columns(motion) for t in terms)], axis=1)


def coefficients(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> Float[np.ndarray, " columns"]:
    """Return the coefficients of `fitted`, without intervals."""
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
    """Solve least squares with columns of different scale, as torque and harmonics."""
    if not len(aim):
        return aim
    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    return (
        np.linalg.lstsq(gram / np.outer(size, size), aim / size, rcond=1e-12)[0] / size
    )


def left_out(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> list[Float[np.ndarray, " _"]]:
    """Return mean squares of each motion's moving stretches when it is left out."""
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
    residual: Float[np.ndarray, " rows"], motion: Motion
) -> Float[np.ndarray, " stretches"]:
    """Return mean squares of the stretches of a motion that move."""
    stretch, moves = motion.stretches(), np.abs(motion.speed)
    count = np.bincount(stretch)
    fast = np.bincount(stretch, moves) / np.maximum(count, 1) > RESTS * moves.mean()
    return np.bincount(stretch, residual**2)[fast] / count[fast]


# --- Result for an axis ---------------------------------------------------------------


@dataclass(frozen=True)
class SelectionStep:
    """A term that was tested.

    Attributes:
        coefficients: In SI, fitted together with the believed terms.
        gain: Mean gain over stretches of motions left out.
        reason: Why it was refused; empty where it was believed.
        tried_with: Terms that were tested together with it.
    """

    term: Term
    coefficients: tuple[float, ...]
    gain: float
    error: float
    reason: str
    tried_with: tuple[Term, ...] = ()


@dataclass(frozen=True)
class EncoderComparison:
    """Fitted terms between the two encoders of an axis.

    Attributes:
        terms: The believed terms, in the order of selection.
        x: Their coefficients, term by term, in SI.
        half: Half the width of their 95 % intervals.
        refused: Terms that were tested last and not believed.
        believed: Selection step of each term.
        delay: Delay of the second encoder, in s.
        velocity_lag: Whether it only lags in proportion to speed; see `Motion.later`.
        delay_step: Selection step of the delay; None: there is no delay.
        delay_half: Half the width of its 95 % interval.
        at_least: Whether it is a lower bound, since friction masks it on every axis.
    """

    terms: tuple[Term, ...]
    x: Float[np.ndarray, " columns"]
    half: Float[np.ndarray, " columns"]
    refused: tuple[SelectionStep, ...]
    believed: tuple[SelectionStep, ...]
    delay: float = 0.0
    velocity_lag: bool = False
    delay_step: "SelectionStep | None" = None
    delay_half: float = 0.0
    at_least: bool = False

    def residual(self, motion: Motion) -> Float[np.ndarray, " rows"]:
        """Return the residual of a motion, its own constant projected out."""
        then = self.then(motion)
        return then.apart - columns(self.terms, then) @ self.x

    def then(self, motion: Motion) -> Motion:
        """Return the motion at the second encoder's delay."""
        return motion.later(self.delay, self.velocity_lag)

    def value(self, effect: str, parameter: str) -> float:
        """Return the sum of a parameter's coefficients; 0 where there is none."""
        return float(
            sum(x for e, p, x in self.known() if (e, p) == (effect, parameter))
        )

    def known(self) -> list[tuple[str, str, float]]:
        """Return effect, parameter and coefficient of every column."""
        names = [(t.effect, p) for t in self.terms for p in t.parameters]
        return [(e, p, float(v)) for (e, p), v in zip(names, self.x, strict=True)]
