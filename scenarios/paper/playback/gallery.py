"""The worst poses stand beside each other, with every method's error on each."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Int

from bench import drawing
from bench.viewer import Scene, magnify

GALLERY = "/worst_ten"
A_ROW = 5
APART = np.array([1.9, 0.0, -2.0])
"""Steps to the next arm in a row and to the next row, along x and z, in m; chosen."""
ERRORS_MAGNIFIED = 2000.0
"""An error of 0.1 mm is an arrow of 200 mm; chosen."""
LINES = {"rigid": ((150, 158, 170), 0.012), "actual": ((240, 100, 0), 0.028)}


def view() -> rrb.Spatial3DView:
    """Return the view of all of them, from the side."""
    middle = 0.5 * APART * [A_ROW - 1, 0, 1]
    target = np.array([0.2, 0.0, 0.6]) + middle
    away = np.array([0.0, -7.8, 0.5])
    camera = rrb.EyeControls3D(
        position=target + away, look_target=target, eye_up=(0, 0, 1)
    )
    return rrb.Spatial3DView(
        origin=GALLERY,
        name="the worst ten",
        eye_controls=camera,
        background=[250, 250, 250],
        line_grid=False,
    )


def colours(methods: Iterable[str]) -> dict[str, tuple[int, int, int]]:
    """Return the colour of each method, the same as in the curves of errors."""
    return dict(zip(methods, cycle(drawing.COLOURS), strict=False))


def hang(
    recording: rr.RecordingStream,
    scene: Scene,
    rows: Int[np.ndarray, " worst"],
    error_mm: Mapping[str, Float[np.ndarray, "worst 3"]],
    words: Sequence[str],
) -> None:
    """Draw arms as lines from base to flange, whatever the time is.

    Args:
        recording: Where to.
        scene: What is to be seen, row by row.
        rows: Which of them are drawn, worst first.
        error_mm: Of each method in each of them.
        words: What stands at the foot of each.
    """
    steps = np.stack([np.divmod(k, A_ROW) for k in range(len(rows))])
    place = APART * np.stack([steps[:, 1], 0 * steps[:, 0], steps[:, 0]], axis=1)
    nominal, actual = scene.nominal[rows], scene.actual[rows]
    arms = {"rigid": nominal, "actual": magnify(nominal, actual, scene.magnified)}
    for name, transforms in arms.items():
        colour, radius = LINES[name]
        strips = list(transforms[..., :3, 3] + place[:, None])
        lines = rr.LineStrips3D(strips, colors=[colour], radii=radius)
        recording.log(f"{GALLERY}/{name}", lines, static=True)
    foot = rr.Points3D(place, labels=list(words), radii=0.05, colors=[60, 60, 60])
    recording.log(f"{GALLERY}/foot", foot, static=True)
    flange, colour = arms["actual"][:, -1, :3, 3] + place, colours(error_mm)
    for name, error in error_mm.items():
        arrows = rr.Arrows3D(
            vectors=1e-3 * ERRORS_MAGNIFIED * error,
            origins=flange,
            colors=[colour[name]],
            radii=0.012,
        )
        path = f"{GALLERY}/errors/{rr.escape_entity_path_part(name)}"
        recording.log(path, arrows, static=True)
