"""Rerun playbacks of a diagnosis, a calibration and a comparison of encoders.

Of a diagnosis, on the timeline `pose`: the arm as recorded under its largest load, each
body coloured by its markers' distance from the nominal simulation, or, of many names,
by its place's share of the mismatch; a ghost that gives way as the patch does and
arrows, the error before and after it, are magnified; beside the arm stand the wind-up
curves, measured and simulated.

Of a calibration, on the timeline `pose`: the links as calibrated; arrows are the
simulator's error on the held-out poses before and after, magnified.

Of a comparison of encoders: their difference over time, before and after.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float, Int

from bench.meshes import shapes
from bench.proof.comparison import residual_of
from bench.proof.proof import Proof
from bench.proof.simulation import NominalState
from bench.shared.settings import MICRO, MM, URAD
from bench.viewer import (
    Colour,
    arm_view,
    arrows,
    draw,
    draw_arm,
    magnify,
    opened,
    side_by_side,
    write,
)
from scenarios.pipelines.diagnosis import Curves, Result, courses_of, curves_of
from scenarios.report import error_budget, summary
from scenarios.report.error_budget import MANY, ErrorBudget, budget_of, percent

if TYPE_CHECKING:
    from scenarios.pipelines.calibration_proof import CalibrationProof
    from scenarios.pipelines.encoder_axes import Axis
    from stiffness.calibration.result import Calibrated

# --- Curves of an axis ----------------------------------------------------------------

WIDTH, HEIGHT = 100.0, 60.0
"""Width and height of a curve's plot, in its own units; chosen."""
ACROSS, DOWN = (-58.0, 54.0), (-38.0, 46.0)
"""Visible range across and down, in the same units; chosen: a margin for words."""
GREY, ORANGE = (120, 120, 120), (240, 100, 0)


def curves(stream: rr.RecordingStream, finding: Result, curves: Curves) -> None:
    """Log the wind-up curves of the axes in `shown_axes`."""
    for k in shown_axes(finding, curves):
        name = curves.axes[k]
        courses = courses_of(curves, name)
        torque = np.concatenate([c.torque for c in courses])
        turn = np.concatenate([v for c in courses for v in (c.measured, c.law)])
        middle, wide = np.mean([torque.min(), torque.max()]), np.ptp(torque) / 2
        centre, high = np.mean([turn.min(), turn.max()]), np.ptp(turn) / 2

        def placed(x: np.ndarray, y: np.ndarray, at=(middle, wide, centre, high)):
            across = WIDTH / 2 * (x - at[0]) / max(at[1], 1e-9)
            up = -HEIGHT / 2 * (y - at[2]) / max(at[3], 1e-9)
            return np.column_stack([across, up]).astype(np.float32)

        measured = np.concatenate([placed(c.torque, c.measured) for c in courses])
        points = rr.Points2D(measured, colors=[GREY], radii=0.9)
        stream.log(f"/curves/{name}/measured", points, static=True)
        if finding.proof is not None:
            strips = [placed(c.torque, c.law) for c in courses]
            lines = rr.LineStrips2D(strips, colors=[ORANGE], radii=0.35)
            stream.log(f"/curves/{name}/patch", lines, static=True)
        left, foot = -WIDTH / 2 - 4, HEIGHT / 2 + 4
        frame = [[[left, -HEIGHT / 2], [left, foot], [WIDTH / 2, foot]]]
        lines = rr.LineStrips2D(frame, colors=[(150, 150, 150)], radii=0.15)
        stream.log(f"/curves/{name}/axes", lines, static=True)
        slides = curves.slides[k]
        load, unit = ("force", "N") if slides else ("torque", "N m")
        moved, small = ("shift", "µm") if slides else ("turn", "µrad")
        texts = [
            f"{load} {torque.min():.0f} to {torque.max():.0f} {unit}",
            f"{moved} over {MICRO * 2 * high:.0f} {small}",
        ]
        labels = rr.Points2D(
            [[0.0, foot + 5], [left + 14, -HEIGHT / 2]],
            labels=texts,
            colors=[(20, 20, 20)],
            radii=0.01,
        )
        stream.log(f"/curves/{name}/labels", labels, static=True)


