"""A map of everything that could be left over belongs to no hypothesis and names none.

Columns of a place: torque in knots for loading and for unloading, torque with the
axis' angle, with time, with axial force, with what it was a row before and how long it
has stood; moments across the axis; and, between visits, the place's own small constant
motions, the axis' angle in harmonics and the tracker's own errors. Chosen after a trial
in which such a map told rightly from wrongly named recordings.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.signature import (
    Motion,
    Part,
    Signature,
    Turn,
    rotate,
    translate,
)
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.tracker_map import errors_of_tracker

KNOTS = 7
"""Knots of torque; chosen: three segments a side."""
TIMES = 5
HARMONICS = (1, 2, 3)
DIRECTIONS = 4
"""Directions of a moment, half a turn together; chosen: one is never far."""


@dataclass(frozen=True)
class MapBlock:
    """Columns of one place and one kind of dependence.

    Attributes:
        where: The place, as in an answer.
        depends_on: What the columns speak of.
        signature: The columns.
    """

    where: str
    depends_on: str
    signature: Signature


def residual_map(situation: Situation) -> tuple[MapBlock, ...]:
    """Return the map of all places."""
    blocks = _of_base(situation)
    for k in range(len(situation.axes)):
        blocks.extend(_of_axis(situation, k))
    seen = errors_of_tracker(situation)
    if seen.columns:
        blocks.append(MapBlock("tracker", "geometry", seen))
    return tuple(blocks)


def hats(values: np.ndarray, knots: int) -> Float[np.ndarray, "rows knots"]:
    """Return piecewise linear functions between knots over the range of values.

    They add up to one; knots are where equal shares of the values lie.
    """
    at = np.unique(np.quantile(values, np.linspace(0.0, 1.0, knots)))
    if len(at) < 2 or at[-1] - at[0] < 1e-12:
        return np.zeros((len(values), 0))
    return np.stack([np.interp(values, at, row) for row in np.eye(len(at))], axis=1)


def _of_axis(situation: Situation, k: int) -> list[MapBlock]:
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
    up, down = knots * grows[:, None], knots * (1.0 - grows)[:, None]
    waves = _waves(situation, k, angle)
    time = hats(situation.recording.time, TIMES)
    blocks = []
    laws = {
        "torque": np.concatenate([up + down], axis=1),
        "direction": up - down,
        "history": np.column_stack([before / unit, t * (stood - stood.mean())]),
        "angle": np.concatenate([waves, waves * t[:, None]], axis=1),
        "time": np.concatenate([time * t[:, None], time], axis=1),
        "load": np.column_stack([t * along, along, along**2]),
    }
    for depends_on, law in laws.items():
        if law.shape[1]:
            signature = Signature(law.shape[1], (Turn(k, law),))
            blocks.append(MapBlock(where, depends_on, signature))
    place = k + 1
    across = situation.seat[:, place, :, :2]
    moment = np.einsum("rij,ri->rj", across, situation.moment[:, place])
    m = moment / (np.max(np.abs(moment)) + 1e-9)
    rotation = np.concatenate([across * m[:, None, :], _one_sided(across, m)], axis=2)
    tilt = rotate(place, rotation, situation.origin[:, place])
    blocks.append(MapBlock(where, "load", Signature(rotation.shape[2], (tilt,))))
    blocks.append(MapBlock(where, "geometry", _constant(situation, place)))
    return blocks


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


def _waves(situation: Situation, k: int, angle: np.ndarray) -> np.ndarray:
    if situation.arm.slides[k] or np.ptp(angle) < 1e-6:
        return np.zeros((len(angle), 0))
    return np.column_stack([f(n * angle) for n in HARMONICS for f in (np.cos, np.sin)])


def _constant(situation: Situation, place: int) -> Signature:
    """Return six constant small motions of a place, along its seat's axes."""
    seat = situation.seat[:, place]
    shift = translate(place, seat)
    turned = rotate(place, seat, situation.origin[:, place])
    twist = np.concatenate([shift.twist, turned.twist], axis=2)
    return Signature(6, (Motion(place, twist),))


def _of_base(situation: Situation) -> list[MapBlock]:
    def scaled(values: np.ndarray) -> np.ndarray:
        return values / max(float(np.max(np.abs(values))), 1e-9)

    moment, force = scaled(situation.moment[:, 0]), scaled(situation.force[:, 0])
    time = scaled(situation.recording.time)[:, None]
    eye = np.broadcast_to(np.eye(3), (situation.rows, 3, 3))
    origin = situation.origin[:, 0]

    def block(depends_on: str, parts: list[Motion]) -> MapBlock:
        twist = np.concatenate([part.twist for part in parts], axis=2)
        joined: tuple[Part, ...] = (Motion(0, twist),)
        return MapBlock("base", depends_on, Signature(twist.shape[2], joined))

    loads = [
        rotate(0, eye * law[:, None, :], origin)
        for law in (moment, moment * np.abs(moment))
    ]
    loads.append(rotate(0, _one_sided(eye[:, :, :2], moment[:, :2]), origin))
    shifts = [translate(0, eye * force[:, None, :])]
    wander = [
        law(0, eye * t[:, None, :])
        for t in (time, time**2)
        for law in (translate, lambda p, r: rotate(p, r, origin))
    ]
    return [block("load", loads + shifts), block("time", wander)]
