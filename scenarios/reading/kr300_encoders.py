"""A KUKA KR300 whose first three axes carry a second encoder becomes a stream.

Motions A, B and C of github.com/JonasWeigand/Robot_Identification (MIT licence): 10 s
each, every 4 ms, no load but the arm's own weight.
"""

from pathlib import Path

import numpy as np
from scipy.io import loadmat

from bench.errors import Unusable
from bench.recording import UNLOADED, Recording

MOTIONS = ("A", "B", "C")
TWICE = 3
"""Axes that have a second encoder."""
BETWEEN = 60.0
"""Seconds between motions in the recording; chosen: the series does not say."""


def recording_of(folder: Path) -> Recording:
    """Read the three motions, one pose each, one after the other.

    Raises:
        Unusable: Where a file is not there or is another one.
    """
    faults, motions = [], []
    for name in MOTIONS:
        try:
            motions.append(_motion(folder / f"{name}.mat"))
        except (OSError, KeyError, AttributeError, ValueError, TypeError) as error:
            faults.append(f"{name}.mat: {error}.")
    if faults:
        raise Unusable(f"Folder {str(folder)!r}", faults)
    time, posture, after, torque = (
        np.concatenate(parts)
        for parts in zip(*_one_after_the_other(motions), strict=True)
    )
    motion = np.repeat(np.arange(len(MOTIONS)), [len(m[0]) for m in motions])
    link = np.full_like(posture, np.nan)
    link[:, :TWICE] = after[:, :TWICE]
    return Recording(
        name="KR300 with two encoders an axis, motions A, B, C",
        robot="KUKA KR300 R2500",
        time=time,
        pose=motion,
        visit=motion,
        posture=posture,
        load_time=time,
        stage=np.full(len(time), UNLOADED),
        link_posture=link,
        axis_torque=torque,
        rows="stream",
    )


def _motion(file: Path) -> tuple[np.ndarray, ...]:
    """Return time in s, angles before and after the gears in rad, torque in N m."""
    content = loadmat(file, squeeze_me=True, struct_as_record=False)
    seen, ratio = content["rec"], np.asarray(content["para"].u, dtype=float)
    return (
        np.asarray(seen.time_cont, dtype=float),
        np.radians(np.asarray(seen.act_pos_mot_deg, dtype=float).T),
        np.radians(np.asarray(seen.act_pos_se_deg, dtype=float).T),
        np.asarray(seen.act_torque_abs_nm, dtype=float).T * ratio,
    )


def _one_after_the_other(motions):
    start = 0.0
    for time, *rest in motions:
        yield (time - time[0] + start, *rest)
        start += time[-1] - time[0] + BETWEEN
