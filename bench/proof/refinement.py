"""Refinement of effects' parameters in the simulator by Gauss-Newton steps.

==========  ==========================================================================
Equation    Gauss-Newton on silent parameters and the effects' own together; what a
            little more of an effect's parameter does is simulated, one by one
Source      finite differences, 2 % of each parameter
Valid       parameters that are near their best already
Ignores     numbers of elements, orders of a name: what is no size
==========  ==========================================================================

What an axis winds up follows from the torque on it and its own effects alone. Changes
on different axes may therefore share a run, and the pose of each link, seen from the
link before, tells them apart again.

==========  ==========================================================================
Equation    T'_L = T_P R', all that L carries moved along; T_P where the link P before
            stands without any change, R' the pose of L seen from P in the shared run
Source      Curtis, Powell, Reid 1974, "On the estimation of sparse Jacobian matrices"
Valid       serial arms under known loads: these are statically determinate
Ignores     how far a wind-up turns the levers of loads at other axes: a share of about
            1e-3, the wind-up itself in rad
==========  ==========================================================================
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float

from bench.effects.effect import CommandEffect, Effect, ModelEffect
from bench.effects.gravity_load import GravityLoad
from bench.effects.tabled_law import TabledLaw
from bench.kinematic_chain import Anatomy
from bench.proof.comparison import (
    ComparisonMode,
    less_means,
    means_are_explained,
    residual_of,
    sigma_of,
)
from bench.proof.nominal_fit import (
    SimulatedJacobian,
    carried,
    framed,
    simulated_jacobian,
    solved,
    stepped,
)
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.rig import States
from bench.shared.errors import BenchError

# --- Changes that share a run ---------------------------------------------------------

FEW = 12
"""Up to so many changes have a run each; chosen: one or two effects with all their
parameters, whose proof then ignores nothing."""


@dataclass(frozen=True)
class Change:
    """Effects that go, and others that come.

    Attributes:
        removed: Of the rig's effects, the very objects.
        added: New ones.
    """

    removed: tuple[Effect, ...] = ()
    added: tuple[Effect, ...] = ()


def with_change(assumed: NominalState, *changes: Change) -> NominalState:
    """Return the assumption with some changes of its effects."""
    gone = {id(effect) for change in changes for effect in change.removed}
    kept = [effect for effect in assumed.rig.effects if id(effect) not in gone]
    added = [effect for change in changes for effect in change.added]
    return replace(assumed, rig=replace(assumed.rig, effects=(*kept, *added)))


def simulate_changes(
    simulation: ReplaySimulation, assumed: NominalState, changes: Sequence[Change]
) -> Iterator[tuple[int, NominalState, SimulatedReadings]]:
    """Simulate an arm with each of many changes by itself.

    Yields a change's index, the arm with it alone, and what it reads, not in order;
    those that cannot be built or find no rest are left out.
    """
    arm = assumed.rig.anatomy
    sites = [_axes_of(change, arm) for change in changes]
    alone, base = len(changes) <= FEW, simulation.states(assumed.rig)
    for group in _groups([frozenset() if alone else s for s in sites]):
        together = with_change(assumed, *(changes[i] for i in group))
        run = _run(simulation, together, base) if len(group) > 1 else None
        for i in group:
            try:
                one = with_change(assumed, changes[i])
                if run is None:
                    states = simulation.states(one.rig, keep=False, about=base)
                else:
                    states = _moved_at(base, run, together, sites[i])
                yield i, one, simulation.read(one, states)
            except BenchError:
                continue


def _run(
    simulation: ReplaySimulation, together: NominalState, base: States
) -> States | None:
    """Simulate; None where it cannot be, so that each change shows whether it can."""
    try:
        return simulation.states(together.rig, keep=False, about=base)
    except BenchError:
        return None


def _axes_of(change: Change, arm: Anatomy) -> frozenset[int]:
    """Return the axes, from 0, whose relative pose a change alters; empty: unknown."""
    found: set[int] = set()
    for effect in (*change.removed, *change.added):
        places = [effect.where, effect.parameters().get("with", effect.where)]
        axes = [arm.axis(str(place)) for place in places]
        if not isinstance(effect, (ModelEffect, CommandEffect)):
            return frozenset()
        if not all(axis in arm.axes for axis in axes):
            return frozenset()
        found |= {arm.axes.index(axis) for axis in axes}
    return frozenset(found)


def _groups(sites: Sequence[frozenset[int]]) -> list[list[int]]:
    """Return which changes share a run: those on different axes, first come first."""
    groups: list[list[int]] = []
    occupied: list[frozenset[int]] = []
    for i, own in enumerate(sites):
        free = (g for g, others in enumerate(occupied) if others and not own & others)
        place = next(free, None) if own else None
        if place is None:
            groups.append([i])
            occupied.append(own)
        else:
            groups[place].append(i)
            occupied[place] |= own
    return groups


def _moved_at(
    base: States, run: States, assumed: NominalState, axes: frozenset[int]
) -> States:
    """Return where everything is when only some axes do what they did in a run."""
    rig = assumed.rig
    arm, names = rig.anatomy, base.bodies
    position, rotation = base.position.copy(), base.rotation.copy()
    angle = base.axis_angle.copy()
    for k in sorted(axes, reverse=True):  # what is carried first: poses are the base's
        link = names.index(arm.links[k])
        before = names.index(arm.links[k - 1] if k else arm.base)
        back = run.rotation[:, before].swapaxes(1, 2)
        away = _turned(back, run.position[:, link] - run.position[:, before])
        at = base.position[:, before] + _turned(base.rotation[:, before], away)
        turn = base.rotation[:, before] @ back @ run.rotation[:, link]
        turn = turn @ base.rotation[:, link].swapaxes(1, 2)
        shift = at - _turned(turn, base.position[:, link])
        for b in np.flatnonzero(carried(rig.model, arm.links[k], names)):
            position[:, b] = _turned(turn, position[:, b]) + shift
            rotation[:, b] = turn @ rotation[:, b]
        angle[:, k] = run.axis_angle[:, k]
    return replace(base, position=position, rotation=rotation, axis_angle=angle)


def _turned(turn: np.ndarray, vector: np.ndarray) -> np.ndarray:
    return (turn @ vector[..., None])[..., 0]


# --- Refinement -----------------------------------------------------------------------

STEP = 0.02
"""Share of a parameter over which its effect is simulated; chosen: above a solver's
rounding, below a kink's reach."""
MAX_STEP = 1.0
"""Share by which a parameter may move in one step; chosen."""
SHORTER = (1.0, 0.25, 0.06)
"""Parts of a step that are tried in turn; chosen."""
ROUNDS = 10
"""Steps at most; chosen."""
TRUSTED = 0.75
"""Share of a predicted gain from which columns are kept; the usual bound of trust
regions (Nocedal and Wright 2006, algorithm 4.1)."""
FAR = 0.2
"""Share by which a parameter moves until its effect is simulated anew; chosen: a kink
of a law then moves past a few readings."""
ENOUGH = 1.0
"""χ² for each parameter below which the step that gains it is the last; chosen: what a
parameter's own error makes."""
BENT_BY = {"hysteresis": ("stiffening",), "lost_motion": ("closing_nm",)}
"""What bends a law's form and is no parameter of the vocabulary."""


