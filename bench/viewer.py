"""Viewer: an experiment as a Rerun recording with arm, rope, forces and errors.

A saved recording opens on the timeline `reading`, one tick a measured state: the arm
under load (deflection magnified, the factor is shown), its rigid ghost, the rope, the
force, the markers, and below them the errors of the methods pose by pose.

Bodies, rope, force and marks are logged once and then moved by columns of numbers.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from bench.meshes import Shape, shapes

# --- Drawing --------------------------------------------------------------------------

COLOURS = (
    *((240, 100, 0), (31, 111, 180), (58, 146, 58), (138, 138, 138)),
    (126, 87, 194),
)
"""Colours of the methods, in their order."""
METRES_PER_NEWTON = 1 / 300
"""Scale of the force's arrow; chosen: 100 N are a third of a metre."""


Colour = tuple[int, ...]


def draw(
    recording: rr.RecordingStream,
    path: str,
    times: list[rr.TimeColumn],
    columns: rr.ComponentColumnList,
    look: rr.AsComponents | None = None,
) -> None:
    """Log what changes along the timelines and, once, how it looks."""
    recording.send_columns(path, indexes=times, columns=columns)
    if look is not None:
        recording.log(path, look, static=True)


def poses(transform: Float[np.ndarray, "rows 4 4"]) -> rr.ComponentColumnList:
    """Return the columns of a body's transforms, with positions in m."""
    return rr.Transform3D.columns(
        translation=transform[:, :3, 3].astype(np.float32),
        mat3x3=transform[:, :3, :3].astype(np.float32),
    )


def arrows(
    origin: Float[np.ndarray, "*rows 3"], vector: Float[np.ndarray, "*rows 3"]
) -> rr.ComponentColumnList:
    """Return the columns of arrows, in m: one in every row, or as many as marks."""
    flat = [values.reshape(-1, 3).astype(np.float32) for values in (origin, vector)]
    columns = rr.Arrows3D.columns(origins=flat[0], vectors=flat[1])
    return columns.partition([len(flat[0]) // len(origin)] * len(origin))


def draw_arm(
    recording: rr.RecordingStream,
    root: str,
    arm: tuple[mujoco.MjModel, Sequence[str]],
    transforms: Float[np.ndarray, "rows bodies 4 4"],
    times: list[rr.TimeColumn],
    colour_of: Callable[[Shape], Colour | np.ndarray],
) -> None:
    """Log the shapes of an arm's bodies, and move the bodies.

    The arm is its model and the bodies that are shown; a shape's colour is one for all
    rows, or packed by row.
    """
    model, bodies = arm
    path_of = {b: f"{root}/{rr.escape_entity_path_part(b)}" for b in bodies}
    for b, body in enumerate(bodies):
        draw(recording, path_of[body], times, poses(transforms[:, b]))
    for i, shape in enumerate(shapes(model)):
        if shape.body not in bodies:
            continue
        path = f"{path_of[shape.body]}/shape_{i}"
        flat = shape.vertex[shape.face].reshape(-1, 3).astype(np.float32)
        normal = np.cross(flat[1::3] - flat[::3], flat[2::3] - flat[::3])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        mesh = rr.Mesh3D(
            vertex_positions=flat,
            vertex_normals=np.repeat(normal, 3, axis=0).astype(np.float32),
        )
        recording.log(path, mesh, static=True)
        colour = colour_of(shape)
        if isinstance(colour, np.ndarray):
            draw(recording, path, times, rr.Mesh3D.columns(albedo_factor=colour))
        else:
            plain = rr.components.AlbedoFactor(colour)
            one = rr.Mesh3D.from_fields(albedo_factor=plain)
            recording.log(path, one, static=True)


def draw_load(
    recording: rr.RecordingStream, scene: "Scene", times: list[rr.TimeColumn]
) -> None:
    """Log the rope, its force and the marks."""
    corners = scene.rope.astype(np.float32)
    marks = scene.markers.reshape(-1, 3).astype(np.float32)
    rows, count = scene.markers.shape[:2]
    for path, columns, look in (
        (
            "/cell/rope",
            rr.LineStrips3D.columns(strips=list(corners)),
            rr.LineStrips3D.from_fields(colors=[60, 60, 60], radii=0.004),
        ),
        (
            "/cell/force",
            arrows(corners[:, 0], scene.force * METRES_PER_NEWTON),
            rr.Arrows3D.from_fields(colors=[192, 61, 62], radii=0.012),
        ),
        (
            "/cell/weight",
            rr.Points3D.columns(positions=corners[:, -1]),
            rr.Points3D.from_fields(colors=[40, 40, 45], radii=0.05),
        ),
        (
            "/cell/markers",
            rr.Points3D.columns(positions=marks).partition([count] * rows),
            rr.Points3D.from_fields(colors=[20, 120, 220], radii=0.007),
        ),
    ):
        draw(recording, path, times, columns, look)


def draw_errors(
    recording: rr.RecordingStream,
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]],
    times: list[rr.TimeColumn],
) -> None:
    """Plot each method's error at the times of the poses."""
    for m, (method, error) in enumerate(error_mm.items()):
        look = rr.SeriesLines(names=method, colors=[COLOURS[m % len(COLOURS)]])
        for a, axis in enumerate("xyz"):
            values = rr.Scalars.columns(scalars=error[:, a])
            draw(recording, f"/error/{axis}/{method}", times, values, look)


