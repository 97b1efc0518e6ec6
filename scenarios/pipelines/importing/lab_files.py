"""Imports a lab's own files by a mapping, or names everything that is wrong with both.

A fault of the mapping hides none of the data: what can be meant is read all the same.
In a stream a plateau begins where all axes and markers are slower than the mapping
says, and ends where one is faster or the load has changed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bench.shared.errors import BenchError, Unusable
from bench.shared.format.assembly import stages_of
from bench.shared.format.folder import counted
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording
from scenarios.pipelines.importing import joined_files, ros_bag, spreadsheet
from scenarios.pipelines.importing.clocks import Lag, stream_lags
from scenarios.pipelines.importing.mapping import (
    LabMapping,
    Standstills,
    contradictions,
    mapping_of,
)
from scenarios.pipelines.importing.ros_bag import bag_as_csv
from scenarios.pipelines.inputs import arm_of, facts_of


def plateaus_of(stream: Recording, rests: Standstills) -> Recording:
    """Average a stream over its rests.

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


@dataclass(frozen=True)
class Imported:
    """A lab's experiment as a recording.

    Attributes:
        lags: How much each channel lags behind the axes; None where nothing tells.
    """

    recording: Recording
    notes: tuple[str, ...]
    clock_notes: tuple[str, ...] = ()
    lags: Mapping[str, Lag | None] = field(default_factory=dict)


def imported(source: Path, mapping: Path, robot: Path | None = None) -> Imported:
    """Import one experiment: a CSV file, the axes' of several, or a ROS 2 bag.

    Raises:
        Unusable: With all faults of mapping, files and model at once.
    """
    said = mapping_of(mapping)
    model, faults = _model(robot)
    in_bag = source.is_dir() or source.suffix.lower() in ros_bag.FILES
    rows = str(said.manifest.get("rows"))
    own = [*said.faults, *contradictions(said.extras, rows, in_bag)]
    faults = [*(f"{mapping.name}, {fault}" for fault in own), *faults]
    read = None
    try:
        if said.tells:
            read = _read(source, said, model, (source.name, mapping.name), in_bag)
        elif not in_bag:
            spreadsheet.source_of(source)
    except Unusable as error:
        faults += _not_of_broken_files(error.faults, said)
    if read is None or faults:
        what = f"{source.name} with {mapping.name}"
        raise Unusable(what, list(dict.fromkeys(faults)))
    return read


def _model(robot: Path | None) -> tuple[ModelFacts | None, list[str]]:
    try:
        return (None if robot is None else facts_of(arm_of(robot))), []
    except Unusable as error:
        return None, [f"--robot {robot}: {fault}" for fault in error.faults]
    except BenchError as error:
        return None, [f"--robot {robot}: {error}"]


def _read(
    source: Path,
    said: LabMapping,
    model: ModelFacts | None,
    names: tuple[str, str],
    in_bag: bool,
) -> Imported:
    manifest, extras, lags = said.manifest, said.extras, {}
    if extras.files and not in_bag:
        faulty = bool(said.faults)
        joined = joined_files.recording_of(
            source, manifest, extras, model, names, faulty
        )
        recording, notes, told = joined.recording, joined.notes, joined.clock_notes
    else:
        if in_bag:
            table, manifest, lags = bag_as_csv(source, manifest, extras, model)
        else:
            table = spreadsheet.source_of(source)
        read = spreadsheet.recording_of(table, manifest, extras.targets, model, names)
        recording, notes, told = read.recording, read.notes, ()
    if not lags and not told and recording.rows == "stream":
        lags = dict(stream_lags(recording))
    if extras.rests:
        recording = plateaus_of(recording, extras.rests)
    return Imported(recording, counted(notes), told, lags)


def _not_of_broken_files(faults: tuple[str, ...], said: LabMapping) -> list[str]:
    """Leave out what only follows from a part of `[files]` that has a fault itself."""
    starts = tuple(f": column '{name}." for name in said.broken_files)
    return [f for f in faults if not any(s in f for s in starts)]