@dataclass(frozen=True)
class RefinedParameter:
    """One number of one effect.

    Attributes:
        effect: Its place among the rig's effects.
        size: By which it is measured.
        sigma: One sigma of its prior about where it starts, as a share of the size.
    """

    effect: int
    name: str
    size: float
    sigma: float = 1.0


Place = tuple[str, str, str]
"""An effect's name, where it sits, and one of its parameters."""
NONE_KNOWN: Mapping[Place, float] = {}


@dataclass(frozen=True)
class Sensitivity:
    """What a whole size more of each parameter does to the readings.

    Attributes:
        places: Whose the columns are, in order.
        matrix: In m (rad for encoders) for each size.
    """

    parameters: tuple[RefinedParameter, ...]
    places: tuple[Place, ...]
    matrix: Float[np.ndarray, "rows readings parameters"]

    def column(
        self, place: Place, size: float
    ) -> Float[np.ndarray, "rows readings"] | None:
        """Return what another size of a parameter does; None where it is not known."""
        if self.places.count(place) != 1:
            return None
        i = self.places.index(place)
        return self.matrix[..., i] * (size / self.parameters[i].size)

    def part(self, rows: Bool[np.ndarray, " rows"]) -> "Sensitivity":
        """Return the same of some rows."""
        return replace(self, matrix=self.matrix[rows])

    def of_others(self, effects: Collection[int]) -> "Sensitivity":
        """Return the same of all but some effects."""
        kept = [i for i, p in enumerate(self.parameters) if p.effect not in effects]
        return Sensitivity(
            tuple(self.parameters[i] for i in kept),
            tuple(self.places[i] for i in kept),
            self.matrix[..., kept],
        )


