"""Where second encoders alone watched a moving arm, they are what is compared."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from bench.recording import Recording
from scenarios.diagnosing.schema import Answer, Detected, Left, Remark
from scenarios.two_encoders.answer import answer_of
from scenarios.two_encoders.compared import compared
from scenarios.two_encoders.patching import patched
from scenarios.two_encoders.report import first_sentence
from scenarios.two_encoders.writing import refused, written
from stiffness.diagnosis.flips import SMALLEST
from stiffness.two_encoders.motions import axes_read_twice

OFF = 0.2
"""How far the slope of one encoder over the other may be from 1; chosen: no gear winds
up by a fifth of its way."""


def is_called_for(recording: Recording) -> bool:
    """Return whether a stream has second encoders and no target that was tracked."""
    return (
        recording.rows == "stream"
        and not recording.markers
        and bool(axes_read_twice(recording))
    )


def carried_out(recording: Recording, model: Path, out: Path) -> tuple[Answer, str]:
    """Compare the encoders and write what was found.

    Args:
        recording: A stream, every axis' motions told apart by `pose`.
        model: The arm's file, for the simulator.
        out: Folder for the answer.

    Returns:
        The answer, and what was found in one sentence.

    Raises:
        Unusable: Where an axis was not read twice in three motions, or none was.
    """
    started = time.perf_counter()
    mistakes = tuple(_mistakes(recording))
    if mistakes:
        answer = _unnamed(recording, mistakes, time.perf_counter() - started)
        refused(out, answer)
        return answer, " ".join(m.text for m in mistakes)
    axes = compared(recording, model)
    answer = answer_of(recording.name, axes, time.perf_counter() - started)
    patch = patched(axes, recording, model) if answer.named else None
    written(out, axes, answer, patch)
    return answer, first_sentence(axes, answer)


def _mistakes(recording: Recording) -> Iterator[Remark]:
    """Say which second encoders do not follow the first ones one to one."""
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


def _unnamed(
    recording: Recording, mistakes: tuple[Remark, ...], seconds: float
) -> Answer:
    text = "a mistake of the set-up, to be mended first"
    return Answer(
        schema=1,
        recording=recording.name,
        verdict="unexplained",
        detection=Detected(SMALLEST, None, None, None),
        located=(),
        explained_share=None,
        named=(),
        rivals=(),
        unexplained=Left(mistakes[0].where, text, {}, None),
        confounded=(),
        warnings=mistakes,
        proof_requested=True,
        proof=None,
        next_experiments=(),
        seconds=round(seconds, 1),
    )
