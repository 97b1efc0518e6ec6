"""Hysteresis of a gear: friction holds back part of the wind-up after a reversal.

==========  ==========================================================================
Equation    θ = C τ - s(τ) w/2 z(u path), s the slope of the axis' wind-up over the
            slope at no torque, u = ∫ s dτ, 1 and τ for a linear spring; z in -1 … 1:
            sum over j = 1, 2, 3 of j z_j / 6, z_j = (u - P_j[u]) / r_j the stop beside
            the play P_j of half width r_j = j r / 3
Source      Visintin 1994, "Differential Models of Hysteresis", chapter III (play and
            stop); evenly spread slips: Iwan 1966, "A distributed-element model for
            hysteresis"; a stop is one Maxwell-slip element as a function of torque
Valid       slow loads; rate-independent; a gear that arrives with one of `MEMORIES`
Ignores     a single slip, other spreads and a rounded stop, dz = (1 - z sign(dτ)) dτ /
            r (Dahl 1968), its variants; ways that are not straight
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState
from stiffness.experiment.visits import (
    ALIKE,
    BEFORE,
    GRAVITY,
    NOTHING,
    carried_states,
    memories,
)

SPREAD = (1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Slips over the largest; chosen: three of an even spread."""


@dataclass(frozen=True)
class Hysteresis(Hypothesis):
    """Axis whose wind-up depends on the path of its torque."""

    effect: ClassVar[str] = "hysteresis"
    shape_names: ClassVar[tuple[str, ...]] = ("slip_nm", "memory")
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"width_rad": (0.0, 1e-2)}
    magnitudes: ClassVar[tuple[str, ...]] = ("width_rad",)
    size_of_variants: ClassVar[float | None] = -2.0

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if situation.steps.shape[1] < 3:
            return ()
        return situation.axes

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        largest = np.max(np.abs(situation.load_torque[:, situation.axis(where)]))
        slips = largest * np.array([0.03, 0.09, 0.22, 0.55])
        kept = memories(situation.recording.visit)
        return np.array([(slip, float(memory)) for memory in kept for slip in slips])

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        half = 0.5 * situation.softness_of(k)
        return turn(k, -half * spread_stop(situation, k, shape[0], round(shape[1])))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        slip, own = shape[0], round(shape[1])
        spread = [stop(situation, k, f * slip, own) for f in (0.3, 0.6, 1.0, 1.7)]
        others = [spread_stop(situation, k, slip, memory) for memory in ALIKE[own]]
        soft = [rounded(situation, k, f * slip, own) for f in (0.5, 1.0, 2.0)]
        slope = situation.softness_of(k)
        forms = [slope * law for law in (*spread, *others, *soft)]
        if k in situation.curved:  # friction in series with the spring, not beside it
            forms.append(spread_stop(situation, k, slip, own))
        return turn(k, *forms)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return {"width_rad": coefficients[0]}


def stop(
    situation: StaticState, axis: int, slip: float, memory: int = NOTHING
) -> Float[np.ndarray, " rows"]:
    """Return the stop operator of an axis' torque over each visit, in -1 … 1.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Half width of the play, in N m.
        memory: Its state at arrival, one of `MEMORIES`; gravity's is its middle.
    """

    def slipped(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        return np.clip(last + now - before, -slip, slip)

    if memory != BEFORE:
        state = _along_visits(situation, axis, memory == GRAVITY, slipped)
    else:
        state = _along_all(situation, axis, slip, slipped, is_stop=True)
    return state / max(slip, np.finfo(float).tiny)  # 0: never loaded


def spread_stop(
    situation: StaticState, axis: int, slip: float, memory: int = NOTHING
) -> Float[np.ndarray, " rows"]:
    """Return stops of evenly spread slips and equal stiffness together, in -1 … 1.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Largest half width of a play, in N m.
        memory: As in `stop`.
    """
    one = [share * stop(situation, axis, share * slip, memory) for share in SPREAD]
    return np.sum(one, axis=0) / sum(SPREAD)


def rounded(
    situation: StaticState, axis: int, slip: float, memory: int = NOTHING
) -> Float[np.ndarray, " rows"]:
    """Return Dahl's stop of an axis' torque over each visit, in -1 … 1.

    Exact for a torque that goes straight from reading to reading.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Torque over which the state follows a turn to 1 - 1/e, in N m.
        memory: As in `stop`.
    """

    def followed(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        change = now - before
        end = np.sign(change)
        return end + (last - end) * np.exp(-np.abs(change) / max(slip, 1e-300))

    if memory != BEFORE:
        return _along_visits(situation, axis, memory == GRAVITY, followed)
    return _along_all(situation, axis, 1.0, followed, is_stop=False)


Moved = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""New state from the old one and the torque before and now, in N m."""


def _along_visits(
    situation: StaticState, axis: int, at_rest: bool, moved: Moved
) -> Float[np.ndarray, " rows"]:
    """Propagate a state, from 0, along an axis' torque in each visit by itself.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        at_rest: Whether it is 0 at the first reading, not at no torque.
        moved: The law.
    """
    path = situation.wound(axis, situation.torque[situation.steps, axis])
    before = path[:, 0] if at_rest else np.zeros(len(path))
    return situation.from_steps(_states(path, before, np.zeros(len(path)), moved))


def _along_all(
    situation: StaticState, axis: int, bound: float, moved: Moved, is_stop: bool
) -> Float[np.ndarray, " rows"]:
    """Propagate a state, from 0, along an axis' torque in all visits and between them.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        bound: Of the state, either sign.
        moved: The law.
        is_stop: Whether it sums changes of torque between bounds.
    """
    within = situation.wound(axis, situation.torque[situation.steps, axis])
    way = situation.wound(axis, situation.way_torque[:, :, axis])
    path = np.hstack([way, within])
    before = np.concatenate([[0.0], within[:-1, -1]])
    least, most = (
        _states(path, before, np.full(len(path), start), moved)[:, -1]
        for start in (-bound, bound)
    )
    change = within[:, -1] - before if is_stop else None
    arrival = carried_states(least, most, bound, change)
    states = _states(path, before, arrival, moved)
    return situation.from_steps(states[:, way.shape[1] :])


def _states(
    path: Float[np.ndarray, "visits steps"],
    before: Float[np.ndarray, " visits"],
    last: Float[np.ndarray, " visits"],
    moved: Moved,
) -> Float[np.ndarray, "visits steps"]:
    """Return the state after each step of a path of torque, from one before it."""
    state = np.empty_like(path)
    for step in range(path.shape[1]):
        last = moved(last, before, path[:, step])
        before = path[:, step]
        state[:, step] = last
    return state
