"""Hysteresis of a gear: friction holds back part of the wind-up after a reversal.

==========  ==========================================================================
Equation    θ = C τ - s w/2 z(u path), s the mean slope of the axis' wind-up between
            the gear's torque and its spring's over the slope at no torque, u = θ / C +
            (w/2) z / C, how far the gear winds up and what friction holds back: τ for a
            linear spring, ∫ s dτ where w is not known yet; z in -1 … 1: sum over j =
            1, 2, 3 of j z_j / 6, z_j = (u - P_j[u]) / r_j the stop beside the play P_j
            of half width r_j = j r / 3; of its gear's torque it carries (w/2) z / C,
            and τ is what other laws beside the spring leave of it
Source      Visintin 1994, "Differential Models of Hysteresis", chapter III (play and
            stop); evenly spread slips: Iwan 1966, "A distributed-element model for
            hysteresis"; a stop is one Maxwell-slip element as a function of torque
Valid       slow loads; rate-independent; a gear that arrives with one of `MEMORIES`,
            or in another state at each visit
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
from stiffness.experiment.static_state import LINEAR, StaticState
from stiffness.experiment.visits import (
    ALIKE,
    BEFORE,
    GRAVITY,
    NOTHING,
    UNKNOWN,
    carried_states,
    memories,
)

SPREAD = (1.0 / 3.0, 2.0 / 3.0, 1.0)
"""Slips over the largest; chosen: three of an even spread."""
SLIPS, ENDS = (0.09, 0.22, 0.55), (0.03, 1.4)
"""Largest slip over the axis' largest torque by a load; chosen: of a stop that no load
makes slip as a whole, the smaller ones still do. At the ends with `NOTHING` alone: the
first slips at once however it arrived, and the last hardly ever."""
STARTS = np.array([-1.0, 0.0, 1.0])
"""States at arrival over their bound, as likely one as the other, where nothing tells
the state; chosen: a gear comes from either side or from rest."""


@dataclass(frozen=True)
class Hysteresis(Hypothesis):
    """Axis whose wind-up depends on the path of its torque."""

    effect: ClassVar[str] = "hysteresis"
    sized_by: ClassVar[str] = "width_rad"
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
        gear = situation.gears.get(situation.axis(where), LINEAR)
        if gear.unknown is not None:
            every = [(slip, UNKNOWN) for slip in (*SLIPS, *ENDS)]
            return np.array(every, dtype=float) * [largest, 1.0]
        kept = memories(situation.recording.visit)
        shapes = [(slip, memory) for memory in kept for slip in SLIPS]
        shapes += [(slip, NOTHING) for slip in ENDS]
        return np.array(shapes, dtype=float) * [largest, 1.0]

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
        spread = _stops(situation, k, np.array([0.3, 0.6, 1.0, 1.7]) * slip, own)
        others = [spread_stop(situation, k, slip, memory) for memory in ALIKE[own]]
        soft = [rounded(situation, k, f * slip, own) for f in (0.5, 1.0, 2.0)]
        slope = situation.softness_of(k)
        forms = [slope * law for law in (*spread, *others, *soft)]
        if situation.is_curved(k):  # friction in series with the spring, not beside it
            forms.append(spread_stop(situation, k, slip, own))
        return turn(k, *forms)

    @override
    def arrival_turns(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, np.ndarray]:
        k, slips = situation.axis(where), np.array(SPREAD) * shape[0]
        stops = _from_any_state(situation, k, slips, slipped(slips))
        law = np.sum(stops, axis=1) / np.sum(slips)
        half = 0.5 * coefficients[0] * situation.softness_of(k)
        away = half * (law - law.mean(axis=0)) / np.sqrt(len(STARTS))
        return {k: away.T}

    @override
    def parallel_torque(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[int, np.ndarray]:
        k = situation.axis(where)
        compliance = situation.unloaded_compliance(k)
        if compliance <= 0.0:
            return {}
        half = 0.5 * coefficients[0] / compliance
        return {k: half * spread_stop(situation, k, shape[0], round(shape[1]))}


def spread_stop(
    situation: StaticState, axis: int, slip: float, memory: int = NOTHING
) -> Float[np.ndarray, " rows"]:
    """Return stops of evenly spread slips and equal stiffness together, in -1 … 1.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Largest half width of a play, in N m.
        memory: Their state at arrival, one of `MEMORIES`, of which gravity's is their
            middle, or UNKNOWN.
    """
    share = np.array(SPREAD)
    one = share[:, None] * _stops(situation, axis, share * slip, memory)
    return np.sum(one, axis=0) / sum(SPREAD)


def along_visits(
    situation: StaticState,
    values: Float[np.ndarray, " rows"],
    moved: "Moved",
    laws: int,
    carries: bool = False,
) -> Float[np.ndarray, "rows laws"]:
    """Return states that follow any value over each visit, from 0 at its first row.

    Args:
        situation: With the order of rows.
        values: What is followed.
        moved: How states follow it.
        laws: How many there are.
        carries: Whether each visit begins with the state that the one before left.
    """
    path = values[situation.steps].reshape(1 if carries else len(situation.steps), -1)
    found = _states(path, path[:, 0], np.zeros((laws, len(path))), moved)
    law = np.moveaxis(found, 0, -1).reshape(laws, *situation.steps.shape)
    return np.stack([situation.from_steps(one) for one in law], axis=1)


def _stops(
    situation: StaticState, axis: int, slips: Float[np.ndarray, " slips"], memory: int
) -> Float[np.ndarray, "slips rows"]:
    """Return the stop operators of several slips, each in -1 … 1."""
    state = _along(situation, axis, slips, slipped(slips), memory, is_stop=True)
    return state / np.maximum(slips[:, None], np.finfo(float).tiny)  # 0: never loaded


def slipped(slips: Float[np.ndarray, " slips"]) -> "Moved":
    """Return how stops of some slips follow a torque, all in N m."""
    high = slips[:, None]

    def moved(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        return np.minimum(np.maximum(last + now - before, -high), high)

    return moved


def rounded(
    situation: StaticState, axis: int, slip: float, memory: int = NOTHING
) -> Float[np.ndarray, " rows"]:
    """Return Dahl's stop of an axis' torque over each visit, in -1 … 1.

    Exact for a torque that goes straight from reading to reading.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        slip: Torque over which the state follows a turn to 1 - 1/e, in N m.
        memory: As in `spread_stop`.
    """

    def followed(last: np.ndarray, before: np.ndarray, now: np.ndarray) -> np.ndarray:
        change = now - before
        end = np.sign(change)
        return end + (last - end) * np.exp(-np.abs(change) / max(slip, 1e-300))

    return _along(situation, axis, np.ones(1), followed, memory, is_stop=False)[0]


Moved = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""New state from the old one and the torque before and now, in N m."""


