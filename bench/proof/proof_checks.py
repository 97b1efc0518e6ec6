"""Checks of a patch: loads and places left out, and placebo effects.

Left out: a direction of pull, the heaviest weight, a region of postures. What is
nominal and the effect's own parameters are fitted again without those rows, to first
order of the simulation, and judged on them. Placebos: the same patch on a neighbouring
axis, and the patch with one effect taken out; what is nominal is fitted again.
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.cluster.vq import kmeans2

from bench.effects.effect import Effect
from bench.effects.places import places_for
from bench.proof.comparison import ComparisonMode
from bench.proof.nominal_fit import simulated_jacobian
from bench.proof.refinement import Change, predicted, simulate_changes
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.shared.recording import Recording

HEAVY = 0.95
"""Share of the largest force from which a load is the heaviest; chosen."""
DIRECTIONS, REGIONS = 6, 4
"""Clusters of pulls and of postures, of which one is left out; chosen."""
ENOUGH = 40
"""Visits to which a placebo's springs are fitted; chosen: six springs need few."""
LEAST = 10
"""Readings rows that a group needs to be judged; chosen."""


@dataclass(frozen=True)
class ProofCheck:
    """One comparison on some rows.

    Attributes:
        kind: `left_out`, `placebo` or `taken_out`.
        before: Rms without the patch, 3-D per marker in m (per angle in rad where
            nothing else was measured).
    """

    kind: str
    what: str
    before: float
    after: float
    poses: int


def left_outs(
    simulation: ReplaySimulation,
    nominal: NominalState,
    patched: NominalState,
    slope: np.ndarray,
    mode: ComparisonMode,
) -> Iterator[ProofCheck]:
    """Try the patch on loads and postures that nothing was fitted to.

    All rows that are used are compared.
    """
    laid = []
    for assumed, own in ((nominal, None), (patched, slope)):
        seen = simulation.see(assumed)
        columns = simulated_jacobian(simulation, assumed, seen, mode.absolute)
        matrix, prior = columns.matrix, columns.prior
        if own is not None and own.shape[2]:
            matrix = np.concatenate([matrix, own], axis=2)
            prior = np.concatenate([prior, np.ones(own.shape[2])])
        laid.append((matrix, prior, seen))
    for what, out in groups(simulation.recording):
        used = mode.keep & out
        kept = replace(mode, keep=mode.keep & ~out)
        if used.sum() < LEAST or kept.keep.sum() < LEAST:
            continue
        sizes = [
            rms(simulation, predicted(matrix, prior, seen, simulation, kept), used)
            for matrix, prior, seen in laid
        ]
        poses = len(np.unique(simulation.recording.posture_id[used]))
        yield ProofCheck("left_out", what, sizes[0], sizes[1], poses)


def groups(recording: Recording) -> Iterator[tuple[str, Bool[np.ndarray, " rows"]]]:
    """Return what may be left out: words, and the rows."""
    wrench = recording.wrench
    if wrench is not None and np.any(wrench):
        size = np.linalg.norm(wrench[:, :3], axis=1)
        heavy = size >= HEAVY * size.max()
        yield f"the heaviest load ({size[heavy].mean():.0f} N)", heavy
        visit = np.unique(recording.visit, return_inverse=True)[1]
        pull = np.zeros((int(visit.max()) + 1, 3))
        np.add.at(pull, visit, wrench[:, :3])
        length = np.linalg.norm(pull, axis=1, keepdims=True)
        unit = pull / np.maximum(length, 1e-9)
        if len(unit) >= 2 * DIRECTIONS:
            commonest = _cluster(unit, DIRECTIONS)
            yield "one direction of pull", commonest[visit]
    ids, first, pose = np.unique(recording.posture_id, True, True)
    posture = recording.posture[first]
    if len(ids) >= 2 * REGIONS:
        region = _cluster(np.hstack([np.cos(posture), np.sin(posture)]), REGIONS)
        yield "one region of postures", region[pose]