def refined_parameters(
    effects: Sequence[Effect], sigmas: Mapping[Place, float] = NONE_KNOWN
) -> tuple[RefinedParameter, ...]:
    """Return what may be moved: all sizes that are neither zero nor without end.

    Where all of an effect is fixed, so is its form.

    Args:
        effects: Whose parameters.
        sigmas: Of their priors, where known; 0: fixed. Others are as wide as the size.
    """
    found = []
    for e, effect in enumerate(effects):
        if isinstance(effect, TabledLaw) or _is_mounted(effect):
            continue
        known = {f.name for f in fields(effect)} - {"where"}
        names = [name for name in effect.parameters() if name in known]
        sigma = {n: sigmas.get((effect.name, effect.where, n), np.inf) for n in names}
        free = [name for name in names if sigma[name] > 0.0]
        if names and not free:
            continue
        for name in (*free, *BENT_BY.get(effect.name, ())):
            value = getattr(effect, name, None)
            if isinstance(value, float) and np.isfinite(value) and value != 0.0:
                own = min(sigma.get(name, np.inf) / abs(value), 1.0)
                found.append(RefinedParameter(e, name, abs(value), own))
    return tuple(found)


def with_changed_parameters(
    effects: Sequence[Effect],
    parameters: Sequence[RefinedParameter],
    step: Float[np.ndarray, " knobs"],
) -> tuple[Effect, ...]:
    """Return effects whose knobs are turned by shares of their sizes.

    What cannot be negative, such as a stiffness or a width, grows by factors.
    """
    changed = list(effects)
    for knob, share in zip(parameters, step, strict=True):
        effect = changed[knob.effect]
        value, (least, _) = getattr(effect, knob.name), effect.bounds()[knob.name]
        if least >= 0.0:
            value = max(value * float(np.exp(share)), least)
        else:
            value += float(share) * knob.size
        changed[knob.effect] = replace(effect, **{knob.name: value})
    return tuple(changed)


def sensitivity(
    simulation: ReplaySimulation,
    assumed: NominalState,
    parameters: Sequence[RefinedParameter],
    known: Sensitivity | None = None,
) -> Sensitivity:
    """Return what a whole size more of each parameter does, by small steps.

    What is known of some parameters is not simulated again.
    """
    everything = ComparisonMode(
        True, 1.0, 1.0, np.ones(simulation.replay.rows, dtype=bool)
    )
    before = residual_of(simulation, simulation.see(assumed), everything)
    found = np.zeros((*before.shape, len(parameters)))
    places, possible, changes = [], [], []
    for i, parameter in enumerate(parameters):
        own = assumed.rig.effects[parameter.effect]
        place = (own.name, own.where, parameter.name)
        places.append(place)
        column = None if known is None else known.column(place, parameter.size)
        if column is not None:
            found[..., i] = column
            continue
        step = np.zeros(len(parameters))
        step[i] = STEP
        try:
            effects = with_changed_parameters(assumed.rig.effects, parameters, step)
        except BenchError:  # at the edge of what can be built: left where it is
            continue
        possible.append(i)
        changes.append(Change((own,), (effects[parameter.effect],)))
    for i, _, seen in simulate_changes(simulation, assumed, changes):
        after = residual_of(simulation, seen, everything)
        found[..., possible[i]] = (before - after) / STEP
    return Sensitivity(tuple(parameters), tuple(places), found)


@dataclass(frozen=True)
class Refinement:
    """An arm where the simulator agrees best.

    Attributes:
        sensitivity: What each parameter of its effects does there.
        mode: Which readings it was refined by.
    """

    assumed: NominalState
    sensitivity: Sensitivity
    mode: ComparisonMode


DISAGREE = 3.0
"""Standard deviations of χ² beyond which means of visits and differences within them do
not hold the same arm; chosen."""