def shown_axes(finding: Result, curves: Curves) -> list[int]:
    """Return up to three axes to show: those named or located, else the first two.

    Of many names, all whose turn is more than noise.
    """
    places = [n.where for n in finding.answer.named]
    places += [x.where for x in finding.answer.located]
    found = [k for k, name in enumerate(curves.axes) if name in places]
    if len(finding.answer.named) >= MANY:
        return [k for k in found if curves.visible[k]]
    return (found or list(range(min(2, len(curves.axes)))))[:3]


# --- The arm --------------------------------------------------------------------------

COLD, WARM, HOT = (196, 200, 204), (240, 100, 0), (150, 20, 30)


def poses_of(
    simulated: Proof, assumed: NominalState, rows: np.ndarray
) -> Float[np.ndarray, "rows bodies 4 4"]:
    """Return where all bodies are in some rows, base_from_body, in m."""
    states = simulated.simulation.see(assumed).states
    base, turn = simulated.simulation.base
    pose = np.zeros((len(rows), len(states.bodies), 4, 4))
    pose[..., :3, :3] = turn.T @ states.rotation[rows]
    pose[..., :3, 3] = (states.position[rows] - base) @ turn
    pose[..., 3, 3] = 1.0
    return pose


SWAY = 0.2
"""Displacement of the magnified ghost that one pose in ten exceeds, in m; chosen: seen,
and still an arm."""
FAINT: Colour = (240, 110, 20, 75)
"""Colour of the ghost."""


def ghost_poses(
    simulated: Proof, rows: np.ndarray
) -> tuple[float, Float[np.ndarray, "rows bodies 4 4"]]:
    """Return a factor, and the patched arm's poses beyond the nominal ones, magnified.

    Bodies are at nominal + factor (patched - nominal).
    """
    nominal = poses_of(simulated, simulated.nominal, rows)
    patched = poses_of(simulated, simulated.patched, rows)
    moved = np.linalg.norm((patched - nominal)[..., :3, 3], axis=-1).max(axis=1)
    factor = _round(SWAY / max(float(np.quantile(moved, 0.9)), 1e-9))
    return factor, magnify(nominal, patched, factor)


def marked_places(
    stream: rr.RecordingStream,
    simulated: Proof,
    budget: ErrorBudget,
    pose: Float[np.ndarray, "rows bodies 4 4"],
    times: list[rr.TimeColumn],
) -> None:
    """Log a labelled point at each axis that has a share of the mismatch."""
    names = simulated.simulation.see(simulated.patched).states.bodies
    links = simulated.nominal.rig.anatomy.links
    colour = error_budget.shades(budget)
    for i, k in enumerate(simulated.simulation.order, 1):
        where = f"a{i}"
        if where not in budget.of_places:
            continue
        at = pose[:, names.index(links[k]), :3, 3].astype(np.float32)
        style = rr.Points3D.from_fields(
            colors=[tuple(round(255 * c) for c in colour[where])],
            labels=[f"{where} {percent(budget.of_places[where])}"],
            show_labels=True,
            radii=0.02,
        )
        place = rr.Points3D.columns(positions=at)
        path = f"/cell/places/{rr.escape_entity_path_part(where)}"
        draw(stream, path, times, place, style)


def heat_of(simulated: Proof, residual: np.ndarray) -> dict[str, np.ndarray]:
    """Return the error of every body by visit, scaled: 0 the noise, 1 the worst."""
    simulation = simulated.simulation
    visit, noise = simulation.replay.visit, simulated.mode.sigma * np.sqrt(3.0)
    found = {
        body: _rms_of_visits(
            visit, residual[:, [name == body for name in simulation.body]]
        )
        for body in dict.fromkeys(simulation.body)
    }
    worst = max(np.quantile(np.concatenate(list(found.values())), 0.98), 2.0 * noise)
    return {
        body: np.clip((values - noise) / (worst - noise), 0.0, 1.0)
        for body, values in found.items()
    }


def _rms_of_visits(
    visit: Int[np.ndarray, " rows"], residual: Float[np.ndarray, "rows markers 3"]
) -> Float[np.ndarray, " visits"]:
    square = np.sum(residual**2, axis=2)
    total = np.bincount(visit, np.nansum(square, axis=1))
    number = np.bincount(visit, np.isfinite(square).sum(axis=1))
    return np.sqrt(total / np.maximum(number, 1))


