"""Set-up errors of loads: wrenches of wrong sign, unit, order or size.

What gives way follows a load: springs, and what gives way at once.

==========  ==========================================================================
Equation    d = sum_k J_k (c_k t_k + b_k t_k / (|t_k| + t0)), c_k, b_k >= 0, t = J^T w:
            marker's differences within a visit from springs in all axes, and from what
            gives way at once
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", 7.3;
            non-negative least squares: Lawson & Hanson 1974
Valid       a measured wrench that changes within visits
Ignores     everything that gives way but the axes
==========  ==========================================================================

Forces of another size than their cause were given in another unit.

==========  ==========================================================================
Equation    |F| = m g of what hangs on the hook; y = frame + places + offsets +
            s sum_k J_k c_k t_k, t = torque of the arm's own weight, c = compliance
            under the measured load: s = 1 where both are in N m; of three weights
            along the base's axes s is where gravity pulls
Source      statics; units: 1 kgf = 9.80665 N, 1 lbf = 4.4482216 N (ISO 80000-4);
            s' error: each posture left out in turn, Bell & McCaffrey 2002 (CR3)
Valid       masses in the model; for s, absolute places of many unloaded postures
Ignores     rope friction; how much sag a controller takes out: said beside the unit
==========  ==========================================================================

A load moves an arm its own way; an arm that moves against it was read wrongly.

==========  ==========================================================================
Equation    rms that `followed_load` leaves under each reading of the files
Source      enumeration
Valid       a measured wrench that changes within visits
Ignores     everything that gives way but the axes
==========  ==========================================================================
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import nnls

from bench.shared.errors import BenchError, Warned
from bench.shared.recording import UNLOADED, Marker, Recording
from stiffness.experiment.visits import held_at_mean
from stiffness.robot.arm import Arm
from stiffness.robot.kinematics import ArmState, point_jacobian
from stiffness.robot.tracker_frame import TrackerFit, initial_tracker_frame
from stiffness.robot.wrench import axes_of_sensor, wrench_in_base
from stiffness.setup.alternatives import (
    KGF,
    LBF,
    best_shift,
    of_columns,
    of_loads,
    of_rows,
)

# --- Response to the load -------------------------------------------------------------

EXPLAINS = 0.8
"""Share of the deflection that springs and what gives way at once must explain
together in a reading that is believed; chosen: in trials of the bench they explain more
with every effect of the vocabulary."""
TENTH = 0.1
"""t0 over the rms of an axis' torque; chosen: play is closed by a tenth of it."""


@dataclass(frozen=True)
class LoadResponse:
    """Springs that follow a load.

    Attributes:
        compliance: Of each axis by springs alone, in rad/(N m); none is negative.
        residual_rms: Rms that they leave of the deflections, in m, noise taken off.
        whole: Rms of the deflections, in m, noise taken off.
        clear: Axes whose spring explains a tenth of the deflection and more.
    """

    compliance: np.ndarray
    residual_rms: float
    whole: float
    clear: np.ndarray

    @property
    def explained(self) -> float:
        """Share of the squares that they explain."""
        return 1.0 - (self.residual_rms / self.whole) ** 2 if self.whole > 0 else 0.0