# --- Scene and layout -----------------------------------------------------------------

READING, POSE = "reading", "pose"
GHOST = (140, 153, 168, 71)
EYE, TARGET = np.array([1.55, -1.6, 1.25]), np.array([0.25, 0.0, 0.62])
"""Where the arm is looked at from, and what is looked at, in m."""


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
    write(recording, "/read_me", words)
    times, arm = _times(scene, np.arange(len(scene.pose))), (scene.model, scene.bodies)
    draw_arm(recording, "/cell/ghost", arm, scene.nominal, times, lambda _: GHOST)
    larger = magnify(scene.nominal, scene.actual, scene.magnified)
    draw_arm(recording, "/cell/arm", arm, larger, times, own_colour)
    draw_load(recording, scene, times)
    draw_errors(recording, error_mm, _times(scene, error_row))


def own_colour(shape: Shape) -> Colour:
    """Return the colour of a shape in its model."""
    return tuple((255 * shape.rgba).astype(int).tolist())


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
    plots = [
        rrb.TimeSeriesView(origin=f"/error/{axis}", name=f"error in {axis} [mm]")
        for axis in "xyz"
    ]
    return side_by_side(
        arm_view("/cell", "the cell", EYE, TARGET),
        rrb.Tabs(
            rrb.Vertical(
                rrb.TextDocumentView(origin="/read_me", name="what is shown"),
                *plots,
                row_shares=[1.3, *[1] * len(plots)],
                name="pose by pose",
            ),
            *tabs,
        ),
        rrb.TimePanel(timeline=READING, state="collapsed", fps=9.0),
    )


def arm_view(
    origin: str, name: str, eye: np.ndarray, target: np.ndarray
) -> rrb.Spatial3DView:
    """Return a view of arms, from an eye that looks at a target, in m."""
    camera = rrb.EyeControls3D(
        position=tuple(eye), look_target=tuple(target), eye_up=(0, 0, 1)
    )
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        eye_controls=camera,
        background=[250, 250, 250],
        line_grid=False,
    )


def side_by_side(
    left: rrb.View | rrb.Container, right: rrb.Container, time: rrb.TimePanel
) -> rrb.Blueprint:
    """Return a layout with arms at the left, and texts and curves at the right."""
    both = rrb.Horizontal(left, right, column_shares=[3, 2])
    return rrb.Blueprint(both, time, collapse_panels=True)


def write(recording: rr.RecordingStream, path: str, words: str) -> None:
    """Log a text in Markdown."""
    text = rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN)
    recording.log(path, text, static=True)


def opened(
    application: str, identity: str | None, layout: rrb.Blueprint, file: Path | None
) -> rr.RecordingStream:
    """Open a recording to a file, or to a viewer where none is given."""
    recording = rr.RecordingStream(application, recording_id=identity)
    if file is None:
        recording.spawn(default_blueprint=layout)
    else:
        recording.save(str(file), default_blueprint=layout)
    return recording
