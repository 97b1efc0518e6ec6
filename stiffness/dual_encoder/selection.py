"""Forward selection of terms by their gain on motions left out.

Test of one term (`tried`):

==========  ==========================================================================
Equation    each motion is left out in turn; gain of a stretch of time = its mean square
            without − with the term, relative to the motion's; believed where the mean
            gain over stretches is above two of its standard errors, no motion as a
            whole is worse, and all coefficients are possible
Source      Breiman et al. 1984 (margins of standard errors)
Valid       two motions or more
Ignores     the search for orders and slip torques on all fitted motions
==========  ==========================================================================

Selection for an axis (`between`):

==========  ==========================================================================
Equation    greedy forward selection by the test above; after each step the friction
            found so far is subtracted from the torque of hysteresis, and slip torques
            and friction speeds are refined
Source      Efroymson 1960 (stepwise regression)
Valid       few terms that differ in shape
Ignores     sets of terms that improve the prediction only together, except wind-up with
            friction
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.stats import sem

from bench.shared.settings import SETTINGS
from stiffness.dual_encoder.fit import (
    EncoderComparison,
    SelectionStep,
    coefficients,
    columns,
    fitted,
    left_out,
    moving_squares,
)
from stiffness.dual_encoder.motions import Motion
from stiffness.dual_encoder.terms import (
    DELAY,
    FRICTION,
    MANY_TURNS,
    ORDER_STEP,
    WOUND,
    Term,
    least_slip,
    plain_terms,
    strongest_waves,
    turns_of,
    usual_friction,
    wave,
)
from stiffness.regression.testing import gain_of

# --- Gain and impossible values -------------------------------------------------------

MARGIN = SETTINGS.standard_errors
LEAST = 0.02
"""Minimum gain of a term that is believed; chosen: much is tried, and less changes
nothing."""
LOOP = 3.0
"""Minimum width of a loop, over the wind-up by the torque's noise; chosen."""
BORROWED = "it lives on the delay"
"""How the reason begins where a wind-up was refused because it is confounded with the
delay."""