def _colours(heat: Float[np.ndarray, " rows"]) -> np.ndarray:
    stops = np.array([COLD, WARM, HOT], dtype=float)
    rgb = np.stack([np.interp(heat, [0.0, 0.6, 1.0], stops[:, c]) for c in range(3)], 1)
    packed = rgb.round().astype(np.uint32)
    return (packed[:, 0] << 24) | (packed[:, 1] << 16) | (packed[:, 2] << 8) | 255


# --- A diagnosis ----------------------------------------------------------------------

POSE = "pose"
LONGEST = 0.15
"""Length of an arrow that few exceed, in m; chosen."""


def show_diagnosis(finding: Result, file: Path | None) -> None:
    """Save the playback, or stream it to a viewer where no file is given."""
    name = f"{finding.answer.recording or 'recording'}-diagnosis"
    stream = opened("stiffness_diagnosis", name, _diagnosis_blueprint(finding), file)
    many = len(finding.answer.named) >= MANY
    said = list((summary.headlines if many else summary.sentences)(finding))
    if many:
        said = [said[0], *(f"- {text}" for text in said[1:])]
    write(stream, "/read_me", "\n\n".join(said))
    simulated = finding.simulated
    if simulated is not None and finding.recording.markers:
        budget = budget_of(finding.answer) if many else None
        _arm(stream, simulated, finding.proof is not None, budget)
        curves(stream, finding, curves_of(simulated))
    stream.flush()
    stream.disconnect()


def _arm(
    stream: rr.RecordingStream,
    simulated: Proof,
    proved: bool,
    budget: ErrorBudget | None,
) -> None:
    simulation, mode = simulated.simulation, simulated.mode
    seen = simulation.see(simulated.nominal)
    rows = _most_loaded(simulated)
    count = len(rows)
    times = [rr.TimeColumn(POSE, sequence=np.arange(count))]
    shape = (simulation.replay.rows, len(simulation.body), 3)
    size = int(np.prod(shape[1:]))
    left = [
        residual_of(simulation, simulation.see(a), mode)[:, :size].reshape(shape)
        for a in (simulated.nominal, simulated.patched)
    ]
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    pose = poses_of(simulated, simulated.nominal, rows)
    if budget is None:
        heat = heat_of(simulated, left[0])
        colours = {body: _colours(of_body) for body, of_body in heat.items()}
    else:
        colours = _colours_of_shares(simulated, budget)
        marked_places(stream, simulated, budget, pose, times)
    arm, grey = (simulated.patched.rig.nominal, seen.states.bodies), (*COLD, 255)
    draw_arm(stream, "/cell/arm", arm, pose, times, lambda s: colours.get(s.body, grey))
    said = ""
    if proved:
        factor, larger = ghost_poses(simulated, rows)
        draw_arm(stream, "/cell/ghost", arm, larger, times, lambda _: FAINT)
        said = (
            " The ghost gives way as the patch does beyond the nominal arm, "
            f"{factor:g} times as far."
        )
    missed_by = np.linalg.norm(left[0], axis=2)
    if np.isfinite(missed_by[rows]).any():  # markers may be hidden under all loads
        missed_by = missed_by[rows]
    usual = np.nanquantile(missed_by, 0.98)
    magnified = _round(LONGEST / max(float(usual), 1e-9))
    visit = simulation.replay.visit
    for name, values, colour in zip(
        ("before", "after"), left, (GREY, ORANGE), strict=True
    ):
        if name == "before" or proved:
            missed = arrows(seen.point[rows], magnified * np.nan_to_num(values[rows]))
            style = rr.Arrows3D.from_fields(colors=[colour], radii=0.004)
            draw(stream, f"/cell/{name}", times, missed, style)
        rms = MICRO * _rms_of_visits(visit, values)
        lines = rr.SeriesLines(names=f"{name} [µm]", colors=[colour])
        scalars = rr.Scalars.columns(scalars=rms)
        draw(stream, f"/error/{name}", times, scalars, lines)
    note = (
        f"Arrows: what the simulation misses, magnified {magnified:.0f} times. Grey: "
        f"nominal arm. Orange: with the patch.{said}"
    )
    if budget is not None:
        note += " The darker a place, the larger its share of the mismatch."
    stream.log("/note", rr.TextDocument(note), static=True)


