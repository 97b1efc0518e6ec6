"""A loaded reading means something beside the unloaded reading of the same visit."""

import numpy as np
from jaxtyping import Int

from bench.errors import Unusable
from bench.recording import UNLOADED, Recording
from stiffness.arm import Arm


def loaded_and_unloaded(
    recording: Recording,
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Pair every loaded row with the first unloaded row of its visit.

    A row is loaded where its stage is not `unloaded` and, if the mass on the hook is
    known, there is one. Where a visit marks no row as unloaded, its first is compared.

    Returns:
        The loaded rows in the order of time, and the row each is compared with.
    """
    loaded = recording.stage != UNLOADED
    if recording.load_mass is not None:
        loaded = loaded & (recording.load_mass > 0.0)
    rows = np.arange(len(recording.time))
    last = len(rows)
    _, number = np.unique(recording.visit, return_inverse=True)
    start = np.full(number.max(initial=-1) + 1, 2 * last)
    np.minimum.at(start, number, rows + last * (recording.stage != UNLOADED))
    compared = start[number] % last
    loaded = loaded & (rows != compared)
    return rows[loaded], compared[loaded]


def usable(arm: Arm, recording: Recording) -> Int[np.ndarray, " markers"]:
    """Choose the end-effector's markers, and refuse what shows no deflection.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: Any recording.

    Returns:
        The markers on the flange; else on the tool; else what moves with them.

    Raises:
        Unusable: With every reason why there are no deflections, and what to add.
    """
    faults = []
    bad = np.argwhere(~np.isfinite(recording.posture))
    for axis in np.unique(bad[:, 1]):
        rows = bad[bad[:, 1] == axis, 0]
        first = f"row {rows[0]}" + (f" and {len(rows) - 1} more" * (len(rows) > 1))
        faults.append(f"the posture of axis {arm.axes[axis]} is no number in {first}.")
    if recording.rows != "plateaus":
        faults.append("its rows are a stream; take plateaus, where the arm rests.")
    if recording.wrench is None or recording.wrench_sensor is None:
        faults.append("there is no wrench: give fx_n … tz_nm and [sensors.wrench].")
    elif not np.isfinite(recording.wrench).all():
        row = int(np.argwhere(~np.isfinite(recording.wrench))[0][0])
        faults.append(f"the wrench is no number in row {row}.")
    if recording.tracker is None:
        faults.append("the tracker's noise is unknown: give [sensors.tracker].")
    chosen = end_effector_markers(arm, recording)
    if not len(chosen):
        faults.append("no marker is on the flange or the tool; put one there.")
    unknown = [k for k in chosen if recording.markers[k].position is None]
    if unknown and recording.displacement == "relative":
        faults.append("relative readings need position_mm of the flange's markers.")
    if faults:
        raise Unusable(f"Recording {recording.name!r}", faults)
    return chosen


def end_effector_markers(arm: Arm, recording: Recording) -> Int[np.ndarray, " markers"]:
    """Return the markers on the flange; else on the tool; else what moves with them."""
    bodies = [marker.body for marker in recording.markers]
    for wanted in ("flange", "tool"):
        goal = arm.bodies.get(wanted, wanted)
        found = [k for k, b in enumerate(bodies) if arm.bodies.get(b, b) == goal]
        if found:
            return np.array(found)
    last = arm.place("flange").axis
    found = [k for k, body in enumerate(bodies) if arm.place(body).axis == last]
    return np.array(found, dtype=int)
