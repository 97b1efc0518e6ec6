"""A term is believed where motions that it was not fitted to are better with it.

==========  ==========================================================================
Equation    each motion is left out in turn; gain of a stretch of time = its mean square
            without − with the term, in shares of the motion's; believed where the mean
            gain over stretches is above two of its standard errors, no motion as a
            whole is worse, and all coefficients are possible
Source      Breiman et al. 1984 (margins of standard errors)
Valid       two motions or more
Ignores     that orders and slips are looked for on all motions that are fitted
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from stiffness.two_encoders.fitting import (
    coefficients,
    columns,
    fitted,
    left_out,
    moving_squares,
)
from stiffness.two_encoders.found import Between, Trial
from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.terms import LATE, WOUND, Term, wave
from stiffness.two_encoders.waves import MANY_TURNS, ORDER_STEP, turns_of

MARGIN = 2.0
LEAST = 0.02
"""Smallest gain that is believed; chosen: much is tried, and less changes nothing."""
LOOP = 3.0
"""Times what a torque's noise winds up that a loop is wide at least; chosen."""
BORROWED = "it lives on the delay"
"""How the reason begins where a wind-up was refused for the delay that it changes."""


def tried(
    so_far: Between,
    more: tuple[Term, ...],
    motions: tuple[Motion, ...],
    shared: float | None = None,
) -> Trial:
    """Try one more term, or some that go together; see `between`."""
    terms = (*so_far.terms, *more)
    x = coefficients(terms, motions)
    before, after = left_out(so_far.terms, motions), left_out(terms, motions)
    gain, error = gain_of(before, after)
    spread = Between(terms, x, x, (), ()).value(WOUND, "compliance_rad_per_nm")
    worse = [  # beyond what the noise of a torque makes of it
        m.pose
        for m, b, a in zip(motions, before, after, strict=True)
        if a.mean() >= b.mean() + spread**2 * m.scatter**2
    ]
    own = x[len(so_far.x) :]
    reason = impossible(terms, x)
    if more[0].effect == "hysteresis" and own[0] < LOOP * spread * _scatter(motions):
        reason = reason or "its loop is no wider than the torque's noise makes it"
    if not reason and worse:
        reason = f"motion {worse[0]} is worse with it when it is fitted to the others"
    elif not reason and gain <= MARGIN * np.sqrt(_numbers(more, motions)) * error:
        reason = "its gain on motions left out may be chance: "
        reason += f"{gain / error:.1f} standard errors"
    elif not reason and gain < LEAST:
        reason = "it takes less than a hundredth off what is left"
    if not reason and shared is not None and _may_borrow(more):
        reason = _borrowed(so_far, terms, motions, shared)
    return Trial(more[0], tuple(own.tolist()), gain, error, reason, more[1:])


def _numbers(more: tuple[Term, ...], motions: tuple[Motion, ...]) -> int:
    """Return how many numbers are looked for together; a wave that passes is one."""
    slow = 0.0 < turns_of(more[0], motions) < MANY_TURNS
    return len(more) + sum(t.effect == "hysteresis" for t in more) + slow


def orders_alike(
    found: Between, motions: Sequence[Motion], term: Term
) -> tuple[float, float]:
    """Return the lowest and highest order of a wave that would do as well.

    Those around it with which a stretch is left no more than two standard errors more.
    """
    then = tuple(map(found.then, motions))
    rest = [t for t in found.terms if t is not term]
    best = np.concatenate(_left_of((*rest, term), then))
    reach = max(1.0, 1.0 / turns_of(wave(1.0), then))
    ends = []
    for way in (-ORDER_STEP, ORDER_STEP):
        order = term.order
        while abs(order + way - term.order) <= reach and order + way >= ORDER_STEP:
            other = _left_of((*rest, wave(order + way)), then)
            more = np.concatenate(other) - best
            if more.mean() > MARGIN * more.std(ddof=1) / np.sqrt(len(more)):
                break
            order += way
        ends.append(order)
    half = 0.5 * ORDER_STEP
    return ends[0] - half, ends[1] + half


def _left_of(terms: Sequence[Term], motions: Sequence[Motion]) -> list[np.ndarray]:
    x = coefficients(terms, motions)
    return [moving_squares(m.apart - columns(terms, m) @ x, m) for m in motions]


def _scatter(motions: Sequence[Motion]) -> float:
    return max(m.scatter for m in motions)


def own_delay(terms: Sequence[Term], motions: Sequence[Motion]) -> tuple[float, float]:
    """Return how much later an axis is than it was taken for, and half its interval."""
    x, half = fitted([LATE, *terms], motions)
    return float(x[0]), float(half[0])


def _may_borrow(more: tuple[Term, ...]) -> bool:
    growing = any(t.parameters == ("friction_s",) for t in more)
    return more[0].effect == WOUND and not growing


def _borrowed(
    so_far: Between,
    terms: Sequence[Term],
    motions: Sequence[Motion],
    shared: float,
) -> str:
    """Say whether a wind-up lives on the delay that the axis shares with others."""
    if not motions[0].measured:
        return ""
    old, half = own_delay(so_far.terms, motions)
    new = own_delay(terms, motions)[0]
    apart = so_far.delay - shared
    if abs(new - old) <= half or abs(new + apart) <= abs(old + apart):
        return ""
    return (
        f"{BORROWED}, which would go from {1e3 * (so_far.delay + old):.2f} ± "
        f"{1e3 * half:.2f} to {1e3 * (so_far.delay + new):.2f} ms, away from the other "
        f"axes' {1e3 * shared:.2f}"
    )


def gain_of(
    before: Sequence[np.ndarray], after: Sequence[np.ndarray]
) -> tuple[float, float]:
    """Return the mean gain over the stretches of motions left out, and its error."""
    gains = np.concatenate(
        [(b - a) / b.mean() for b, a in zip(before, after, strict=True)]
    )
    return float(gains.mean()), float(gains.std(ddof=1) / np.sqrt(len(gains)))


def impossible(terms: Sequence[Term], x: Float[np.ndarray, " columns"]) -> str:
    """Say which coefficient no gear can have; empty: none."""
    i, give, slipping = 0, 0.0, 0.0
    for term in terms:
        own = x[i : i + len(term.parameters)]
        i += len(own)
        if (own < term.least).any():
            return f"{term.parameters[0]} would be below zero, which cannot be"
        give += float(own[0]) if term.effect == WOUND else 0.0
        if term.effect == "hysteresis":
            slipping += 0.5 * float(own[0]) / term.shape[0]
    if slipping > give:
        return "its contacts would be stiffer than the gear, which cannot be"
    return ""
