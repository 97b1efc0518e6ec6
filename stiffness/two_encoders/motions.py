"""A motion is one run of a stream, read on both sides of one gear."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.errors import Unusable
from bench.recording import Recording

FEWEST = 3
"""Motions of an axis: two are fitted, one judges."""
SHORTEST = 50
"""Rows of a motion; chosen: fewer hold no ten stretches of time."""
STRETCHES = 10
"""Stretches of time that a motion is cut into; what is left in one hangs together."""


@dataclass(frozen=True)
class Motion:
    """One axis during one motion.

    Attributes:
        pose: Id of the motion.
        time: Since the start of the recording, in s.
        angle: Before the gear, referred to the axis, in rad.
        speed: Of it, in rad/s.
        torque: Of the motor, output side, in N m; None where it was not read.
        apart: Angle after the gear less the one before it, mean taken off, in rad.
    """

    pose: int
    time: Float[np.ndarray, " rows"]
    angle: Float[np.ndarray, " rows"]
    speed: Float[np.ndarray, " rows"]
    torque: Float[np.ndarray, " rows"] | None
    apart: Float[np.ndarray, " rows"]

    def stretches(self) -> np.ndarray:
        """Return the number of the stretch that each row belongs to."""
        span = self.time[-1] - self.time[0]
        part = (self.time - self.time[0]) / span * STRETCHES
        return np.minimum(part.astype(int), STRETCHES - 1)


def motions_of(recording: Recording) -> dict[int, tuple[Motion, ...]]:
    """Return the motions of every axis that was read twice, in the order of time.

    Raises:
        Unusable: Where no axis was, or one not in `FEWEST` motions; with all faults.
    """
    faults = []
    if recording.rows != "stream":
        faults.append('rows are "plateaus"; two encoders are compared in a "stream".')
    axes = axes_read_twice(recording)
    if not axes:
        faults.append("no axis has an angle after its gear (a1_link_deg …).")
    every = {}
    if not faults:
        ids = np.unique(recording.pose)
        for axis in axes:
            found = [_motion(recording, axis, int(i)) for i in ids]
            motions = sorted((m for m in found if m), key=lambda m: m.time[0])
            every[axis] = tuple(motions)
            if len(motions) < FEWEST:
                faults.append(
                    f"a{axis + 1} has {len(motions)} motions of {SHORTEST} rows with "
                    "both encoders: two are fitted, one judges; give each motion a "
                    f"`pose` of its own, {FEWEST} or more."
                )
    if faults:
        raise Unusable(f"Recording {recording.name!r}", faults)
    return every


def axes_read_twice(recording: Recording) -> tuple[int, ...]:
    """Return the axes that were read on both sides of their gears."""
    if recording.link_posture is None:
        return ()
    seen = np.isfinite(recording.link_posture).any(axis=0)
    return tuple(int(k) for k in np.flatnonzero(seen))


def _motion(recording: Recording, axis: int, pose: int) -> Motion | None:
    assert recording.link_posture is not None
    link = recording.link_posture[:, axis]
    rows = np.flatnonzero((recording.pose == pose) & np.isfinite(link))
    if len(rows) < SHORTEST:
        return None
    time, angle = recording.time[rows], recording.posture[rows, axis]
    torque = recording.axis_torque
    apart = link[rows] - angle
    return Motion(
        pose=pose,
        time=time,
        angle=angle,
        speed=np.gradient(angle, time),
        torque=None if torque is None else torque[rows, axis],
        apart=apart - apart.mean(),
    )
