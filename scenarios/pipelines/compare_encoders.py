"""Compares the encoders before and after each gear, and fills in diagnosis.json.

`compare_encoders` is the whole comparison, for a stream with second encoders and no
tracked target; `answer_of` puts it into schema 1.
"""

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from scipy.stats import norm

from bench.patch import Patch
from bench.proof.explained_share import explained_share, percentile, resampled
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.recording import Recording
from bench.shared.settings import URAD
from scenarios.pipelines.encoder_axes import Axis, heldout_comparison, whole_rms
from scenarios.pipelines.patching import patch_of_encoders
from scenarios.pipelines.schema import (
    Answer,
    At,
    Called,
    Detected,
    Findings,
    Interval,
    Left,
    Placed,
    Proved,
    Refused,
    Remark,
    interval_of,
    verdict_of,
    wave_of,
    why_not,
)
from stiffness.diagnosis.result import Decision
from stiffness.dual_encoder.fit import (
    SHOWS,
    SelectionStep,
    correlation_time,
    explained_share_by,
)
from stiffness.dual_encoder.motions import axes_read_twice
from stiffness.dual_encoder.selection import BORROWED, orders_alike
from stiffness.dual_encoder.terms import FRICTION, WIDTHS, WOUND, Term
from stiffness.regression.testing import SIGNIFICANCE, SMALLEST

# --- Names and parameters -------------------------------------------------------------

SUREST = 0.9999


def called(axis: Axis) -> list[Called]:
    """Return the effects named at an axis; slip elements make one hysteresis."""
    found, names = axis.found, []
    if found.delay_step is not None:
        known = {"delay_s": _interval(found.delay, found.delay_half)}
        if found.at_least:
            known = {"delay_s": replace(known["delay_s"], high=None)}
        names.append(_name("channel_delay", axis, found.delay_step, known))
    names += [*_spring(axis), *_widths(axis), *_harmonics(axis)]
    return names


def depends_on(axis: Axis) -> tuple[str, ...]:
    """Return the quantities that the named effects of an axis depend on."""
    kinds = [n.effect for n in called(axis)]
    return tuple(dict.fromkeys(d for kind in kinds for d in CATALOGUE[kind].depends_on))


def max_significance(axis: Axis) -> float:
    """Return the largest gain of a name in standard errors; 0: nothing is named."""
    late = [] if axis.found.delay_step is None else [axis.found.delay_step]
    named = [t for t in axis.found.believed if t.term.effect != FRICTION]
    if axis.is_nominal_spring:
        named = [t for t in named if t.term.effect != WOUND]
    return max(map(_z, [*late, *named]), default=0.0)


def contradicts(axis: Axis) -> bool:
    """Return whether the recording contradicts the model's spring by over a decade."""
    return (
        axis.model_compliance > 0.0
        and axis.compliance is not None
        and not axis.is_nominal_spring
        and axis.p_value_before < SIGNIFICANCE
    )


def columns_of(
    axis: Axis,
) -> Iterator[tuple[Term, SelectionStep, np.ndarray, np.ndarray]]:
    """Yield each term with its selection step, coefficients and half intervals."""
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
    if not wound and contradicts(axis) and axis.compliance is not None:
        compliance, half = axis.compliance
        sure = min(1.0 - axis.p_value_before, SUREST)
        high = max(compliance + half, 0.0)
        known = Interval(max(compliance, 0.0), max(compliance - half, 0.0), high)
        yield Called(WOUND, axis.name, sure, (), {"compliance_rad_per_nm": known})


def _widths(axis: Axis) -> Iterator[Called]:
    for effect, size in WIDTHS.items():
        own = [c for c in columns_of(axis) if c[0].effect == effect]
        if own:
            width = sum(float(x[0]) for _, _, x, _ in own)
            half = float(np.hypot.reduce([h[0] for *_, h in own]))
            surest = max((trial for _, trial, _, _ in own), key=_z)
            named = _name(effect, axis, surest, {size: _interval(width, half)})
            if effect == "lost_motion":  # a report that leads does the same
                lag = At("reading_lag", axis.name)
                named = replace(named, equivalents=(lag,))
            yield named


