"""An axis is seen when it travels, something turns it, and something shows it turn."""

from dataclasses import dataclass

import numpy as np

from bench.recording import Recording
from stiffness.arm import Arm
from stiffness.standing import Standing
from stiffness.wrench import wrench_in_base

SMALL_TORQUE = 1.0
"""N m of change below which an axis' wind-up hardly shows (chosen: a gear of
1e5 N m/rad then moves a point one metre away by a tracker's 10 µm)."""
SMALL_TRAVEL = np.radians(1.0)
"""Range of an angle below which nothing is seen to vary with it; chosen."""
SMALL_LEVER = 1e-3
"""m per rad below which no marker shows an axis turn (chosen: 1° moves it 17 µm)."""


@dataclass(frozen=True)
class AxisView:
    """How much of one axis a recording can see.

    Attributes:
        name: The model's joint.
        travel: Range of its angle, in rad (m).
        torque: Range of the torque about it from weight and load, in N m; within a
            visit where displacements are relative.
        lever: Largest motion of a marker per turn, in m per rad; NaN where no marker.
        seen: Whether a marker (one of unknown place beyond it will do) or an encoder
            after the gear shows it turn.
    """

    name: str
    travel: float
    torque: float
    lever: float
    seen: bool


TOO_ALIKE = 0.95
"""Cosine above which two axes' give moves the markers alike; as in the diagnosis."""
MOST_VISITS = 500
"""Visits that are looked at for it; chosen: a second."""


def axis_views(recording: Recording, arm: Arm) -> list[AxisView]:
    """Say of each axis how far it turns, what turns it, and what would show it."""
    standing = arm.at(recording.posture)
    torque = _since_unloaded(recording, _torque(recording, standing))
    lever = np.full(len(arm.axes), np.nan)
    seen = np.zeros(len(arm.axes), dtype=bool)
    if recording.link_posture is not None:
        seen |= np.isfinite(recording.link_posture).any(axis=0)
    for marker in recording.markers:
        place = np.zeros(3) if marker.position is None else marker.position
        jacobian = standing.jacobian(marker.body, place)[:, :3]  # (rows, 3, axes)
        if marker.position is None:
            seen[arm.chain.carriers(arm.place(marker.body).axis)] = True
        lever = np.fmax(lever, np.max(np.linalg.norm(jacobian, axis=1), axis=0))
    travel, turning = np.ptp(recording.posture, axis=0), np.ptp(torque, axis=0)
    seen |= np.nan_to_num(lever) > SMALL_LEVER
    each = zip(arm.axes, travel, turning, lever, seen, strict=True)
    return [
        AxisView(name, float(a), float(t), float(m), bool(s))
        for name, a, t, m, s in each
    ]


def alike(recording: Recording, arm: Arm) -> list[tuple[str, str]]:
    """Return pairs of axes whose give moves all markers in nearly the same way.

    An axis of compliance c moves a marker by J c τ. Its mean over the rows of a visit
    (over all rows, where each visit has one) is taken off: frames and places take it.
    """
    _, visit = np.unique(recording.visit, return_inverse=True)
    step = -(-(visit.max() + 1) // MOST_VISITS)
    r = recording.take(np.flatnonzero(visit % step == 0))
    if not r.markers:
        return []
    standing = arm.at(r.posture)
    torque = _torque(r, standing)
    _, visit, count = np.unique(r.visit, return_inverse=True, return_counts=True)
    if count.max() == 1:
        visit, count = np.zeros_like(visit), np.array([len(visit)])
    columns = []
    for marker in r.markers:
        place = np.zeros(3) if marker.position is None else marker.position
        moved = standing.jacobian(marker.body, place)[:, :3] * torque[:, None]
        mean = np.zeros((len(count), *moved.shape[1:]))
        np.add.at(mean, visit, moved)
        moved = moved - (mean / count[:, None, None])[visit]
        columns.append(moved.reshape(-1, len(arm.axes)))
    moved = np.vstack(columns)
    product = moved.T @ moved
    size = np.sqrt(np.diag(product))
    apart = np.outer(size, size)
    cosine = np.divide(product, apart, out=np.zeros_like(apart), where=apart > 0.0)
    return [
        (arm.axes[i], arm.axes[j])
        for i, j in zip(*np.triu_indices(len(size), 1), strict=True)
        if abs(cosine[i, j]) > TOO_ALIKE
    ]


def _torque(recording: Recording, standing: Standing) -> np.ndarray:
    """Return the torque about each axis from weight and load, (rows, axes), N m."""
    torque = standing.gravity_torque(recording.tool)
    if (sensor := recording.wrench_sensor) is not None and recording.wrench is not None:
        wrench = wrench_in_base(recording, standing)
        torque = torque + standing.load_torque(wrench, sensor.body, sensor.position)
    return torque


def _since_unloaded(recording: Recording, torque: np.ndarray) -> np.ndarray:
    if recording.displacement == "absolute":
        return torque
    _, first, visit = np.unique(recording.visit, return_index=True, return_inverse=True)
    return torque - torque[first[visit]]