def load_response(some: Recording, frames: TrackerFit, arm: Arm) -> LoadResponse | None:
    """Fit what gives way.

    Args:
        some: Pairs of rows: before the load and under it.
        frames: Where the tracker and the markers are.
        arm: The nominal arm, with the recording's names.

    Returns:
        None where no marker was seen in both rows of a pair.
    """
    standing = arm.at(some.posture)
    points, sensor, tracker = some.points, some.wrench_sensor, some.tracker
    assert points is not None and sensor is not None and tracker is not None
    moved = (points[1::2] - points[::2]) @ frames.turn.T
    wrench = wrench_in_base(some, standing)
    torque = standing.load_torque(wrench, sensor.body, sensor.position)
    torque = torque[1::2] - torque[::2]
    size = TENTH * np.sqrt(np.mean(torque**2, axis=0))
    play = torque / np.maximum(np.abs(torque) + size, 1e-12)
    jacobian = jacobians(some, standing, frames)[::2]
    laws = [jacobian * law[:, None, None] for law in (torque, play)]
    columns = np.concatenate(laws, axis=3)
    seen = np.isfinite(moved).all(axis=2)
    if not seen.any():
        return None
    design, aim = columns[seen].reshape(-1, 2 * len(arm.axes)), moved[seen].ravel()
    axes = len(arm.axes)
    size = np.linalg.norm(design, axis=0).reshape(len(laws), axes)
    shown = (size > RANK * size.max(axis=1, keepdims=True)).ravel()
    design, size = design * shown, np.where(shown, size.ravel(), 1.0)
    stacked = np.column_stack([design / size, aim])
    turned = np.asarray(np.linalg.qr(stacked, mode="r"))  # fits alike
    _, rest = nnls(turned[:, :-1], turned[:, -1])
    springs, _ = nnls(turned[:, :axes], turned[:, -1])
    noise = 2.0 * np.sum(tracker.repeatability**2)
    count = seen.sum()
    return LoadResponse(
        springs / size[:axes],
        float(np.sqrt(max(rest**2 / count - noise, noise / 10.0))),
        float(np.sqrt(max(aim @ aim / count - noise, 0.0))),
        springs**2 > 0.1 * (aim @ aim),
    )


def jacobians(some: Recording, standing: ArmState, frames: TrackerFit) -> np.ndarray:
    """Return (rows, markers, 3, axes), in m per rad."""
    placed = zip(some.markers, frames.marker_positions, strict=True)
    each = [standing.jacobian(marker.body, place) for marker, place in placed]
    return np.stack(each, axis=1)[:, :, :3]


# --- Size of the load and of the sag --------------------------------------------------

UNLIKE = 100.0
"""Factor between fitted and nominal compliance that no arm has; chosen."""
FLOPPY, STARK = 0.1, 1e-6
"""Most and least that an arm's axes sag under its own weight, in rad; chosen: those of
industrial arms sag by 1e-4 to 3e-3."""
FELT = 1.0
"""Torque of its own weight from which an axis' sag is judged, in N m; chosen."""
HEAVY = 3.0
"""Factor between the force and the weight on the hook that no rope makes; chosen: a
tackle doubles it, pounds and kilograms for newtons are beyond."""
NEAR = 0.25
"""How far a ratio may be from a unit's own that it is taken for; chosen: friction of a
rope is a tenth, and what plays and slips makes compliance a fifth larger or smaller."""
SURE, ERRORS = 0.08, 3.0
"""Standard error over s from which it is believed, chosen: a third of `NEAR`; and how
many of them a unit may be off, chosen: what a controller leaves is any number."""
RANK = 1e-9
"""Singular value over the largest below which columns are the same, and size over the
largest below which one is rounding: of an axis that no marker shows. Chosen."""
POSTURES, FEWEST = 60, 5
"""Visits whose sag is looked at, chosen for time; and how many say how sure it is: of
fewer, leaving one out leaves nothing that would foretell it."""


def _over_hook(some: Recording) -> float | None:
    """Return the force over the weight on the hook, of pairs; None: none is stated."""
    if some.load_mass is None or some.wrench is None:
        return None
    force = np.linalg.norm(np.diff(some.wrench[:, :3], axis=0)[::2], axis=1)
    hung = KGF * np.abs(np.diff(some.load_mass)[::2])
    return float(np.sum(force) / np.sum(hung)) if hung.any() else None


def of_size(
    some: Recording, arm: Arm, fit: LoadResponse, over_hook: float | None
) -> Warned | None:
    """Doubt units where springs come out as no arm has them."""
    if over_hook is not None and not 1.0 / HEAVY < over_hook < HEAVY:
        unit = _unit(over_hook)
        text = (
            f"the force is {over_hook:.3g} times the weight on the hook"
            f"{f', as if in {unit}' if unit else ''}: check the units of "
            "fx_n, fy_n, fz_n and of load_kg."
        )
        return Warned("units", "wrench_sensor", text)
    if not fit.clear.any() or fit.explained < EXPLAINS:
        return None
    known = fit.clear & (arm.stiffness > 0)
    weight = np.abs(arm.at(some.posture).gravity_torque(some.tool)).max(axis=0)
    heavy = fit.clear & ~arm.slides & (weight > max(0.1 * weight.max(), FELT))
    sag = (weight * fit.compliance)[heavy]
    words = None
    if known.any():
        ratio = float(np.median(fit.compliance[known] * arm.stiffness[known]))
        if not 1.0 / UNLIKE < ratio < UNLIKE:
            words = f"{ratio:.3g} times what the model's springs give"
    if words is None and len(sag) and not STARK < sag.max() < FLOPPY:
        words = f"such that the arm's own weight would turn axes by {sag.max():.2g} rad"
    if words is None:
        return None
    text = f"deflections are {words}: check the units of wrench and markers."
    return Warned("units", "wrench_sensor", text)


