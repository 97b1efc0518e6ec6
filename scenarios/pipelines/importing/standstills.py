"""Turns the standstills of a stream into plateaus.

A plateau begins where all axes and markers are slower than the mapping says, and ends
where one is faster or the load has changed.
"""

from dataclasses import replace

import numpy as np

from bench.shared.errors import Unusable
from bench.shared.format.assembly import stages_of
from bench.shared.recording import Recording
from scenarios.pipelines.importing.mapping import Standstills


def plateaus_of(stream: Recording, rests: Standstills) -> Recording:
    """Average a stream over its rests.

    Args:
        stream: One row per instant.
        rests: Speeds below which the arm rests.

    Raises:
        Unusable: Where it never rests.
    """
    cuts = _segments(stream, rests)
    if not cuts:
        fault = (
            f"it never rests for {rests.hold_s:g} s below "
            f"{rests.speed_deg_per_s:g}°/s; change [rests]."
        )
        raise Unusable(f"Recording {stream.name!r}", [fault])
    frames = np.array([last - first for first, last in cuts])

    def mean(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        return np.stack([_mean(values[first:last]) for first, last in cuts])

    posture = mean(stream.posture)
    assert posture is not None
    pose = _same(posture, np.radians(rests.same_pose_deg))
    visit = np.cumsum(np.diff(pose, prepend=pose[:1]) != 0)
    wrench = mean(stream.wrench)
    load = None if wrench is None else np.linalg.norm(wrench[:, :3], axis=1)
    return replace(
        stream,
        rows="plateaus",
        time=np.array([stream.time[last - 1] for _, last in cuts]),
        load_time=np.array([stream.time[first] for first, _ in cuts]),
        posture_id=pose,
        visit=visit,
        stage=stages_of(visit, load, rests.load_step_n),
        posture=posture,
        wrench=wrench,
        points=mean(stream.points),
        commanded=mean(stream.commanded),
        last_move=None,
        link_posture=mean(stream.link_posture),
        axis_torque=mean(stream.axis_torque),
        temperature=mean(stream.temperature),
        load_mass=mean(stream.load_mass),
        frames=frames,
    )


def _segments(stream: Recording, rests: Standstills) -> list[tuple[int, int]]:
    step = np.maximum(np.diff(stream.time), 1e-9)
    limit = np.full(stream.posture.shape[1], np.radians(rests.speed_deg_per_s))
    if stream.slides:
        limit[np.array(stream.slides)] = rests.speed_mm_per_s / 1e3
    still = np.all(np.abs(np.diff(stream.posture, axis=0)) <= limit * step[:, None], 1)
    cuts, first = [], 0
    for row in range(1, len(stream.time) + 1):
        ends = row == len(stream.time) or not still[row - 1]
        if not ends and stream.wrench is not None:
            change = stream.wrench[row, :3] - stream.wrench[first, :3]
            ends = np.linalg.norm(change) > rests.load_step_n
        if ends:
            if stream.time[row - 1] - stream.time[first] >= rests.hold_s:
                cuts.append((first, row))
            first = row
    return cuts


def _mean(values: np.ndarray) -> np.ndarray:
    """Average over rows; NaN where nothing was seen."""
    seen = np.isfinite(values)
    count = seen.sum(axis=0)
    total = np.where(seen, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _same(posture: np.ndarray, within: float) -> np.ndarray:
    """Give postures that agree the same number."""
    known: list[np.ndarray] = []
    numbers = []
    for one in posture:
        near = [k for k, old in enumerate(known) if np.abs(one - old).max() <= within]
        numbers.append(near[0] if near else len(known))
        if not near:
            known.append(one)
    return np.array(numbers)
