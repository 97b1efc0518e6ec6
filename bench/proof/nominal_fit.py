"""Gauss-Newton fit of compliance, tracker frame and marker positions in MuJoCo.

How a little more of what is nominal moves a marker (`simulated_jacobian`):

==========  ==========================================================================
Equation    δp = (z × (p - o)) θ δ(ln c) on an axis with wind-up θ (z θ on a slide);
            R_body δplace for a marker; δt + δω × p for the frame
Source      first order of the kinematics: Siciliano et al. 2009, section 3.1
Valid       springs that are nearly linear: θ grows with the compliance c
Ignores     how a wind-up changes the torques of other axes
==========  ==========================================================================

Where an effect shows in differences within visits alone, springs are fitted to these;
what only means of visits say, such as arrival and geometry, cannot bend them.

How far each axis turned beyond the simulation (`joint_rotation_estimates`):

==========  ==========================================================================
Equation    turn = (A'A + λ)^-1 A'r row by row, A the axes' screws at the markers
Source      least squares; λ keeps turns that no marker shows at zero
Valid       small turns, markers that see the axes
Ignores     motions across the axes
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from bench.kinematic_chain import carriers_of
from bench.proof.comparison import ComparisonMode, less_means, residual_of, sigma_of
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.rig import RIGID, Rig

# --- Simulated Jacobian ---------------------------------------------------------------

DECADE = float(np.log(10.0))
"""One sigma of ln c about where the fit starts: a decade either way is nominal."""
PLACE = 1e-3
"""One sigma of a stated marker place, in m; the rule of what is nominal."""
UNKNOWN = 1.0
"""One sigma of what is not stated, in m or rad."""


@dataclass(frozen=True)
class SimulatedJacobian:
    """What one unit of each silent parameter does to the readings.

    Attributes:
        matrix: Displacements of markers, then angles, (rows, readings, parameters).
        axes: Which axes' springs come first, from 0.
        framed: Whether the six of the frame follow.
    """

    matrix: Float[np.ndarray, "rows readings parameters"]
    prior: Float[np.ndarray, " parameters"]
    axes: tuple[int, ...]
    framed: bool


def simulated_jacobian(
    simulation: ReplaySimulation,
    assumed: NominalState,
    seen: SimulatedReadings,
    places: bool,
) -> SimulatedJacobian:
    """Return the columns of all nuisance parameters."""
    rig = assumed.rig
    axes = tuple(int(k) for k in simulation.order if rig.springs[k] < RIGID)
    rows = len(seen.point)
    blocks = [
        turned_by(simulation, rig, seen, k, wind_up(simulation, rig, seen))
        for k in axes
    ]
    prior = [DECADE] * len(axes)
    every = np.ones(rows, dtype=bool)
    more, sigma = framing(simulation, assumed, seen, places, every)
    blocks += more
    prior += sigma
    stacked = [np.reshape(block, (rows, -1)) for block in blocks]
    if seen.angle is not None:
        angles = [_on_encoders(simulation, rig, seen, k) for k in axes]
        angles += [np.zeros(seen.angle.shape)] * (len(stacked) - len(angles))
        stacked = [np.hstack(pair) for pair in zip(stacked, angles, strict=True)]
    readings = 3 * len(simulation.body) + (
        0 if seen.angle is None else len(simulation.order)
    )
    none = np.zeros((rows, readings, 0))  # no spring, and nothing else unknown
    matrix = np.stack(stacked, axis=2) if stacked else none
    return SimulatedJacobian(matrix, np.array(prior), axes, is_framed(simulation))


def is_framed(simulation: ReplaySimulation) -> bool:
    """Return whether the tracker's frame is unknown, and fitted."""
    recording = simulation.recording
    return recording.base_from_tracker is None and bool(recording.markers)


def framing(
    simulation: ReplaySimulation,
    assumed: NominalState,
    seen: SimulatedReadings,
    places: bool,
    rows: Bool[np.ndarray, " rows"],
) -> tuple[list[np.ndarray], list[float]]:
    """Return what frame and places do to markers in some rows, and their priors."""
    recording, point = simulation.recording, seen.point[rows]
    blocks, prior = [], []
    relative = recording.displacement == "relative"
    if is_framed(simulation):
        about = point
        if relative and recording.points is not None:
            about = recording.points[rows] @ assumed.turn.T
        blocks += [np.full(point.shape, (not relative) * e) for e in np.eye(3)]
        blocks += [np.cross(e, about) for e in np.eye(3)]
        prior += [UNKNOWN] * 6
    if places and not relative:
        states, base_turn = seen.states, simulation.base[1]
        for m, marker in enumerate(recording.markers):
            b = states.bodies.index(simulation.body[m])
            turn = base_turn.T @ states.rotation[rows, b]
            for i in range(3):
                block = np.zeros(point.shape)
                block[:, m] = turn[:, :, i]
                blocks.append(block)
            prior += [UNKNOWN if marker.position is None else PLACE] * 3
    return blocks, prior


