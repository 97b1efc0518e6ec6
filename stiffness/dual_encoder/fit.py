"""Least-squares fit of terms to motions, and what it leaves on motions left out.

Each motion has a constant of its own, which is projected out. `EncoderComparison` holds
the selected terms of an axis and the steps of the selection.

==========  ==========================================================================
Equation    least squares; intervals: sandwich over stretches with Student's t
Source      Liang, Zeger 1986
Valid       stretches longer than the correlation time of the residual
Ignores     the search for orders and slip torques on the fitted motions
==========  ==========================================================================

Noise, from stated accuracies or from the readings (`noise_of`, `p_value_beyond_noise`):

==========  ==========================================================================
Equation    noise² = stated² + (compliance x noise of the torque)²; not stated: from
            third differences of rows, whose variance is 20 times a row's.
            The residual exceeds noise where mean squares of stretches, or their
            logarithms, lie above it: much in few of them, or a little in many
Source      von Neumann et al. 1941 (differences); Student's t over stretches of time
Valid       white noise
Ignores     errors of an encoder that repeat with its angle
==========  ==========================================================================

Dependence of the residual on angle, torque and speed (`explained_share_by`):

==========  ==========================================================================
Equation    share = 1 − |r − f(x)|² / |r|², r the residual of the motion left out, f the
            mean residual of the fitted motions by x: angle, torque, speed
Source      binned regression (Tukey 1961), tested on another motion
Valid       motions that cover the same angles, torques and speeds
Ignores     dependence on several of them at once
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import t as student

from stiffness.dual_encoder.motions import STRETCHES, Motion
from stiffness.dual_encoder.terms import WOUND, Term
from stiffness.regression.testing import gain_of

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


# --- Noise ----------------------------------------------------------------------------

STATED = 1.1
"""Allowed ratio of noise to stated noise; chosen: a tenth, as statements go."""
SEEN = 2.0
"""The same for noise estimated from rows only, which is its white part; chosen."""


def noise_of(
    motions: Sequence[Motion], found: EncoderComparison | None, stated: float | None
) -> float:
    """Return the noise of a row of an axis, standard deviation in rad.

    One sigma of an encoder after a gear is in rad, None where not stated.
    """
    own = white_noise_sigma(motions) if stated is None else stated
    compliance = 0.0
    if found is not None:
        compliance = found.value(WOUND, "compliance_rad_per_nm")
    torque = max(m.scatter for m in motions)
    return float(np.hypot(own, compliance * torque))


def white_noise_sigma(motions: Sequence[Motion]) -> float:
    """Return the white noise estimated from differences between rows, in rad."""
    rough = np.concatenate([np.diff(m.apart, 3) for m in motions])
    return float(np.sqrt(np.mean(rough**2) / 20.0))


def p_value_beyond_noise(
    residual: Sequence[Float[np.ndarray, " _"]],
    motions: Sequence[Motion],
    noise: float,
    stated: bool,
) -> float:
    """Return the p-value of the hypothesis that the residual is no larger than noise.

    Residuals and one sigma of a row are in rad; the motions' stretches are the
    independent units; `stated`: an instrument states the noise.
    """
    most = ((STATED if stated else SEEN) * noise) ** 2
    parts = [
        moving_squares(part - part.mean(), m)
        for part, m in zip(residual, motions, strict=True)
    ]
    squares = np.concatenate(parts) / max(most, np.finfo(float).tiny)
    often = _above(np.log(np.maximum(squares, np.finfo(float).tiny)), 0.0)
    return min(1.0, 2.0 * min(often, _above(squares, 1.0)))


def _above(values: Float[np.ndarray, " stretches"], most: float) -> float:
    """Return the p-value of a mean above an upper limit."""
    error = max(float(values.std(ddof=1)), 1e-12) / np.sqrt(len(values))
    return float(student.sf((values.mean() - most) / error, len(values) - 1))


# --- Comparison on motions left out ---------------------------------------------------

Axes = Mapping[int, tuple[Motion, ...]]
"""Motions of every axis."""


def gain_between(
    axes: Axes,
    before: Mapping[int, EncoderComparison],
    after: Mapping[int, EncoderComparison],
) -> tuple[float, float]:
    """Return the mean gain over stretches of all axes, and its standard error."""
    squares = [
        both
        for k, m in axes.items()
        for both in zip(_squares(m, before[k]), _squares(m, after[k]), strict=True)
    ]
    return gain_of(*zip(*squares, strict=True))


def residual_mean_square(
    motions: tuple[Motion, ...], found: EncoderComparison
) -> float:
    """Return the mean square residual of motions left out, in rad^2."""
    return float(np.mean(np.concatenate(_squares(motions, found))))


def is_quiet(
    motions: tuple[Motion, ...],
    found: EncoderComparison,
    stated: float | None,
    times: float,
) -> bool:
    """Return whether the residual of an axis is within a multiple of its noise."""
    return (
        residual_mean_square(motions, found)
        <= (times * noise_of(motions, found, stated)) ** 2
    )


def _squares(motions: tuple[Motion, ...], found: EncoderComparison) -> list[np.ndarray]:
    return left_out(found.terms, [found.then(m) for m in motions])


# --- Dependence and correlation -------------------------------------------------------

BINS = 20
SHOWS = 0.1
"""Share of the residual below which it counts as independent of a quantity; chosen."""


def explained_share_by(
    residual: Sequence[Float[np.ndarray, " _"]],
    motions: Sequence[Motion],
    judged_left: Float[np.ndarray, " rows"],
    judged: Motion,
) -> dict[str, float]:
    """Return the share of a motion's residual that a quantity explains in others."""
    shares = {}
    for name in ("angle", "torque", "speed"):
        others = [getattr(m, name) for m in motions]
        own = getattr(judged, name)
        if own is None or any(x is None for x in others):
            continue
        shares[name] = _share(
            np.concatenate(others), np.concatenate(list(residual)), own, judged_left
        )
    return shares


def correlation_time(residual: Float[np.ndarray, " rows"], motion: Motion) -> float:
    """Return the time after which the residual is no longer correlated, in s."""
    y = residual - residual.mean()
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