def of_sag(
    recording: Recording,
    arm: Arm,
    frames: TrackerFit,
    fit: LoadResponse,
    over_hook: float | None,
) -> Warned | None:
    """Doubt mounting and units where its own weight turns the arm otherwise than loads.

    First where gravity pulls, by what three directions of it would turn, beside what a
    compensator of any axis would; then how much. A force as large as the weight on the
    hook has the unit that is stated.
    """
    modelled, some = arm.chain.gravity, some_visits(recording, POSTURES)
    if recording.displacement != "absolute" or fit.explained < EXPLAINS:
        return None
    if len(some.posture) < FEWEST or not modelled.any():
        return None
    pulls = _sag(some, arm, frames, fit, with_compensators=True).shares(
        np.linalg.norm(modelled) * np.eye(3)
    )
    if pulls is not None and (told := _of_mounting(*pulls, modelled)) is not None:
        return told
    found = _sag(some, arm, frames, fit).shares(modelled[:, None])
    if found is None:
        return None
    ratio, error = float(found[0][0]), float(np.sqrt(found[1][0, 0]))
    unit = _unit(ratio, ERRORS * error) if error <= SURE * abs(ratio) else ""
    weighed = over_hook is not None and abs(over_hook - 1.0) < NEAR
    if not unit or weighed:
        return None
    text = (
        f"the wrench looks given in {unit}: under its own weight the arm gives way "
        f"{ratio:.3g} times as much as the wrench would have it. N and Nm are "
        f"expected. Or the controller takes out {1.0 - ratio:.0%} of the sag: the "
        "weight on the hook tells, where the recording has it."
    )
    return Warned("units", "wrench_sensor", text)