def _harmonics(axis: Axis) -> list[Called]:
    """Return all harmonics of a gear as transmission errors, the largest first."""
    waves = []
    for term, trial, x, half in columns_of(axis):
        if term.order:
            size, spread = float(np.hypot(*x)), float(half.max())
            low, high = orders_alike(axis.found, axis.fitted, term)
            phase = float(np.arctan2(x[0], x[1]))
            known = wave_of(size, spread, Interval(term.order, low, high), phase)
            waves.append((size, _name(term.effect, axis, trial, known)))
    return [name for _, name in sorted(waves, key=lambda w: -w[0])]


def _name(
    effect: str, axis: Axis, trial: SelectionStep, known: dict[str, Interval]
) -> Called:
    sure = float(np.clip(norm.cdf(_z(trial)), 0.0, SUREST))
    return Called(effect, axis.name, sure, (), known)


def _interval(value: float, half: float) -> Interval:
    return Interval(value, value - half, value + half)


def _z(trial: SelectionStep) -> float:
    return trial.gain / max(trial.error, np.finfo(float).tiny)


# --- What no name explains ------------------------------------------------------------


def unexplained(axes: Sequence[Axis]) -> Left:
    """Describe the residual of the axis whose residual is the largest.

    Its size, what it is correlated with, and how long it keeps its sign.
    """
    worst = max(axes, key=lambda a: whole_rms(a.after))
    left = [worst.found.residual(m) for m in worst.fitted]
    shares = explained_share_by(left, worst.fitted, worst.after, worst.judged)
    goes = [f"{100 * s:.0f} % with {x}" for x, s in shares.items() if s >= SHOWS]
    how = f"as in the other motions it goes {' and '.join(goes)}"
    if not goes:
        how = f"it goes with {', '.join(shares)} otherwise than in the other motions"
    whose = "stated" if worst.stated else "of noise from row to row"
    text = (
        f"{URAD * whole_rms(worst.after):.1f} µrad rms of the judged motion beside "
        f"{URAD * worst.noise:.1f} µrad {whose}; {how}; it keeps its sign for "
        f"{correlation_time(worst.after, worst.judged):.2f} s"
    )
    return Left(worst.name, f"{text}.{_help(worst)}", {}, None)


def _help(a: Axis) -> str:
    if a.judged.measured:
        return ""
    return f" A column {a.name}_tau_nm would help, or masses as they are."


# --- Notices --------------------------------------------------------------------------

MIN_EXPLAINED = 0.5
"""Share that a wind-up must explain before the torque's sign is questioned; chosen."""


def notices(axes: Sequence[Axis], named: Sequence[Called]) -> Iterator[Remark]:
    """Yield warnings on torques, springs, orders of harmonics and refused terms."""
    for a in axes:
        if _torque(a):
            yield Remark("torque", a.name, _torque(a))
    yield from _doubts(axes, named)
    yield from _refused(axes)


def _doubts(axes: Sequence[Axis], named: Sequence[Called]) -> Iterator[Remark]:
    for a in axes:
        if contradicts(a) and a.compliance is not None:
            text = (
                f"the model's spring at {a.name} has {1.0 / a.model_compliance:.3g} "
                "N m/rad, the recording winds up by "
                f"{1e6 * max(a.compliance[0], 0.0):.3g} ± {1e6 * a.compliance[1]:.2g} "
                f"µrad/(N m) where that makes {1e6 * a.model_compliance:.3g}."
            )
            yield Remark("spring", a.name, text)
        if any(t.term.effect == WOUND and _backwards(t) for t in a.found.refused):
            text = (
                f"{a.name} would wind up against its torque: turn the sign of the "
                f"column {a.name}_tau_nm, which is positive where the motor drives the "
                "axis the way its angle grows."
            )
            yield Remark("torque_sign", a.name, text)
    if any(a.found.at_least for a in axes):
        text = (
            "the delay is the least that no axis contradicts: friction that grows with "
            "speed in the torque of every motor that winds up its gear may hide more."
        )
        yield Remark("delay", axes[0].name, text)
    for n in named:
        order = n.parameters.get("order")
        if order is not None and _wide(order):
            text = (
                f"orders {order.low:g} to {order.high:g} do as well as "
                f"{order.estimate:g}: {n.where} passes too little of a wave to tell."
            )
            yield Remark("order", n.where, text)


def _backwards(trial: SelectionStep) -> bool:
    """Return whether a negative compliance would explain most of the difference."""
    return trial.coefficients[0] < 0.0 and trial.gain > MIN_EXPLAINED


