"""A term is believed where motions that it was not fitted to are better with it.

==========  ==========================================================================
Equation    each motion is left out in turn; gain of a stretch of time = its mean square
            without − with the term, in shares of the motion's; believed where the mean
            gain over stretches is above two of its standard errors, no motion as a
            whole is worse, the coefficient is possible, and the axis' delay does not
            leave its 95 % interval away from the delay of the other axes: all second
            encoders are read by one instrument, and the motor's torque holds friction,
            which goes with speed as a delay does
Source      Breiman et al. 1984 (margins of standard errors); intervals: sandwich over
            stretches (Liang, Zeger 1986) with Student's t
Valid       two motions or more
Ignores     that a wave's order is looked for on all motions that are fitted
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from stiffness.two_encoders.motions import STRETCHES, Motion
from stiffness.two_encoders.terms import Term, plain_terms, strongest_waves

MARGIN = 2.0
BORROWED = "it lives on the delay"
"""How the reason begins where a term was refused for the delay that it would change."""
RESTS = 0.1
"""Share of a motion's mean speed below which a stretch is at rest and tells nothing."""
MOST_TERMS = 12
"""Terms that an axis is given at most; chosen."""


@dataclass(frozen=True)
class Trial:
    """A term that was tried.

    Attributes:
        term: The term.
        coefficients: In SI, fitted together with what was believed.
        gain: Mean over stretches of motions left out.
        error: Its standard error.
        reason: Why it was refused; empty: it was believed.
    """

    term: Term
    coefficients: tuple[float, ...]
    gain: float
    error: float
    reason: str


@dataclass(frozen=True)
class Between:
    """What lies between the encoders of an axis.

    Attributes:
        terms: What was believed, in that order.
        x: Their coefficients, term by term, in SI.
        half: Half the width of their 95 % intervals.
        refused: What was tried last and not believed.
        believed: How each was believed.
    """

    terms: tuple[Term, ...]
    x: Float[np.ndarray, " columns"]
    half: Float[np.ndarray, " columns"]
    refused: tuple[Trial, ...]
    believed: tuple[Trial, ...]

    def left(self, motion: Motion) -> Float[np.ndarray, " rows"]:
        """Return what stays unexplained of a motion, its own constant taken off."""
        return motion.apart - columns(self.terms, motion) @ self.x


def between(motions: tuple[Motion, ...], shared: float | None = None) -> Between:
    """Find what lies between the encoders of an axis.

    Args:
        motions: All are fitted.
        shared: Delay of the other axes' second encoders, in s; None: nobody knows.
    """
    terms: tuple[Term, ...] = ()
    believed: list[Trial] = []
    while True:
        x, half = fitted(terms, motions)
        so_far = Between(terms, x, half, (), tuple(believed))
        known = {t.effect for t in terms if not t.order}
        rest = [t for t in plain_terms(motions) if t.effect not in known]
        rest += strongest_waves(motions, tuple(so_far.left(m) for m in motions))
        trials = [tried(so_far, term, motions, shared) for term in rest]
        good = [t for t in trials if not t.reason]
        if not good or len(terms) == MOST_TERMS:
            return Between(terms, x, half, tuple(trials), tuple(believed))
        best = max(good, key=lambda t: t.gain)
        believed.append(best)
        terms = (*terms, best.term)


def tried(
    so_far: Between,
    term: Term,
    motions: tuple[Motion, ...],
    shared: float | None = None,
) -> Trial:
    """Try one more term; see `between`."""
    terms = (*so_far.terms, term)
    x = fitted(terms, motions)[0]
    each, worse = [], []
    for out in motions:
        others = tuple(m for m in motions if m is not out)
        before = _squares(so_far.terms, others, out)
        after = _squares(terms, others, out)
        each.append((before - after) / before.mean())
        if after.sum() >= before.sum():
            worse.append(out.pose)
    gains = np.concatenate(each)
    gain, error = float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))
    own = x[len(so_far.x) :]
    reason = ""
    if (own < term.least).any():
        reason = f"{term.parameters[0]} would be below zero, which cannot be"
    elif worse:
        reason = f"motion {worse[0]} is worse with it when it is fitted to the others"
    elif gain <= MARGIN * error:
        reason = "it gains less than two standard errors on motions left out"
    else:
        reason = _borrowed(so_far, x, shared)
    return Trial(term, tuple(own.tolist()), gain, error, reason)


def _borrowed(
    so_far: Between, x: Float[np.ndarray, " columns"], shared: float | None
) -> str:
    """Say whether a term lives on the delay that the axis shares with others."""
    names = [name for term in so_far.terms for name in term.parameters]
    if shared is None or "delay_s" not in names:
        return ""
    i = names.index("delay_s")
    old, new, half = so_far.x[i], x[i], so_far.half[i]
    if abs(new - old) <= half or abs(new - shared) <= abs(old - shared):
        return ""
    return (
        f"{BORROWED}, which would go from {1e3 * old:.2f} ± "
        f"{1e3 * half:.2f} to {1e3 * new:.2f} ms, away from the other axes' "
        f"{1e3 * shared:.2f}"
    )


def shared_delay(axes: Sequence[tuple[Motion, ...]], but: int) -> float | None:
    """Return the median delay of all axes but one, each fitted alone, in s."""
    delay = [t for t in plain_terms(axes[but]) if t.effect == "channel_delay"]
    others = [fitted(delay, m)[0][0] for k, m in enumerate(axes) if k != but]
    return float(np.median(others)) if others else None


def columns(terms: Sequence[Term], motion: Motion) -> Float[np.ndarray, "rows columns"]:
    """Return the columns of several terms."""
    none = np.zeros((len(motion.time), 0))
    return np.concatenate([none, *(t.columns(motion) for t in terms)], axis=1)


def fitted(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients and half the width of their intervals."""
    a = np.concatenate([columns(terms, m) for m in motions])
    y = np.concatenate([m.apart for m in motions])
    if a.shape[1] == 0:
        return np.zeros(0), np.zeros(0)
    x = np.linalg.lstsq(a, y, rcond=None)[0]
    inverse = np.linalg.pinv(a.T @ a)
    left = y - a @ x
    cut = [STRETCHES * i + m.stretches() for i, m in enumerate(motions)]
    stretch = np.concatenate(cut)
    names = np.unique(stretch)
    scores = np.stack([a[stretch == c].T @ left[stretch == c] for c in names])
    count = len(names)
    spread = inverse @ (scores.T @ scores) @ inverse * count / (count - 1)
    return x, student.ppf(0.975, count - 1) * np.sqrt(np.diag(spread))


def _squares(
    terms: Sequence[Term], motions: Sequence[Motion], out: Motion
) -> Float[np.ndarray, " stretches"]:
    """Return mean squares of the stretches that move, of a motion left out."""
    x = fitted(terms, motions)[0]
    left = out.apart - columns(terms, out) @ x
    stretch, moves = out.stretches(), np.abs(out.speed)
    count = np.bincount(stretch)
    fast = np.bincount(stretch, moves) / np.maximum(count, 1) > RESTS * moves.mean()
    return np.bincount(stretch, left**2)[fast] / count[fast]