def placebos(
    simulation: ReplaySimulation,
    patched: NominalState,
    own: Sequence[Effect],
    mode: ComparisonMode,
    held: np.ndarray,
) -> Iterator[ProofCheck]:
    """Put each effect on its neighbours, and take each out.

    Rows are compared as the mode says, with those that are fitted; `held` are judged.
    """
    some = some_of(simulation, held)
    simulation, held = simulation.part(some), held[some]
    mode = replace(mode, keep=mode.keep[some])
    after = refitted(simulation, patched, simulation.see(patched), mode, held)
    poses = len(np.unique(simulation.recording.posture_id[held]))
    tried: list[tuple[Effect, Effect | None]] = []
    for effect in own:
        elsewhere = _at_adjacent_sites(simulation, patched, effect)
        tried += [(effect, None), *((effect, neighbour) for neighbour in elsewhere)]
    changes = [Change((e,), () if n is None else (n,)) for e, n in tried]
    sizes = {
        i: refitted(simulation, assumed, seen, mode, held)
        for i, assumed, seen in simulate_changes(simulation, patched, changes)
    }
    without = {id(e): sizes.get(i) for i, (e, n) in enumerate(tried) if n is None}
    for i, (effect, neighbour) in enumerate(tried):
        size = without[id(effect)]
        if i not in sizes or size is None:
            continue
        word = f"{effect.name} at {effect.where}"
        if neighbour is None:
            yield ProofCheck("taken_out", f"without {word}", size, after, poses)
            continue
        what = f"{effect.name} at {neighbour.where} instead of {effect.where}"
        yield ProofCheck("placebo", what, size, sizes[i], poses)


def some_of(
    simulation: ReplaySimulation, held: np.ndarray
) -> Bool[np.ndarray, " rows"]:
    """Return the rows held out and those of some other visits.

    All of them where gears remember: a visit then needs the one before it.
    """
    if "carried" in (simulation.memory, *simulation.memories.values()):
        return np.ones(len(held), dtype=bool)
    others = np.unique(simulation.replay.visit[~held])
    every = max(1, -(-len(others) // ENOUGH))
    return held | np.isin(simulation.replay.visit, others[::every])


def refitted(
    simulation: ReplaySimulation,
    assumed: NominalState,
    seen: SimulatedReadings,
    mode: ComparisonMode,
    held: np.ndarray,
) -> float:
    """Return the rms on held rows once what is nominal is fitted again."""
    columns = simulated_jacobian(simulation, assumed, seen, mode.absolute)
    after = predicted(columns.matrix, columns.prior, seen, simulation, mode)
    return rms(simulation, after, held)


def rms(simulation: ReplaySimulation, residual: np.ndarray, rows: np.ndarray) -> float:
    """Return the rms of markers, 3-D in m; of angles in rad where there are none."""
    square = squares(simulation, residual)[0 if simulation.recording.markers else 1][
        rows
    ]
    return float(np.sqrt(np.nanmean(square))) if np.isfinite(square).any() else np.nan


def squares(
    simulation: ReplaySimulation, residual: Float[np.ndarray, "rows readings"]
) -> tuple[np.ndarray, np.ndarray]:
    """Return squares of markers (rows, markers) in m² and angles (rows, axes), rad²."""
    markers = len(simulation.recording.markers)
    points = residual[:, : 3 * markers].reshape(len(residual), markers, 3)
    return np.sum(points**2, axis=2), residual[:, 3 * markers :] ** 2


def _cluster(values: np.ndarray, count: int) -> np.ndarray:
    """Return a mask of the cluster whose size is the middle one."""
    start = values[np.linspace(0, len(values) - 1, count).astype(int)]
    with warnings.catch_warnings(action="ignore", category=UserWarning):  # one is empty
        label = kmeans2(values, start, iter=20)[1]
    sizes = np.bincount(label, minlength=count)
    order = np.argsort(sizes)
    return label == order[len(order) // 2]


def _at_adjacent_sites(
    simulation: ReplaySimulation, assumed: NominalState, effect: Effect
) -> list[Effect]:
    if not {"axis", "link"} & set(effect.places):
        return []
    arm = assumed.rig.anatomy
    known = places_for(effect.places, arm)
    if effect.where not in known or "with" in effect.parameters():
        return []
    at = known.index(effect.where)
    count = len(arm.axes)
    near = [i for i in (at - 1, at + 1) if 0 <= i < min(count, len(known))]
    return [replace(effect, where=known[i]) for i in near]