def _along(
    situation: StaticState,
    axis: int,
    bounds: Float[np.ndarray, " laws"],
    moved: Moved,
    memory: int,
    is_stop: bool,
) -> Float[np.ndarray, "laws rows"]:
    """Propagate states, from 0, along an axis' torque.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        bounds: Of the state of each law, either sign.
        moved: The laws, one a row.
        memory: BEFORE: through all visits and the ways between them; else along each
            visit by itself, and 0 at its first reading for GRAVITY, at no torque for
            NOTHING, the mean over `STARTS` for UNKNOWN.
        is_stop: Whether they sum changes of torque between bounds.
    """
    if memory == UNKNOWN:
        return _from_any_state(situation, axis, bounds, moved).mean(axis=0)
    carries = memory == BEFORE
    key = ("path", axis, carries)
    path = situation.once(key, lambda: _path(situation, axis, carries))
    start, skipped = np.zeros((len(bounds), len(path))), 0
    if carries:
        before = np.concatenate([[0.0], path[:-1, -1]])
        change = path[:, -1] - before if is_stop else None
        way = situation.once(
            ("way", axis),
            lambda: situation.wound(axis, situation.way_torque[:, :, axis]),
        )
        path, skipped = np.hstack([way, path]), way.shape[1]
        either = np.array([-1.0, 1.0])[:, None, None] * bounds[:, None]
        least, most = _states(path, before, start + either, moved)[-1]
        ends = zip(least, most, bounds, strict=True)
        start = np.stack([carried_states(*end, change) for end in ends])
    else:
        before = path[:, 0] if memory == GRAVITY else np.zeros(len(path))
    states = _states(path, before, start, moved)[skipped:]
    return np.stack([situation.from_steps(states[:, k].T) for k in range(len(bounds))])


def _from_any_state(
    situation: StaticState, axis: int, bounds: Float[np.ndarray, " laws"], moved: Moved
) -> Float[np.ndarray, "starts laws rows"]:
    """Return the states along each visit from each of `STARTS` at its first reading."""
    key = ("path", axis, False)
    path = situation.once(key, lambda: _path(situation, axis, carries=False))
    start = STARTS[:, None, None] * bounds[:, None] + np.zeros(len(path))
    states = np.moveaxis(np.array(_states(path, path[:, 0], start, moved)), 0, -1)
    return np.array([[situation.from_steps(law) for law in one] for one in states])


def _path(
    situation: StaticState, axis: int, carries: bool
) -> Float[np.ndarray, "visits steps"]:
    """Return the torque that an axis' play follows through each visit.

    Args:
        situation: With the torque and the order of rows.
        axis: Its index, counted from 0.
        carries: Whether the play remembers the visits before.
    """
    law = (Hysteresis.effect, situation.axes[axis])
    beside = situation.gears.get(axis, LINEAR).parallel.get(law)
    if beside is None or carries:  # of a way between visits it is unknown
        torque = situation.spring_torque(axis, law)
        return situation.wound(axis, torque[situation.steps])
    torque = situation.spring_torque(axis)
    return (situation.wound(axis, torque) + beside)[situation.steps]


def _states(
    path: Float[np.ndarray, "visits steps"],
    before: Float[np.ndarray, " visits"],
    last: Float[np.ndarray, "*laws visits"],
    moved: Moved,
) -> Float[np.ndarray, "steps *laws visits"]:
    """Return the states after each step of a path of torque, from those before it."""
    states = []
    for now in path.T:
        last = moved(last, before, now)
        before = now
        states.append(last)
    return np.array(states)
