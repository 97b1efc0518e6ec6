"""Rerun playback of the study: the arm, errors, the worst poses, training curves.

The experiment is shown row by row: the arm, its rigid ghost, the rope and the methods'
errors. The poses with the largest errors stand side by side, worst first, on a timeline
of their own; each network's training is a curve over its steps.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Int

from bench import viewer
from bench.cell import HOOK_SITE, MOUNT
from bench.shared import replaced_whole
from bench.viewer import Scene, magnify
from scenarios.studies.paper.cells import Cell, CellResult
from scenarios.studies.paper.comparison import Contender
from scenarios.studies.paper.experiment import Experiment
from scenarios.studies.paper.linear_fit import LinearFit
from scenarios.studies.paper.transfer import ConvolutionCell, PerceptronCell
from stiffness.experiment.deflections import Deflections

# --- Training curves ------------------------------------------------------------------

STEP = "step"
LEARNT = ("learnt", "held_back")


@dataclass(frozen=True)
class Curve:
    """The training curve of one network.

    Attributes:
        name: Name of the network; a path in the playback.
        step: Completed steps or epochs.
        value: Loss, or error in mm.
    """

    name: str
    step: Float[np.ndarray, " points"]
    value: Float[np.ndarray, " points"]


def curves(cell: Cell, result: CellResult) -> list[Curve]:
    """Return the training curves of a cell of the study's comparison."""
    if not isinstance(cell, PerceptronCell | ConvolutionCell):
        return []
    kind = "ft_mlp" if isinstance(cell, PerceptronCell) else "dt_cnn"
    name = f"{kind}/{cell.plan.replace(' ', '_')}/seed_{cell.seed}"
    found = [Curve(f"loss/{name}", result["step"], result["loss"])]
    if "best/curve" in result:
        epoch = np.arange(1.0, 1.0 + result["best/curve"].shape[1])
        for part, value in zip(LEARNT, result["best/curve"], strict=True):
            found.append(Curve(f"tuning_mae_mm/{name}/{part}", epoch, value))
    return found


def show_curve(recording: rr.RecordingStream, curve: Curve) -> None:
    """Log a curve on the timeline of steps."""
    path = f"/training/{curve.name}"
    times = [rr.TimeColumn(STEP, sequence=curve.step.astype(int))]
    values = rr.Scalars.columns(scalars=curve.value)
    viewer.draw(recording, path, times, values, rr.SeriesLines(names=curve.name))


# --- The scene ------------------------------------------------------------------------

MAGNIFIED = 50.0


def scene(experiment: Experiment) -> viewer.Scene:
    """Return the experiment's scene, row by row."""
    rig, plan, states = experiment.rig, experiment.plan, experiment.states
    anatomy = rig.anatomy
    bodies = (anatomy.base, *anatomy.links, anatomy.flange)
    index = [states.bodies.index(body) for body in bodies]
    actual = np.tile(np.eye(4), (len(plan.row_visit), len(bodies), 1, 1))
    actual[..., :3, :3] = states.rotation[:, index]
    actual[..., :3, 3] = states.position[:, index]
    posture = plan.posture[plan.row_visit]
    nominal = experiment.arm.placements(posture, list(bodies))
    hook = states.point(MOUNT, rig.model.site(HOOK_SITE).pos)
    pulley = plan.pulley[plan.row_visit]
    centre = rig.mounted.pulley[pulley]
    weight = np.stack([rig.model.site(f"weight_{p}").pos for p in pulley])
    mount = states.bodies.index(MOUNT)
    force = (states.rotation[:, mount] @ states.wrench[:, :3, None])[..., 0]
    return viewer.Scene(
        model=rig.nominal,
        bodies=bodies,
        nominal=nominal,
        actual=actual,
        pose=plan.row_visit,
        magnified=MAGNIFIED,
        rope=np.stack([hook, centre, weight], axis=1),
        force=force,
        markers=_markers(experiment),
    )


def _markers(experiment: Experiment) -> np.ndarray:
    points = experiment.recording.points
    assert points is not None
    frame = experiment.measured.frame.base_from_tracker
    return points @ frame[:3, :3].T + frame[:3, 3]


# --- The gallery ----------------------------------------------------------------------

GALLERY = "/worst_ten"
A_ROW = 5
APART = np.array([1.9, 0.0, -2.0])
"""Steps to the next arm in a row and to the next row, along x and z, in m; chosen."""
ERRORS_MAGNIFIED = 2000.0
"""An error of 0.1 mm is an arrow of 200 mm; chosen."""
LINES = {"rigid": ((150, 158, 170), 0.012), "actual": ((240, 100, 0), 0.028)}


def view() -> rrb.Spatial3DView:
    """Return the view of all worst poses, from the side."""
    middle = 0.5 * APART * [A_ROW - 1, 0, 1]
    target = np.array([0.2, 0.0, 0.6]) + middle
    eye = target + np.array([0.0, -7.8, 0.5])
    return viewer.arm_view(GALLERY, "the worst ten", eye, target)


def colours(methods: Iterable[str]) -> dict[str, tuple[int, int, int]]:
    """Return the colour of each method, the same as in the curves of errors."""
    return dict(zip(methods, cycle(viewer.COLOURS), strict=False))