def tried(
    so_far: EncoderComparison,
    more: tuple[Term, ...],
    motions: tuple[Motion, ...],
    shared: float | None = None,
) -> SelectionStep:
    """Test one more term, or several together; see `between`."""
    terms = (*so_far.terms, *more)
    x = coefficients(terms, motions)
    before, after = left_out(so_far.terms, motions), left_out(terms, motions)
    gain, error = gain_of(before, after)
    spread = EncoderComparison(terms, x, x, (), ()).value(
        WOUND, "compliance_rad_per_nm"
    )
    worse = [  # beyond what the noise of a torque makes of it
        m.posture_id
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
        reason = "it takes less than a hundredth off the residual"
    if not reason and shared is not None and _may_borrow(more):
        reason = _borrowed(so_far, terms, motions, shared)
    return SelectionStep(more[0], tuple(own.tolist()), gain, error, reason, more[1:])


def _numbers(more: tuple[Term, ...], motions: tuple[Motion, ...]) -> int:
    """Return how many parameters are searched together; a full wave has one."""
    slow = 0.0 < turns_of(more[0], motions) < MANY_TURNS
    return len(more) + sum(t.effect == "hysteresis" for t in more) + slow


def orders_alike(
    found: EncoderComparison, motions: Sequence[Motion], term: Term
) -> tuple[float, float]:
    """Return the lowest and highest order of a wave that predict as well.

    Orders around it whose residual in a stretch is at most two standard errors larger.
    """
    then = tuple(map(found.then, motions))
    rest = [t for t in found.terms if t is not term]
    best = np.concatenate(_residual_squares((*rest, term), then))
    reach = max(1.0, 1.0 / turns_of(wave(1.0), then))
    ends = []
    for way in (-ORDER_STEP, ORDER_STEP):
        order = term.order
        while abs(order + way - term.order) <= reach and order + way >= ORDER_STEP:
            other = _residual_squares((*rest, wave(order + way)), then)
            more = np.concatenate(other) - best
            if more.mean() > MARGIN * sem(more):
                break
            order += way
        ends.append(order)
    half = 0.5 * ORDER_STEP
    return ends[0] - half, ends[1] + half


def _residual_squares(
    terms: Sequence[Term], motions: Sequence[Motion]
) -> list[np.ndarray]:
    x = coefficients(terms, motions)
    return [moving_squares(m.apart - columns(terms, m) @ x, m) for m in motions]


def _scatter(motions: Sequence[Motion]) -> float:
    return max(m.scatter for m in motions)


def own_delay(terms: Sequence[Term], motions: Sequence[Motion]) -> tuple[float, float]:
    """Return how much an axis' delay exceeds the assumed one, and half its interval."""
    x, half = fitted([DELAY, *terms], motions)
    return float(x[0]), float(half[0])


def _may_borrow(more: tuple[Term, ...]) -> bool:
    growing = any(t.parameters == ("friction_s",) for t in more)
    return more[0].effect == WOUND and not growing


def _borrowed(
    so_far: EncoderComparison,
    terms: Sequence[Term],
    motions: Sequence[Motion],
    shared: float,
) -> str:
    """Return why a wind-up is confounded with the delay shared with other axes."""
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


def impossible(terms: Sequence[Term], x: Float[np.ndarray, " columns"]) -> str:
    """Return which coefficients no gear can have; empty: none."""
    i, compliance, slipping = 0, 0.0, 0.0
    for term in terms:
        own = x[i : i + len(term.parameters)]
        i += len(own)
        if (own < term.least).any():
            return f"{term.parameters[0]} would be below zero, which cannot be"
        compliance += float(own[0]) if term.effect == WOUND else 0.0
        if term.effect == "hysteresis":
            slipping += 0.5 * float(own[0]) / term.shape[0]
    if slipping > compliance:
        return "its contacts would be stiffer than the gear, which cannot be"
    return ""


# --- Forward selection ----------------------------------------------------------------

MOST_TERMS = 12
"""Maximum number of terms of an axis; chosen."""
FINER = (0.7, 1.0, 1.4)
"""Factors by which a slip torque is refined; chosen."""


def between(
    motions: tuple[Motion, ...],
    delay: float = 0.0,
    waves: bool = True,
    shared: float | None = None,
    velocity_lag: bool = False,
) -> EncoderComparison:
    """Return the terms between the encoders of an axis.

    Delays of the second encoder and of the other axes are in s, the latter None where
    there are none; `waves`: those of transmission error are searched for.
    """
    motions = tuple(m.later(delay, velocity_lag) for m in motions)
    terms: tuple[Term, ...] = ()
    believed: list[SelectionStep] = []
    while True:
        terms, x, half = _refined(terms, motions)
        so_far = EncoderComparison(
            terms, x, half, (), tuple(believed), delay, velocity_lag
        )
        trials = [
            tried(so_far, t, motions, shared)
            for t in _candidates(so_far, motions, waves)
        ]
        good = [t for t in trials if not t.reason]
        if not good:
            return replace(so_far, refused=tuple(trials))
        wound = [t for t in good if t.term.effect == WOUND]
        best = max(good, key=lambda t: t.gain)
        if wound and 0.0 < turns_of(best.term, motions) < MANY_TURNS:
            best = max(wound, key=lambda t: t.gain)  # gravity is a slow wave as well
        for term in (best.term, *best.tried_with):
            believed.append(replace(best, term=term, tried_with=()))
            terms = (*terms, term)
        if len(terms) >= MOST_TERMS:
            terms, x, half = _refined(terms, motions)
            return EncoderComparison(
                terms, x, half, tuple(trials), tuple(believed), delay, velocity_lag
            )


def _candidates(
    so_far: EncoderComparison, motions: tuple[Motion, ...], waves: bool
) -> list[tuple[Term, ...]]:
    plain = plain_terms(motions, so_far.terms)
    found: list[tuple[Term, ...]] = [(_without_friction(t, so_far),) for t in plain]
    if any(t.effect == WOUND for t in plain) and all(m.measured for m in motions):
        wound = next(t for t in plain if t.effect == WOUND)
        constant, growing = usual_friction()
        found += [(wound, constant), (wound, growing), (wound, constant, growing)]
    if waves:
        sheets = tuple(columns(so_far.terms, m) for m in motions)
        left = tuple(
            m.apart - a @ so_far.x for m, a in zip(motions, sheets, strict=True)
        )
        found += [(w,) for w in strongest_waves(motions, left, sheets)]
    return found


def _refined(
    terms: tuple[Term, ...], motions: tuple[Motion, ...]
) -> tuple[tuple[Term, ...], np.ndarray, np.ndarray]:
    """Subtract the friction found from each hysteresis' torque, and refine its slip."""
    x = coefficients(terms, motions)
    for i in 2 * [i for i, t in enumerate(terms) if t.shape]:
        so_far = EncoderComparison(terms, x, x, (), ())
        trials = []
        for factor in FINER:
            term = _without_friction(terms[i], so_far)
            term = replace(term, shape=(factor * term.shape[0], *term.shape[1:]))
            if term.effect == "hysteresis" and term.shape[0] < least_slip(motions):
                continue
            others = (*terms[:i], term, *terms[i + 1 :])
            own = coefficients(others, motions)
            if not impossible(others, own):
                trials.append((_squares(others, own, motions), others, own))
        if trials:
            _, terms, x = min(trials, key=lambda t: t[0])
    return (terms, *fitted(terms, motions))


def _squares(terms: Sequence[Term], x: np.ndarray, motions: Sequence[Motion]) -> float:
    left = (m.apart - columns(terms, m) @ x for m in motions)
    return sum(float(part @ part) for part in left)


def _without_friction(term: Term, so_far: EncoderComparison) -> Term:
    """Return a hysteresis term whose torque is free of the friction found so far."""
    compliance = so_far.value(WOUND, "compliance_rad_per_nm")
    if term.effect != "hysteresis" or compliance <= 0.0:
        return term
    turns = [t.shape[0] for t in so_far.terms if t.effect == FRICTION and t.shape]
    constant = so_far.value(FRICTION, "friction_rad") / compliance
    factor = so_far.value(FRICTION, "friction_s") / compliance
    return replace(term, shape=(term.shape[0], constant, factor, (turns or [1.0])[0]))
