"""Map of residuals: what each place may do that no hypothesis names.

What a levelled tracker does wrong lies along its two circles and its beam.

==========  ==========================================================================
Equation    error = e_a (1, r, h cos na, h sin na) + e_e (1, r cos 2a, r sin 2a, r cos
            ne, r sin ne) + e_r (1, r, r²) + e_z r², n = 1, 2; a azimuth, e elevation, r
            range and h its level part, seen from the tracker, z against gravity
Source      Muralikrishnan, Phillips, Sawyer 2016, "Laser trackers for large-scale
            dimensional metrology: a review", section 4: circles off their centres, axes
            and beam beside each other and askew; e_z r²: a beam that sags
Valid       a tracker that stands upright, at the origin of its readings' frame
Ignores     a target that turns away from the beam
==========  ==========================================================================

A map of everything that could be left over belongs to no hypothesis and names none.

Columns of a place: torque in knots for loading and for unloading, torque with the
axis' angle, with time, with axial force, with what it was a row before and how long it
has stood; moments across the axis and what friction holds back of them, from visit to
visit anew and, at the base, as the visit before left it; all that forces and moments on
the place may turn or move linearly; and, between visits, the place's own small constant
motions, the axis' angle in harmonics, a course of the base in time and the tracker's
own errors; what the force sensor's channels take up of each other, hold back and drift
by, how its scale goes, and what of each visit's load was tared away.

==========  ==========================================================================
Equation    compliance: (shift, turn) = C (F, M), C symmetric, without the axis' own
            spring; along the axes of the moving side, about the place's origin
Source      Klimchik et al. 2011: full 6 x 6 compliance of a joint; reciprocity of
            elastic bodies (Betti 1872)
Valid       linear elastic bearings and castings of one place
Ignores     what two places do to each other: the turns about an axis by any part of its
            wrench, without reciprocity, have columns of their own
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, absolute, marked_point, sprung
from stiffness.effects.hysteresis import SLIPS, along_visits, slipped
from stiffness.effects.jacobian import (
    NOTHING,
    BodyTwist,
    EffectJacobian,
    JacobianBlock,
    JointRotation,
    MarkerDisplacement,
    mixture,
    rotate,
    rotation_about,
    six_motions,
    translate,
)
from stiffness.effects.statics import misread, reading
from stiffness.experiment.static_state import StaticState
from stiffness.experiment.visits import BEFORE, memories

# --- Errors of a levelled tracker -----------------------------------------------------

COLUMNS = 17
NEAREST = 0.3
"""Level distance from the base's origin in m at which no tracker stands: readings were
turned to the base's frame; chosen."""
LEAST = 1e-3
"""Level distance in m below which a target has no azimuth; chosen."""


def errors_of_tracker(situation: StaticState) -> EffectJacobian:
    """Return how each marker would be seen beside its place; nothing where it cancels.

    A marker of unknown place is taken at its body's origin.
    """
    gravity, frame = situation.arm.chain.gravity, situation.tracker
    if frame is None or not absolute(situation) or not gravity.any():
        return NOTHING
    axes, stand = upright(-gravity), frame[:3, 3]
    if np.hypot(*(stand @ axes)[:2]) < NEAREST:
        return NOTHING
    parts = []
    for m in range(len(situation.recording.markers)):
        away = (marked_point(situation, m) - stand) @ axes
        parts.append(MarkerDisplacement(m, axes @ along_circles(away)))
    return EffectJacobian(COLUMNS, tuple(parts)) if parts else NOTHING


