"""What is added to the KR300's second encoders, and what is found of it."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.recording import Recording
from stiffness.two_encoders.delays import across
from stiffness.two_encoders.found import Between
from stiffness.two_encoders.motions import Motion, motions_of
from stiffness.two_encoders.terms import FRICTION, LATE, Term


@dataclass(frozen=True)
class Added:
    """An effect that is put into one axis.

    Attributes:
        effect: Its name.
        axis: Counted from 0.
        parameter: Reported in SI.
        size: What is added.
        change: From a motion to what it adds to the second encoder, in rad.
    """

    effect: str
    axis: int
    parameter: str
    size: float
    change: Callable[[Motion], Float[np.ndarray, " rows"]]


ORDER = 61.0
"""Of the wave that is added; chosen: no multiple of what was found."""
ADDED = tuple(
    Added(effect, axis, parameter, size, change)
    for axis in range(3)
    for effect, parameter, size, change in (
        ("channel_delay", "delay_s", 2e-3, lambda m: _late(m, 2e-3)),
        (
            "joint_compliance", "compliance_rad_per_nm", 5e-7,
            lambda m: -5e-7 * np.asarray(m.torque),
        ),
        (
            "lost_motion", "width_rad", 4e-4,
            lambda m: -2e-4 * np.sign(np.where(np.abs(m.speed) < 1e-3, 0.0, m.speed)),
        ),
        (
            "transmission_error", "amplitude_rad", 1.5e-4,
            lambda m: 1.5e-4 * np.sin(ORDER * m.angle + 0.5),
        ),
    )
)  # fmt: skip
"""Every effect on every axis that is read twice."""


def rows(recording: Recording) -> Iterator[dict[str, object]]:
    """Yield a row of the table for each effect that is added."""
    fit = {k: own[:-1] for k, own in motions_of(recording).items()}
    plain = across(fit)
    for added in ADDED:
        changed = tuple(
            replace(m, apart=_centred(m.apart + added.change(m)))
            for m in fit[added.axis]
        )
        found = across({**fit, added.axis: changed})
        yield _row(added, plain[added.axis], found[added.axis])


def _row(added: Added, before: Between, after: Between) -> dict[str, object]:
    known = _size(before, added)[0]
    named, (value, half) = _is_there(after, added), _size(after, added)
    news = _effects(after) - _effects(before)
    return {
        "recording": "real_kr300",
        "effect": added.effect,
        "where": f"a{added.axis + 1}",
        "parameter": added.parameter,
        "added": added.size,
        "named": named,
        "found_more": value - known if named else 0.0,
        "low": value - half - known if named else 0.0,
        "high": value + half - known if named else 0.0,
        "before": known,
        "also_named": " ".join(sorted(news - {added.effect})),
    }


def _effects(found: Between) -> set[str]:
    late = {LATE.effect} if found.late is not None else set()
    return {t.effect for t in found.terms} - {FRICTION} | late


def _is_there(found: Between, added: Added) -> bool:
    late = added.effect == LATE.effect and found.late is not None
    return late or any(_same(term, added) for term in found.terms)


def _same(term: Term, added: Added) -> bool:
    near = not term.order or abs(term.order - ORDER) <= 1.0
    return term.effect == added.effect and near


def _size(found: Between, added: Added) -> tuple[float, float]:
    """Return the coefficient and half its interval; zeros where it is not there."""
    if added.effect == LATE.effect:
        return found.delay, found.late_half
    i = 0
    for term in found.terms:
        x = found.x[i : i + len(term.parameters)]
        own = found.half[i : i + len(x)]
        half = float(own.max() if term.order else own[0])
        i += len(x)
        if _same(term, added):
            return float(np.hypot(*x)) if term.order else float(x[0]), half
    return 0.0, 0.0


def _late(motion: Motion, delay: float) -> Float[np.ndarray, " rows"]:
    angle = motion.angle + motion.apart
    return np.interp(motion.time - delay, motion.time, angle) - angle


def _centred(values: Float[np.ndarray, " rows"]) -> Float[np.ndarray, " rows"]:
    return values - values.mean()
