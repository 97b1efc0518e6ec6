"""Mode of comparison: differences within a visit, or means of visits as they are.

An effect that the load brings about shows in how markers move while the load comes and
goes; there each marker's mean over a visit says nothing and is taken off. An effect of
geometry shows in the means alone, and so does every effect where no load comes and
goes; then nothing is taken off.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from bench.effects.effect import Effect
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.shared.effect_catalogue import CATALOGUE, MEANS

FAINT = 9.0
"""Sum of squares, in sigmas of a reading, of what all differences within visits could
show; chosen: below three sigmas in all, knowing its form would not make it visible."""


@dataclass(frozen=True)
class ComparisonMode:
    """How readings are compared.

    Attributes:
        absolute: Whether means of visits count.
        sigma: One sigma of a marker's coordinate, in m.
        angle_sigma: The same of an angle, in rad.
        keep: Rows that may be looked at.
    """

    absolute: bool
    sigma: float
    angle_sigma: float
    keep: Bool[np.ndarray, " rows"]


def means_count(
    world: ReplaySimulation, nominal: NominalState, patched: NominalState
) -> bool:
    """Return whether readings are compared as they are, means of visits included.

    Args:
        world: The recording.
        nominal: The arm without what is to be proved.
        patched: With it; the same arm where nothing is.
    """
    if world.recording.displacement != "absolute":
        return False
    own = [e for e in patched.rig.effects if e not in nominal.rig.effects]
    if any(_shows_in_means_alone(effect) for effect in own):
        return True
    every = comparison_mode_of(world, True, np.ones(world.replay.rows, dtype=bool))
    seen = world.see(patched)
    if own:  # what it does to readings
        away = residual_of(world, world.see(nominal), every)
        away = away - residual_of(world, seen, every)
    elif seen.point.size:  # where markers go
        away = np.reshape(seen.point, (len(seen.point), -1))
    else:
        return False
    sigma = sigma_of(world, every)[: away.shape[1]]
    within = centred(away, world.replay.visit, every.keep) / sigma
    return float(np.nansum(within**2)) < FAINT


def _shows_in_means_alone(effect: Effect) -> bool:
    info = CATALOGUE.get(effect.name)  # a table of what has no name is in none
    return info is not None and info.visible_in == MEANS


def comparison_mode_of(
    world: ReplaySimulation, absolute: bool, keep: np.ndarray
) -> ComparisonMode:
    """Return how a recording's readings are compared."""
    recording = world.recording
    sigma, frames = 1e-5, 1.0
    if recording.tracker is not None:
        sigma = float(np.sqrt(np.mean(recording.tracker.repeatability**2)))
    if recording.frames is not None:
        frames = float(np.mean(recording.frames))
    angle = recording.encoder_repeatability or 1e-6
    return ComparisonMode(absolute, max(sigma, 1e-9) / np.sqrt(frames), angle, keep)


def residual_of(
    world: ReplaySimulation, seen: SimulatedReadings, gauge: ComparisonMode
) -> np.ndarray:
    """Return residuals of markers, then of angles, (rows, readings); NaN = not seen."""
    left = np.reshape(seen.residual, (len(seen.residual), -1))
    if seen.angle is not None:
        left = np.hstack([left, seen.angle])
    return left if gauge.absolute else centred(left, world.replay.visit, gauge.keep)


def sigma_of(
    world: ReplaySimulation, gauge: ComparisonMode
) -> Float[np.ndarray, " readings"]:
    """Return one sigma of each entry of a row's residual."""
    sigma = np.full(3 * len(world.recording.markers), gauge.sigma)
    if world.recording.link_posture is not None:
        angles = np.full(len(world.order), gauge.angle_sigma)
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
