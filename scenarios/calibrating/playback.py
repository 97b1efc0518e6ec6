"""Pose by pose one sees where the target was missed, before and after.

On the timeline `pose` the links stand as calibrated; arrows show what the simulator
misses on the poses kept back, magnified.
"""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from scenarios.calibrating.proof import Proof
from scenarios.diagnosing.playback_curves import GREY, ORANGE
from stiffness.calibration.calibrated import Calibrated
from stiffness.calibration.stance import Stance

POSE = "pose"
LONGEST = 0.15
"""Length of an arrow that few exceed, in m; chosen."""
MM = 1e3


def save(found: Calibrated, proof: Proof, words: str, file: Path) -> None:
    """Write the playback.

    Args:
        found: The calibration.
        proof: What the simulator misses.
        words: What was found, in plain words.
        file: Where to.
    """
    stream = rr.RecordingStream("stiffness_calibration", recording_id="calibration")
    stream.save(str(file), default_blueprint=_blueprint())
    stance = Stance.of(found.readings, found.drawn)
    held = np.flatnonzero(found.held)
    times = [rr.TimeColumn(POSE, sequence=np.arange(len(held)))]
    stream.log("/cell", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    point = stance.point[held]
    origin = stance.standing.origin[:, held].swapaxes(0, 1)  # (rows, axes, 3)
    arm = np.concatenate([origin, point[:, None]], axis=1).astype(np.float32)
    strips = rr.LineStrips3D.columns(strips=arm).partition([1] * len(held))
    stream.send_columns("/cell/arm", indexes=times, columns=strips)
    usual = float(np.quantile(np.linalg.norm(proof.before, axis=1), 0.98))
    magnified = 10.0 ** np.floor(np.log10(LONGEST / max(usual, 1e-9)))
    both = (("before", proof.before, GREY), ("after", proof.after, ORANGE))
    for name, left, colour in both:
        arrows = rr.Arrows3D.columns(
            origins=point.astype(np.float32),
            vectors=(magnified * left).astype(np.float32),
        ).partition([1] * len(held))
        stream.send_columns(f"/cell/{name}", indexes=times, columns=arrows)
        style = rr.Arrows3D.from_fields(colors=[colour], radii=0.004)
        stream.log(f"/cell/{name}", style, static=True)
        size = MM * np.linalg.norm(left, axis=1)
        stream.send_columns(
            f"/error/{name}", indexes=times, columns=rr.Scalars.columns(scalars=size)
        )
        lines = rr.SeriesLines(names=f"{name} [mm]", colors=[colour])
        stream.log(f"/error/{name}", lines, static=True)
    note = (
        f"{words}\n\nArrows: what the simulator misses on poses kept back, magnified "
        f"{magnified:.0f} times. Grey: as drawn. Orange: as calibrated."
    )
    stream.log("/read_me", rr.TextDocument(note), static=True)
    stream.flush()
    stream.disconnect()


def _blueprint() -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(origin="/cell", name="poses kept back"),
            rrb.Vertical(
                rrb.TextDocumentView(origin="/read_me", name="what was found"),
                rrb.TimeSeriesView(origin="/error", name="error [mm]"),
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=POSE, state="collapsed", fps=4.0),
        collapse_panels=True,
    )
