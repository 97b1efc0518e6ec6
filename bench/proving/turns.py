"""What markers show of each axis is how far it turned beyond the simulation.

==========  ==========================================================================
Equation    turn = (A'A + λ)^-1 A'r row by row, A the axes' screws at the markers
Source      least squares; λ keeps turns that no marker shows at zero
Valid       small turns, markers that see the axes
Ignores     motions across the axes
==========  ==========================================================================
"""

import numpy as np
from jaxtyping import Float

from bench.proving.columns import turned_by, wind_up
from bench.proving.world import Assumed, Seen, World

FAINT = 0.02
"""Lever in m below which markers do not show a turn; chosen."""


def turns_of(
    world: World,
    assumed: Assumed,
    seen: Seen,
    residual: Float[np.ndarray, "rows markers 3"],
) -> Float[np.ndarray, "rows axes"]:
    """Return the turn of every axis of the recording that fits residuals, in rad."""
    rig = assumed.rig
    unit = np.ones((len(residual), len(rig.springs)))
    good = np.isfinite(residual).all(axis=2, keepdims=True)
    left = np.where(good, residual, 0.0).reshape(len(residual), -1)
    blocks = [turned_by(world, rig, seen, int(k), unit) for k in world.order]
    screws = np.stack([np.where(good, b, 0.0).reshape(left.shape) for b in blocks], 2)
    inner = screws.swapaxes(1, 2) @ screws
    inner = inner + FAINT**2 * np.eye(inner.shape[1])
    ask = np.einsum("rna,rn->ra", screws, left)
    return np.linalg.solve(inner, ask[..., None])[..., 0]


def torques_of(
    world: World, assumed: Assumed, seen: Seen
) -> Float[np.ndarray, "rows axes"]:
    """Return the torque about each axis of an arm with nothing but springs, in N m."""
    rig = assumed.rig
    return (wind_up(world, rig, seen) * rig.springs)[:, world.order]
