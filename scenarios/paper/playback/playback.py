"""The experiment is shown as it went: arm, rigid ghost, rope, methods' errors."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from bench import viewer
from scenarios.paper.experiment import Experiment
from scenarios.paper.linear_fit.fit import LinearFit
from scenarios.paper.playback.gallery import ERRORS_MAGNIFIED, colours, view
from scenarios.paper.playback.scene import MAGNIFIED, scene
from scenarios.paper.playback.training_curves import Curve
from scenarios.paper.playback.training_curves import show as show_curve
from scenarios.paper.playback.worst import WORST, show_worst

LAYOUT = viewer.blueprint(
    tabs=(
        rrb.Vertical(
            rrb.TextDocumentView(origin="/worst", name="which they are"),
            view(),
            row_shares=[1, 1.3],
            name="the worst ten poses",
        ),
        rrb.TimeSeriesView(origin="/training", name="training"),
    )
)


@dataclass(frozen=True)
class Learnt:
    """What the methods that are shown made of the experiment.

    Attributes:
        error_mm: Of each method in each pose of the experiment.
        curves: How their networks were trained.
    """

    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]]
    curves: Sequence[Curve]


def live(seed: int) -> rr.RecordingStream:
    """Open a viewer on this machine."""
    return viewer.live("study", seed, LAYOUT)


def save(
    file: Path,
    seed: int,
    experiment: Experiment,
    found: LinearFit,
    learnt: Learnt,
) -> None:
    """Write a recording whole, or leave what was there; as `show`."""
    beside = file.with_suffix(".partial")
    recording = viewer.saved(beside, "study", seed, LAYOUT)
    show(recording, experiment, found, learnt)
    os.replace(beside, file)


def show(
    recording: rr.RecordingStream,
    experiment: Experiment,
    found: LinearFit,
    learnt: Learnt,
) -> None:
    """Log everything that is to be seen.

    Args:
        recording: Where to.
        experiment: What was done and seen.
        found: What six springs made of it.
        learnt: What the methods made of it.
    """
    rows, shown = experiment.measured.row, scene(experiment)
    words = _words(experiment, found, learnt)
    viewer.show(recording, shown, learnt.error_mm, rows, words)
    _arrows(recording, experiment, shown, learnt)
    show_worst(recording, shown, learnt.error_mm, experiment.measured)
    for curve in learnt.curves:
        show_curve(recording, curve)
    recording.flush()
    recording.disconnect()


def _arrows(
    recording: rr.RecordingStream,
    experiment: Experiment,
    shown: viewer.Scene,
    learnt: Learnt,
) -> None:
    """Draw each method's error at the flange, side by side."""
    rows = experiment.measured.row
    place = shown.actual[rows, -1, :3, 3]
    colour = colours(learnt.error_mm)
    for name, error in learnt.error_mm.items():
        arrow = (1e-3 * ERRORS_MAGNIFIED * error).astype(np.float32)
        path = f"/cell/errors/{rr.escape_entity_path_part(name)}"
        recording.send_columns(
            path,
            indexes=[rr.TimeColumn(viewer.READING, sequence=rows)],
            columns=rr.Arrows3D.columns(
                vectors=arrow, origins=place.astype(np.float32)
            ),
        )
        drawn = rr.Arrows3D.from_fields(colors=[colour[name]], radii=0.005)
        recording.log(path, drawn, static=True)


def _words(experiment: Experiment, found: LinearFit, learnt: Learnt) -> str:
    methods = ", ".join(learnt.error_mm)
    lines = [
        "## The experiment of Table 1 on the bench",
        f"Deflection magnified **{MAGNIFIED:.0f} times**. Grey: the rigid arm. Orange: "
        "the arm as it stands. Not magnified: the rope, its pull (red, 100 N are a "
        "third of a metre) and the marks as the tracker saw them (blue).",
        f"Arrows at the flange: the errors of {methods}, magnified "
        f"{ERRORS_MAGNIFIED:.0f} times.",
        "Timeline `reading`: nine readings a posture, weights up and down; beside the "
        "arm the errors, posture by posture, in the colours of the arrows. The tabs "
        "above: the ten poses that the methods get most wrong (timeline "
        f"`{WORST}` shows them in the cell), and how the networks were trained "
        "(timeline `step`).",
        "",
        "| axis | identified [kN m/rad] | truth, secant |",
        "|---|---|---|",
    ]
    for p, secant in zip(
        found.fitted.stiffness, experiment.secant_stiffness, strict=True
    ):
        lines.append(f"| {p.name} | {p.value / 1e3:.2f} | {secant / 1e3:.2f} |")
    return "\n\n".join(lines[:5]) + "\n" + "\n".join(lines[5:])
