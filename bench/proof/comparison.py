"""Mode of comparison: differences within a visit, or means of visits as they are.

An effect that the load brings about shows in how markers move while the load comes and
goes; there each marker's mean over a visit says nothing and is taken off. An effect of
geometry shows in the means alone, and so does every effect where no load comes and
goes; then nothing is taken off. Where noise explains what a fit leaves of the means,
they hold the patched arm's parameters, too, and are still taken off where arms are
compared.

What a body turns beside the simulation (`turns_of`) shows in its marks' residuals:

==========  ==========================================================================
Equation    turn = M⁻¹ Σ a_i x r_i, M = Σ |a_i|² 1 - a_i a_i', a_i, r_i place and
            residual of a mark beside those of the marks' middle; noise σ² trace M⁻¹,
            of a 6D target 3 (σ / arm)², arm its points' rms distance from the first
Source      least squares for a small rotation of a rigid body
Valid       three marks or more that do not lie in line
Ignores     marks that the tracker sees less exactly in depth
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from bench.effects.effect import Effect
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.shared.effect_catalogue import CATALOGUE, MEANS
from bench.shared.recording import Recording

FAINT = 9.0
"""Sum of squares, in sigmas of a reading, of what all differences within visits could
show; chosen: below three sigmas in all, knowing its form would not make it visible."""

FLAT = 1e-6
"""Least moment of inertia of marks over their largest below which they lie in line;
chosen: a mark a thousandth of their length beside the line."""


@dataclass(frozen=True)
class ComparisonMode:
    """How readings are compared.

    Attributes:
        absolute: Whether means of visits count.
        sigma: One sigma of a marker's coordinate, in m.
        angle_sigma: The same of an angle, in rad.
    """

    absolute: bool
    sigma: float
    angle_sigma: float
    keep: Bool[np.ndarray, " rows"]


def means_count(
    simulation: ReplaySimulation, nominal: NominalState, patched: NominalState
) -> bool:
    """Return whether readings are compared as they are, means of visits included.

    The patched arm is the nominal one where nothing is to be proved.
    """
    if simulation.recording.displacement != "absolute":
        return False
    own = [e for e in patched.rig.effects if e not in nominal.rig.effects]
    if any(_shows_in_means_alone(effect) for effect in own):
        return True
    every = comparison_mode_of(
        simulation, True, np.ones(simulation.replay.rows, dtype=bool)
    )
    seen = simulation.see(patched)
    if own:  # what it does to readings
        away = residual_of(simulation, simulation.see(nominal), every)
        away = away - residual_of(simulation, seen, every)
    elif seen.point.size:  # where markers go
        away = np.reshape(seen.point, (len(seen.point), -1))
    else:
        return False
    sigma = sigma_of(simulation, every)[: away.shape[1]]
    within = centred(away, simulation.replay.visit, every.keep) / sigma
    return float(np.nansum(within**2)) < FAINT


SCATTERED = 2.0
"""Mean square of visits' means, over what the noise leaves of them, up to which they
scatter no more than the noise; chosen: errors of their own are then no larger."""


def means_are_explained(
    simulation: ReplaySimulation,
    left: Float[np.ndarray, "rows readings"],
    mode: ComparisonMode,
) -> bool:
    """Return whether noise explains the means of visits in residuals of all rows."""
    points = 3 * len(simulation.recording.markers)
    if simulation.recording.displacement != "absolute" or not points:
        return False
    left = left[mode.keep, :points]
    visit, good = simulation.replay.visit[mode.keep], np.isfinite(left)
    count = int(visit.max()) + 1
    number, total = np.zeros((2, count, points))
    np.add.at(number, visit, good.astype(float))
    np.add.at(total, visit, np.where(good, left, 0.0))
    read = number > 0
    square = total[read] ** 2 / number[read] / mode.sigma**2
    return float(np.mean(square)) < SCATTERED


def _shows_in_means_alone(effect: Effect) -> bool:
    info = CATALOGUE.get(effect.name)  # a table of what has no name is in none
    return info is not None and info.visible_in == MEANS


def comparison_mode_of(
    simulation: ReplaySimulation, absolute: bool, keep: np.ndarray
) -> ComparisonMode:
    """Return how a recording's readings are compared."""
    recording = simulation.recording
    sigma, frames = 1e-5, 1.0
    if recording.tracker is not None:
        sigma = float(np.sqrt(np.mean(recording.tracker.repeatability**2)))
    if recording.frames is not None:
        frames = float(np.mean(recording.frames))
    angle = recording.encoder_repeatability or 1e-6
    return ComparisonMode(absolute, max(sigma, 1e-9) / np.sqrt(frames), angle, keep)