def some_visits(recording: Recording, most: int) -> Recording:
    """Take the first row of at most so many visits, evenly."""
    first = np.unique(recording.visit, return_index=True)[1]
    return recording.take(first[:: -(-len(first) // most)])


def ends_of_bodies(markers: Sequence[Marker], arm: Arm) -> list[int]:
    """Return the first and the last marker of each body: few that show it."""
    of_body: dict[int, list[int]] = {}
    for m, marker in enumerate(markers):
        of_body.setdefault(arm.attachment(marker.body).axis, []).append(m)
    return sorted({m for own in of_body.values() for m in (own[0], own[-1])})


def _of_mounting(
    pulls: np.ndarray, covariance: np.ndarray, modelled: np.ndarray
) -> Warned | None:
    """Doubt how the base is mounted where gravity surely pulls along another line.

    A controller that takes out more than all of the sag turns it round, and no mounting
    changes its size.
    """
    down, size = modelled / np.linalg.norm(modelled), np.linalg.norm(pulls)
    lifted = down @ pulls < 0.0 and abs(size - 1.0) > NEAR
    off = float(np.linalg.norm(pulls - (down @ pulls if lifted else size) * down))
    error = float(np.sqrt(np.linalg.norm(covariance, 2)))
    if size < NEAR or off < NEAR * size or error > SURE * size or off < ERRORS * error:
        return None
    angle = np.degrees(np.arccos(np.clip(down @ pulls / size, -1.0, 1.0)))
    said = ", ".join(f"{part:.2f}" for part in pulls / size)
    text = (
        f"the base looks mounted otherwise than in the model: its own weight turns the "
        f"arm as if gravity pulled along ({said}) of the base, {angle:.0f}° from where "
        "the model has it. Turn the base in the model as the arm is mounted."
    )
    return Warned("base_mounting", "base", text)


def _unit(ratio: float, off: float = np.inf) -> str:
    """Return the unit in which a force would be read this many times its size."""
    for name, size in (("kgf", KGF), ("lbf", LBF)):
        if abs(ratio * size - 1.0) < min(NEAR, off * size):
            return name
    return ""


@dataclass(frozen=True)
class Sag:
    """What gravity along the base's axes would do to readings, and what they show.

    Offsets, frame and markers' places, which do some of it too, are projected out.

    Attributes:
        columns: Sag per m/s^2 along each of the base's axes, in m.
        residual: What the readings show of it, in m.
        others: Orthonormal basis of what is projected out.
        posture: Which posture each coordinate was read in.
    """

    columns: Float[np.ndarray, "coordinates 3"]
    residual: Float[np.ndarray, " coordinates"]
    others: Float[np.ndarray, "coordinates others"]
    posture: Int[np.ndarray, " coordinates"]

    def shares(
        self, pulls: Float[np.ndarray, "3 pulls"]
    ) -> tuple[Float[np.ndarray, " pulls"], Float[np.ndarray, "pulls pulls"]] | None:
        """Return how much of some accelerations' sag is shown, and its covariance.

        Errors are by leaving out each posture in turn. None where readings cannot tell
        the accelerations, one a column in m/s^2, from each other.
        """
        own = self.columns @ pulls
        along, scale, back = np.linalg.svd(own, full_matrices=False)
        if scale[-1] <= RANK * scale[0]:
            return None
        inverse = (back.T / scale) @ along.T
        share = inverse @ self.residual
        rest = self.residual - own @ share
        basis = np.column_stack([self.others, along])
        covariance = np.zeros((len(share), len(share)))
        for posture in np.unique(self.posture):
            its = self.posture == posture
            free = np.eye(its.sum()) - basis[its] @ basis[its].T
            moved = inverse[:, its] @ np.linalg.lstsq(free, rest[its], rcond=RANK)[0]
            covariance += np.outer(moved, moved)
        return share, covariance


def _sag(
    some: Recording,
    arm: Arm,
    frames: TrackerFit,
    fit: LoadResponse,
    with_compensators: bool = False,
) -> Sag:
    """Return the sag of an arm as readings show it.

    Args:
        some: One row of each visit.
        arm: The nominal arm, with the recording's names.
        frames: Where the tracker and the markers are.
        fit: What gives way under the load.
        with_compensators: Whether a wave of each axis' angle is projected out, too:
            what a compensator there turns it by, as gravity along another line would.
    """
    standing, markers = arm.at(some.posture), some.markers
    jacobian = jacobians(some, standing, frames)  # (rows, markers, 3, axes)
    placed = zip(markers, frames.marker_positions, strict=True)
    points = np.stack([standing.point(m.body, place) for m, place in placed], axis=1)
    assert some.points is not None
    left = some.points @ frames.turn.T + frames.shift - points
    places = np.zeros((*left.shape, 3 * len(markers)))
    for m, marker in enumerate(markers):
        places[:, m, :, 3 * m : 3 * m + 3] = standing.turn(marker.body)
    sags = []
    for pull in np.eye(3):
        pulled = replace(standing, chain=replace(standing.chain, gravity=pull))
        torque = fit.compliance * pulled.gravity_torque(some.tool)
        sags.append((jacobian * torque[:, None, None]).sum(axis=3))
    seen = np.isfinite(left)
    every = [point_jacobian(points), jacobian, places]
    if with_compensators:
        angle = some.posture[:, None, None]
        every += [jacobian * np.sin(angle), jacobian * np.cos(angle)]
    others = np.concatenate(every, axis=3)[seen]
    size = np.linalg.norm(others, axis=0)
    u, scale, _ = np.linalg.svd(others / np.where(size > 0, size, 1.0), False)
    u = u[:, scale > RANK * scale[0]]
    columns = np.stack([sag[seen] for sag in sags], axis=1)
    of_posture = np.broadcast_to(np.arange(len(left))[:, None, None], left.shape)
    return Sag(
        columns - u @ (u.T @ columns),
        left[seen] - u @ (u.T @ left[seen]),
        u,
        of_posture[seen],
    )


def of_tool(recording: Recording, arm: Arm) -> Warned | None:
    """Doubt whether readings hold the tool's weight, by those without a load.

    ==========  ======================================================================
    Equation    f = u + R b, f the force along the base's axes as it is used, R the
                sensor's axes, b its zero: u = m g, m the tool's mass where it is not
                taken off, minus that where it never was in the readings
    Source      statics; least squares over means of postures
    Valid       a sensor that turns with the arm; a tool of stated mass
    Ignores     what hangs on the sensor beside the tool: m is another number then
    ==========  ======================================================================

    Args:
        recording: With a wrench.
        arm: The nominal arm, with the recording's names.
    """
    sensor, tool = recording.wrench_sensor, recording.tool
    if sensor is None or sensor.frame != "sensor" or tool is None or tool.mass <= 0.0:
        return None
    none = recording.stage == UNLOADED
    if recording.load_mass is not None:
        none &= recording.load_mass == 0.0
    some = recording.take(np.flatnonzero(none))
    first = np.unique(some.posture_id, return_index=True)[1]
    if len(first) < FEWEST or not arm.chain.gravity.any():
        return None
    standing = arm.at(some.posture)
    force = wrench_in_base(some, standing)[:, :3]
    axes = axes_of_sensor(sensor, standing)
    still = np.broadcast_to(np.eye(3), axes.shape)
    rows = np.concatenate([still, axes, force[..., None]], axis=2)
    mean = held_at_mean(some.posture_id, rows.reshape(len(rows), -1))[first]
    design, read = np.split(mean.reshape(-1, 7), [6], axis=1)
    size = np.linalg.svd(design, compute_uv=False)
    if size[-1] <= RANK * size[0]:
        return None
    found, square, _, _ = np.linalg.lstsq(design, read[:, 0])
    inverse = np.linalg.inv(design.T @ design)[:3, :3]
    error = float(np.sqrt(square.sum() / (len(design) - 6) * np.max(inverse)))
    weight = tool.mass * float(np.linalg.norm(arm.chain.gravity))
    down = arm.chain.gravity / np.linalg.norm(arm.chain.gravity)
    along = float(found[:3] @ down)
    across = float(np.linalg.norm(found[:3] - along * down))
    held = tool.mass * (along / weight + sensor.includes_tool_weight)
    if_mistaken = 0.0 if sensor.includes_tool_weight else tool.mass
    if abs(held - if_mistaken) > NEAR * tool.mass or error > SURE * weight:
        return None
    if across > NEAR * weight:  # the arm hangs otherwise than is stated
        return None
    other = "false" if sensor.includes_tool_weight else "true"
    text = (
        f"readings without a load hold {max(held, 0.0):.2f} kg that turn with gravity, "
        f"and the tool weighs {tool.mass:.2f} kg: say includes_tool_weight = {other}, "
        "or state the tool that the sensor carries."
    )
    return Warned("tool_weight", "wrench_sensor", text)


# --- Errors of loads ------------------------------------------------------------------

PAIRS = 200
"""Pairs of rows that this looks at; chosen for time."""
LOUD = 3.0
"""Deflection over noise, both rms, from which it can be judged; chosen."""
BETTER = 1.5
"""Factor in rms by which another reading must fit better; chosen: it then leaves less
than half of the squares, and has no number more to fit them with."""
RIGHT = 0.05
"""Share of the deflection, in rms, that a reading may leave and is not doubted; chosen:
a slip leaves all of an axis' or a component's, and that seldom is a twentieth."""
ALIKE = 0.9
"""Rms over that of a reading told before from which this one fits alike; chosen."""
FEW, LIKELY = 60, 8
"""Pairs by which other readings are ranked, and how many of the best are then judged by
all; chosen for time."""


def load_setup_errors(recording: Recording, arm: Arm) -> tuple[Warned, ...]:
    """Return the gross mistake that differences within visits show.

    Args:
        recording: With markers and a tracker.
        arm: The nominal arm, with the recording's names.
    """
    if recording.wrench is None or recording.wrench_sensor is None:
        return ()
    pairs = _pairs(recording)
    try:
        frames = initial_tracker_frame(arm, recording, np.zeros(len(arm.axes)))
    except BenchError:
        return ()
    some = recording.take(pairs)
    written = load_response(some, frames, arm) if len(pairs) else None
    assert recording.tracker is not None
    noise = float(np.sqrt(2.0 * np.sum(recording.tracker.repeatability**2)))
    if written is None or written.whole < LOUD * noise:
        return ()
    answer = None
    if written.residual_rms > RIGHT * written.whole:
        few, seen = _few(some, frames, arm)

        def misfit(size: np.ndarray) -> float:
            assert few.wrench is not None
            fit = load_response(replace(few, wrench=few.wrench * size), seen, arm)
            return np.inf if fit is None else fit.residual_rms

        others = [*of_loads(some, arm, misfit), *of_columns(some)]
        if recording.rows == "plateaus":
            others += [(warned, r.take(pairs)) for warned, r in of_rows(recording)]
        left, answer = _better(others, written, arm, frames)
        doubted = answer is None or left > RIGHT * written.whole
        if doubted and recording.displacement == "relative":
            shifted = _shifted(some, arm, frames)
            answer = _better(shifted, written, arm, frames, left)[1] or answer
    if answer is None:
        over_hook = _over_hook(some)
        answer = of_size(some, arm, written, over_hook) or of_tool(recording, arm)
        answer = answer or of_sag(recording, arm, frames, written, over_hook)
    return () if answer is None else (answer,)


def _pairs(recording: Recording) -> np.ndarray:
    """Return the first row of a visit and another of it, in turn.

    All rows count: by the least and the largest load alone a wrench that is one row
    off can look reversed.
    """
    visit = recording.visit
    first, where = np.unique(visit, return_index=True, return_inverse=True)[1:]
    longest = max(int(np.bincount(where).max()) - 1, 1)
    every = max(1, -(-len(first) * longest // PAIRS))
    rows = np.flatnonzero(
        (first[where] != np.arange(len(visit))) & (where % every == 0)
    )
    rows = rows[:: -(-len(rows) // PAIRS) or 1]
    return np.stack([first[where[rows]], rows], axis=1).ravel()


def _better(
    others: Iterable[tuple[Warned, Recording]],
    written: LoadResponse,
    arm: Arm,
    frames: TrackerFit,
    most: float = np.inf,
) -> tuple[float, Warned | None]:
    """Return what the best reading leaves, if any is believed, and what is said of it.

    Args:
        others: Other readings of the pairs of rows.
        written: The fit as they are written.
        arm: The nominal arm, with the recording's names.
        frames: Where the tracker and the markers are.
        most: What another believed reading leaves, in m.
    """
    others = list(others)
    ranked = []
    for i, (_, other) in enumerate(others):
        few = load_response(*_few(other, frames, arm), arm)
        ranked.append((np.inf if few is None else few.residual_rms, i))
    likely = sorted(i for _, i in sorted(ranked)[:LIKELY])
    best, left, answer = min(written.residual_rms / BETTER, ALIKE * most), most, None
    for warned, other in (others[i] for i in likely):
        fit = load_response(other, frames, arm)
        if fit is not None and fit.residual_rms < best and fit.explained > EXPLAINS:
            left, answer = fit.residual_rms, warned
            best = ALIKE * left
    return left, answer


def _shifted(
    some: Recording, arm: Arm, frames: TrackerFit
) -> list[tuple[Warned, Recording]]:
    """Return the reading with the zero of one axis fitted, if it is another one."""
    few, seen = _few(some, frames, arm)

    def misfit(posture: np.ndarray) -> float:
        fit = load_response(replace(few, posture=posture), seen, arm)
        return np.inf if fit is None else fit.residual_rms

    found = best_shift(few.posture, arm.slides, misfit)
    if found is None:
        return []
    return [(found.warned, replace(some, posture=found.meant(some.posture)))]


def _few(some: Recording, frames: TrackerFit, arm: Arm) -> tuple[Recording, TrackerFit]:
    """Return some of the pairs, with a few markers of each body."""
    pairs = np.arange(len(some.time)).reshape(-1, 2)
    rows = pairs[:: -(-len(pairs) // FEW)].ravel()
    kept = ends_of_bodies(some.markers, arm)
    return (
        some.watching(kept).take(rows),
        replace(frames, marker_positions=frames.marker_positions[kept]),
    )
