"""Posture by posture one sees where the arm differs, and what the patch leaves of it.

On the timeline `pose` the arm stands as in the recording under its largest load, each
body coloured by how far its marks are from the nominal simulation; arrows show what is
missing before and after the patch, magnified; beside it the wind-up curves.
"""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from bench.proof import Proof
from bench.proving.gauge import residual_of
from scenarios.diagnosing import story
from scenarios.diagnosing.finding import MICRO, Finding, curves_of
from scenarios.diagnosing.playback_arm import bodies, heat_of
from scenarios.diagnosing.playback_curves import (
    ACROSS,
    DOWN,
    GREY,
    ORANGE,
    curves,
    shown,
)

POSE = "pose"
LONGEST = 0.15
"""Length of an arrow that few exceed, in m; chosen."""


def show(finding: Finding, file: Path | None) -> None:
    """Save the playback, or stream it to a viewer where no file is given."""
    stream = rr.RecordingStream("stiffness_diagnosis", recording_id=_id(finding))
    if file is None:
        stream.spawn(default_blueprint=_blueprint(finding))
    else:
        stream.save(str(file), default_blueprint=_blueprint(finding))
    words = "\n\n".join(story.sentences(finding))
    document = rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN)
    stream.log("/read_me", document, static=True)
    simulated = finding.simulated
    if simulated is not None and finding.recording.markers:
        _arm(stream, simulated, finding.proof is not None)
        curves(stream, finding, curves_of(simulated))
    stream.flush()
    stream.disconnect()


def _arm(stream: rr.RecordingStream, simulated: Proof, proved: bool) -> None:
    world, gauge = simulated.world, simulated.gauge
    seen = world.see(simulated.nominal)
    rows = _most_loaded(simulated)
    count = len(rows)
    times = [rr.TimeColumn(POSE, sequence=np.arange(count))]
    shape = (world.replay.rows, len(world.body), 3)
    size = int(np.prod(shape[1:]))
    left = [
        residual_of(world, world.see(a), gauge)[:, :size].reshape(shape)
        for a in (simulated.nominal, simulated.patched)
    ]
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    heat = heat_of(simulated, left[0])
    bodies(stream, simulated, rows, heat, times)
    usual = np.nanquantile(np.linalg.norm(left[0][rows], axis=2), 0.98)
    magnified = _round(LONGEST / max(float(usual), 1e-9))
    markers = shape[1]
    for path, values, colour in zip(
        ("/cell/before", "/cell/after"), left, (GREY, ORANGE), strict=True
    ):
        if path.endswith("after") and not proved:
            continue
        vectors = magnified * np.nan_to_num(values[rows])
        columns = rr.Arrows3D.columns(
            origins=seen.point[rows].reshape(-1, 3).astype(np.float32),
            vectors=vectors.reshape(-1, 3).astype(np.float32),
        ).partition([markers] * count)
        stream.send_columns(path, indexes=times, columns=columns)
        style = rr.Arrows3D.from_fields(colors=[colour], radii=0.004)
        stream.log(path, style, static=True)
    visit = world.replay.visit
    for name, values, colour in zip(
        ("before", "after"), left, (GREY, ORANGE), strict=True
    ):
        square = np.sum(values**2, axis=2)
        sums = [np.bincount(visit, np.nansum(square, axis=1)),
                np.bincount(visit, np.isfinite(square).sum(axis=1))]  # fmt: skip
        rms = MICRO * np.sqrt(sums[0] / np.maximum(sums[1], 1))
        stream.send_columns(
            f"/error/{name}", indexes=times, columns=rr.Scalars.columns(scalars=rms)
        )
        lines = rr.SeriesLines(names=f"{name} [µm]", colors=[colour])
        stream.log(f"/error/{name}", lines, static=True)
    note = (
        f"Arrows: what the simulation misses, magnified {magnified:.0f} times. Grey: "
        "nominal arm. Orange: with the patch."
    )
    stream.log("/note", rr.TextDocument(note), static=True)


def _most_loaded(simulated: Proof) -> np.ndarray:
    """Return the row of each visit at which the load is largest."""
    recording, visit = simulated.world.recording, simulated.world.replay.visit
    load = np.zeros(len(visit))
    if recording.wrench is not None:
        load = np.linalg.norm(recording.wrench[:, :3], axis=1)
    order = np.lexsort((load, visit))
    return order[np.flatnonzero(np.diff(visit[order], append=-1))]


def _blueprint(finding: Finding) -> rrb.Blueprint:
    camera = rrb.EyeControls3D(
        position=(1.7, -1.6, 1.25), look_target=(0.35, 0.0, 0.6), eye_up=(0, 0, 1)
    )
    simulated = finding.simulated
    views: list = [rrb.TextDocumentView(origin="/read_me", name="what was found")]
    if simulated is not None and finding.recording.markers:
        found = curves_of(simulated)
        for k in shown(finding, found):
            name = found.axes[k]
            view = rrb.Spatial2DView(
                origin=f"/curves/{name}",
                name=f"{name}: turn beyond the nominal arm against torque, 3 visits",
                background=[250, 250, 250],
                visual_bounds=rrb.VisualBounds2D(x_range=ACROSS, y_range=DOWN),
            )
            views.append(view)
        views.append(rrb.TimeSeriesView(origin="/error", name="rms error [µm]"))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(
                    origin="/cell",
                    name="the arm, coloured by what the nominal simulation misses",
                    eye_controls=camera,
                    background=[250, 250, 250],
                    line_grid=False,
                ),
                rrb.TextDocumentView(origin="/note", name="what is drawn"),
                row_shares=[9, 1],
            ),
            rrb.Vertical(*views),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=POSE, state="collapsed", fps=4.0),
        collapse_panels=True,
    )


def _round(value: float) -> float:
    """Return the nearest of 1, 2 and 5 times a power of ten, from below."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(n for n in (1, 2, 5) if n * power <= value) * power)


def _id(finding: Finding) -> str:
    return f"{finding.answer.recording or 'recording'}-diagnosis"
