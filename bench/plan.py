"""A plan is what an experiment will do: visit postures, and load the arm in each.

What to use when: `LoadStep` and `parse_path` say how one visit is loaded, `Plan` says
which postures are visited and what every row's time and load are, `repeated` goes back
to some of them, `mixed_pulleys` spreads the directions of pull over the visits.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from bench.errors import Unusable
from bench.load_path import (
    DEFAULT_PATH,
    HOLD,
    LoadStep,
    directions,
    parse_path,
    path_faults,
    stages,
)

__all__ = [
    "DEFAULT_PATH",
    "HOLD",
    "LoadStep",
    "Plan",
    "evenly_spaced",
    "mixed_pulleys",
    "parse_path",
    "repeated",
]

MOVE_TIME = 10.0  # s; chosen: a slow move and its settling
PULLEY_PLACES = 6  # chosen: a pull along each half-axis needs six
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class Plan:
    """Postures in the order they are visited, each loaded along the same path.

    Rows are readings, ordered by time: visit by visit, step by step.

    Attributes:
        name: What the experiment is called.
        posture: Axis angles that are commanded, in rad (slides in m).
        pose: Id of each posture; the same id again is the same posture again.
        pulley: Which pulley place guides the rope, counted from 0.
        path: What hangs on the hook, done in every visit; starts without a load.
        move_time: From the last reading of a visit to the arrival at the next, in s.

    Raises:
        Unusable: Where the arrays disagree or the path does not start unloaded; all
            faults at once.
    """

    name: str
    posture: Float[np.ndarray, "visits axes"]
    pose: Int[np.ndarray, " visits"]
    pulley: Int[np.ndarray, " visits"]
    path: tuple[LoadStep, ...] = DEFAULT_PATH
    move_time: float = MOVE_TIME

    def __post_init__(self):
        """Check that everything speaks of the same visits, naming every fault."""
        faults = path_faults(self.path)
        if self.posture.ndim != 2 or 0 in self.posture.shape:
            faults.append(
                f"posture has shape {self.posture.shape}, expected (visits, axes)."
            )
        elif not np.all(np.isfinite(self.posture)):
            rows = np.flatnonzero(~np.isfinite(self.posture).all(axis=1))
            faults.append(f"posture is not finite in visits {rows.tolist()}.")
        for name in ("pose", "pulley"):
            value, visits = getattr(self, name), self.posture.shape[:1]
            if value.shape != visits:
                faults.append(f"{name} has shape {value.shape}, expected {visits}.")
            elif not np.issubdtype(value.dtype, np.integer) or np.any(value < 0):
                faults.append(f"{name} must hold integers of at least 0.")
        if not (np.isfinite(self.move_time) and self.move_time >= 0):
            faults.append(f"move_time is {self.move_time} s, expected at least 0.")
        if not faults:
            _, first, which = np.unique(self.pose, True, True)
            moved = np.any(self.posture != self.posture[first[which]], axis=1)
            faults += [
                f"pose {pose} names two different postures; give each its own id."
                for pose in np.unique(self.pose[moved])
            ]
        if faults:
            raise Unusable(f"Plan {self.name!r}", faults)

    @property
    def visits(self) -> int:
        """How many times the arm stops in a posture."""
        return len(self.posture)

    @property
    def rows(self) -> int:
        """How many readings there will be."""
        return self.visits * len(self.path)

    @property
    def row_visit(self) -> Int[np.ndarray, " rows"]:
        """The visit of each row, counted from 0."""
        return np.repeat(np.arange(self.visits), len(self.path))

    @property
    def row_mass(self) -> Float[np.ndarray, " rows"]:
        """What hangs on the hook in each row, in kg."""
        return np.tile([step.mass for step in self.path], self.visits)

    @property
    def row_direction(self) -> Float[np.ndarray, " rows"]:
        """+1 in rows whose load last grew, -1 where it last fell."""
        return np.tile(directions(self.path), self.visits)

    @property
    def time(self) -> Float[np.ndarray, " rows"]:
        """When each row is read, in s since the arrival at the first posture.

        The load changes right after the row before and hangs for the step's hold.
        """
        return self._clock(np.cumsum([step.hold for step in self.path]))

    @property
    def load_time(self) -> Float[np.ndarray, " rows"]:
        """When the load of each row last changed, in s since the first arrival.

        Arrival at a posture counts, for the arm's weight then acts in another way; a
        step with the mass of the step before does not.
        """
        changed, now, mass = [], 0.0, None
        for step in self.path:
            changed.append(now if step.mass != mass else changed[-1])
            now, mass = now + step.hold, step.mass
        return self._clock(np.array(changed))

    @property
    def stage(self) -> np.ndarray:
        """One of `bench.recording.STAGES` for each row, as `load_path.stages` says."""
        return np.tile(stages(self.path), self.visits)

    def _clock(self, since_arrival: np.ndarray) -> Float[np.ndarray, " rows"]:
        """Return times, in s, of moments that every visit has in common."""
        lasts = sum(step.hold for step in self.path) + self.move_time
        return (np.arange(self.visits)[:, None] * lasts + since_arrival).ravel()


def repeated(plan: Plan, count: int) -> Plan:
    """Return the plan with some postures visited again after all others.

    What differs between two visits of a pose is noise and nothing else: posture, pulley
    and path are the same.

    Args:
        plan: What is done first.
        count: How many visits are repeated, evenly spaced over the plan; at most all.

    Raises:
        Unusable: Where count is below 0 or above the number of visits.
    """
    if not 0 <= count <= plan.visits:
        fault = f"{count} visits to repeat, expected 0 to {plan.visits}."
        raise Unusable(f"Plan {plan.name!r}", [fault])
    again = evenly_spaced(plan.visits, count)
    order = np.concatenate([np.arange(plan.visits), again])
    return replace(
        plan,
        posture=plan.posture[order],
        pose=plan.pose[order],
        pulley=plan.pulley[order],
    )


def evenly_spaced(total: int, count: int) -> Int[np.ndarray, " count"]:
    """Return count different indices below total, in order; both ends from two on."""
    return np.rint(np.linspace(0, max(total - 1, 0), count)).astype(int)


def mixed_pulleys(
    visits: int, places: int = PULLEY_PLACES
) -> Int[np.ndarray, " visits"]:
    """Return a pulley place for each visit that follows no grid of postures.

    place = floor(places * frac(visit * golden ratio)): all places come equally often,
    and no period of the postures is a period of the places (Weyl 1916, "Über die
    Gleichverteilung von Zahlen mod. Eins").

    Raises:
        Unusable: Where there is no place.
    """
    if places < 1:
        raise Unusable("Pulley places", [f"{places} places, expected at least 1."])
    return np.floor(places * np.mod(np.arange(visits) * GOLDEN, 1.0)).astype(int)
