"""A little more of what is nominal moves every marker in a way known beforehand.

==========  ==========================================================================
Equation    δp = (z × (p - o)) θ δ(ln c) on an axis with wind-up θ (z θ on a slide);
            R_body δplace for a marker; δt + δω × p for the frame
Source      first order of the kinematics: Siciliano et al. 2009, section 3.1
Valid       springs that are nearly linear: θ grows with the compliance c
Ignores     how a wind-up changes the torques of other axes
==========  ==========================================================================
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float

from bench.proving.world import Assumed, Seen, World
from bench.rig import RIGID, Rig

DECADE = float(np.log(10.0))
"""One sigma of ln c about where the fit starts: a decade either way is nominal."""
PLACE = 1e-3
"""One sigma of a stated marker place, in m; the rule of what is nominal."""
UNKNOWN = 1.0
"""One sigma of what is not stated, in m or rad."""


@dataclass(frozen=True)
class Columns:
    """What one unit of each silent parameter does to the readings.

    Attributes:
        matrix: Displacements of markers, then angles, (rows, readings, parameters).
        prior: One sigma of each parameter.
        axes: Which axes' springs come first, from 0.
        framed: Whether the six of the frame follow.
    """

    matrix: Float[np.ndarray, "rows readings parameters"]
    prior: Float[np.ndarray, " parameters"]
    axes: tuple[int, ...]
    framed: bool


def columns_of(world: World, assumed: Assumed, seen: Seen, places: bool) -> Columns:
    """Return the columns of all that is fitted silently.

    Args:
        world: The recording.
        assumed: What the simulation took to be so.
        seen: What came of it.
        places: Whether markers' places are among the parameters.
    """
    rig = assumed.rig
    axes = tuple(int(k) for k in world.order if rig.springs[k] < RIGID)
    rows = len(seen.point)
    blocks = [turned_by(world, rig, seen, k, wind_up(world, rig, seen)) for k in axes]
    prior = [DECADE] * len(axes)
    every = np.ones(rows, dtype=bool)
    more, sigma = framing(world, assumed, seen, places, every)
    blocks += more
    prior += sigma
    stacked = [np.reshape(block, (rows, -1)) for block in blocks]
    if seen.angle is not None:
        angles = [_on_encoders(world, rig, seen, k) for k in axes]
        angles += [np.zeros(seen.angle.shape)] * (len(stacked) - len(angles))
        stacked = [np.hstack(pair) for pair in zip(stacked, angles, strict=True)]
    matrix = np.stack(stacked, axis=2) if stacked else np.zeros((rows, 0, 0))
    return Columns(matrix, np.array(prior), axes, is_framed(world))


def is_framed(world: World) -> bool:
    """Return whether the tracker's frame is unknown, and fitted."""
    recording = world.recording
    return recording.base_from_tracker is None and bool(recording.markers)


def framing(
    world: World,
    assumed: Assumed,
    seen: Seen,
    places: bool,
    rows: Bool[np.ndarray, " rows"],
) -> tuple[list[np.ndarray], list[float]]:
    """Return what frame and places do to markers in some rows, and their priors."""
    recording, point = world.recording, seen.point[rows]
    blocks, prior = [], []
    relative = recording.displacement == "relative"
    if is_framed(world):
        about = point
        if relative and recording.points is not None:
            about = recording.points[rows] @ assumed.turn.T
        blocks += [np.full(point.shape, (not relative) * e) for e in np.eye(3)]
        blocks += [np.cross(e, about) for e in np.eye(3)]
        prior += [UNKNOWN] * 6
    if places and not relative:
        states, base_turn = seen.states, world.base[1]
        for m, marker in enumerate(recording.markers):
            b = states.bodies.index(world.body[m])
            turn = base_turn.T @ states.rotation[rows, b]
            for i in range(3):
                block = np.zeros(point.shape)
                block[:, m] = turn[:, :, i]
                blocks.append(block)
            prior += [UNKNOWN if marker.position is None else PLACE] * 3
    return blocks, prior


def turned_by(
    world: World, rig: Rig, seen: Seen, k: int, angle: Float[np.ndarray, "rows axes"]
) -> Float[np.ndarray, "rows markers 3"]:
    """Return how markers move when axis k turns by small angles, in m."""
    states, model, arm = seen.states, rig.nominal, rig.anatomy
    base, turn = world.base
    joint, b = model.joint(arm.axes[k]), states.bodies.index(arm.links[k])
    at = states.position[:, b] + states.rotation[:, b] @ joint.pos
    at = (at - base) @ turn
    along = states.rotation[:, b] @ joint.axis @ turn
    block = np.broadcast_to(along[:, None], seen.point.shape)
    if not arm.slides[k]:
        block = np.cross(along[:, None], seen.point - at[:, None])
    moves = carried(model, arm.links[k], world.body)
    return block * angle[:, k, None, None] * moves[:, None]


def wind_up(world: World, rig: Rig, seen: Seen) -> Float[np.ndarray, "rows axes"]:
    """Return by how much every axis of the arm is wound, in rad."""
    posture = np.zeros(seen.states.axis_angle.shape)
    posture[:, world.order] = world.recording.posture
    return seen.states.axis_angle - rig.command(posture).reference


def carried(
    model: mujoco.MjModel, link: str, bodies: tuple[str, ...]
) -> Bool[np.ndarray, " bodies"]:
    """Return whether each body hangs on a link or is it."""
    root = model.body(link).id

    def hangs(b: int) -> bool:
        while b and b != root:
            b = int(model.body_parentid[b])
        return b == root

    return np.array([hangs(model.body(body).id) for body in bodies], dtype=bool)


def _on_encoders(world: World, rig: Rig, seen: Seen, k: int) -> np.ndarray:
    block = np.zeros((len(seen.point), len(world.order)))
    block[:, world.order.tolist().index(k)] = wind_up(world, rig, seen)[:, k]
    return block
