"""Refinement of an effect's parameters in the simulator by Gauss-Newton steps.

==========  ==========================================================================
Equation    Gauss-Newton on silent parameters and the effects' own together; what a
            little more of an effect's parameter does is simulated, one by one
Source      finite differences, 2 % of each parameter
Valid       parameters that are near their best already
Ignores     numbers of elements, orders of a name: what is no size
==========  ==========================================================================
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from bench.effects.effect import Effect
from bench.effects.gravity_load import GravityLoad
from bench.effects.tabled_law import TabledLaw
from bench.proof.comparison import ComparisonMode, centred, residual_of, sigma_of
from bench.proof.nominal_fit import framed, simulated_jacobian, solved, stepped
from bench.proof.simulation import NominalState, ReplaySimulation, SimulatedReadings
from bench.shared.errors import BenchError

STEP = 0.02
"""Share of a parameter over which its effect is simulated; chosen: above a solver's
rounding, below a kink's reach."""
MAX_STEP = 0.5
"""Share by which a parameter may move in one step; chosen."""
ENOUGH = 2e-4
"""Share of the misfit below which another step gains nothing; chosen."""
BENT_BY = {"hysteresis": ("stiffening",), "lost_motion": ("closing_nm",)}
"""What bends a law's form and is no parameter of the vocabulary."""


@dataclass(frozen=True)
class RefinedParameter:
    """One number of one effect.

    Attributes:
        effect: Its place among the rig's effects.
        name: Of the field.
        size: By which it is measured.
    """

    effect: int
    name: str
    size: float


def refined_parameters(effects: Sequence[Effect]) -> tuple[RefinedParameter, ...]:
    """Return what may be moved: all sizes that are neither zero nor without end."""
    found = []
    for e, effect in enumerate(effects):
        if isinstance(effect, TabledLaw) or _is_mounted(effect):
            continue
        known = {f.name for f in fields(effect)} - {"where"}
        names = [name for name in effect.parameters() if name in known]
        for name in (*names, *BENT_BY.get(effect.name, ())):
            value = getattr(effect, name, None)
            if isinstance(value, float) and np.isfinite(value) and value != 0.0:
                found.append(RefinedParameter(e, name, abs(value)))
    return tuple(found)


def with_changed_parameters(
    effects: Sequence[Effect],
    parameters: Sequence[RefinedParameter],
    step: Float[np.ndarray, " knobs"],
) -> tuple[Effect, ...]:
    """Return effects whose knobs are turned by shares of their sizes."""
    changed = list(effects)
    for knob, share in zip(parameters, step, strict=True):
        effect = changed[knob.effect]
        value = getattr(effect, knob.name) + float(share) * knob.size
        least = effect.at_least.get(knob.name, -np.inf)
        changed[knob.effect] = replace(effect, **{knob.name: max(value, least)})
    return tuple(changed)


def sensitivity(
    world: ReplaySimulation,
    assumed: NominalState,
    parameters: Sequence[RefinedParameter],
) -> Float[np.ndarray, "rows readings knobs"]:
    """Return what a whole size more of each knob does, by small steps."""
    everything = ComparisonMode(True, 1.0, 1.0, np.ones(world.replay.rows, dtype=bool))
    before = residual_of(world, world.see(assumed), everything)
    found = np.zeros((*before.shape, len(parameters)))
    for i in range(len(parameters)):
        step = np.zeros(len(parameters))
        step[i] = STEP
        try:
            rig = with_effects(
                assumed, with_changed_parameters(assumed.rig.effects, parameters, step)
            )
            after = residual_of(world, world.see(rig), everything)
        except BenchError:  # at the edge of what can be built: left where it is
            continue
        found[..., i] = (before - after) / STEP
    return found


def refined(
    world: ReplaySimulation,
    assumed: NominalState,
    gauge: ComparisonMode,
    rounds: int = 4,
) -> tuple[NominalState, np.ndarray, tuple[RefinedParameter, ...]]:
    """Move springs, frames and effects to where the simulator agrees best.

    A step that makes the agreement worse is halved once, then given up. What a knob
    does is simulated once: laws hardly change as their parameters do.

    Returns:
        What is assumed now, what each knob does, and the knobs.
    """
    knobs = refined_parameters(assumed.rig.effects)
    slope = sensitivity(world, assumed, knobs)
    cost = robust_chi_square(world, assumed, gauge)
    for _ in range(rounds):
        seen = world.see(assumed)
        columns = simulated_jacobian(world, assumed, seen, gauge.absolute)
        matrix = np.concatenate([columns.matrix, slope], axis=2)
        prior = np.concatenate([columns.prior, np.ones(len(knobs))])
        left = residual_of(world, seen, gauge)
        step = solved(matrix, prior, left, world, gauge)
        n = columns.matrix.shape[2]
        for share in (1.0, 0.5):
            own = np.clip(share * step[n:], -MAX_STEP, MAX_STEP)
            try:
                trial = stepped(assumed, columns, share * step[:n])
                effects = with_changed_parameters(trial.rig.effects, knobs, own)
                trial = with_effects(trial, effects)
                if not gauge.absolute:
                    trial = framed(world, trial, gauge)
                after = robust_chi_square(world, trial, gauge)
            except BenchError:
                continue
            if after < cost:
                break
        else:
            break
        gained, assumed, cost = cost - after, trial, after
        if gained < ENOUGH * cost:
            break
    return assumed, slope, knobs


def robust_chi_square(
    world: ReplaySimulation, assumed: NominalState, gauge: ComparisonMode
) -> float:
    """Return the mean square of residuals in sigmas; far ones count as 6 sigmas."""
    left = residual_of(world, world.see(assumed), gauge)[gauge.keep]
    share = left / sigma_of(world, gauge)
    good = np.isfinite(share)
    if not good.any():
        return 0.0
    scale = max(1.0, 1.4826 * float(np.median(np.abs(share[good]))))
    return float(np.mean(np.minimum(np.abs(share[good]), 6.0 * scale) ** 2))


def with_effects(assumed: NominalState, effects: Sequence[Effect]) -> NominalState:
    """Return the assumption with other effects."""
    return replace(assumed, rig=replace(assumed.rig, effects=tuple(effects)))


def predicted(
    matrix: np.ndarray,
    prior: np.ndarray,
    seen: SimulatedReadings,
    world: ReplaySimulation,
    gauge: ComparisonMode,
) -> Float[np.ndarray, "rows readings"]:
    """Return what is left in all rows after a fit to those kept, to first order.

    Args:
        matrix: What one unit of each parameter does.
        prior: One sigma of each.
        seen: What was left before.
        world: The recording.
        gauge: Which rows are kept.
    """
    step = solved(matrix, prior, residual_of(world, seen, gauge), world, gauge)
    every = replace(gauge, keep=np.ones(len(gauge.keep), dtype=bool))
    change = matrix @ step
    if not gauge.absolute:
        change = centred(change, world.replay.visit, every.keep)
    return residual_of(world, seen, every) - change


def _is_mounted(effect: Effect) -> bool:
    return isinstance(effect, GravityLoad) and effect.where == "flange"
