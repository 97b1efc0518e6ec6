"""Creep of a gear: wind-up that grows with the time under load.

==========  ==========================================================================
Equation    T dx/dt = τ(t) - x, at arrival x = 0, or gravity's torque where the arm has
            settled under it; θ = C τ + ratio C x
Source      standard linear solid: Zener 1948, "Elasticity and anelasticity of metals"
Valid       loads that are constant from `load_time` on, until the next row's
            `load_time`; an arm that comes to its posture without memory except of
            gravity
Ignores     faster and slower relaxation times (its variants); creep remaining from the
            posture before
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, sprung
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState

FASTEST, SLOWEST = 0.25, 4.0
"""T over the shortest wait and over the longest visit; chosen: beyond them creep mimics
the axis' own spring, or a straight line in time."""


@dataclass(frozen=True)
class Creep(Hypothesis):
    """Axis whose wind-up follows its torque partly at once and partly with a delay."""

    effect: ClassVar[str] = "creep"
    shape_names: ClassVar[tuple[str, ...]] = ("time_s", "settled")
    logarithmic: ClassVar[tuple[str, ...]] = ("time_s",)
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
    def shapes(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        recording, steps = situation.recording, situation.steps
        stands = waits(situation)
        visit = recording.time[steps[:, -1]] - recording.load_time[steps[:, 0]]
        low, high = FASTEST * stands[stands > 0.0].min(), SLOWEST * visit.max()
        times = np.geomspace(low, high, 4)
        return np.array([(time, settled) for settled in (0.0, 1.0) for time in times])

    @override
    def jacobian(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        k = situation.axis(where)
        return turn(k, followed(situation, k, shape[0], bool(shape[1])))

    @override
    def variants(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        k = situation.axis(where)
        time, settled = shape[0], bool(shape[1])
        beside = [followed(situation, k, f * time, settled) for f in (1 / 3, 3.0)]
        return turn(k, *beside, followed(situation, k, time, not settled))

    @override
    def parameters(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        compliance = situation.compliance[situation.axis(where)]
        return {"ratio": coefficients[0] / compliance, "time_s": shape[0]}


def waits(situation: StaticState) -> Float[np.ndarray, " rows"]:
    """Return the time since each row's last change of load, in s."""
    return situation.recording.time - situation.recording.load_time


def followed(
    situation: StaticState, axis: int, time_constant: float, settled: bool = False
) -> Float[np.ndarray, " rows"]:
    """Return the low-pass filtered torque of a creeping element, in N m, by reading.

    Exact for a torque that changes in steps: gravity comes with the arrival, which is
    the first `load_time` of a visit, and each load at its own.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        time_constant: T, in s.
        settled: Whether creep under gravity had ended before the arrival.
    """
    recording, steps = situation.recording, situation.steps
    torque = situation.torque[steps, axis]  # (visits, longest) N m
    read, changed = recording.time[steps], recording.load_time[steps]
    state = np.empty_like(torque)
    now, last, before = np.zeros(len(steps)), changed[:, 0], torque[:, 0]
    if settled:
        now = before - situation.load_torque[steps[:, 0], axis]
    for step in range(torque.shape[1]):
        change = np.clip(changed[:, step], last, read[:, step])
        now = before + (now - before) * np.exp((last - change) / time_constant)
        before, last = torque[:, step], read[:, step]
        now = before + (now - before) * np.exp((change - last) / time_constant)
        state[:, step] = now
    return situation.from_steps(state)
