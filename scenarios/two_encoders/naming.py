"""What is believed between encoders gets the vocabulary's names and parameters."""

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace
from scipy.stats import norm

from scenarios.diagnosing.schema import Called, Interval
from scenarios.two_encoders.axis import Axis
from stiffness.two_encoders.found import Trial
from stiffness.two_encoders.judging import orders_alike
from stiffness.two_encoders.terms import FRICTION, WOUND, Term

ALPHA = 0.005
"""Below this p-value there is something."""
SUREST = 0.9999
DEPENDS = {
    "channel_delay": ("time", "direction"),
    "transmission_error": ("angle",),
    "joint_compliance": ("torque",),
    "hysteresis": ("torque", "history"),
    "lost_motion": ("direction",),
}


def called(axis: Axis) -> list[Called]:
    """Return what was named of an axis; contacts that slip are one hysteresis."""
    found, names = axis.found, []
    if found.late is not None:
        known = {"delay_s": _interval(found.delay, found.late_half)}
        if found.at_least:
            known = {"delay_s": replace(known["delay_s"], high=None)}
        names.append(_name("channel_delay", axis, found.late, known))
    names += [*_spring(axis), *_widths(axis), *_waves(axis)]
    return names


def depends_on(axis: Axis) -> tuple[str, ...]:
    """Return what an axis' difference depends on."""
    kinds = [n.effect for n in called(axis)]
    return tuple(dict.fromkeys(d for kind in kinds for d in DEPENDS[kind]))


def score(axis: Axis) -> float:
    """Return how many standard errors the surest name gains; 0: none was believed."""
    late = [] if axis.found.late is None else [axis.found.late]
    named = [t for t in axis.found.believed if t.term.effect != FRICTION]
    if axis.is_nominal_spring:
        named = [t for t in named if t.term.effect != WOUND]
    return max(map(_z, [*late, *named]), default=0.0)


def contradicts(axis: Axis) -> bool:
    """Return whether a spring that the model has is not there, or far off."""
    return (
        axis.model_give > 0.0
        and axis.give is not None
        and not axis.is_nominal_spring
        and axis.beyond_before < ALPHA
    )


def columns_of(axis: Axis) -> Iterator[tuple[Term, Trial, np.ndarray, np.ndarray]]:
    """Yield every term with its trial, its coefficients and half their intervals."""
    found, i = axis.found, 0
    for term, trial in zip(found.terms, found.believed, strict=True):
        width = len(term.parameters)
        yield term, trial, found.x[i : i + width], found.half[i : i + width]
        i += width


def _spring(axis: Axis) -> Iterator[Called]:
    wound = [c for c in columns_of(axis) if c[0].effect == WOUND]
    for term, trial, x, half in wound:
        if not axis.is_nominal_spring:
            known = {term.parameters[0]: _interval(float(x[0]), float(half[0]))}
            yield _name(WOUND, axis, trial, known)
    if not wound and contradicts(axis) and axis.give is not None:
        give, half = axis.give
        sure = min(1.0 - axis.beyond_before, SUREST)
        high = max(give + half, 0.0)
        known = Interval(max(give, 0.0), max(give - half, 0.0), high)
        yield Called(WOUND, axis.name, sure, (), {"compliance_rad_per_nm": known})


def _widths(axis: Axis) -> Iterator[Called]:
    for effect in ("hysteresis", "lost_motion"):
        own = [c for c in columns_of(axis) if c[0].effect == effect]
        if own:
            width = sum(float(x[0]) for _, _, x, _ in own)
            half = float(np.hypot.reduce([h[0] for *_, h in own]))
            surest = max((trial for _, trial, _, _ in own), key=_z)
            yield _name(effect, axis, surest, {"width_rad": _interval(width, half)})


def _waves(axis: Axis) -> list[Called]:
    """Return all waves of a gear, the largest first."""
    waves = []
    for term, trial, x, half in columns_of(axis):
        if term.order:
            size, spread = float(np.hypot(*x)), float(half.max())
            low, high = orders_alike(axis.found, axis.fitted, term)
            phase = float(np.arctan2(x[0], x[1]))
            known = {
                "amplitude_rad": _interval(size, spread),
                "order": Interval(term.order, low, high),
                "phase_rad": _interval(phase, spread / size),
            }
            waves.append((size, _name(term.effect, axis, trial, known)))
    return [name for _, name in sorted(waves, key=lambda w: -w[0])]


def _name(effect: str, axis: Axis, trial: Trial, known: dict[str, Interval]) -> Called:
    sure = float(np.clip(norm.cdf(_z(trial)), 0.0, SUREST))
    return Called(effect, axis.name, sure, (), known)


def _interval(value: float, half: float) -> Interval:
    return Interval(value, value - half, value + half)


def _z(trial: Trial) -> float:
    return trial.gain / max(trial.error, np.finfo(float).tiny)