def residual_of(
    simulation: ReplaySimulation, seen: SimulatedReadings, mode: ComparisonMode
) -> np.ndarray:
    """Return residuals of markers, then of angles, (rows, readings); NaN = not seen."""
    left = np.reshape(seen.residual, (len(seen.residual), -1))
    if seen.angle is not None:
        left = np.hstack([left, seen.angle])
    return less_means(left, simulation, mode)


def less_means(
    values: np.ndarray, simulation: ReplaySimulation, mode: ComparisonMode
) -> np.ndarray:
    """Return values of all rows, less means of visits where these do not count."""
    if mode.absolute:
        return values
    return centred(values, simulation.replay.visit, mode.keep)


def sigma_of(
    simulation: ReplaySimulation, mode: ComparisonMode
) -> Float[np.ndarray, " readings"]:
    """Return one sigma of each entry of a row's residual."""
    sigma = np.full(3 * len(simulation.recording.markers), mode.sigma)
    if simulation.recording.link_posture is not None:
        angles = np.full(len(simulation.order), mode.angle_sigma)
        sigma = np.concatenate([sigma, angles])
    return sigma


def centred(
    values: np.ndarray, visit: np.ndarray, keep: Bool[np.ndarray, " rows"]
) -> np.ndarray:
    """Return values less their mean over each visit's rows that are kept.

    Visits of which no row is kept have their own mean taken off.
    """
    count = int(visit.max()) + 1
    kept_in = np.bincount(visit, keep, count) > 0
    use = keep | ~kept_in[visit]
    flat = values.reshape(len(values), -1)
    good = np.isfinite(flat) & use[:, None]
    starts = np.flatnonzero(np.diff(visit, prepend=-1))
    total = np.add.reduceat(np.where(good, flat, 0.0), starts, axis=0)
    number = np.add.reduceat(good.astype(float), starts, axis=0)
    mean = np.divide(total, number, out=np.full_like(total, np.nan), where=number > 0)
    return (flat - mean[visit]).reshape(values.shape)


def bodies_in_6d(recording: Recording) -> tuple[tuple[int, ...], ...]:
    """Return the marks of each 6D target, and of each body with three marks or more."""
    found: dict[tuple[str, bool], list[int]] = {}
    for m, marker in enumerate(recording.markers):
        whole = marker.target is not None
        found.setdefault((marker.target or marker.body, whole), []).append(m)
    return tuple(tuple(own) for own in found.values() if len(own) > 2)


def turns_of(
    simulation: ReplaySimulation,
    seen: SimulatedReadings,
    residual: Float[np.ndarray, "rows readings"],
    mode: ComparisonMode,
) -> tuple[Float[np.ndarray, "rows bodies"], Float[np.ndarray, "rows bodies"]]:
    """Return the squares of bodies' turns beside the simulation, and of their noise.

    Returns:
        Both in rad²; NaN where fewer than three marks were seen, or marks in line.
    """
    recording, groups = simulation.recording, bodies_in_6d(simulation.recording)
    left = np.reshape(residual[:, : 3 * len(recording.markers)], seen.point.shape)
    square = np.full((len(left), len(groups)), np.nan)
    noise = square.copy()
    share = np.ones(len(left))
    if not mode.absolute:
        _, counts = np.unique(simulation.replay.visit, return_counts=True)
        share = 1.0 - 1.0 / counts[simulation.replay.visit]
    for g, own in enumerate(groups):
        use = np.isfinite(left[:, own]).all(axis=2, keepdims=True)
        number = np.maximum(use.sum(axis=1, keepdims=True), 1)
        moved, place = (np.where(use, x[:, own], 0.0) for x in (left, seen.point))
        arm, moved = (
            np.where(use, x - x.sum(axis=1, keepdims=True) / number, 0.0)
            for x in (place, moved)
        )
        inertia = np.sum(arm**2, axis=(1, 2))[:, None, None] * np.eye(3)
        inertia = inertia - arm.swapaxes(1, 2) @ arm
        size = np.linalg.eigvalsh(inertia)
        good = (number.ravel() > 2) & (size[:, 0] > FLAT * size[:, 2])
        moment = np.sum(np.cross(arm, moved), axis=1)[good]
        turn = np.linalg.solve(inertia[good], moment[..., None])[..., 0]
        square[good, g] = np.sum(turn**2, axis=1)
        spread = np.sum(1.0 / size[good], axis=1)
        if recording.markers[own[0]].target is not None:
            away = place[good, 1:] - place[good, :1]
            spread = 3.0 / np.mean(np.sum(away**2, axis=2), axis=1)
        noise[good, g] = mode.sigma**2 * spread * share[good]
    return square, noise
