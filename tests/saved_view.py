"""Reads back a playback that was saved for the viewer, by the viewer's own reader."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun import chunk


def viewer_into(monkeypatch: pytest.MonkeyPatch, file: Path) -> list[object]:
    """Write to a file instead of opening a viewer; returns the blueprints it got."""
    opened: list[object] = []

    def spawn(stream: rr.RecordingStream, default_blueprint: object) -> None:
        opened.append(default_blueprint)
        stream.save(str(file), default_blueprint=default_blueprint)  # type: ignore[arg-type]

    monkeypatch.setattr(rr.RecordingStream, "spawn", spawn)
    return opened


def identity(file: Path) -> tuple[str, str]:
    """Return the application's and the recording's id."""
    (entry,) = chunk.RrdReader(file).recordings()
    return entry.application_id, entry.recording_id


def entities(file: Path) -> set[str]:
    """Return the paths of all entities."""
    schema = chunk.RrdReader(file).store().schema()
    return {str(path) for path in schema.entity_paths()}


def timeline(file: Path) -> str:
    """Return the timeline that the blueprint opens on."""
    reader = chunk.RrdReader(file)
    (blueprint,) = reader.blueprints()
    for piece in reader.store(store=blueprint).stream():
        if str(piece.entity_path) == "/time_panel":
            column = piece.to_record_batch().column("TimePanelBlueprint:timeline")
            return column.to_pylist()[0][0]
    raise AssertionError("The blueprint has no time panel.")


def column(file: Path, path: str, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return ticks on the timeline `reading` and the numbers of a component."""
    for piece in chunk.RrdReader(file).store().stream():
        batch = piece.to_record_batch()
        if str(piece.entity_path) == path and name in batch.schema.names:
            if piece.is_static:
                continue
            ticks = batch.column("reading").to_numpy(zero_copy_only=False)
            return ticks, np.array(batch.column(name).to_pylist(), float)
    raise AssertionError(f"{path} has no {name}.")


def still(file: Path, path: str, name: str) -> list:
    """Return the items of a static component."""
    for piece in chunk.RrdReader(file).store().stream():
        batch = piece.to_record_batch()
        if str(piece.entity_path) == path and name in batch.schema.names:
            return batch.column(name).to_pylist()[0]
    raise AssertionError(f"{path} has no {name}.")
