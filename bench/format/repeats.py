"""A row that repeats the one above, its time included, is one reading and not two."""

import numpy as np
from jaxtyping import Int

from bench.format.faults import SHOWN, Place
from bench.recording import Recording

READ = ("posture", "wrench", "points", "load_mass", "link_posture", "axis_torque")
MORE = ("temperature", "frames")


def repeats(recording: Recording) -> Int[np.ndarray, " repeats"]:
    """Return the rows that are the row above once more, in all that was read.

    Replicates are no repeats: they have a time of their own, or noise. In a stream,
    whose clock may be coarse and whose channels may stand still, nothing is one.
    """
    r = recording
    if r.rows != "plateaus":
        return np.zeros(0, dtype=int)
    same = (np.diff(r.time) == 0) & (np.diff(r.visit) == 0)
    for name in (*READ, *MORE):
        if (values := getattr(r, name)) is not None:
            flat = np.reshape(values, (len(r.time), -1))
            alike = (flat[1:] == flat[:-1]) | (np.isnan(flat[1:]) & np.isnan(flat[:-1]))
            same &= alike.all(axis=1)
    return np.flatnonzero(same) + 1


def said_of_repeats(place: Place, recording: Recording) -> list[str]:
    """Say where a whole file has a reading twice, and what to do."""
    rows = repeats(recording).tolist()
    said = [
        f"{place.row(r)}: the row above once more, with the same time and the same "
        "readings; it would count twice. Delete one, or give each its own time."
        for r in rows[:SHOWN]
    ]
    if len(rows) > SHOWN:
        said.append(f"{place.file}: and {len(rows) - SHOWN} more rows like these.")
    return said