def upright(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """Return axes as columns, the third along a direction."""
    z = up / np.linalg.norm(up)
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def along_circles(away: Float[np.ndarray, "rows 3"]) -> Float[np.ndarray, "rows 3 17"]:
    """Return the errors per unit of each, along upright axes.

    Args:
        away: Targets seen from the tracker along these axes, in m.
    """
    level = np.maximum(np.hypot(away[:, 0], away[:, 1]), LEAST)
    far = np.hypot(level, away[:, 2])
    a, e = np.arctan2(away[:, 1], away[:, 0]), np.arctan2(away[:, 2], level)
    none, one = np.zeros_like(a), np.ones_like(a)
    beam = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    side = np.stack([-np.sin(a), np.cos(a), none], axis=1)
    up, fall = np.cross(beam, side), np.stack([none, none, one], axis=1)
    waves = [f(n * x) for x in (a, e) for n in (1, 2) for f in (np.cos, np.sin)]
    parts = [
        (side, [one, far, *(level * w for w in waves[:4])]),
        (up, [one, *(far * w for w in waves[2:])]),
        (beam, [one, far, far**2]),
        (fall, [far**2]),
    ]
    columns = [along * size[:, None] for along, sizes in parts for size in sizes]
    return np.stack(columns, axis=2)


# --- Map of residuals -----------------------------------------------------------------

KNOTS = 7
"""Knots of torque; chosen: three segments a side."""
TIMES = 5
COURSE = 7
"""Knots of a slow course of the base; chosen: a day's wave over a day's work."""
WANDER, VISITS_A_KNOT = 25, 6
"""Knots of its quick course, which shifts alone, and visits that each knot has at
least; chosen: half an hour of a day's work."""
GROWTH = 4
"""Knots of a link's course; chosen: with three a link's warm-up was taken for slips."""
HARMONICS = (1, 2, 3)
TOLD_APART = 0.1
"""Part of the largest displacement of a generic law that each of its columns makes at
least; chosen: a tenth is lost among what laws beside it may err by."""
SENSOR = "wrench_sensor"
LEAST_READ = 1e-3
"""Least of the largest force and of the largest moment that were read, in N and N m:
a smaller one is no scale; chosen."""
NOISY, MOVED = 0.01, 0.03
"""Noise of a channel over the largest that it read, from which columns of readings are
of the same noise as the mismatch that it makes; and least change of a channel that
tells loading from unloading: three times that. Chosen."""
DIRECTIONS = 4
"""Directions of a moment, half a turn together; chosen: one is never far."""


@dataclass(frozen=True)
class MapBlock:
    """Columns of one place and one kind of dependence.

    Attributes:
        where: The place, as in an answer.
        kind: Which of the blocks of its place.
        depends_on: What the columns depend on.
        jacobian: The columns.
    """

    where: str
    kind: str
    depends_on: str
    jacobian: EffectJacobian


@dataclass(frozen=True)
class GenericTerm(Hypothesis):
    """Whatever a block of the map may do, as a term of a set without a name.

    Attributes:
        effect: What it is called among decisions: `generic` and its kind.
        kind: Of the block.
        depends_on: What its columns depend on.
    """

    effect: str  # pyright: ignore[reportIncompatibleVariableOverride]
    kind: str
    depends_on: str
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {}

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        found = (b.where for b in residual_map(situation) if b.kind == self.kind)
        return tuple(found)

    @override
    def jacobian(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        of_place = (b for b in residual_map(situation) if b.where == where)
        return next(b.jacobian for b in of_place if b.kind == self.kind)

    @override
    def parameters(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        return {}


def shows_everywhere(where: str, depends_on: tuple[str, ...]) -> bool:
    """Return whether names at many places would share out what columns do.

    A course in time of the base or a link, whatever pulls, and what channels of the
    force sensor take up of each other, to which all axes seem to respond.
    """
    is_course = depends_on == ("time",) and not where.startswith("a")
    return is_course or where == SENSOR


@lru_cache(maxsize=2)
def residual_map(situation: StaticState) -> tuple[MapBlock, ...]:
    """Return the map of all places."""
    blocks = _of_base(situation)
    for k in range(len(situation.axes)):
        blocks.extend(_of_axis(situation, k))
    seen = errors_of_tracker(situation)
    if seen.columns:
        blocks.append(MapBlock("tracker", "tracker", "geometry", seen))
    return (*blocks, *_of_sensor(situation))


def hats(values: np.ndarray, knots: int) -> Float[np.ndarray, "rows knots"]:
    """Return piecewise linear functions between knots over the range of values.

    They add up to one; knots are where equal shares of the values lie.
    """
    at = _knots(values, knots)
    found = [np.interp(values, at, row) for row in np.eye(len(at))]
    return np.stack(found, axis=1) if found else np.zeros((len(values), 0))


def _knots(values: np.ndarray, knots: int) -> Float[np.ndarray, " knots"]:
    """Return where equal shares of values lie; none where all are the same."""
    at = np.unique(np.quantile(values, np.linspace(0.0, 1.0, knots)))
    return at if len(at) > 1 and at[-1] - at[0] >= 1e-12 else at[:0]


def _from_zero(
    torque: Float[np.ndarray, " rows"], knots: int
) -> Float[np.ndarray, "rows columns"]:
    """Return piecewise linear functions that are nothing at no torque.

    A constant turn is an offset, and no law of torque. Where no row is without torque
    the outer pieces go on to there.
    """
    at = _knots(torque, knots)
    if not len(at):
        return np.zeros((len(torque), 0))
    within = np.clip(0.0, at[0], at[-1])
    first = int(np.clip(np.searchsorted(at, 0.0) - 1, 0, len(at) - 2))
    at_zero = np.array([np.interp(within, at, row) for row in np.eye(len(at))])
    beyond = (0.0 - within) / (at[first + 1] - at[first])
    at_zero[[first, first + 1]] += [-beyond, beyond]
    return (hats(torque, knots) - at_zero)[:, :-1]  # all of them add up to nothing


def _of_axis(situation: StaticState, k: int) -> list[MapBlock]:
    where = situation.axes[k]
    torque, angle = situation.torque[:, k], situation.recording.posture[:, k]
    load = situation.load_torque[:, k]
    unit = max(float(np.max(np.abs(torque))), 1e-9)
    t = torque / unit
    steps = situation.steps
    path = load[steps]
    rise = np.diff(path, axis=1, prepend=path[:, :1])
    grows = situation.from_steps((np.sign(path) * np.sign(rise) >= 0).astype(float))
    before = situation.from_steps(np.concatenate([path[:, :1], path[:, :-1]], axis=1))
    stood = np.log1p(situation.recording.time - situation.recording.load_time)
    along = np.einsum(
        "ri,ri->r", situation.frame[:, k + 1, :, 2], situation.force[:, k + 1]
    )
    along = along / max(float(np.max(np.abs(along))), 1e-9)
    knots = hats(torque, KNOTS)
    waves = _harmonics(situation, k, angle)
    time = hats(situation.recording.time, TIMES)
    blocks = []
    laws = {
        "torque": _from_zero(torque, KNOTS),
        "direction": knots * (2.0 * grows - 1.0)[:, None],
        "history": np.column_stack([before / unit, t * (stood - stood.mean())]),
        "angle": _told_apart(
            np.concatenate([waves, waves * t[:, None]], axis=1),
            np.column_stack([np.ones(len(t)), t]),
        ),
        "time": np.concatenate([time * t[:, None], time[:, 1:]], axis=1),
        "load": np.column_stack([t * along, along**2, _loads_on(situation, k + 1)]),
    }
    for depends_on, law in laws.items():
        if law.shape[1]:
            signature = EffectJacobian(law.shape[1], (JointRotation(k, law),))
            blocks.append(MapBlock(where, depends_on, depends_on, signature))
    place = k + 1
    across = situation.seat[:, place, :, :2]
    moment = np.einsum("rij,ri->rj", across, situation.moment[:, place])
    m = moment / (np.max(np.abs(moment)) + 1e-9)
    rotation = np.concatenate([across * m[:, None, :], _one_sided(across, m)], axis=2)
    tilt = rotation_about(place, rotation, situation.origin[:, place])
    blocks.append(MapBlock(where, "tilt", "load", tilt))
    lag = _lagging(situation, across, moment)
    friction = rotation_about(place, lag, situation.origin[:, place])
    blocks.append(MapBlock(where, "friction", "history", friction))
    blocks.append(MapBlock(where, "compliance", "load", _compliance(situation, place)))
    blocks.append(MapBlock(where, "geometry", "geometry", _constant(situation, place)))
    parent = situation.arm.chain.parent
    if parent[k] >= 0 and parent.count(parent[k]) == 1 and time.shape[1]:
        blocks.append(_warming(situation, parent[k] + 1, place))
    return blocks


def _loads_on(situation: StaticState, place: int) -> Float[np.ndarray, "rows 9"]:
    """Return a place's wrench but its torque, along both sides' axes, each scaled.

    What turns an axis beside its own torque: a neighbour's torque, a pull along it.
    """
    force, moment = situation.force[:, place], situation.moment[:, place]
    along = [
        np.einsum("rij,ri->rj", side[:, place], wrench)
        for side in (situation.seat, situation.frame)
        for wrench in (force, moment)
    ]
    found = np.concatenate(
        [along[0], along[1][:, :2], along[2][:, :2], along[3][:, :2]], axis=1
    )
    return found / np.maximum(np.max(np.abs(found), axis=0), 1e-9)


def _compliance(situation: StaticState, place: int) -> EffectJacobian:
    """Return small motions of a place by a full symmetric compliance, but its spring's.

    Twist and wrench are along the axes of the moving side: Klimchik et al. 2011.
    """
    frame = situation.frame[:, place]
    motion = six_motions(place, frame, situation.origin[:, place]).twist
    wrench = np.concatenate(
        [
            np.einsum("rij,ri->rj", frame, situation.force[:, place]),
            np.einsum("rij,ri->rj", frame, situation.moment[:, place]),
        ],
        axis=1,
    )
    own = 2 if situation.arm.slides[place - 1] else 5
    pairs = [(i, j) for i in range(6) for j in range(i, 6) if not i == j == own]
    columns = [
        motion[:, :, i] * wrench[:, j, None]
        + (motion[:, :, j] * wrench[:, i, None] if i != j else 0.0)
        for i, j in pairs
    ]
    twist = np.stack(columns, axis=2)
    return EffectJacobian(len(pairs), (BodyTwist(place, twist),))


def _one_sided(
    across: Float[np.ndarray, "rows 3 2"], moment: Float[np.ndarray, "rows 2"]
) -> Float[np.ndarray, "rows 3 columns"]:
    """Return rotations about both directions by sizes of the moment about any.

    What opens one way only, a bearing or a foot, knows no directions of ours.
    """
    about = np.linspace(0.0, np.pi, DIRECTIONS, endpoint=False)
    even = np.abs(moment @ np.stack([np.cos(about), np.sin(about)]))
    columns = across[:, :, :, None] * even[:, None, None, :]
    return columns.reshape(len(moment), 3, -1)


def _lagging(
    situation: StaticState,
    about: Float[np.ndarray, "rows 3 directions"],
    moment: Float[np.ndarray, "rows directions"],
    carries: bool = False,
) -> Float[np.ndarray, "rows 3 columns"]:
    """Return rotations about some directions by what friction holds of each moment.

    Args:
        situation: With the order of rows.
        about: The directions.
        moment: About each.
        carries: Whether each visit begins with what the one before left.
    """
    columns = []
    for j, own in enumerate(moment.T):
        path = own[situation.steps]
        start = path[0, 0] if carries else path[:, :1]
        slips = np.array(SLIPS) * max(float(np.max(np.abs(path - start))), 1e-9)
        moved = slipped(slips)
        stops = along_visits(situation, own, moved, len(slips), carries) / slips
        columns.append(about[:, :, j, None] * stops[:, None, :])
    return np.concatenate(columns, axis=2)


def _told_apart(
    law: Float[np.ndarray, "rows columns"], known: Float[np.ndarray, "rows _"]
) -> Float[np.ndarray, "rows kept"]:
    """Return what a law does that is told apart from what is known.

    Waves over a small range of angles make up a constant, so that a stiffness with
    waves would hold the spring and leave laws of torque nothing to refer to.
    """
    if not law.shape[1]:
        return law
    rest = law - known @ np.linalg.lstsq(known, law)[0]
    _, size, turn = np.linalg.svd(rest, full_matrices=False)
    return rest @ turn[size > TOLD_APART * np.max(size)].T


def _harmonics(situation: StaticState, k: int, angle: np.ndarray) -> np.ndarray:
    if situation.arm.slides[k] or np.ptp(angle) < 1e-6:
        return np.zeros((len(angle), 0))
    return np.column_stack([f(n * angle) for n in HARMONICS for f in (np.cos, np.sin)])


def _constant(situation: StaticState, place: int) -> EffectJacobian:
    """Return six constant small motions of a place, along its seat's axes."""
    seat, origin = situation.seat[:, place], situation.origin[:, place]
    return EffectJacobian(6, (six_motions(place, seat, origin),))


def _warming(situation: StaticState, link: int, place: int) -> MapBlock:
    """Return courses in time of where a link holds the axis after it.

    A link that warms up grows, or its end alone, which turns where one side is warmer.
    Markers of a link that grows move by as much as they lie along it.

    Args:
        situation: Where the arm stood.
        link: Its number, that of the axis that carries it.
        place: The place of the axis after it.
    """
    seat = situation.seat[:, place]
    courses = hats(situation.recording.time, GROWTH)[:, 1:]

    def over_time(columns: np.ndarray) -> np.ndarray:
        every = columns[..., None] * courses[:, None, None, :]
        return every.reshape(*columns.shape[:2], -1)

    grows = translate(place, seat).twist
    turns = rotate(place, seat, situation.origin[:, place]).twist
    twist = over_time(np.concatenate([grows, grows, turns], axis=2))
    parts: list[JacobianBlock] = [BodyTwist(place, twist)]
    start = situation.origin[:, link]
    along = situation.origin[:, place] - start
    square = np.maximum(np.sum(along**2, axis=1), 1e-12)
    for m, marker in enumerate(situation.recording.markers):
        if situation.arm.attachment(marker.body).axis == link - 1:
            lever = marked_point(situation, m) - start
            share = np.clip(np.sum(lever * along, axis=1) / square, 0.0, 1.0)
            still = np.zeros_like(seat)
            moved = np.concatenate([seat, still, still], axis=2)
            shift = over_time(share[:, None, None] * moved)
            parts.append(MarkerDisplacement(m, shift))
    law = EffectJacobian(twist.shape[2], tuple(parts))
    return MapBlock(f"link_{link}", "warming", "time", law)


def _of_sensor(situation: StaticState) -> list[MapBlock]:
    """Return what axes' springs do where the force sensor errs.

    By what each channel takes up of each, its 6 x 6 matrix of gains and crosstalk, and
    by its own square; by what it holds back of its own changes; by how its zero goes,
    and the scale of all; by what was tared away. Per share of the largest force and of
    the largest moment that were read. Nothing of channels that are `NOISY`.
    """
    if situation.recording.wrench is None or not sprung(situation):
        return []
    read = reading(situation)
    size = np.linalg.norm(read.reshape(-1, 2, 3), axis=2).max(axis=0)
    full = np.repeat(np.maximum(size, LEAST_READ), 3)
    spec = situation.recording.wrench_sensor
    sigma = np.zeros(6) if spec is None else spec.sigma
    each, own = np.arange(6), np.flatnonzero(sigma <= NOISY * full)
    share = (read / full)[:, own]
    side = _loading(situation, share)
    lags = np.concatenate([side, side * np.abs(share)], axis=1)
    zero = hats(situation.recording.time, GROWTH)[:, 1:]
    laws = (
        ("channels", "load", np.tile(each, len(own)), np.repeat(share, 6, axis=1)),
        ("square", "load", own, share * np.abs(share)),
        ("lag", "history", np.tile(own, 2), lags),
        ("zero", "time", np.repeat(own, zero.shape[1]), np.tile(zero, len(own))),
    )
    blocks = []
    for kind, depends_on, to, law in (of_kind for of_kind in laws if len(of_kind[2])):
        done = misread(situation, to, full[to] * law)
        blocks.append(MapBlock(SENSOR, kind, depends_on, done))
    if len(own) and zero.shape[1]:
        scale = (share[:, None] * zero[:, :, None]).reshape(len(share), -1)
        to = np.tile(own, zero.shape[1])
        alike = np.kron(np.eye(zero.shape[1]), np.ones((len(own), 1)))
        done = mixture(misread(situation, to, full[to] * scale), alike)
        blocks.append(MapBlock(SENSOR, "scale", "time", done))
    if np.all(sigma[:3] <= NOISY * full[:3]):
        more = full[0] * _along_load(situation, read)
        tared = mixture(misread(situation, each, more), np.ones((6, 1)))
        blocks.append(MapBlock(SENSOR, "tare", "load", tared))
    return blocks


def _along_load(
    situation: StaticState, read: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows 6"]:
    """Return a force of 1 N as each visit's largest load pulls, in all of its rows.

    A rope that is under tension, or carries a hook, while the sensor is zeroed pulls
    more by the same in each row.
    """
    force = np.linalg.norm(read[:, :3], axis=1)
    steps = situation.steps
    most = steps[np.arange(len(steps)), np.argmax(force[steps], axis=1)]
    pulled = force[most] > MOVED * max(float(np.max(force)), LEAST_READ)
    unit = read[most] * (pulled / np.maximum(force[most], LEAST_READ))[:, None]
    return unit[situation.visit]


def _loading(
    situation: StaticState, share: Float[np.ndarray, "rows channels"]
) -> Float[np.ndarray, "rows channels"]:
    """Return to which side channels moved last, -1 … 1: what holds back is behind.

    A stop would follow the noise of the reading, of which the mismatch is made.
    """
    sides = [along_visits(situation, one, _last_side, 1) for one in share.T]
    return np.concatenate(sides, axis=1) if sides else share


def _last_side(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Return the sign of the last change that is more than noise."""
    change = now - before
    return np.where(np.abs(change) > MOVED, np.sign(change), last)


def _of_base(situation: StaticState) -> list[MapBlock]:
    def scaled(values: np.ndarray) -> np.ndarray:
        return values / max(float(np.max(np.abs(values))), 1e-9)

    moment, force = scaled(situation.moment[:, 0]), scaled(situation.force[:, 0])
    time = situation.recording.time
    slow = hats(time, COURSE)[:, 1:]
    quick = hats(time, min(WANDER, len(situation.steps) // VISITS_A_KNOT))[:, 1:]
    eye = np.broadcast_to(np.eye(3), (situation.rows, 3, 3))
    origin = situation.origin[:, 0]

    def block(kind: str, depends_on: str, parts: list[BodyTwist]) -> MapBlock:
        twist = np.concatenate([part.twist for part in parts], axis=2)
        joined: tuple[JacobianBlock, ...] = (BodyTwist(0, twist),)
        jacobian = EffectJacobian(twist.shape[2], joined)
        return MapBlock("base", kind, depends_on, jacobian)

    loads = [
        rotate(0, eye * law[:, None, :], origin)
        for law in (moment, moment * np.abs(moment))
    ]
    loads.append(rotate(0, _one_sided(eye[:, :, :2], moment[:, :2]), origin))
    shifts = [translate(0, eye * force[:, None, :])]
    drift = [
        law(0, eye * t[:, None, None])
        for t in slow.T
        for law in (translate, lambda p, r: rotate(p, r, origin))
    ]
    found = [block("load", "load", loads + shifts)]
    for kind, carries in (("friction", False), ("memory", True)):
        if not carries or BEFORE in memories(situation.recording.visit):
            lag = _lagging(situation, eye, situation.moment[:, 0], carries)
            found.append(block(kind, "history", [rotate(0, lag, origin)]))
    if drift:
        found.append(block("time", "time", drift))
    if quick.shape[1] > slow.shape[1]:
        wander = [translate(0, eye * t[:, None, None]) for t in quick.T]
        found.append(block("wander", "time", wander))
    return found
