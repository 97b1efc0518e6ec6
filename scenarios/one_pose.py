"""A stream of one pose is one reading: a diagnosis counts poses, not instants."""

import numpy as np

from bench.format.plausible import SAME_POSTURE
from bench.recording import Recording
from stiffness.two_encoders.motions import FEWEST

SLIDE = 1e-4
"""Way from which a slide has moved, in m; chosen: a tenth of what a limit allows."""


def said_of_one_pose(recording: Recording) -> tuple[str, ...]:
    """Say what to do with a stream that is all one pose though the arm moves."""
    r = recording
    way = np.ptp(r.posture, axis=0)
    least = np.where(np.resize(r.slides or (False,), way.shape), SLIDE, SAME_POSTURE)
    if r.rows != "stream" or len(np.unique(r.pose)) > 1 or np.all(way <= least):
        return ()
    encoders = r.link_posture is not None and not r.markers
    number = "give each motion a number of its own as its `pose`"
    if encoders:
        what = f"{number}, {FEWEST} motions or more."
    else:
        what = (
            "where the arm stopped, add [rests] to the mapping (speed_deg_per_s = 0.05,"
            f" hold_s = 1.0) and import it again; where it never stopped, {number}."
        )
    return (
        f"all {len(r.time)} instants of this stream are one pose, though the arm moves,"
        f" and a diagnosis counts poses: {what}",
    )