def turned_by(
    simulation: ReplaySimulation,
    rig: Rig,
    seen: SimulatedReadings,
    k: int,
    angle: Float[np.ndarray, "rows axes"],
) -> Float[np.ndarray, "rows markers 3"]:
    """Return how markers move when axis k turns by small angles, in m."""
    states, model, arm = seen.states, rig.nominal, rig.anatomy
    base, turn = simulation.base
    joint, b = model.joint(arm.axes[k]), states.bodies.index(arm.links[k])
    at = states.position[:, b] + states.rotation[:, b] @ joint.pos
    at = (at - base) @ turn
    along = states.rotation[:, b] @ joint.axis @ turn
    block = np.broadcast_to(along[:, None], seen.point.shape)
    if not arm.slides[k]:
        block = np.cross(along[:, None], seen.point - at[:, None])
    moves = carried(model, arm.links[k], simulation.body)
    return block * angle[:, k, None, None] * moves[:, None]


def wind_up(
    simulation: ReplaySimulation, rig: Rig, seen: SimulatedReadings
) -> Float[np.ndarray, "rows axes"]:
    """Return by how much every axis of the arm is wound, in rad."""
    posture = np.zeros_like(seen.states.axis_angle)
    posture[:, simulation.order] = simulation.recording.posture
    moves = simulation.recording.moves.of_axes(simulation.order, posture.shape[1])
    return seen.states.axis_angle - rig.command(posture, moves).reference


def carried(
    model: mujoco.MjModel, link: str, bodies: tuple[str, ...]
) -> Bool[np.ndarray, " bodies"]:
    """Return whether each body hangs on a link or is it."""
    root, own = model.body(link).id, (model.body(body).id for body in bodies)
    return np.array([root in carriers_of(model, b) for b in own], dtype=bool)


def _on_encoders(
    simulation: ReplaySimulation, rig: Rig, seen: SimulatedReadings, k: int
) -> np.ndarray:
    block = np.zeros((len(seen.point), len(simulation.order)))
    block[:, simulation.order.tolist().index(k)] = wind_up(simulation, rig, seen)[:, k]
    return block


# --- Nominal fit ----------------------------------------------------------------------

SEVERE = 4.5
"""Sigmas from which a reading counts less (Huber 1964); chosen."""


def fitted(
    simulation: ReplaySimulation,
    start: NominalState,
    mode: ComparisonMode,
    rounds: int = 3,
) -> NominalState:
    """Fit what is nominal by Gauss-Newton in the simulator."""
    assumed = start
    for _ in range(rounds):
        if not mode.absolute:
            assumed = framed(simulation, assumed, mode)
        seen = simulation.see(assumed)
        columns = simulated_jacobian(simulation, assumed, seen, mode.absolute)
        left = residual_of(simulation, seen, mode)
        step = solved(columns.matrix, columns.prior, left, simulation, mode)
        assumed = stepped(assumed, columns, step)
    return assumed if mode.absolute else framed(simulation, assumed, mode)


def framed(
    simulation: ReplaySimulation, assumed: NominalState, mode: ComparisonMode
) -> NominalState:
    """Fit frame and places alone, to the first row of every visit."""
    if (
        simulation.recording.displacement == "relative"
        or not simulation.recording.markers
    ):
        return assumed
    seen = simulation.see(assumed)
    rows = np.zeros(len(mode.keep), dtype=bool)
    rows[np.unique(simulation.first_rows())] = True
    rows &= mode.keep
    blocks, prior = framing(simulation, assumed, seen, True, rows)
    if not blocks:
        return assumed
    matrix = np.stack([np.reshape(b, (rows.sum(), -1)) for b in blocks], axis=2)
    left = np.reshape(seen.residual[rows], (rows.sum(), -1))
    step = least_squares(matrix, np.array(prior), left, mode.sigma)
    columns = SimulatedJacobian(matrix, np.array(prior), (), is_framed(simulation))
    return stepped(assumed, columns, step)


