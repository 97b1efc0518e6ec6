"""Imports a lab's own files by a mapping, or names everything that is wrong with both.

A fault of the mapping hides none of the data: what can be meant is read all the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bench.shared.errors import BenchError, Unusable
from bench.shared.format.folder import counted
from bench.shared.models import ModelFacts
from bench.shared.recording import Recording
from scenarios.pipelines.importing import joined_files, ros_bag, spreadsheet
from scenarios.pipelines.importing.clocks import Lag, stream_lags
from scenarios.pipelines.importing.mapping import (
    LabMapping,
    contradictions,
    mapping_of,
)
from scenarios.pipelines.importing.ros_bag import bag_as_csv
from scenarios.pipelines.importing.standstills import plateaus_of
from scenarios.pipelines.inputs import arm_of, facts_of


@dataclass(frozen=True)
class Imported:
    """A lab's experiment as a recording.

    Attributes:
        recording: What the files hold.
        notes: What to say of columns and rows.
        clock_notes: What was found of the files' clocks.
        lags: How much each channel lags behind the axes; None where nothing tells.
    """

    recording: Recording
    notes: tuple[str, ...]
    clock_notes: tuple[str, ...] = ()
    lags: Mapping[str, Lag | None] = field(default_factory=dict)


def imported(source: Path, mapping: Path, robot: Path | None = None) -> Imported:
    """Import one experiment.

    Args:
        source: CSV file, the axes' where there are several; or a ROS 2 bag.
        mapping: What its columns or topics are.
        robot: Model whose names and limits are checked too; None checks neither.

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