def _colours_of_shares(simulated: Proof, budget: ErrorBudget) -> dict[str, Colour]:
    """Return the colour of each body: of its own share or its axis', the larger."""
    anatomy, found = simulated.nominal.rig.anatomy, {}
    number = {f"link_{i}": k for i, k in enumerate(simulated.simulation.order, 1)}
    for where, rgb in error_budget.body_shades(budget).items():
        body = anatomy.links[number[where]] if where in number else anatomy.body(where)
        red, green, blue = (round(255 * c) for c in rgb)
        found[body] = (red, green, blue, 255)
    return found


def _most_loaded(simulated: Proof) -> np.ndarray:
    """Return the row of each visit at which the load is largest."""
    recording, visit = simulated.simulation.recording, simulated.simulation.replay.visit
    load = np.zeros(len(visit))
    if recording.wrench is not None:
        load = np.linalg.norm(recording.wrench[:, :3], axis=1)
    order = np.lexsort((load, visit))
    return order[np.flatnonzero(np.diff(visit[order], append=-1))]


FIELD = np.radians(50.0)
"""Angle of view that all that is shown fits into; chosen: below the viewer's 55° from
top to bottom, for a view may be narrower than high."""
SIGHT = np.array([0.62, -0.68, 0.39]) / np.linalg.norm([0.62, -0.68, 0.39])
"""Direction from the arm to the eye."""


