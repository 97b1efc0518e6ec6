"""Experiments that discriminate between two competing models.

==========  ==========================================================================
Equation    expected log Bayes factor = |P (a - b)|²/2σ², a and b what the marks would
            do under either, each mark's mean over the visit taken off, P without the
            direction of a, which an error of the force's size could make
Source      Box & Hill 1967, "Discrimination among mechanistic models", with equal and
            known covariance
Valid       rivals whose parameters are known well beside their difference
Ignores     what the next data would do to the parameters
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from bench.cell import GRAVITY
from bench.proof.simulation import NominalState, ReplaySimulation

HOLD, DWELL = 20.0, 120.0
"""How long a load stands before it is read, in s; chosen: a careful hand, a coffee."""


@dataclass(frozen=True)
class Experiment:
    """One visit that could be made.

    Attributes:
        posture: In the recording's order of axes, in rad.
        path: What hangs on the hook, in kg; the same twice is a dwell.
        unit: Wrench per N of the rope's pull, at the sensor along the base's axes.
    """

    posture: Float[np.ndarray, " axes"]
    path: tuple[float, ...]
    unit: Float[np.ndarray, "6"]


def candidates(
    simulation: ReplaySimulation, assumed: NominalState, count: int = 16
) -> list[Experiment]:
    """Return visits that can surely be made: poses and pulls that were made before.

    The sensor's pull is that of the arm that is assumed; poses are taken evenly.
    """
    recording = simulation.recording
    wrench = simulation.wrench(assumed.rig)
    size = np.linalg.norm(wrench[:, :3], axis=1)
    if size.max() <= 0.0:
        return []
    mass = round(float(size.max()) / GRAVITY, 1)
    rows = [
        members[np.argmax(size[members])]
        for members in (
            np.flatnonzero(recording.posture_id == pose)
            for pose in np.unique(recording.posture_id)
        )
    ]
    chosen = [rows[i] for i in np.linspace(0, len(rows) - 1, count).astype(int)]
    found = []
    for row in dict.fromkeys(int(r) for r in chosen):
        if size[row] < size.max() / 10:
            continue
        unit = wrench[row] / size[row]
        found += [Experiment(recording.posture[row], p, unit) for p in paths(mass)]
    return found


def paths(mass: float) -> tuple[tuple[float, ...], ...]:
    """Return courses of the load up to a mass, in kg.

    Up and down in steps; a wait under load and after it; a small loop within the large
    one; a fine approach to zero, where play closes.
    """
    half, tenth = round(mass / 2, 2), round(mass / 10, 2)
    return (
        (0.0, half, mass, half, 0.0),
        (0.0, mass, mass, 0.0, 0.0),
        (0.0, mass, half, round(0.8 * mass, 2), half, 0.0),
        (0.0, tenth, 2 * tenth, half, mass, 2 * tenth, tenth, 0.0),
    )


def expected(
    simulation: ReplaySimulation,
    one: NominalState,
    other: NominalState,
    experiments: Sequence[Experiment],
    sigma: float,
) -> Float[np.ndarray, " experiments"]:
    """Return the expected log Bayes factor of each experiment between two rivals.

    One sigma of a mark's coordinate is in m.
    """
    factor = np.zeros(len(experiments))
    lengths = {len(e.path) for e in experiments}
    for length in lengths:
        index = [i for i, e in enumerate(experiments) if len(e.path) == length]
        some = [experiments[i] for i in index]
        seen = [_displacement(simulation, assumed, some) for assumed in (one, other)]
        for i, a, b in zip(index, *seen, strict=True):
            factor[i] = _distance(a, b) / (2.0 * sigma**2)
    return factor


def _displacement(
    simulation: ReplaySimulation,
    assumed: NominalState,
    experiments: Sequence[Experiment],
) -> Float[np.ndarray, "visits readings"]:
    """Return what marks would do, each less its mean over the visit, in m."""
    rig = assumed.rig
    posture = np.zeros((len(experiments), len(rig.springs)))
    posture[:, simulation.order] = [e.posture for e in experiments]
    path = np.array([e.path for e in experiments])
    unit = np.array([e.unit for e in experiments])
    wrench = GRAVITY * path[:, :, None] * unit[:, None]
    same = np.diff(path, axis=1, prepend=-1.0) == 0.0
    states = rig.respond(posture, wrench, np.where(same, DWELL, HOLD))
    point = simulation.points(assumed.rig, states, assumed.marker_positions)
    point = point.reshape(*path.shape, -1)
    return (point - point.mean(axis=1, keepdims=True)).reshape(len(path), -1)


def _distance(a: np.ndarray, b: np.ndarray) -> float:
    """Return the square of a - b beside the direction of a."""
    gap = a - b
    along = float(a @ a)
    if along > 0.0:
        gap = gap - a * (float(gap @ a) / along)
    return float(gap @ gap)
