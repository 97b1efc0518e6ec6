"""Hysteresis of a gear: friction holds back part of the wind-up after a reversal.

==========  ==========================================================================
Equation    θ = C τ - s(τ) w/2 z(τ path), s the slope of the axis' wind-up over the
            slope at no torque, 1 for a linear spring; z in -1 … 1: the play operator's
            distance from its middle, z = (τ - P[τ]) / r, P the play of half width r
Source      Visintin 1994, "Differential Models of Hysteresis", chapter III (play and
            stop); the stop z is one Maxwell-slip element as a function of torque
Valid       slow loads; rate-independent; an arm whose torque grew from zero to its
            first reading, or whose gears came to rest there (`settled`)
Ignores     the spread of several slipping elements and a rounded stop, dz = (1 - z
            sign(dτ)) dτ / r (Dahl 1968), its variants; wind-up remaining from the way
            to the posture
==========  ==========================================================================
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class Hysteresis(Hypothesis):
    """Axis whose wind-up depends on the path of its torque."""

    effect: ClassVar[str] = "hysteresis"
    shape_names: ClassVar[tuple[str, ...]] = ("slip_nm", "settled")
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"width_rad": (0.0, 1e-2)}
    magnitudes: ClassVar[tuple[str, ...]] = ("width_rad",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if situation.steps.shape[1] < 3:
            return ()
        return situation.axes

    @override
    def shapes(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        largest = np.max(np.abs(situation.load_torque[:, situation.axis(where)]))
        slips = largest * np.array([0.03, 0.1, 0.25, 0.6])
        return np.array([(slip, settled) for settled in (0.0, 1.0) for slip in slips])

    @override
    def jacobian(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        k = situation.axis(where)
        half = 0.5 * situation.softness_of(k)
        return turn(k, -half * stop(situation, k, shape[0], bool(shape[1])))

    @override
    def variants(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
    ) -> EffectJacobian:
        k = situation.axis(where)
        slip, settled = shape[0], bool(shape[1])
        spread = [stop(situation, k, f * slip, settled) for f in (0.3, 0.6, 1.7, 3.0)]
        other = stop(situation, k, slip, not settled)
        soft = [rounded(situation, k, f * slip, settled) for f in (0.5, 1.0, 2.0)]
        slope = situation.softness_of(k)
        return turn(k, *(slope * law for law in (*spread, other, *soft)))

    @override
    def parameters(
        self,
        situation: StaticState,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        return {"width_rad": coefficients[0]}


def stop(
    situation: StaticState, axis: int, slip: float, settled: bool = False
) -> Float[np.ndarray, " rows"]:
    """Return the stop operator of an axis' torque over each visit, in -1 … 1.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Half width of the play, in N m.
        settled: Whether it starts from its middle at the first reading of a visit; else
            torque has grown from zero to there.
    """

    def slipped(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        return np.clip(last + now - before, -slip, slip)

    state = _along_visits(situation, axis, settled, slipped)
    return state / max(slip, np.finfo(float).tiny)  # 0: never loaded


def rounded(
    situation: StaticState, axis: int, slip: float, settled: bool = False
) -> Float[np.ndarray, " rows"]:
    """Return Dahl's stop of an axis' torque over each visit, in -1 … 1.

    Exact for a torque that goes straight from reading to reading.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Torque over which the state follows a turn to 1 - 1/e, in N m.
        settled: As in `stop`.
    """

    def followed(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        change = now - before
        end = np.sign(change)
        return end + (last - end) * np.exp(-np.abs(change) / max(slip, 1e-300))

    return _along_visits(situation, axis, settled, followed)


def _along_visits(
    situation: StaticState,
    axis: int,
    settled: bool,
    moved: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
) -> Float[np.ndarray, " rows"]:
    """Propagate a state, from 0, along an axis' torque in each visit.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        settled: As in `stop`.
        moved: New state from the old one and the torque before and now, in N m.
    """
    path = situation.torque[situation.steps, axis]  # (visits, longest) N m
    state = np.empty_like(path)
    last = np.zeros(len(path))
    before = path[:, 0] if settled else np.zeros(len(path))
    for step in range(path.shape[1]):
        last = moved(last, before, path[:, step])
        before = path[:, step]
        state[:, step] = last
    return situation.from_steps(state)
