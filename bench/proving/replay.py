"""What was done to an arm can be done again: postures, wrenches, and for how long.

Rows become steps of a visit. Where a load changed a while after the reading before,
the load before goes on acting unread until then; visits shorter than the longest end
in steps that nobody reads.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from bench.recording import Recording

SAME = 1e-7
"""Change of a posture within a visit that is none, in rad; chosen: an encoder's last
digit."""
QUICK = 1e-9
"""How long a step lasts that nobody reads, in s."""
SOON = 1e-3
"""Share of a hold that may pass before the load changes; chosen: no creep shows it."""


@dataclass(frozen=True)
class Replay:
    """Visits, each of the same number of steps.

    Attributes:
        posture: Of each visit, in rad (slides in m).
        row: Whose wrench acts in each step.
        read: Whether that row is read at the end of the step.
        hold: For how long each step lasts, in s.
        visit: Index of each row's stay, from 0, by which differences are taken.
    """

    posture: Float[np.ndarray, "visits axes"]
    row: Int[np.ndarray, "visits steps"]
    read: Bool[np.ndarray, "visits steps"]
    hold: Float[np.ndarray, "visits steps"]
    visit: Int[np.ndarray, " rows"]

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(self.visit)

    def to_rows(self, values: np.ndarray) -> np.ndarray:
        """Bring values of all steps, visit after visit, back to the rows."""
        order = np.empty(self.rows, dtype=int)
        order[self.row[self.read]] = np.flatnonzero(self.read.ravel())
        return values[order]


def replay_of(recording: Recording, waits: bool = True) -> Replay:
    """Lay out what was done.

    Args:
        recording: With at least one row.
        waits: Whether time matters, that is whether anything creeps.
    """
    visit = np.unique(recording.visit, return_inverse=True)[1]
    starts = np.flatnonzero(np.diff(visit, prepend=-1))
    stays = np.split(np.arange(len(visit)), starts[1:])
    posture = recording.posture
    still = all(np.ptp(posture[rows], axis=0).max() < SAME for rows in stays)
    if not still:  # a stream: each instant is a state of its own
        stays = [np.array([row]) for row in range(len(visit))]
    steps = [_steps(recording, rows, waits) for rows in stays]
    longest = max(len(s) for s in steps)
    shape = (len(stays), longest)
    row, read, hold = np.zeros(shape, int), np.zeros(shape, bool), np.zeros(shape)
    for v, course in enumerate(steps):
        own = list(zip(*course, strict=True))
        row[v], hold[v] = own[0][-1], QUICK
        row[v, : len(course)], read[v, : len(course)], hold[v, : len(course)] = own
    first = np.array([rows[0] for rows in stays])
    return Replay(posture[first], row, read, np.maximum(hold, QUICK), visit)


def _steps(
    recording: Recording, rows: np.ndarray, waits: bool
) -> list[tuple[int, bool, float]]:
    """Return whose wrench acts, whether it is read, and for how long, step by step."""
    time, changed = recording.time, recording.load_time
    course: list[tuple[int, bool, float]] = []
    before: int | None = None
    for row in rows:
        begins = float(changed[row] if before is None else time[before])
        change = float(np.clip(changed[row], begins, time[row]))
        total = float(time[row] - begins)
        if before is not None and waits and change - begins > SOON * total:
            course.append((before, False, float(change - begins)))
            total = float(time[row] - change)
        course.append((int(row), True, total))
        before = int(row)
    return course