def refined(
    simulation: ReplaySimulation,
    assumed: NominalState,
    mode: ComparisonMode,
    sigmas: Mapping[Place, float] = NONE_KNOWN,
    known: Sensitivity | None = None,
) -> Refinement:
    """Return where the simulator agrees best.

    ==========  ======================================================================
    Equation    means of visits count, too, where noise explains what a fit to all
                readings leaves of them, and differences within visits lose no more by
                it than n + 3 sqrt(2 n) of their χ², n parameters
    Source      two estimates of one arm, of which one may be inconsistent: Hausman
                1978, "Specification Tests in Econometrics"
    Valid       absolute readings; parameters that both hold
    Ignores     errors of geometry that imitate springs under the arm's own weight
    ==========  ======================================================================

    They hold springs that a load hardly winds, and have nothing of their own to bend
    them by.
    """
    found, sensitive = _refined_by(simulation, assumed, mode, sigmas, known)
    within = Refinement(found, sensitive, mode)
    if mode.absolute or simulation.recording.displacement != "absolute":
        return within
    whole, seen = replace(mode, absolute=True), simulation.see(found)
    columns = _joint_jacobian(simulation, found, seen, whole, sensitive)
    count = len(columns.prior)
    most = chi_square(simulation, found, mode)
    most += count + DISAGREE * float(np.sqrt(2.0 * count))

    def agree(left: Float[np.ndarray, "rows readings"]) -> bool:
        square = _square(simulation, less_means(left, simulation, mode), mode)
        return square <= most and means_are_explained(simulation, left, whole)

    if not agree(predicted(columns.matrix, columns.prior, seen, simulation, whole)):
        return within
    found, sensitive = _refined_by(simulation, found, whole, sigmas, sensitive)
    if not agree(residual_of(simulation, simulation.see(found), whole)):
        return within
    return Refinement(found, sensitive, whole)


def _joint_jacobian(
    simulation: ReplaySimulation,
    assumed: NominalState,
    seen: SimulatedReadings,
    mode: ComparisonMode,
    known: Sensitivity,
) -> SimulatedJacobian:
    """Return the columns of all silent parameters, then those of effects' own."""
    silent = simulated_jacobian(simulation, assumed, seen, mode.absolute)
    matrix = np.concatenate([silent.matrix, known.matrix], axis=2)
    own = [parameter.sigma for parameter in known.parameters]
    prior = np.concatenate([silent.prior, own])
    return replace(silent, matrix=matrix, prior=prior)


def _refined_by(
    simulation: ReplaySimulation,
    assumed: NominalState,
    mode: ComparisonMode,
    sigmas: Mapping[Place, float],
    known: Sensitivity | None,
) -> tuple[NominalState, Sensitivity]:
    """Return where one comparison agrees best, and what each parameter does there.

    Springs, frames and effects are moved. Each parameter of an effect has a prior about
    where it starts: what the readings do not hold stays at its first estimate. What an
    effect does is simulated anew where its parameters have moved far.
    """
    knobs = refined_parameters(assumed.rig.effects, sigmas)
    sensitive = sensitivity(simulation, assumed, knobs, known)
    at = _Refined(assumed, np.zeros(len(knobs)), chi_square(simulation, assumed, mode))
    simulated_at = at.from_start
    enough = ENOUGH * max(len(knobs), 1)
    for _ in range(ROUNDS):
        cost, at = at.cost, _better(simulation, at, mode, sensitive)
        gained, predicted = cost - at.cost, cost - at.predicted
        if predicted < enough:
            break
        far = np.flatnonzero(np.abs(at.from_start - simulated_at) > FAR)
        if len(far) and gained < TRUSTED * predicted:
            own = {knobs[i].effect for i in far}
            others = sensitive.of_others(own)
            sensitive = sensitivity(simulation, at.assumed, knobs, others)
            anew = np.array([knob.effect in own for knob in knobs])
            simulated_at = np.where(anew, at.from_start, simulated_at)
        elif gained < enough:
            break
    return at.assumed, sensitive


@dataclass(frozen=True)
class _Refined:
    """An arm on the way to its most probable parameters.

    Attributes:
        from_start: Shares by which effects' parameters were moved.
        cost: χ² of readings and prior.
        predicted: What it was to be by the step that came here.
    """

    assumed: NominalState
    from_start: Float[np.ndarray, " knobs"]
    cost: float
    predicted: float = np.inf


