"""A load moves an arm its own way; an arm that moves against it was read wrongly.

==========  ==========================================================================
Equation    rms that `followed_load` leaves under each reading of the files
Source      enumeration
Valid       a measured wrench that changes within visits
Ignores     everything that gives way but the axes
==========  ==========================================================================
"""

from collections.abc import Iterable

import numpy as np

from bench.errors import BenchError
from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.diagnosis.diagnosis import Warned
from stiffness.diagnosis.first_frames import first_frames
from stiffness.diagnosis.followed_load import EXPLAINS, Fit, followed
from stiffness.diagnosis.other_columns import of_columns, of_rows
from stiffness.diagnosis.other_loads import of_loads
from stiffness.diagnosis.readings import Frames
from stiffness.diagnosis.set_up_sizes import of_sag, of_size

PAIRS = 200
"""Pairs of rows that this looks at; chosen for time."""
LOUD = 3.0
"""Deflection over noise, both rms, from which it can be judged; chosen."""
BETTER = 2.0
"""Factor in rms by which another reading must fit better; chosen."""
RIGHT = 0.05
"""Share of the deflection, in rms, that a reading may leave and is not doubted; chosen:
a slip leaves all of an axis' or a component's, and that seldom is a twentieth."""
ALIKE = 0.9
"""Rms over that of a reading told before from which this one fits alike; chosen."""


def mistakes_of_loads(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Return the gross mistake that differences within visits show.

    Args:
        recording: With markers and a tracker.
        arm: The nominal arm, with the recording's names.
    """
    if recording.wrench is None or recording.wrench_sensor is None:
        return ()
    pairs = _pairs(recording)
    try:
        frames = first_frames(arm, recording, np.zeros(len(arm.axes)))
    except BenchError:
        return ()
    some = recording.take(pairs)
    written = followed(some, arm, frames) if len(pairs) else None
    assert recording.tracker is not None
    noise = float(np.sqrt(2.0 * np.sum(recording.tracker.repeatability**2)))
    if written is None or written.whole < LOUD * noise:
        return ()
    answer = None
    if written.left > RIGHT * written.whole:
        others = [*of_loads(some, arm), *of_columns(some)]
        if recording.rows == "plateaus":
            others += [(warned, r.take(pairs)) for warned, r in of_rows(recording)]
        answer = _better(others, written, arm, frames)
    if answer is None:
        answer = of_size(some, arm, written) or of_sag(recording, arm, frames, written)
    return () if answer is None else (answer,)


def _pairs(recording: Recording) -> np.ndarray:
    """Return the first row of a visit and another of it, in turn.

    All rows count: by the least and the largest load alone a wrench that is one row
    off can look reversed.
    """
    visit = recording.visit
    first, where = np.unique(visit, return_index=True, return_inverse=True)[1:]
    longest = max(int(np.bincount(where).max()) - 1, 1)
    every = max(1, -(-len(first) * longest // PAIRS))
    rows = np.flatnonzero(
        (first[where] != np.arange(len(visit))) & (where % every == 0)
    )
    rows = rows[:: -(-len(rows) // PAIRS) or 1]
    return np.stack([first[where[rows]], rows], axis=1).ravel()


def _better(
    others: Iterable[tuple[Warned, Recording]], written: Fit, arm: Arm, frames: Frames
) -> Warned | None:
    """Return what is said of the reading that fits best, if any is believed."""
    best, answer = written.left / BETTER, None
    for warned, other in others:
        fit = followed(other, arm, frames)
        if fit is not None and fit.left < best and fit.explained > EXPLAINS:
            best, answer = ALIKE * fit.left, warned
    return answer
