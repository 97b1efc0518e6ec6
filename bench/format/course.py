"""Visits, stages and ages of a load can be read from the order in which rows came."""

import numpy as np
from jaxtyping import Float, Int

from bench.recording import LOADED, LOADING, UNLOADED, UNLOADING

STEP = 0.05
"""Share of the largest load below which a measured load has not changed (chosen: well
above a sensor's noise, well below one of ten steps)."""


def visits_of(pose: Int[np.ndarray, " rows"]) -> Int[np.ndarray, " rows"]:
    """Count the runs of equal pose: a run is one visit (the format's own rule)."""
    return np.cumsum(np.diff(pose, prepend=pose[:1]) != 0)


def load_times_of(
    time: Float[np.ndarray, " rows"],
    visit: Int[np.ndarray, " rows"],
    load_mass: Float[np.ndarray, " rows"] | None,
) -> Float[np.ndarray, " rows"]:
    """Return when the load last changed: right after the row before (the format).

    Where the mass on the hook is stated and is the same as in the row before of the
    same visit, it did not change there: the row is a dwell.

    Args:
        time: When each row was read, in s.
        visit: The visit of each row.
        load_mass: Nominal mass on the hook, in kg.
    """
    changed = np.ones(len(time), dtype=bool)
    if load_mass is not None:
        changed[1:] = (np.diff(load_mass) != 0) | (np.diff(visit) != 0)
    before = np.concatenate([time[:1], time[:-1]])
    last = np.maximum.accumulate(np.where(changed, np.arange(len(time)), 0))
    return before[last]


def stages_of(
    visit: Int[np.ndarray, " rows"],
    load: Float[np.ndarray, " rows"] | None,
    step: float,
) -> np.ndarray:
    """Read the stage of each row from the load's course in its visit.

    Near zero is unloaded, near the visit's largest is loaded; between them the last
    change of more than a step says loading or unloading.

    Args:
        visit: The visit of each row.
        load: Size of the load, in any unit; None where there is none but weight.
        step: What counts as a change, in the load's unit.
    """
    stage = np.full(len(visit), UNLOADED, dtype="<U9")
    if load is None:
        return stage
    starts = np.flatnonzero(np.diff(visit, prepend=visit[:1] - 1))
    for first, end in zip(starts, [*starts[1:], len(visit)], strict=True):
        stage[first:end] = _stages_of_visit(load[first:end], step)
    return stage


def _stages_of_visit(load: Float[np.ndarray, " rows"], step: float) -> list[str]:
    largest, turned, rising = float(np.max(load)), 0.0, True
    stages = []
    for size in load:
        if abs(size - turned) > step:
            turned, rising = size, size > turned
        if size <= step:
            stages.append(UNLOADED)
        elif size >= largest - step:
            stages.append(LOADED)
        else:
            stages.append(LOADING if rising else UNLOADING)
    return stages
