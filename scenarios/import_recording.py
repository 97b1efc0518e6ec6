"""How does a lab's own file become a recording?

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

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from bench import files
from bench.errors import Unusable
from bench.model_facts import ModelFacts
from bench.recording import Recording
from scenarios.command import run
from scenarios.importing import bag, several, spreadsheet
from scenarios.importing.lag import Lag, lag_between, said
from scenarios.importing.mapping import Extras, mapping_of
from scenarios.importing.rests import plateaus_of
from scenarios.nominal import arm_of, facts_of
from scenarios.one_pose import said_of_one_pose


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
    s = settings
    manifest, extras = mapping_of(s.mapping)
    model = None if s.robot is None else facts_of(arm_of(s.robot))
    in_bag = s.source.is_dir() or s.source.suffix.lower() in bag.FILES
    rows = str(manifest.get("rows"))
    if faults := [*_against(extras, rows, in_bag)]:
        raise Unusable(f"Mapping {str(s.mapping)!r}", faults)
    names = (s.source.name, s.mapping.name)
    lags: dict[str, Lag | None] = {}
    told: list[str] = []
    if extras.files:
        recording, notes, told = several.recording_of(
            s.source, manifest, extras, model, names
        )
    else:
        if in_bag:
            source, manifest, lags = _of_bag(s.source, manifest, extras, model)
        else:
            source = spreadsheet.source_of(s.source)
        read = spreadsheet.recording_of(source, manifest, extras.targets, model, names)
        recording, notes = read
        if not lags and recording.rows == "stream":
            lags = dict(_lags(recording))
    if extras.rests:
        recording = plateaus_of(recording, extras.rests)
    files.write(s.out, recording)
    rows, kind = len(recording.time), recording.rows
    poses = len(np.unique(recording.pose))
    print(f"{s.out}: {rows} rows ({kind}), {poses} poses.")
    for line in told:
        print(line)
    for name, lag in lags.items():
        print(f"Lag of {name} behind the axes: {said(lag)}.")
    for note in (*notes, *said_of_one_pose(recording)):
        print(f"Note: {note}")
    return recording


def _against(extras: Extras, rows: str, in_bag: bool) -> Iterator[str]:
    """Say which parts of a mapping do not go together."""
    if extras.rests and rows != "stream":
        yield '[rests] turns a stream into plateaus: say rows = "stream".'
    if extras.files and rows != "stream":
        yield '[files] are joined instant by instant: say rows = "stream".'
    if extras.files and in_bag:
        yield "[files] go with a CSV; a bag has [topics]."


def _of_bag(
    path: Path, manifest: dict, extras: Extras, model: ModelFacts | None
) -> tuple[bytes, dict, dict[str, Lag | None]]:
    """Turn a bag into a CSV and a manifest that reads it."""
    if extras.topics is None:
        raise Unusable(f"Bag {str(path)!r}", ["the mapping has no [topics]."])
    robot = manifest.get("robot")
    axes = robot.get("axes", ()) if isinstance(robot, dict) else ()
    own = tuple(axes) or (model.joints if model else ())
    axes = extras.topics.joint_names or own
    columns, lags = bag.columns_of(path, extras.topics, axes)
    slides = dict(zip(model.joints, model.slides, strict=True)) if model else {}
    said = dict(manifest.get("columns", {}))
    for k in range(1, sum(n[:1] == "a" and n[1:].isdigit() for n in columns) + 1):
        slide = bool(axes) and slides.get(axes[k - 1], False)
        unit = "m" if slide else "rad"
        said.setdefault(
            f"a{k}_{'mm' if slide else 'deg'}", {"from": f"a{k}", "unit": unit}
        )
    for name in extras.topics.poses:
        if name in manifest.get("markers", {}):
            for c in "xyz":
                said.setdefault(f"{name}_{c}_mm", {"from": f"{name}.{c}", "unit": "m"})
    return bag.text_of(columns), {**manifest, "columns": said}, lags


def _lags(stream: Recording) -> Iterator[tuple[str, Lag | None]]:
    """Estimate how much the tracker and the wrench lag the axes."""
    time, points = stream.time, stream.points
    if points is not None:
        for m, marker in enumerate(stream.markers):
            seen = np.isfinite(points[:, m]).all(axis=1)
            if seen.sum() > 3:
                lag = lag_between(time, stream.posture, time[seen], points[seen, m])
                yield f"marker {marker.name}", lag
    if stream.wrench is not None:
        yield (
            "the wrench",
            lag_between(time, stream.posture, time, stream.wrench[:, :3]),
        )


if __name__ == "__main__":
    run(main, Settings)
