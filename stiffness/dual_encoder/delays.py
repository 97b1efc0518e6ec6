"""Delay of the second encoders that all axes share, and terms confounded with it.

==========  ==========================================================================
Equation    all axes are fitted twice, without a delay and with the same for all; the
            delay is believed where motions left out are better with it by two standard
            errors and every axis that can determine it shows at least half of it;
            motions left out decide between an exact delay and a lag in proportion to
            speed; an axis' own estimate is used where it does not contradict the
            common one. An axis has a delay of its own where that, with the same
            terms, halves its residual and is not earlier than a row
Source      Furgale, Rehder, Siegwart 2013 (one clock, one delay)
Valid       delays that are short beside the motions
Ignores     clocks of different rate
==========  ==========================================================================

Viscous friction in a motor's torque that winds up a gear mimics a negative delay: such
an axis cannot determine the delay. Where all axes are such, the smallest delay that no
axis contradicts is taken.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from stiffness.dual_encoder.fit import (
    Axes,
    EncoderComparison,
    SelectionStep,
    gain_between,
    is_quiet,
    residual_mean_square,
)
from stiffness.dual_encoder.motions import Motion
from stiffness.dual_encoder.selection import LEAST, MARGIN, between, own_delay
from stiffness.dual_encoder.terms import DELAY, WOUND, plain_terms, usual_friction

CLEARLY = 0.5
"""Share of the residual that a delay of an axis' own must remove; chosen."""
QUIET = 1.05
"""Residual over noise below which an axis needs no further term; chosen."""
ROUNDS = 3
CLOSE = 0.01
"""Relative change of a delay at which the iteration ends; chosen."""


@dataclass(frozen=True)
class DelayFit:
    """Fit of all axes with a common delay.

    Attributes:
        delay: Of the second encoders' clock, in s.
        half: Half the width of the 95 % interval of each axis' delay.
        found: Other terms of each axis.
    """

    delay: float
    half: dict[int, float]
    found: dict[int, EncoderComparison]


@threadpool_limits.wrap(limits=1, user_api="blas")
def across(axes: Axes, stated: float | None = None) -> dict[int, EncoderComparison]:
    """Return the terms of all axes of a recording, with the delay that they share.

    One sigma of an encoder after a gear is in rad, None where not stated.
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
    """Fit the common delay of some axes, and their other terms."""
    guesses = np.array([_guesses(m) for m in axes.values()])
    tries = [_followed(axes, float(g)) for g in np.median(guesses, axis=0)]
    common, half = min(tries, key=lambda t: t[0])[1:]
    exact, creeping = (_exactly(axes, common, half, c) for c in (False, True))
    gain, error = gain_between(axes, creeping.found, exact.found)
    return exact if gain > MARGIN * error else creeping


def _exactly(axes: Axes, common: float, half: float, velocity_lag: bool) -> DelayFit:
    """Fit all axes with a common delay, each refined by its own estimate."""
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
    """Iterate from an initial delay; return residual over noise, delay, its half."""
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
    """Return the residual of motions left out, all axes with equal weight."""
    return float(
        sum(np.log(residual_mean_square(m, found[k])) for k, m in axes.items())
    )


def _guesses(motions: tuple[Motion, ...]) -> tuple[float, float]:
    """Return initial values of an axis' delay, fitted alone and with a wind-up."""
    wound = [t for t in plain_terms(motions) if t.effect == WOUND]
    if wound and motions[0].measured:
        wound += usual_friction()[:1]
    return own_delay((), motions)[0], own_delay(wound, motions)[0]


def _change(axes: Axes, found: Mapping[int, EncoderComparison]) -> tuple[float, float]:
    """Return the correction of a delay, and half its interval."""
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
    """Return whether friction in a torque that winds up the gear may mask a delay."""
    return motions[0].measured and any(t.effect == WOUND for t in found.terms)


def _believed(
    axes: Axes, before: Mapping[int, EncoderComparison], late: DelayFit
) -> bool:
    if late.delay < 0.0 and any(_hidden(m, late.found[k]) for k, m in axes.items()):
        return False  # friction alone mimics such a delay
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
    """Insert the delay as the first of each axis' believed terms."""
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
