"""Creep of a gear: wind-up that grows with the time under load.

==========  ==========================================================================
Equation    T dx/dt = τ(t) - x; at arrival x is 0, or gravity's torque where the arm has
            come to rest under it, or what the visit before and the way left
            (`MEMORIES`); θ = C τ + ratio C x, C of the spring at no torque
Source      standard linear solid: Zener 1948, "Elasticity and anelasticity of metals"
Valid       loads that are constant from `load_time` on, until the next row's
            `load_time`; a way that begins at the last reading and ends at the first
            `load_time` of the next visit
Ignores     faster and slower relaxation times (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes, sprung
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

FASTEST, SLOWEST = 0.25, 4.0
"""T over the shortest wait and over the longest visit; chosen: beyond them creep mimics
the axis' own spring, or a straight line in time."""


@dataclass(frozen=True)
class Creep(Hypothesis):
    """Axis whose wind-up follows its torque partly at once and partly with a delay."""

    effect: ClassVar[str] = "creep"
    sized_by: ClassVar[str] = "ratio"
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 0.0}
    shape_names: ClassVar[tuple[str, ...]] = ("time_s", "memory")
    logarithmic: ClassVar[tuple[str, ...]] = ("time_s",)
    size_of_variants: ClassVar[float | None] = 1.0
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "ratio": (0.0, 2.0),
        "time_s": (0.0, np.inf),
    }

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if situation.steps.shape[1] < 2 or not np.any(waits(situation) > 0.0):
            return ()
        return sprung(situation)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        recording, steps = situation.recording, situation.steps
        stands = waits(situation)
        visit = recording.time[steps[:, -1]] - recording.load_time[steps[:, 0]]
        low, high = FASTEST * stands[stands > 0.0].min(), SLOWEST * visit.max()
        times = np.geomspace(low, high, 4)
        kept = memories(recording.visit)
        return np.array([(time, float(memory)) for memory in kept for time in times])

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        return turn(k, followed(situation, k, shape[0], round(shape[1])))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        time, own = shape[0], round(shape[1])
        beside = [followed(situation, k, f * time, own) for f in (1 / 3, 3.0)]
        others = [followed(situation, k, time, memory) for memory in ALIKE[own]]
        return turn(k, *beside, *others)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        compliance = situation.unloaded_compliance(situation.axis(where))
        return {"ratio": coefficients[0] / compliance, "time_s": shape[0]}


def waits(situation: StaticState) -> Float[np.ndarray, " rows"]:
    """Return the time since each row's last change of load, in s."""
    return situation.recording.time - situation.recording.load_time


def followed(
    situation: StaticState, axis: int, time_constant: float, memory: int = NOTHING
) -> Float[np.ndarray, " rows"]:
    """Return the low-pass filtered torque of a creeping element, in N m, by reading.

    Exact for a torque that changes in steps: gravity comes with the arrival, which is
    the first `load_time` of a visit, and each load at its own.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        time_constant: T, in s.
        memory: Its state at arrival, one of `MEMORIES`.
    """
    steps = situation.steps
    gravity = situation.torque[steps[:, 0], axis]
    gravity = gravity - situation.load_torque[steps[:, 0], axis]
    start = np.zeros(len(steps))
    if memory == GRAVITY:
        start = gravity
    elif memory == BEFORE:
        start = _from_before(situation, axis, time_constant)
    return situation.from_steps(_states(situation, axis, time_constant, start))


def _from_before(
    situation: StaticState, axis: int, time_constant: float
) -> Float[np.ndarray, " visits"]:
    """Return the state at each arrival that all visits before and their ways left."""
    recording, steps = situation.recording, situation.steps
    way = situation.way_torque[:, :, axis]
    arrival = recording.load_time[steps[:, 0]]
    move = np.diff(arrival, prepend=arrival[0])
    move[1:] = np.maximum(arrival[1:] - recording.time[steps[:-1, -1]], 0.0)
    share = move[1:] / time_constant / (way.shape[1] - 1)  # of T, from point to point
    kept = np.exp(-share)
    lag = np.divide(-np.expm1(-share), share, out=np.ones_like(share), where=share > 0)
    bound = max(float(np.max(np.abs(situation.torque[:, axis]))), 1e-30)

    def ends(start: float) -> np.ndarray:
        """Return the state at the next arrival of visits that begin alike."""
        now = _states(situation, axis, time_constant, np.full(len(steps), start))
        last = now[:-1, -1]
        for old, new in pairwise(way[1:].T):  # torque changes evenly between points
            last = new + (last - old) * kept - (new - old) * lag
        return np.append(last, 0.0)  # none after the last

    return carried_states(ends(-bound), ends(bound), bound)


def _states(
    situation: StaticState,
    axis: int,
    time_constant: float,
    now: Float[np.ndarray, " visits"],
) -> Float[np.ndarray, "visits longest"]:
    """Return the state at each reading of all visits, from that at their arrival."""
    recording, steps = situation.recording, situation.steps
    torque = situation.torque[steps, axis]  # (visits, longest) N m
    read, changed = recording.time[steps], recording.load_time[steps]
    state = np.empty_like(torque)
    last, before = changed[:, 0], torque[:, 0]
    for step in range(torque.shape[1]):
        change = np.minimum(np.maximum(changed[:, step], last), read[:, step])
        now = before + (now - before) * np.exp((last - change) / time_constant)
        before, last = torque[:, step], read[:, step]
        now = before + (now - before) * np.exp((change - last) / time_constant)
        state[:, step] = now
    return state
