"""What lies between two encoders is put into the fixed form of diagnosis.json."""

from collections.abc import Sequence

import numpy as np
from scipy.stats import norm

from scenarios.diagnosing.schema import (
    Answer,
    At,
    Called,
    Detected,
    Interval,
    Left,
    Placed,
    Proved,
    Remark,
)
from scenarios.two_encoders.compared import Axis, whole_rms
from stiffness.two_encoders.judging import Trial

URAD = 1e6
ALPHA = 0.005
"""Below this p-value there is something."""
DEPENDS = {
    "channel_delay": ("time", "direction"),
    "transmission_error": ("angle",),
    "joint_compliance": ("torque",),
    "lost_motion": ("direction",),
}


def answer_of(name: str, axes: Sequence[Axis], seconds: float) -> Answer:
    """Put all axes together."""
    before = np.concatenate([a.before for a in axes])
    after = np.concatenate([a.after for a in axes])
    total = float(before @ before)
    named = tuple(c for a in axes for c in _called(a))
    gain = _gain(axes)
    worst = max(axes, key=lambda a: whole_rms(a.after))
    p = min(float(norm.sf(max(map(_z, a.found.believed), default=0.0))) for a in axes)
    named = named if p < ALPHA else ()
    left = None
    if named:
        text = (
            "slow, alike in motions that pass the same torques and angles, but of "
            "another size in each: neither torque nor direction explains it on "
            "motions left out"
        )
        left = Left(worst.name, text, {}, None)
    return Answer(
        schema=1,
        recording=name,
        verdict="partly_explained" if named else "no_mismatch",
        detection=Detected(p, None, None, None),
        located=tuple(
            Placed(
                a.name,
                float(norm.sf(max(map(_z, a.found.believed)))),
                float((a.before @ a.before - a.after @ a.after) / total),
                tuple(
                    dict.fromkeys(d for t in a.found.terms for d in DEPENDS[t.effect])
                ),
                "while the axis moves",
            )
            for a in sorted(axes, key=lambda a: -float(a.before @ a.before))
            if named and a.found.believed
        ),
        named=named,
        rivals=(),
        unexplained=left,
        confounded=tuple(
            (At("joint_compliance", a.name), At("channel_delay", a.name))
            for a in axes
            for t in a.found.refused
            if t.term.effect == "joint_compliance" and "lives on" in t.reason
        ),
        warnings=tuple(
            Remark("refused", a.name, f"{t.term.effect} is not named: {t.reason}.")
            for a in axes
            for t in a.found.refused
            if not t.term.order
        ),
        proof=Proved(
            simulator="mujoco",
            held_out_poses=1,
            before_rms_urad=URAD * whole_rms(before),
            after_rms_urad=URAD * whole_rms(after),
            noise_rms_urad=None,
            gain_urad=gain,
        ),
        next_experiments=(),
        seconds=round(seconds, 1),
    )


def _called(axis: Axis) -> list[Called]:
    """Return what was named; of waves the largest stands for all."""
    found, i, names, waves = axis.found, 0, [], []
    for term, trial in zip(found.terms, found.believed, strict=True):
        width = len(term.parameters)
        x, half = found.x[i : i + width], found.half[i : i + width]
        i += width
        sure = float(np.clip(norm.cdf(_z(trial)), 0.0, 0.9999))
        if term.order:
            waves.append((float(np.hypot(*x)), term.order, x, float(half.max()), sure))
        else:
            known = {term.parameters[0]: _interval(float(x[0]), float(half[0]))}
            names.append(Called(term.effect, axis.name, sure, (), known))
    if waves:
        size, order, x, half, sure = max(waves, key=lambda w: w[0])
        phase = float(np.arctan2(x[0], x[1]))
        known = {
            "amplitude_rad": _interval(size, half),
            "order": Interval(order, order - 0.5, order + 0.5),
            "phase_rad": _interval(phase, half / size),
        }
        names.append(Called("transmission_error", axis.name, sure, (), known))
    return names


def _gain(axes: Sequence[Axis]) -> Interval:
    """Return the gain and its interval; stretches of time are drawn anew."""
    squares, count = [], []
    for a in axes:
        cut = a.judged.stretches()
        squares.append([np.bincount(cut, r**2) for r in (a.before, a.after)])
        count.append(np.bincount(cut))
    both, rows = np.concatenate(squares, axis=1), np.concatenate(count)
    drawn = np.random.default_rng(0).integers(len(rows), size=(1999, len(rows)))
    size = np.sqrt(both[:, drawn].sum(axis=2) / rows[drawn].sum(axis=1))
    low, high = np.quantile(size[0] - size[1], [0.025, 0.975])
    gain = np.sqrt(both.sum(axis=1) / rows.sum()) @ [1.0, -1.0]
    return Interval(URAD * float(gain), URAD * float(low), URAD * float(high))


def _interval(value: float, half: float) -> Interval:
    return Interval(value, value - half, value + half)


def _z(trial: Trial) -> float:
    return trial.gain / trial.error