def _better(
    simulation: ReplaySimulation, at: _Refined, mode: ComparisonMode, known: Sensitivity
) -> _Refined:
    """Return where a Gauss-Newton step gains, shortened where it must be, or `at`."""
    seen = simulation.see(at.assumed)
    columns = _joint_jacobian(simulation, at.assumed, seen, mode, known)
    n = len(columns.prior) - len(at.from_start)
    since = np.concatenate([np.zeros(n), at.from_start])
    left = residual_of(simulation, seen, mode)
    step = solved(columns.matrix, columns.prior, left, simulation, mode, since)
    prior = columns.prior[n:]
    furthest = float(np.abs(step[n:]).max(initial=0.0))
    step *= MAX_STEP / max(furthest, MAX_STEP)
    for share in SHORTER:
        own = share * step[n:]
        moved = at.from_start + own
        try:
            trial = stepped(at.assumed, columns, share * step[:n])
            effects = with_changed_parameters(trial.rig.effects, known.parameters, own)
            trial = with_effects(trial, effects)
            if not mode.absolute:
                trial = framed(simulation, trial, mode)
            apart = float(np.sum((moved / prior) ** 2))
            cost = chi_square(simulation, trial, mode) + apart
        except BenchError:
            continue
        if cost < at.cost:
            change = less_means(columns.matrix @ (share * step), simulation, mode)
            linear = _square(simulation, left - change, mode) + apart
            return _Refined(trial, moved, cost, linear)
    return replace(at, predicted=-np.inf)


def chi_square(
    simulation: ReplaySimulation, assumed: NominalState, mode: ComparisonMode
) -> float:
    """Return the sum of squared residuals in sigmas; far ones count as 6 sigmas."""
    return _square(
        simulation, residual_of(simulation, simulation.see(assumed), mode), mode
    )


def _square(
    simulation: ReplaySimulation,
    residual: Float[np.ndarray, "rows readings"],
    mode: ComparisonMode,
) -> float:
    share = residual[mode.keep] / sigma_of(simulation, mode)
    good = np.isfinite(share)
    if not good.any():
        return 0.0
    scale = max(1.0, 1.4826 * float(np.median(np.abs(share[good]))))
    return float(np.sum(np.minimum(np.abs(share[good]), 6.0 * scale) ** 2))


def spring_errors(
    simulation: ReplaySimulation, found: Refinement
) -> Float[np.ndarray, " axes"]:
    """Return one sigma of the logarithm of each axis' compliance; 0 where it is rigid.

    Beside all that was refined: C = H⁻¹, H of the whitened Jacobian and the priors.
    Poses are what is independent: where they scatter more than their readings' noise
    says, it is the variance of H⁻¹ Σ g of their scores g (White 1982).
    """
    assumed, mode = found.assumed, found.mode
    seen = simulation.see(assumed)
    columns = _joint_jacobian(simulation, assumed, seen, mode, found.sensitivity)
    sigma, parameters = sigma_of(simulation, mode), len(columns.prior)
    white = (residual_of(simulation, seen, mode) / sigma)[mode.keep]
    shown = (less_means(columns.matrix, simulation, mode) / sigma[:, None])[mode.keep]
    good = np.isfinite(white) & np.isfinite(shown).all(axis=2)
    shown, white = np.where(good[..., None], shown, 0.0), np.where(good, white, 0.0)
    flat = np.reshape(shown, (-1, parameters))
    gram = flat.T @ flat + np.diag(columns.prior**-2.0)
    scale = 1.0 / np.sqrt(np.diag(gram))
    covariance = np.linalg.inv(gram * scale * scale[:, None]) * scale * scale[:, None]
    pose = np.unique(simulation.recording.posture_id[mode.keep], return_inverse=True)[1]
    score = np.zeros((pose.max() + 1, parameters))
    np.add.at(score, pose, np.einsum("rnp,rn->rp", shown, white))
    moved = score @ covariance
    variance = np.maximum(np.diag(covariance), np.sum(moved**2, axis=0))
    errors = np.zeros(len(assumed.rig.springs))
    errors[list(columns.axes)] = np.sqrt(variance[: len(columns.axes)])
    return errors


def with_effects(assumed: NominalState, effects: Sequence[Effect]) -> NominalState:
    """Return the assumption with other effects."""
    return replace(assumed, rig=replace(assumed.rig, effects=tuple(effects)))


def predicted(
    matrix: np.ndarray,
    prior: np.ndarray,
    seen: SimulatedReadings,
    simulation: ReplaySimulation,
    mode: ComparisonMode,
) -> Float[np.ndarray, "rows readings"]:
    """Return the residual of all rows after a fit to those kept, to first order."""
    step = solved(matrix, prior, residual_of(simulation, seen, mode), simulation, mode)
    every = replace(mode, keep=np.ones(len(mode.keep), dtype=bool))
    change = less_means(matrix @ step, simulation, every)
    return residual_of(simulation, seen, every) - change


def _is_mounted(effect: Effect) -> bool:
    return isinstance(effect, GravityLoad) and effect.where == "flange"
