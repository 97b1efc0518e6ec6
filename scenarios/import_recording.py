"""Turns a lab's own file into a recording.

Reads a CSV as a spreadsheet exports it, or a ROS 2 bag (`pip install '.[ros]'`), by a
mapping in TOML: the format's manifest, and beyond it

    number_rows, interval_s, pulled    each row is a pose; rows come every N s; each row
                                       is a deflection of which the unloaded arm is zero
    [csv]       separator, decimal, encoding = "cp1252", skip_rows = 1 (rows of units
                below the header, or a list of lines), skip_incomplete = true
    [columns]   a1_deg = "J1", or { from = "J1", unit = "rad" }, { from = "J2",
                factor = -1.0 }, { from = ["J2", "J3"], sum = [-1, -1] }
    [targets.NAME]   6D targets       [rests]    a stream becomes plateaus
    [files.NAME]     more CSV files beside FILE, row by row or each by its own clock
    [topics]         what is what in a bag

All faults of mapping and data are named at once, with lines as a spreadsheet counts
them, and nothing is written until all is right. `--suggest FILE.csv` writes a mapping
to correct. How much one channel lags another is estimated and said.

Run:    python -m scenarios.import_recording FILE --mapping MAPPING.toml --out DIR
        python -m scenarios.import_recording --suggest FILE.csv --mapping NEW.toml
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

    source: Annotated[Path | None, tyro.conf.Positional] = None
    """CSV file (the axes', where there are several), or a ROS 2 bag: its folder, or its
    only file (.mcap, .db3)."""
    mapping: Path | None = None
    """TOML file that says what its columns or topics are."""
    out: Path | None = None
    """Folder for the recording."""
    robot: Path | None = None
    """Model of the robot, MJCF or URDF, whose names and limits are checked too."""
    suggest: Path | None = None
    """CSV file for which a mapping is to be written, to --mapping or beside it: columns
    are guessed by their names and units, and you correct it."""


def main(settings: Settings) -> Recording:
    """Import one experiment, or suggest how to."""
    import numpy as np

    from bench.shared.errors import Unusable
    from bench.shared.format import folder
    from scenarios.pipelines.importing.clocks import lag_text
    from scenarios.pipelines.importing.lab_files import imported
    from scenarios.pipelines.importing.suggestion import write_suggestion
    from scenarios.pipelines.inputs import arm_of, facts_of, said_of_one_pose

    s = settings
    if s.suggest is not None:
        model = None if s.robot is None else facts_of(arm_of(s.robot))
        mapping = write_suggestion(s.suggest, s.mapping, model)
        print(f"{mapping}: a mapping to correct. Then:")
        files = f"{s.suggest} --mapping {mapping}"
        print(
            f"python -m scenarios.import_recording {files} --robot MODEL.xml --out DIR"
        )
        raise SystemExit(0)
    if s.source is None or s.mapping is None or s.out is None:
        say = "give FILE, --mapping MAPPING.toml and --out DIR; or --suggest FILE.csv."
        raise Unusable("This command", [say])
    read = imported(s.source, s.mapping, s.robot)
    recording = read.recording
    folder.write(s.out, recording)
    rows, kind = len(recording.time), recording.rows
    poses = len(np.unique(recording.posture_id))
    print(f"{s.out}: {rows} rows ({kind}), {poses} poses.")
    for line in read.clock_notes:
        print(line)
    for name, lag in read.lags.items():
        print(f"Lag of {name} behind the axes: {lag_text(lag)}.")
    for note in (*read.notes, *said_of_one_pose(recording)):
        print(f"Note: {note}")
    return recording


if __name__ == "__main__":
    run(main, Settings)
