"""Turns a lab's own file into a recording.

Reads a CSV as a spreadsheet exports it, or a ROS 2 bag (`pip install '.[ros]'`), by a
mapping in TOML: the format's manifest with `[columns]` and `[csv]`, and beyond it
`[targets.NAME]` (6D targets), `[rests]` (a stream becomes plateaus), `[topics]` and
`[files.NAME]` (more CSV files beside FILE, each by its own clock). All faults are named
at once, and nothing is written until all is right. How much one channel lags another is
estimated and said.

Run:    python -m scenarios.import_recording FILE --mapping MAPPING.toml --out DIR
Takes:  1 s for 1,000 rows
Expect: DIR with a recording, which `python -m scenarios.check` finds whole
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from bench.shared.recording import Recording


@dataclass(frozen=True)
class Settings:
    """What is read, and where it goes."""

    source: Annotated[Path, tyro.conf.Positional]
    """CSV file (the axes', where there are several), or a ROS 2 bag: its folder, or its
    only file (.mcap, .db3)."""
    mapping: Path
    """TOML file that says what its columns or topics are."""
    out: Path
    """Folder for the recording."""
    robot: Path | None = None
    """Model of the robot, MJCF or URDF, whose names and limits are checked too."""


def main(settings: Settings) -> Recording:
    """Import one experiment."""
    import numpy as np

    from bench.shared.errors import Unusable
    from bench.shared.format import folder
    from scenarios.pipelines.importing import log_files, ros_bag, spreadsheet
    from scenarios.pipelines.importing.clocks import Lag, lag_text, stream_lags
    from scenarios.pipelines.importing.mapping import contradictions, mapping_of
    from scenarios.pipelines.importing.ros_bag import bag_as_csv
    from scenarios.pipelines.importing.standstills import plateaus_of
    from scenarios.pipelines.inputs import arm_of, facts_of, said_of_one_pose

    s = settings
    manifest, extras = mapping_of(s.mapping)
    model = None if s.robot is None else facts_of(arm_of(s.robot))
    in_bag = s.source.is_dir() or s.source.suffix.lower() in ros_bag.FILES
    rows = str(manifest.get("rows"))
    if faults := [*contradictions(extras, rows, in_bag)]:
        raise Unusable(f"Mapping {str(s.mapping)!r}", faults)
    names = (s.source.name, s.mapping.name)
    lags: dict[str, Lag | None] = {}
    told: list[str] = []
    if extras.files:
        recording, notes, told = log_files.recording_of(
            s.source, manifest, extras, model, names
        )
    else:
        if in_bag:
            source, manifest, lags = bag_as_csv(s.source, manifest, extras, model)
        else:
            source = spreadsheet.source_of(s.source)
        read = spreadsheet.recording_of(source, manifest, extras.targets, model, names)
        recording, notes = read
        if not lags and recording.rows == "stream":
            lags = dict(stream_lags(recording))
    if extras.rests:
        recording = plateaus_of(recording, extras.rests)
    folder.write(s.out, recording)
    rows, kind = len(recording.time), recording.rows
    poses = len(np.unique(recording.posture_id))
    print(f"{s.out}: {rows} rows ({kind}), {poses} poses.")
    for line in told:
        print(line)
    for name, lag in lags.items():
        print(f"Lag of {name} behind the axes: {lag_text(lag)}.")
    for note in (*notes, *said_of_one_pose(recording)):
        print(f"Note: {note}")
    return recording


if __name__ == "__main__":
    run(main, Settings)
