"""What lies between two encoders is put into the fixed form of diagnosis.json."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.stats import norm

from bench.proving.channels import explained_share
from scenarios.diagnosing.schema import (
    Answer,
    At,
    Detected,
    Interval,
    Placed,
    Proved,
)
from scenarios.diagnosing.verdict import Findings, verdict_of
from scenarios.two_encoders.axis import Axis, whole_rms
from scenarios.two_encoders.naming import ALPHA, called, depends_on, score
from scenarios.two_encoders.remarks import remarks
from scenarios.two_encoders.unexplained import unexplained
from stiffness.two_encoders.judging import BORROWED

URAD = 1e6


def answer_of(name: str, axes: Sequence[Axis], seconds: float) -> Answer:
    """Put all axes together."""
    p = min(1.0, len(axes) * min(map(_p_value, axes)))
    named = tuple(c for a in axes for c in called(a)) if p < ALPHA else ()
    more = len(axes) * min(a.beyond_after for a in axes) < ALPHA
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
    verdict = verdict_of(Findings(p < ALPHA, bool(named), not more, True, entry, share))
    open_ = verdict not in ("no_mismatch", "explained")
    return Answer(
        schema=1,
        recording=name,
        verdict=verdict,
        detection=Detected(p, None, None, None),
        located=_located(axes) if p < ALPHA else (),
        explained_share=share,
        named=named,
        rivals=(),
        unexplained=unexplained(axes) if open_ else None,
        confounded=tuple(dict.fromkeys(_confounded(axes))),
        warnings=tuple(remarks(axes, named)),
        proof_requested=True,
        proof=entry,
        next_experiments=(),
        seconds=round(seconds, 1),
    )


def _p_value(axis: Axis) -> float:
    """Return that of the axis being as simulated: by its noise and by its names."""
    named = float(norm.sf(score(axis))) if score(axis) > 0.0 else 1.0
    return min(axis.beyond_before, named)


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
        if called(a) or _p_value(a) < ALPHA
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
    """Return the share of what noise does not explain; None without stated noise."""
    if not all(a.stated for a in axes):
        return None
    both, rows = _squares(axes)
    counts = [len(np.bincount(a.judged.stretches())) for a in axes]
    noise = rows * np.repeat([a.noise**2 for a in axes], counts)
    share = explained_share(both[0], both[1], noise, rows.astype(float))
    return None if share is None else Interval(share.estimate, share.low, share.high)


def _squares(axes: Sequence[Axis]) -> tuple[np.ndarray, np.ndarray]:
    """Return sums of squares before and after, and rows, of every stretch of time."""
    squares, count = [], []
    for a in axes:
        cut = a.judged.stretches()
        squares.append([np.bincount(cut, r**2) for r in (a.before, a.after)])
        count.append(np.bincount(cut))
    return np.concatenate(squares, axis=1), np.concatenate(count)


def _gain(axes: Sequence[Axis]) -> Interval:
    """Return the gain and its interval; stretches of time are drawn anew."""
    both, rows = _squares(axes)
    drawn = np.random.default_rng(0).integers(len(rows), size=(1999, len(rows)))
    size = np.sqrt(both[:, drawn].sum(axis=2) / rows[drawn].sum(axis=1))
    low, high = np.quantile(size[0] - size[1], [0.025, 0.975])
    gain = np.sqrt(both.sum(axis=1) / rows.sum()) @ [1.0, -1.0]
    return Interval(URAD * float(gain), URAD * float(low), URAD * float(high))