def _wide(order: Interval) -> bool:
    assert isinstance(order.low, float) and isinstance(order.high, float)
    return order.high - order.low > 1.0


def _refused(axes: Sequence[Axis]) -> Iterator[Remark]:
    for a in axes:
        for t in a.found.refused:
            if not t.term.order:
                text = f"{t.term.effect} is not named: {t.reason}."
                yield Remark("refused", a.name, text)


def _torque(a: Axis) -> str:
    if not _known(a):
        return (
            f"no torque of {a.name} is known: a column {a.name}_tau_nm, or masses in "
            "the model, would tell its wind-up from other causes."
        )
    if not a.judged.measured:
        return (
            f"the torque of {a.name} was not read: it is worked out from the model's "
            "masses, so a load that they do not hold is not in it."
        )
    return ""


def _known(a: Axis) -> bool:
    torque = a.judged.torque
    return torque is not None and bool((torque != torque[0]).any())


# --- The entry in schema 1 ------------------------------------------------------------


def answer_of(name: str, axes: Sequence[Axis], seconds: float) -> Answer:
    """Return the comparison of all axes as an answer in schema 1."""
    p = min(1.0, len(axes) * min(map(_p_value, axes)))
    named = tuple(c for a in axes for c in called(a)) if p < SIGNIFICANCE else ()
    more = len(axes) * min(a.p_value_after for a in axes) < SIGNIFICANCE
    before = np.concatenate([a.before for a in axes])
    after = np.concatenate([a.after for a in axes])
    entry = Proved(
        simulator="mujoco",
        held_out_poses=1,
        before_rms_urad=URAD * whole_rms(before),
        after_rms_urad=URAD * whole_rms(after),
        noise_rms_urad=_noise(axes),
        gain_urad=_gain(axes),
    )
    share = _explained(axes)
    verdict = verdict_of(
        Findings(p < SIGNIFICANCE, bool(named), not more, True, entry, share)
    )
    open_ = verdict not in ("no_mismatch", "explained")
    return Answer(
        recording=name,
        verdict=verdict,
        detection=Detected(p, None, None, None),
        located=_located(axes) if p < SIGNIFICANCE else (),
        explained_share=share,
        named=named,
        unexplained=unexplained(axes) if open_ else None,
        confounded=tuple(dict.fromkeys(_confounded(axes))),
        warnings=tuple(notices(axes, named)),
        proof=entry,
        seconds=round(seconds, 1),
        refused=tuple(_refused_sizes(axes)),
    )


def _refused_sizes(axes: Sequence[Axis]) -> Iterator[Refused]:
    for a in axes:
        for t in a.found.refused:
            if t.term.effect != FRICTION and not t.term.order:
                sizes = zip(t.term.parameters, t.coefficients, strict=False)
                known = {name: Interval(v, None, None) for name, v in sizes}
                yield Refused(t.term.effect, a.name, known, t.reason)


def _p_value(axis: Axis) -> float:
    """Return the p-value of an axis being nominal, by its residual or its names.

    Twice the lesser of both; that of the names ignores that they were chosen.
    """
    named = (
        float(norm.sf(max_significance(axis))) if max_significance(axis) > 0.0 else 1.0
    )
    return min(1.0, 2.0 * min(axis.p_value_before, named))


def _located(axes: Sequence[Axis]) -> tuple[Placed, ...]:
    total = sum(float(a.before @ a.before) for a in axes)
    return tuple(
        Placed(
            a.name,
            _p_value(a),
            float((a.before @ a.before - a.after @ a.after) / total),
            depends_on(a),
            "while the axis moves",
        )
        for a in sorted(axes, key=lambda a: -float(a.before @ a.before))
        if called(a) or _p_value(a) < SIGNIFICANCE
    )


def _confounded(axes: Sequence[Axis]) -> Iterator[tuple[At, At]]:
    for a in axes:
        for t in a.found.refused:
            if t.reason.startswith(BORROWED):
                yield At("joint_compliance", a.name), At("channel_delay", a.name)


def _noise(axes: Sequence[Axis]) -> float | None:
    if not all(a.stated for a in axes):
        return None
    return URAD * float(np.sqrt(np.mean([a.noise**2 for a in axes])))


