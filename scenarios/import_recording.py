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

    from bench.shared.format import folder
    from scenarios.pipelines.importing.clocks import lag_text
    from scenarios.pipelines.importing.lab_files import imported
    from scenarios.pipelines.inputs import said_of_one_pose

    s = settings
    read = imported(s.source, s.mapping, s.robot)
    recording = read.recording
    folder.write(s.out, recording)
    rows, kind = len(recording.time), recording.rows
    poses = len(np.unique(recording.posture_id))
    print(f"{s.out}: {rows} rows ({kind}), {poses} poses.")
    for line in read.told:
        print(line)
    for name, lag in read.lags.items():
        print(f"Lag of {name} behind the axes: {lag_text(lag)}.")
    for note in (*read.notes, *said_of_one_pose(recording)):
        print(f"Note: {note}")
    return recording


if __name__ == "__main__":
    run(main, Settings)