def solved(
    matrix: Float[np.ndarray, "rows readings parameters"],
    prior: Float[np.ndarray, " parameters"],
    residual: Float[np.ndarray, "rows readings"],
    simulation: ReplaySimulation,
    mode: ComparisonMode,
    moved: Float[np.ndarray, " parameters"] | None = None,
) -> Float[np.ndarray, " parameters"]:
    """Return the step of parameters that makes residuals smallest.

    The prior has one sigma of each about its prior mean, from which `moved` says how
    far it stands already; residuals are NaN where nothing was read.
    """
    matrix, rows = less_means(matrix, simulation, mode), mode.keep
    sigma = sigma_of(simulation, mode)
    return least_squares(matrix[rows], prior, residual[rows], sigma, moved)


def least_squares(
    matrix: Float[np.ndarray, "rows readings parameters"],
    prior: Float[np.ndarray, " parameters"],
    residual: Float[np.ndarray, "rows readings"],
    sigma: Float[np.ndarray, " readings"] | float,
    moved: Float[np.ndarray, " parameters"] | None = None,
) -> Float[np.ndarray, " parameters"]:
    """Return the most probable step of parameters; far readings count less."""
    good = np.isfinite(residual) & np.isfinite(matrix).all(axis=2)
    white = (residual / sigma)[good]
    shown = (matrix / np.broadcast_to(sigma, residual.shape)[..., None])[good]
    step, weight = np.zeros(matrix.shape[2]), np.ones(len(white))
    for _ in range(2):
        heavy = shown * weight[:, None]
        gram = heavy.T @ shown + np.diag(prior**-2.0)
        scale = 1.0 / np.sqrt(np.diag(gram))
        ask = heavy.T @ white
        if moved is not None:
            ask -= moved * prior**-2.0
        step = scale * np.linalg.solve(gram * scale * scale[:, None], scale * ask)
        rest = np.abs(white - shown @ step)
        spread = 1.4826 * np.median(rest) if len(rest) else 1.0
        weight = np.minimum(1.0, SEVERE * max(spread, 1e-9) / np.maximum(rest, 1e-12))
    return step


def stepped(
    assumed: NominalState, columns: SimulatedJacobian, step: np.ndarray
) -> NominalState:
    """Return the assumption moved by a step of its silent parameters."""
    rig, n = assumed.rig, len(columns.axes)
    if n and np.any(np.abs(step[:n]) > 1e-12):
        stiffness = rig.springs.copy()
        growth = np.exp(np.clip(step[:n], -DECADE, DECADE))
        stiffness[list(columns.axes)] /= growth
        rig = replace(rig, stiffness=stiffness)
    turn, shift, place = assumed.turn, assumed.shift, assumed.marker_positions
    if columns.framed:  # a column moves what is predicted, so readings move back
        move, vector = step[n : n + 3], step[n + 3 : n + 6]
        back = Rotation.from_rotvec(-vector).as_matrix()
        turn, shift = back @ turn, back @ shift - move
    rest = step[n + 6 * columns.framed : n + 6 * columns.framed + place.size]
    if len(rest):
        place = place + rest.reshape(-1, 3)
    return NominalState(rig, turn, shift, place)


# --- Joint rotations from residuals ---------------------------------------------------

FAINT = 0.02
"""Lever in m below which markers do not show a turn; chosen."""


def joint_rotation_estimates(
    simulation: ReplaySimulation,
    assumed: NominalState,
    seen: SimulatedReadings,
    residual: Float[np.ndarray, "rows markers 3"],
) -> Float[np.ndarray, "rows axes"]:
    """Return the turn of every axis of the recording that fits residuals, in rad."""
    rig = assumed.rig
    unit = np.ones((len(residual), len(rig.springs)))
    good = np.isfinite(residual).all(axis=2, keepdims=True)
    left = np.where(good, residual, 0.0).reshape(len(residual), -1)
    blocks = [turned_by(simulation, rig, seen, int(k), unit) for k in simulation.order]
    screws = np.stack([np.where(good, b, 0.0).reshape(left.shape) for b in blocks], 2)
    inner = screws.swapaxes(1, 2) @ screws
    inner = inner + FAINT**2 * np.eye(inner.shape[1])
    ask = np.einsum("rna,rn->ra", screws, left)
    return np.linalg.solve(inner, ask[..., None])[..., 0]


def torques_of(
    simulation: ReplaySimulation, assumed: NominalState, seen: SimulatedReadings
) -> Float[np.ndarray, "rows axes"]:
    """Return the torque about each axis of an arm with nothing but springs, in N m."""
    rig = assumed.rig
    return (wind_up(simulation, rig, seen) * rig.springs)[:, simulation.order]