def eye_on(points: Float[np.ndarray, "points 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Return where to look from and at, in m, so that all points are in view."""
    low, high = points.min(axis=0), points.max(axis=0)
    centre = (low + high) / 2.0
    towards = (points - centre) @ SIGHT
    aside = np.linalg.norm(points - centre - towards[:, None] * SIGHT, axis=1)
    away = max(float(np.max(towards + aside / np.tan(FIELD / 2.0))), 0.3)
    return centre + away * SIGHT, centre


def shown_points(simulated: Proof) -> Float[np.ndarray, "points 3"]:
    """Return corners of the arm and of its ghost in all poses shown, in m."""
    rows = _most_loaded(simulated)
    names = simulated.simulation.see(simulated.patched).states.bodies
    some = [
        poses_of(simulated, simulated.nominal, rows), ghost_poses(simulated, rows)[1]
    ]  # fmt: skip
    found = [pose[:, :, :3, 3].reshape(-1, 3) for pose in some]
    for shape in shapes(simulated.patched.rig.nominal):
        if shape.body not in names:
            continue
        b = names.index(shape.body)
        ends = np.stack([shape.vertex.min(axis=0), shape.vertex.max(axis=0)])
        corner = np.array(np.meshgrid(*ends.T)).reshape(3, -1).T
        for pose in some:
            turned = np.einsum("rij,cj->rci", pose[:, b, :3, :3], corner)
            found.append((turned + pose[:, b, None, :3, 3]).reshape(-1, 3))
    return np.concatenate(found)


def _diagnosis_blueprint(finding: Result) -> rrb.Blueprint:
    simulated, many = finding.simulated, len(finding.answer.named) >= MANY
    drawn = simulated is not None and bool(finding.recording.markers)
    points = np.array([[-0.3, -0.7, 0.0], [1.0, 0.7, 1.2]])
    if simulated is not None and drawn:
        points = shown_points(simulated)
    words = rrb.TextDocumentView(origin="/read_me", name="what was found")
    plots: list = []
    if simulated is not None and drawn:
        found = curves_of(simulated)
        for k in shown_axes(finding, found):
            name = found.axes[k]
            view = rrb.Spatial2DView(
                origin=f"/curves/{name}",
                name=f"{name}: turn" if many else f"{name}: turn over torque, 3 visits",
                background=[250, 250, 250],
                visual_bounds=rrb.VisualBounds2D(x_range=ACROSS, y_range=DOWN),
            )
            plots.append(view)
        if many and plots:
            plots = [rrb.Tabs(*plots)]
        plots.append(rrb.TimeSeriesView(origin="/error", name="rms error [µm]"))
    name = "what the nominal arm misses" if not many else "share of the mismatch"
    return side_by_side(
        rrb.Vertical(
            arm_view("/cell", name, *eye_on(points)),
            rrb.TextDocumentView(origin="/note", name="what is drawn"),
            row_shares=[6, 1],
        ),
        rrb.Vertical(words, *plots, row_shares=[2, *[1] * len(plots)]),
        rrb.TimePanel(timeline=POSE, state="collapsed", fps=4.0),
    )


def _round(value: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(value))
    below = [n for n in (1, 2, 5) if n * power <= value]
    return float(max(below, default=1) * power)  # a logarithm may be rounded up


# --- A calibration --------------------------------------------------------------------


def show_calibration(
    found: Calibrated, proof: CalibrationProof, words: str, file: Path | None
) -> None:
    """Save the playback, or stream it to a viewer where no file is given."""
    from stiffness.calibration.model import CalibrationState

    layout = side_by_side(
        rrb.Spatial3DView(origin="/cell", name="poses kept back"),
        rrb.Vertical(
            rrb.TextDocumentView(origin="/read_me", name="what was found"),
            rrb.TimeSeriesView(origin="/error", name="error [mm]"),
        ),
        rrb.TimePanel(timeline=POSE, state="collapsed", fps=4.0),
    )
    stream = opened("stiffness_calibration", "calibration", layout, file)
    state = CalibrationState.of(found.readings, found.corrected_geometry)
    held = np.flatnonzero(found.held)
    times = [rr.TimeColumn(POSE, sequence=np.arange(len(held)))]
    stream.log("/cell", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    point = state.point[held]
    origin = state.standing.origin[:, held].swapaxes(0, 1)  # (rows, axes, 3)
    arm = np.concatenate([origin, point[:, None]], axis=1).astype(np.float32)
    strips = rr.LineStrips3D.columns(strips=arm).partition([1] * len(held))
    draw(stream, "/cell/arm", times, strips)
    usual = float(np.quantile(np.linalg.norm(proof.before, axis=1), 0.98))
    magnified = 10.0 ** np.floor(np.log10(LONGEST / max(usual, 1e-9)))
    both = (("before", proof.before, GREY), ("after", proof.after, ORANGE))
    for name, left, colour in both:
        style = rr.Arrows3D.from_fields(colors=[colour], radii=0.004)
        draw(stream, f"/cell/{name}", times, arrows(point, magnified * left), style)
        size = rr.Scalars.columns(scalars=MM * np.linalg.norm(left, axis=1))
        lines = rr.SeriesLines(names=f"{name} [mm]", colors=[colour])
        draw(stream, f"/error/{name}", times, size, lines)
    note = (
        f"{words}\n\nArrows: what the simulator misses on poses kept back, magnified "
        f"{magnified:.0f} times. Grey: as drawn. Orange: as calibrated."
    )
    stream.log("/read_me", rr.TextDocument(note), static=True)
    stream.flush()
    stream.disconnect()


# --- A comparison of encoders ---------------------------------------------------------

PLAYBACK = "diagnosis.rrd"
TIME = "time"


def show_comparison(axes: Sequence[Axis], file: Path | None) -> None:
    """Show curves of the judged motion, in µrad, and of its angle and torque."""
    stream = opened("two_encoders", None, _comparison_blueprint(axes), file)
    for a in axes:
        times = [rr.TimeColumn(TIME, duration=a.judged.time)]
        curves = {"nominal": URAD * a.before, "named": URAD * a.after}
        curves["angle_deg"] = np.degrees(a.judged.angle)
        if a.judged.torque is not None:
            curves["torque_nm"] = a.judged.torque
        for name, values in curves.items():
            scalars = rr.Scalars.columns(scalars=values)
            draw(stream, f"/{a.name}/{name}", times, scalars)
    stream.flush()
    stream.disconnect()


def _comparison_blueprint(axes: Sequence[Axis]) -> rrb.Blueprint:
    """Lay out each axis' residual above its joint angle."""
    columns = [
        rrb.Vertical(
            rrb.TimeSeriesView(
                origin=f"/{a.name}",
                contents=[f"/{a.name}/nominal", f"/{a.name}/named"],
                name=f"{a.name}: second encoder less simulation [µrad]",
            ),
            rrb.TimeSeriesView(
                origin=f"/{a.name}/angle_deg", name=f"{a.name}: angle [°]"
            ),
            row_shares=[2, 1],
        )
        for a in axes
    ]
    return rrb.Blueprint(rrb.Horizontal(*columns), collapse_panels=True)
