"""Bodies, rope, force and marks are drawn once and then moved by columns of numbers."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
from jaxtyping import Float

from bench.shapes import shapes

if TYPE_CHECKING:
    from bench.viewer import Scene

COLOURS = (
    *((240, 100, 0), (31, 111, 180), (58, 146, 58), (138, 138, 138)),
    (126, 87, 194),
)
"""Of the methods, in their order."""
METRES_PER_NEWTON = 1 / 300
"""Length of the force's arrow; chosen: 100 N are a third of a metre."""


def arm(
    recording: rr.RecordingStream,
    root: str,
    scene: "Scene",
    transforms: Float[np.ndarray, "rows bodies 4 4"],
    times: list[rr.TimeColumn],
    colour: Float[np.ndarray, "4"] | None,
) -> None:
    """Draw the arm's shapes, in one colour or their own, and move its bodies."""
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


def load(
    recording: rr.RecordingStream, scene: "Scene", times: list[rr.TimeColumn]
) -> None:
    """Draw the rope, its pull and the marks."""

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


def errors(
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