def hang(
    recording: rr.RecordingStream,
    scene: Scene,
    rows: Int[np.ndarray, " worst"],
    error_mm: Mapping[str, Float[np.ndarray, "worst 3"]],
    words: Sequence[str],
) -> None:
    """Log arms as static lines from base to flange, side by side.

    Rows are those drawn, worst first, with a label at the foot of each; errors are in
    mm.
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


# --- The worst poses ------------------------------------------------------------------

WORST = "worst"
TEN = 10


def worst_poses(
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]],
) -> Int[np.ndarray, " worst"]:
    """Return the ten poses of largest error by any method but the springs, sorted.

    Errors are compared by their length over all directions.
    """
    shown = list(error_mm.values())
    learnt = [error for name, error in error_mm.items() if name != "vjm"]
    lengths = [np.linalg.norm(error, axis=1) for error in learnt or shown]
    size = np.max(lengths, axis=0)
    return np.argsort(-size, kind="stable")[:TEN]


def show_worst(
    recording: rr.RecordingStream,
    scene: Scene,
    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]],
    measured: Deflections,
) -> None:
    """Log the worst poses side by side, on a timeline of their own, and in a table.

    Errors are in mm.
    """
    chosen = worst_poses(error_mm)
    rows = measured.row[chosen]
    time = [rr.TimeColumn(WORST, sequence=np.arange(1, len(rows) + 1))]

    def send(path: str, columns: rr.ComponentColumnList) -> None:
        viewer.draw(recording, path, time, columns)

    nominal, actual = scene.nominal[rows], scene.actual[rows]
    larger = magnify(nominal, actual, scene.magnified)
    for root, transforms in (("/cell/ghost", nominal), ("/cell/arm", larger)):
        for b, body in enumerate(scene.bodies):
            send(f"{root}/{body}", viewer.poses(transforms[:, b]))
    corners = scene.rope[rows].astype(np.float32)
    send("/cell/rope", rr.LineStrips3D.columns(strips=list(corners)))
    pull = scene.force[rows] * viewer.METRES_PER_NEWTON
    send("/cell/force", viewer.arrows(corners[:, 0], pull))
    send("/cell/weight", rr.Points3D.columns(positions=corners[:, -1]))
    for name, error in error_mm.items():
        arrow = 1e-3 * ERRORS_MAGNIFIED * error[chosen]
        path = f"/cell/errors/{rr.escape_entity_path_part(name)}"
        send(path, viewer.arrows(actual[:, -1, :3, 3], arrow))
    words = [
        f"{i}: pose {pose}" for i, pose in enumerate(measured.posture_id[chosen], 1)
    ]
    at_worst = {name: error[chosen] for name, error in error_mm.items()}
    hang(recording, scene, rows, at_worst, words)
    lines = [f"| | pose | A1 to A6 [deg] | {' | '.join(error_mm)} [mm] |"]
    lines.append("|" + "---|" * (3 + len(error_mm)))
    for rank, k in enumerate(chosen, start=1):
        angles = np.rad2deg(measured.cases.posture[k])
        sizes = [f"{np.linalg.norm(error[k]):.3f}" for error in error_mm.values()]
        posture = ", ".join(f"{angle:.0f}" for angle in angles)
        cells = [str(rank), str(measured.posture_id[k]), posture, *sizes]
        lines.append(f"| {' | '.join(cells)} |")
    text = "\n".join(["## The worst ten poses", "", *lines])
    text += (
        "\n\nLengths of the errors. Below: the ten beside each other, rigid (grey) and "
        f"as they stand (orange, magnified {scene.magnified:.0f} times), with every "
        f"method's error ({ERRORS_MAGNIFIED:.0f} times). The timeline `{WORST}` goes "
        "through them in the cell."
    )
    viewer.write(recording, "/worst", text)


# --- The whole playback ---------------------------------------------------------------

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
    """Errors and training curves of the methods that are shown.

    Attributes:
        error_mm: Errors of each method in each pose of the experiment, in mm.
    """

    error_mm: Mapping[str, Float[np.ndarray, "poses 3"]]
    curves: Sequence[Curve]


def opened(seed: int, file: Path | None = None) -> rr.RecordingStream:
    """Open a playback to a file, or to a viewer on this machine."""
    return viewer.opened("stiffness_bench", f"study-{seed}", LAYOUT, file)


def save(
    file: Path, seed: int, experiment: Experiment, found: LinearFit, learnt: Learnt
) -> None:
    """Write a playback whole, or keep the earlier file; content as in `show`."""
    with replaced_whole(file) as beside:
        show(opened(seed, beside), experiment, found, learnt)


def show(
    recording: rr.RecordingStream,
    experiment: Experiment,
    found: LinearFit,
    learnt: Learnt,
) -> None:
    """Log the scene, errors, worst poses, curves and text."""
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
    """Log each method's error as an arrow at the flange, side by side."""
    rows = experiment.measured.row
    place = shown.actual[rows, -1, :3, 3]
    times = [rr.TimeColumn(viewer.READING, sequence=rows)]
    colour = colours(learnt.error_mm)
    for name, error in learnt.error_mm.items():
        path = f"/cell/errors/{rr.escape_entity_path_part(name)}"
        columns = viewer.arrows(place, 1e-3 * ERRORS_MAGNIFIED * error)
        look = rr.Arrows3D.from_fields(colors=[colour[name]], radii=0.005)
        viewer.draw(recording, path, times, columns, look)


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


# --- What was found -------------------------------------------------------------------


def shown_errors(methods: Sequence[Contender]) -> dict:
    """Return the errors that the playback shows: each method on its best plan."""
    variants = ("pretrained", "aligned", "frozen")
    return {
        c.method: c.experiment
        for c in methods
        if c.method not in variants and c.plan in ("-", "spanning")
    }
