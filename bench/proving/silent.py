"""What is nominal is fitted without a word: springs, tracker's frame, markers' places.

Where an effect shows in differences within visits alone, springs are fitted to these;
what only means of visits say, such as arrival and geometry, cannot bend them.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.proving.columns import (
    DECADE,
    Columns,
    columns_of,
    framing,
    is_framed,
)
from bench.proving.gauge import Gauge, centred, residual_of, sigma_of
from bench.proving.world import Assumed, World

SEVERE = 4.5
"""Sigmas from which a reading counts less (Huber 1964); chosen."""


def fitted(world: World, start: Assumed, gauge: Gauge, rounds: int = 3) -> Assumed:
    """Fit what is nominal by Gauss-Newton in the simulator.

    Args:
        world: The recording.
        start: Where to begin.
        gauge: Which rows are looked at, and how.
        rounds: Simulations that are spent.
    """
    assumed = start
    for _ in range(rounds):
        if not gauge.absolute:
            assumed = framed(world, assumed, gauge)
        seen = world.see(assumed)
        columns = columns_of(world, assumed, seen, gauge.absolute)
        left = residual_of(world, seen, gauge)
        step = solved(columns.matrix, columns.prior, left, world, gauge)
        assumed = stepped(assumed, columns, step)
    return assumed if gauge.absolute else framed(world, assumed, gauge)


def framed(world: World, assumed: Assumed, gauge: Gauge) -> Assumed:
    """Fit frame and places alone, to the first row of every visit."""
    if world.recording.displacement == "relative" or not world.recording.markers:
        return assumed
    seen = world.see(assumed)
    rows = np.zeros(len(gauge.keep), dtype=bool)
    rows[np.unique(world.first_rows())] = True
    rows &= gauge.keep
    blocks, prior = framing(world, assumed, seen, True, rows)
    if not blocks:
        return assumed
    matrix = np.stack([np.reshape(b, (rows.sum(), -1)) for b in blocks], axis=2)
    left = np.reshape(seen.residual[rows], (rows.sum(), -1))
    step = least_squares(matrix, np.array(prior), left, gauge.sigma)
    columns = Columns(matrix, np.array(prior), (), is_framed(world))
    return stepped(assumed, columns, step)


def solved(
    matrix: Float[np.ndarray, "rows readings parameters"],
    prior: Float[np.ndarray, " parameters"],
    left: Float[np.ndarray, "rows readings"],
    world: World,
    gauge: Gauge,
) -> Float[np.ndarray, " parameters"]:
    """Return the step of parameters that makes residuals smallest.

    Args:
        matrix: What one unit of each parameter does.
        prior: One sigma of each about where it stands.
        left: Residuals, NaN where nothing was read.
        world: The recording.
        gauge: Which rows count, and how.
    """
    if not gauge.absolute:
        matrix = centred(matrix, world.replay.visit, gauge.keep)
    rows = gauge.keep
    return least_squares(matrix[rows], prior, left[rows], sigma_of(world, gauge))


def least_squares(
    matrix: Float[np.ndarray, "rows readings parameters"],
    prior: Float[np.ndarray, " parameters"],
    left: Float[np.ndarray, "rows readings"],
    sigma: Float[np.ndarray, " readings"] | float,
) -> Float[np.ndarray, " parameters"]:
    """Return the most probable step of parameters; far readings count less."""
    good = np.isfinite(left) & np.isfinite(matrix).all(axis=2)
    white = (left / sigma)[good]
    shown = (matrix / np.broadcast_to(sigma, left.shape)[..., None])[good]
    step, weight = np.zeros(matrix.shape[2]), np.ones(len(white))
    for _ in range(2):
        heavy = shown * weight[:, None]
        gram = heavy.T @ shown + np.diag(prior**-2.0)
        scale = 1.0 / np.sqrt(np.diag(gram))
        ask = scale * (heavy.T @ white)
        step = scale * np.linalg.solve(gram * scale * scale[:, None], ask)
        rest = np.abs(white - shown @ step)
        spread = 1.4826 * np.median(rest) if len(rest) else 1.0
        weight = np.minimum(1.0, SEVERE * max(spread, 1e-9) / np.maximum(rest, 1e-12))
    return step


def stepped(assumed: Assumed, columns: Columns, step: np.ndarray) -> Assumed:
    """Return the assumption moved by a step of its silent parameters."""
    rig, n = assumed.rig, len(columns.axes)
    if n and np.any(np.abs(step[:n]) > 1e-12):
        stiffness = rig.springs.copy()
        growth = np.exp(np.clip(step[:n], -DECADE, DECADE))
        stiffness[list(columns.axes)] /= growth
        rig = replace(rig, stiffness=stiffness)
    turn, shift, place = assumed.turn, assumed.shift, assumed.place
    if columns.framed:  # a column moves what is predicted, so readings move back
        move, vector = step[n : n + 3], step[n + 3 : n + 6]
        back = Rotation.from_rotvec(-vector).as_matrix()
        turn, shift = back @ turn, back @ shift - move
    rest = step[n + 6 * columns.framed : n + 6 * columns.framed + place.size]
    if len(rest):
        place = place + rest.reshape(-1, 3)
    return Assumed(rig, turn, shift, place)