def _explained(axes: Sequence[Axis]) -> Interval | None:
    """Return the explained share of the part beyond noise; None: noise not stated."""
    if not all(a.stated for a in axes):
        return None
    both, rows = _squares(axes)
    counts = [len(np.bincount(a.judged.stretches())) for a in axes]
    noise = rows * np.repeat([a.noise**2 for a in axes], counts)
    share = explained_share(both[0], both[1], noise, rows.astype(float))
    return share and interval_of(share)


def _squares(axes: Sequence[Axis]) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of squares before and after, and rows, of every block of time."""
    squares, count = [], []
    for a in axes:
        cut = a.judged.stretches()
        squares.append([np.bincount(cut, r**2) for r in (a.before, a.after)])
        count.append(np.bincount(cut))
    return np.concatenate(squares, axis=1), np.concatenate(count)


def _gain(axes: Sequence[Axis]) -> Interval:
    """Return the gain in µrad and its interval by a bootstrap over blocks of time."""
    both, rows = _squares(axes)
    size = np.sqrt(resampled(both) / resampled(rows))
    gain = np.sqrt(both.sum(axis=1) / rows.sum()) @ [1.0, -1.0]
    return interval_of(percentile(gain, size[0] - size[1]), URAD)


# --- The comparison -------------------------------------------------------------------

OFF = 0.2
"""Largest difference from 1 of the slope of one encoder over the other; chosen: no gear
winds up by a fifth of its travel."""


@dataclass(frozen=True)
class ComparisonOutcome:
    """The axes, the answer and the patch of a comparison of encoders.

    Attributes:
        axes: Result of each axis; empty where the set-up is wrong.
        patch: For the simulator; None where nothing was named.
    """

    axes: tuple[Axis, ...]
    answer: Answer
    patch: Patch | None
    model: Path | None = None

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """The verdict on each term that was tried and refused, at each axis."""
        gate, nothing = "motions_left_out", math.nan
        return tuple(
            Decision((t.term.effect, a.name), gate, False, nothing, nothing, t.reason)
            for a in self.axes
            for t in a.found.refused
        )

    def why_not(self, effect: str, where: str) -> str:
        """Say why an effect was not named at an axis; see `schema.why_not`."""
        return why_not(self.answer, self.decisions, effect, where)


def compare_encoders(recording: Recording, model: Path) -> ComparisonOutcome:
    """Compare the encoders on both sides of each gear.

    The motions of the stream are told apart by `pose`.

    Raises:
        Unusable: Where an axis was not read twice in three motions, or none was.
    """
    started = time.perf_counter()
    mistakes = tuple(_mistakes(recording))
    if mistakes:
        answer = _stopped(recording, mistakes, time.perf_counter() - started)
        return ComparisonOutcome((), answer, None)
    axes = heldout_comparison(recording, model)
    answer = answer_of(recording.name, axes, time.perf_counter() - started)
    patch = patch_of_encoders(axes, recording, model) if answer.named else None
    return ComparisonOutcome(tuple(axes), answer, patch, model)


def _mistakes(recording: Recording) -> Iterator[Remark]:
    """Yield a warning for each second encoder that is not one to one with the first."""
    assert recording.link_posture is not None
    for k in axes_read_twice(recording):
        slope = _slope(recording.posture[:, k], recording.link_posture[:, k])
        name = f"a{k + 1}"
        if slope is None or abs(slope - 1.0) < OFF:
            continue
        if abs(slope + 1.0) < OFF:
            text = f"the second encoder of {name} looks reversed."
            yield Remark("axis_reversed", name, text)
        else:
            text = (
                f"the second encoder of {name} turns {slope:.3g} times as far as the "
                "first: another unit, another axis, or not referred to the axis?"
            )
            yield Remark("units", name, text)


def _slope(before: np.ndarray, after: np.ndarray) -> float | None:
    seen = np.isfinite(after)
    if seen.sum() < 2 or np.ptp(before[seen]) < np.radians(1.0):
        return None
    return float(np.polyfit(before[seen], after[seen], 1)[0])


def _stopped(
    recording: Recording, mistakes: tuple[Remark, ...], seconds: float
) -> Answer:
    text = "a mistake of the set-up, to be mended first"
    return Answer(
        recording=recording.name,
        verdict="unexplained",
        detection=Detected(SMALLEST, None, None, None),
        unexplained=Left(mistakes[0].where, text, {}, None),
        warnings=mistakes,
        seconds=round(seconds, 1),
    )
