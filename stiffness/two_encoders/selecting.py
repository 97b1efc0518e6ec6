"""Terms are believed one after the other, what gains most first.

==========  ==========================================================================
Equation    greedy forward selection of what `judging` believes; after each step the
            torque that contacts feel is freed of the friction found by then, and the
            torques and speeds at which things slip are refined
Source      Efroymson 1960 (stepwise regression)
Valid       few terms that differ in shape
Ignores     sets of terms that are believed only together, but wind-up and friction
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stiffness.two_encoders.fitting import coefficients, columns, fitted
from stiffness.two_encoders.found import Between, Trial
from stiffness.two_encoders.judging import impossible, tried
from stiffness.two_encoders.motions import Motion
from stiffness.two_encoders.terms import (
    FRICTION,
    WOUND,
    Term,
    least_slip,
    plain_terms,
    usual_friction,
)
from stiffness.two_encoders.waves import MANY_TURNS, strongest_waves, turns_of

MOST_TERMS = 12
"""Terms that an axis is given at most; chosen."""
FINER = (0.7, 1.0, 1.4)
"""Steps by which a slip is refined; chosen."""


def between(
    motions: tuple[Motion, ...],
    delay: float = 0.0,
    waves: bool = True,
    shared: float | None = None,
    creeps: bool = False,
) -> Between:
    """Find what lies between the encoders of an axis.

    Args:
        motions: All are fitted.
        delay: By how much the second encoder tells late, in s.
        waves: Whether waves are looked for.
        shared: Delay of the other axes, in s; None: there are none, or no delay.
        creeps: See `Motion.later`.
    """
    motions = tuple(m.later(delay, creeps) for m in motions)
    terms: tuple[Term, ...] = ()
    believed: list[Trial] = []
    while True:
        terms, x, half = _refined(terms, motions)
        so_far = Between(terms, x, half, (), tuple(believed), delay, creeps)
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
        for term in (best.term, *best.beside):
            believed.append(replace(best, term=term, beside=()))
            terms = (*terms, term)
        if len(terms) >= MOST_TERMS:
            terms, x, half = _refined(terms, motions)
            return Between(
                terms, x, half, tuple(trials), tuple(believed), delay, creeps
            )


def _candidates(
    so_far: Between, motions: tuple[Motion, ...], waves: bool
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
    """Take the friction found off every contact's torque, and look for its slip."""
    x = coefficients(terms, motions)
    for i in 2 * [i for i, t in enumerate(terms) if t.shape]:
        so_far = Between(terms, x, x, (), ())
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


def _without_friction(term: Term, so_far: Between) -> Term:
    """Return a contact that feels the torque without the friction found so far."""
    give = so_far.value(WOUND, "compliance_rad_per_nm")
    if term.effect != "hysteresis" or give <= 0.0:
        return term
    turns = [t.shape[0] for t in so_far.terms if t.effect == FRICTION and t.shape]
    constant = so_far.value(FRICTION, "friction_rad") / give
    factor = so_far.value(FRICTION, "friction_s") / give
    return replace(term, shape=(term.shape[0], constant, factor, (turns or [1.0])[0]))
