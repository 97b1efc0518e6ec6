"""One looks at an experiment as at a machine: the arm goes through its postures.

A saved recording opens on the timeline `reading`, one tick a measured state: the arm
as it stands (deflection magnified, the factor is shown), its rigid ghost, the rope, the
force, the markers, and below them the errors of the methods pose by pose.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from bench import drawing

READING, POSE = "reading", "pose"
GHOST = np.array([0.55, 0.6, 0.66, 0.28])


@dataclass(frozen=True)
class Scene:
    """What is to be seen of an experiment, row by row, in the base's frame.

    Attributes:
        model: The nominal arm, whose shapes are shown.
        bodies: The bodies that are shown.
        nominal: Transforms of the rigid arm, base_from_body, in m.
        actual: Transforms of the arm as it stands.
        pose: The visit of each row.
        magnified: By what the deflection is multiplied.
        rope: Corners of the rope, from the hook on, in m.
        force: Force of the rope on the hook, in N.
        markers: Places of the markers as measured, in m; NaN = not seen.
    """

    model: mujoco.MjModel
    bodies: tuple[str, ...]
    nominal: Float[np.ndarray, "rows bodies 4 4"]
    actual: Float[np.ndarray, "rows bodies 4 4"]
    pose: Int[np.ndarray, " rows"]
    magnified: float
    rope: Float[np.ndarray, "rows corners 3"]
    force: Float[np.ndarray, "rows 3"]
    markers: Float[np.ndarray, "rows markers 3"]


def show(
    recording: rr.RecordingStream,
    scene: Scene,
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]],
    error_row: Int[np.ndarray, " poses"],
    words: str,
) -> None:
    """Log an experiment.

    Args:
        recording: Where to; saved or live.
        scene: What is to be seen.
        error_mm: Error of each method in each pose along x, y, z, in mm.
        error_row: The row that each pose's error belongs to.
        words: What the reader should know, in Markdown.
    """
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log(
        "/read_me",
        rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN),
        static=True,
    )
    times = _times(scene, np.arange(len(scene.pose)))
    drawing.arm(recording, "/cell/ghost", scene, scene.nominal, times, GHOST)
    larger = magnify(scene.nominal, scene.actual, scene.magnified)
    drawing.arm(recording, "/cell/arm", scene, larger, times, None)
    drawing.load(recording, scene, times)
    drawing.errors(recording, error_mm, _times(scene, error_row))


def _times(scene: Scene, row: Int[np.ndarray, " rows"]) -> list[rr.TimeColumn]:
    return [
        rr.TimeColumn(READING, sequence=row),
        rr.TimeColumn(POSE, sequence=scene.pose[row]),
    ]


def magnify(
    nominal: Float[np.ndarray, "*rows 4 4"],
    actual: Float[np.ndarray, "*rows 4 4"],
    factor: float,
) -> Float[np.ndarray, "*rows 4 4"]:
    """Return transforms that differ from nominal by a multiple of what they do.

    Positions by p + factor (p' - p), orientations by the rotation vector of R' Rᵀ times
    the factor.
    """
    result = nominal.copy()
    result[..., :3, 3] += factor * (actual[..., :3, 3] - nominal[..., :3, 3])
    turn = actual[..., :3, :3] @ np.swapaxes(nominal[..., :3, :3], -1, -2)
    shape = turn.shape
    vector = factor * Rotation.from_matrix(turn.reshape(-1, 3, 3)).as_rotvec()
    turned = Rotation.from_rotvec(vector).as_matrix().reshape(shape)
    result[..., :3, :3] = turned @ nominal[..., :3, :3]
    return result


def blueprint(tabs: tuple[rrb.View | rrb.Container, ...] = ()) -> rrb.Blueprint:
    """Return the layout that opens on the timeline of readings, camera on the arm.

    Args:
        tabs: What gets a tab beside the errors.
    """
    camera = rrb.EyeControls3D(
        position=(1.55, -1.6, 1.25), look_target=(0.25, 0.0, 0.62), eye_up=(0, 0, 1)
    )
    plots = [
        rrb.TimeSeriesView(origin=f"/error/{axis}", name=f"error in {axis} [mm]")
        for axis in "xyz"
    ]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                origin="/cell",
                name="the cell",
                eye_controls=camera,
                background=[250, 250, 250],
                line_grid=False,
            ),
            rrb.Tabs(
                rrb.Vertical(
                    rrb.TextDocumentView(origin="/read_me", name="what is shown"),
                    *plots,
                    row_shares=[1.3, *[1] * len(plots)],
                    name="pose by pose",
                ),
                *tabs,
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=READING, state="collapsed", fps=9.0),
        collapse_panels=True,
    )


def saved(
    file: Path, name: str, seed: int, layout: rrb.Blueprint | None = None
) -> rr.RecordingStream:
    """Open a recording that is saved to a file, with its blueprint."""
    recording = rr.RecordingStream("stiffness_bench", recording_id=f"{name}-{seed}")
    recording.save(str(file), default_blueprint=layout or blueprint())
    return recording


def live(
    name: str, seed: int, layout: rrb.Blueprint | None = None
) -> rr.RecordingStream:
    """Open a recording that streams to a viewer on this machine."""
    recording = rr.RecordingStream("stiffness_bench", recording_id=f"{name}-{seed}")
    recording.spawn(default_blueprint=layout or blueprint())
    return recording
