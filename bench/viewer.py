"""Viewer: an experiment as a Rerun recording with arm, rope, forces and errors.

A saved recording opens on the timeline `reading`, one tick a measured state: the arm
under load (deflection magnified, the factor is shown), its rigid ghost, the rope, the
force, the markers, and below them the errors of the methods pose by pose.

Bodies, rope, force and marks are logged once and then moved by columns of numbers.
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

from bench.meshes import shapes

# --- Drawing --------------------------------------------------------------------------

COLOURS = (
    *((240, 100, 0), (31, 111, 180), (58, 146, 58), (138, 138, 138)),
    (126, 87, 194),
)
"""Colours of the methods, in their order."""
METRES_PER_NEWTON = 1 / 300
"""Scale of the force's arrow; chosen: 100 N are a third of a metre."""


def draw_arm(
    recording: rr.RecordingStream,
    root: str,
    scene: "Scene",
    transforms: Float[np.ndarray, "rows bodies 4 4"],
    times: list[rr.TimeColumn],
    colour: Float[np.ndarray, "4"] | None,
) -> None:
    """Log the arm's shapes, in one colour or their own, and move its bodies."""
    for b, body in enumerate(scene.bodies):
        recording.send_columns(
            f"{root}/{body}",
            indexes=times,
            columns=rr.Transform3D.columns(
                translation=transforms[:, b, :3, 3].astype(np.float32),
                mat3x3=transforms[:, b, :3, :3].astype(np.float32),
            ),
        )
    for i, shape in enumerate(shapes(scene.model)):
        if shape.body not in scene.bodies:
            continue
        rgba = shape.rgba if colour is None else colour
        flat = shape.vertex[shape.face].reshape(-1, 3).astype(np.float32)
        normal = np.cross(flat[1::3] - flat[::3], flat[2::3] - flat[::3])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        recording.log(
            f"{root}/{shape.body}/shape_{i}",
            rr.Mesh3D(
                vertex_positions=flat,
                vertex_normals=np.repeat(normal, 3, axis=0).astype(np.float32),
                albedo_factor=rr.components.AlbedoFactor(
                    (255 * np.asarray(rgba)).astype(np.uint8)
                ),
            ),
            static=True,
        )


def draw_load(
    recording: rr.RecordingStream, scene: "Scene", times: list[rr.TimeColumn]
) -> None:
    """Log the rope, its force and the marks."""

    def send(path, columns):
        recording.send_columns(path, indexes=times, columns=columns)

    corners = scene.rope.astype(np.float32)
    send("/cell/rope", rr.LineStrips3D.columns(strips=list(corners)))
    recording.log(
        "/cell/rope",
        rr.LineStrips3D.from_fields(colors=[60, 60, 60], radii=0.004),
        static=True,
    )
    pull = scene.force * METRES_PER_NEWTON
    send(
        "/cell/force",
        rr.Arrows3D.columns(vectors=pull.astype(np.float32), origins=corners[:, 0]),
    )
    recording.log(
        "/cell/force",
        rr.Arrows3D.from_fields(colors=[192, 61, 62], radii=0.012),
        static=True,
    )
    send(
        "/cell/weight",
        rr.Points3D.columns(positions=corners[:, -1]),
    )
    recording.log(
        "/cell/weight",
        rr.Points3D.from_fields(colors=[40, 40, 45], radii=0.05),
        static=True,
    )
    rows, markers = scene.markers.shape[:2]
    send(
        "/cell/markers",
        rr.Points3D.columns(
            positions=scene.markers.reshape(-1, 3).astype(np.float32)
        ).partition([markers] * rows),
    )
    recording.log(
        "/cell/markers",
        rr.Points3D.from_fields(colors=[20, 120, 220], radii=0.007),
        static=True,
    )


def draw_errors(
    recording: rr.RecordingStream,
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]],
    times: list[rr.TimeColumn],
) -> None:
    """Plot each method's error at the times of the poses."""
    for m, (method, error) in enumerate(error_mm.items()):
        for a, axis in enumerate("xyz"):
            recording.send_columns(
                f"/error/{axis}/{method}",
                indexes=times,
                columns=rr.Scalars.columns(scalars=error[:, a]),
            )
            recording.log(
                f"/error/{axis}/{method}",
                rr.SeriesLines(names=method, colors=[COLOURS[m % len(COLOURS)]]),
                static=True,
            )


# --- Scene and layout -----------------------------------------------------------------

READING, POSE = "reading", "pose"
GHOST = np.array([0.55, 0.6, 0.66, 0.28])


@dataclass(frozen=True)
class Scene:
    """Data of an experiment to be shown, row by row, in the base's frame.

    Attributes:
        model: The nominal arm, whose shapes are shown.
        nominal: Transforms of the rigid arm, base_from_body, in m.
        actual: Transforms of the loaded arm.
        pose: The visit of each row.
        magnified: Factor of the deflection.
        rope: Corners of the rope, from the hook on, in m.
        force: Force of the rope on the hook, in N.
        markers: Measured positions of the markers, in m; NaN = not seen.
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
    """Log an experiment, saved or live, with the error of each method in each pose.

    Errors are in mm along x, y, z, each with the row that it belongs to; words are
    notes for the reader, in Markdown.
    """
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log(
        "/read_me",
        rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN),
        static=True,
    )
    times = _times(scene, np.arange(len(scene.pose)))
    draw_arm(recording, "/cell/ghost", scene, scene.nominal, times, GHOST)
    larger = magnify(scene.nominal, scene.actual, scene.magnified)
    draw_arm(recording, "/cell/arm", scene, larger, times, None)
    draw_load(recording, scene, times)
    draw_errors(recording, error_mm, _times(scene, error_row))


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
    """Return transforms whose difference from nominal is multiplied by a factor.

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

    Tabs stand beside the errors.
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
