"""The poses that methods get most wrong are one click away, worst first."""

from collections.abc import Mapping

import numpy as np
import rerun as rr
from jaxtyping import Float, Int

from bench.viewer import Scene, magnify
from scenarios.paper.playback.gallery import ERRORS_MAGNIFIED, hang
from stiffness.deflections import Deflections

WORST = "worst"
TEN = 10


def worst_poses(
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]], count: int = TEN
) -> Int[np.ndarray, " count"]:
    """Return the poses with the largest error of any method but the springs, in turn.

    The length of a method's error in all directions is what counts.
    """
    shown = list(error_mm.values())
    learnt = [error for name, error in error_mm.items() if name != "vjm"]
    lengths = [np.linalg.norm(error, axis=1) for error in learnt or shown]
    size = np.max(lengths, axis=0)
    return np.argsort(-size, kind="stable")[:count]


def show_worst(
    recording: rr.RecordingStream,
    scene: Scene,
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]],
    measured: Deflections,
) -> None:
    """Log the worst poses side by side, on a timeline of their own, and in a table.

    Args:
        recording: Where to.
        scene: What is to be seen, row by row.
        error_mm: Of each method in each pose.
        measured: Which row and posture each pose is.
    """
    chosen = worst_poses(error_mm)
    rows = measured.row[chosen]
    time = [rr.TimeColumn(WORST, sequence=np.arange(1, len(rows) + 1))]

    def send(path: str, columns) -> None:
        recording.send_columns(path, indexes=time, columns=columns)

    nominal, actual = scene.nominal[rows], scene.actual[rows]
    larger = magnify(nominal, actual, scene.magnified)
    for root, transforms in (("/cell/ghost", nominal), ("/cell/arm", larger)):
        for b, body in enumerate(scene.bodies):
            columns = rr.Transform3D.columns(
                translation=transforms[:, b, :3, 3].astype(np.float32),
                mat3x3=transforms[:, b, :3, :3].astype(np.float32),
            )
            send(f"{root}/{body}", columns)
    corners = scene.rope[rows].astype(np.float32)
    send("/cell/rope", rr.LineStrips3D.columns(strips=list(corners)))
    pull = (scene.force[rows] / 300.0).astype(np.float32)
    send("/cell/force", rr.Arrows3D.columns(vectors=pull, origins=corners[:, 0]))
    send("/cell/weight", rr.Points3D.columns(positions=corners[:, -1]))
    for name, error in error_mm.items():
        arrow = (1e-3 * ERRORS_MAGNIFIED * error[chosen]).astype(np.float32)
        place = actual[:, -1, :3, 3].astype(np.float32)
        path = f"/cell/errors/{rr.escape_entity_path_part(name)}"
        send(path, rr.Arrows3D.columns(vectors=arrow, origins=place))
    words = [f"{i}: pose {pose}" for i, pose in enumerate(measured.pose[chosen], 1)]
    at_worst = {name: error[chosen] for name, error in error_mm.items()}
    hang(recording, scene, rows, at_worst, words)
    lines = [f"| | pose | A1 to A6 [deg] | {' | '.join(error_mm)} [mm] |"]
    lines.append("|" + "---|" * (3 + len(error_mm)))
    for rank, k in enumerate(chosen, start=1):
        angles = np.rad2deg(measured.cases.posture[k])
        sizes = [f"{np.linalg.norm(error[k]):.3f}" for error in error_mm.values()]
        posture = ", ".join(f"{angle:.0f}" for angle in angles)
        cells = [str(rank), str(measured.pose[k]), posture, *sizes]
        lines.append(f"| {' | '.join(cells)} |")
    text = "\n".join(["## The worst ten poses", "", *lines])
    text += (
        "\n\nLengths of the errors. Below: the ten beside each other, rigid (grey) and "
        f"as they stand (orange, magnified {scene.magnified:.0f} times), with every "
        f"method's error ({ERRORS_MAGNIFIED:.0f} times). The timeline `{WORST}` goes "
        "through them in the cell."
    )
    recording.log(
        "/worst", rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True
    )
