"""Delay of the second encoders that all axes share, and terms that live on it.

==========  ==========================================================================
Equation    all axes are judged twice, without a delay and with the same for all; the
            delay is believed where motions left out are better with it by two standard
            errors and every axis that can tell shows at least half of it; whether the
            second encoder tells exactly what was, or only lags with speed, motions left
            out say; it is as exact as the axis tells, where that does not contradict
            it. An axis has a
            delay of its own where that, beside the same terms, halves what is left of
            it, and is none earlier than a row
Source      Furgale, Rehder, Siegwart 2013 (one clock, one delay)
Valid       delays that are short beside the motions
Ignores     clocks that run at another rate
==========  ==========================================================================

Friction that grows with speed, in a motor's torque that winds up a gear, looks like a
delay below zero: such an axis cannot tell. Where all axes are such, the least delay
that no axis contradicts is taken.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from stiffness.dual_encoder.fit import EncoderComparison, SelectionStep
from stiffness.dual_encoder.motions import Motion
from stiffness.dual_encoder.residuals import (
    Axes,
    gain_between,
    is_quiet,
    residual_mean_square,
)
from stiffness.dual_encoder.selection import LEAST, MARGIN, between, own_delay
from stiffness.dual_encoder.terms import DELAY, WOUND, plain_terms, usual_friction

CLEARLY = 0.5
"""Share of what is left that a clock of its own must take off; chosen."""
QUIET = 1.05
"""Times its noise below which an axis asks for no more; chosen."""
ROUNDS = 3
CLOSE = 0.01
"""Share of a delay by which it may still change; chosen."""


@dataclass(frozen=True)
class DelayFit:
    """What a delay makes of some axes.

    Attributes:
        delay: Of the clock, in s.
        half: Half the width of the 95 % interval of each axis' delay.
        found: What lies between the encoders of each axis beside it.
    """

    delay: float
    half: dict[int, float]
    found: dict[int, EncoderComparison]


def across(axes: Axes, stated: float | None = None) -> dict[int, EncoderComparison]:
    """Find what lies between the encoders of all axes of a recording.

    Args:
        axes: Motions that are fitted, of every axis.
        stated: One sigma of an encoder after a gear, in rad; None: not stated.
    """
    found = {k: between(m) for k, m in axes.items()}
    if all(is_quiet(m, found[k], stated, QUIET) for k, m in axes.items()):
        return found
    common = _shared(axes)
    if _believed(axes, found, common):
        found = _with_trials(axes, found, common)
    if len(axes) == 1:
        return found
    for k, m in axes.items():
        if not is_quiet(m, found[k], stated, 1.0 / CLEARLY):
            own = _shared({k: m})
            step = float(np.median(np.diff(m[0].time)))
            alike = replace(found[k], delay=own.found[k].delay)
            less = residual_mean_square(m, alike) < CLEARLY * residual_mean_square(
                m, found[k]
            )
            if less and own.found[k].delay > -step:
                found |= _with_trials({k: m}, found, own)
    return found


def _shared(axes: Axes) -> DelayFit:
    """Find the delay of some axes' common clock, and the rest beside it."""
    guesses = np.array([_guesses(m) for m in axes.values()])
    tries = [_followed(axes, float(g)) for g in np.median(guesses, axis=0)]
    common, half = min(tries, key=lambda t: t[0])[1:]
    exact, creeping = (_exactly(axes, common, half, c) for c in (False, True))
    gain, error = gain_between(axes, creeping.found, exact.found)
    return exact if gain > MARGIN * error else creeping


def _exactly(axes: Axes, common: float, half: float, velocity_lag: bool) -> DelayFit:
    """Judge all axes beside a common delay, each as exact as it tells."""
    found, halves = {}, {}
    for k, m in axes.items():
        shared = common if len(axes) > 1 else None
        own = between(m, common, shared=shared, velocity_lag=velocity_lag)
        halves[k] = half
        change, told = _own(m, own)
        if not _hidden(m, own) and abs(change) <= told:
            exact = between(
                m, common + change, shared=shared, velocity_lag=velocity_lag
            )
            if not _hidden(m, exact):
                own, halves[k] = exact, told
        found[k] = own
    return DelayFit(common, halves, found)


def _followed(axes: Axes, delay: float) -> tuple[float, float, float]:
    """Follow a guess; return what is left in shares of noise, delay and its half."""
    left_over, half = np.inf, np.inf
    for _ in range(ROUNDS):
        shared = delay if len(axes) > 1 else None
        found = {k: between(m, delay, False, shared) for k, m in axes.items()}
        left_over = _size(axes, found)
        change, half = _change(axes, found)
        delay += change
        if abs(change) <= CLOSE * abs(delay):
            break
    return left_over, delay, half


def _size(axes: Axes, found: Mapping[int, EncoderComparison]) -> float:
    """Return how much is left of motions left out, all axes alike."""
    return float(
        sum(np.log(residual_mean_square(m, found[k])) for k, m in axes.items())
    )


def _guesses(motions: tuple[Motion, ...]) -> tuple[float, float]:
    """Return what an axis takes for its delay, alone and beside a wind-up."""
    wound = [t for t in plain_terms(motions) if t.effect == WOUND]
    if wound and motions[0].measured:
        wound += usual_friction()[:1]
    return own_delay((), motions)[0], own_delay(wound, motions)[0]


def _change(axes: Axes, found: Mapping[int, EncoderComparison]) -> tuple[float, float]:
    """Return by how much a delay should change, and half its interval."""
    told = {k: _own(m, found[k]) for k, m in axes.items()}
    clear = [told[k] for k, m in axes.items() if not _hidden(m, found[k])]
    if not clear:
        return max(told.values(), key=lambda t: t[0])
    change, half = np.median(np.array(clear), axis=0)  # one axis may be mistaken
    return float(change), float(half / np.sqrt(len(clear)))


def _own(motions: tuple[Motion, ...], found: EncoderComparison) -> tuple[float, float]:
    then = tuple(map(found.then, motions))
    rest = [t for t in found.terms if t.parameters != ("friction_s",)]
    return own_delay(rest, then)


def _hidden(motions: tuple[Motion, ...], found: EncoderComparison) -> bool:
    """Return whether friction in a torque that winds up the gear may hide a delay."""
    return motions[0].measured and any(t.effect == WOUND for t in found.terms)


def _believed(
    axes: Axes, before: Mapping[int, EncoderComparison], late: DelayFit
) -> bool:
    if late.delay < 0.0 and any(_hidden(m, late.found[k]) for k, m in axes.items()):
        return False  # friction makes such a delay of nothing
    gain, error = gain_between(axes, before, late.found)
    for k, m in axes.items():
        own, half = _own(m, late.found[k])
        contradicts = abs(own) > max(0.5 * abs(late.delay), half)
        if contradicts and not _hidden(m, late.found[k]):
            return False
    return gain > max(LEAST, MARGIN * error)


def _with_trials(
    axes: Axes, before: Mapping[int, EncoderComparison], late: DelayFit
) -> dict[int, EncoderComparison]:
    """Put the delay first among what was believed of each axis."""
    found = {}
    least = all(_hidden(m, late.found[k]) for k, m in axes.items())
    for k, m in axes.items():
        own = late.found[k]
        gain, error = gain_between({k: m}, before, late.found)
        trial = SelectionStep(DELAY, (own.delay,), gain, error, "")
        found[k] = replace(
            own, delay_step=trial, delay_half=late.half[k], at_least=least
        )
    return dict(before) | found
