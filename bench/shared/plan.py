"""Plan of an experiment: configurations, load paths and pulleys, with durations.

What to use when: `LoadStep` and `parse_path` define the loads of one visit, `Plan` the
postures to visit, with every row's time and load; `repeated` adds repeated visits, and
`mixed_pulleys` distributes the directions of the rope's force over the visits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from bench.shared.errors import Unusable, refuse
from bench.shared.recording import LOADED, LOADING, UNLOADED, UNLOADING

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


# --- Load path ------------------------------------------------------------------------

HOLD = 20.0  # s; chosen: creep of a minute is under way, instruments have settled
DWELL = 120.0  # s; chosen: longer than the fast part of a gear's after-effect


@dataclass(frozen=True)
class LoadStep:
    """A mass on the hook, and how long it hangs before the reading.

    Attributes:
        mass: In kg; what hung before is replaced, not added to.
        hold: From the change of load to the reading, in s.

    Raises:
        Unusable: Where either is negative or not finite.
    """

    mass: float
    hold: float = HOLD

    def __post_init__(self):
        """Check the mass and the time, naming every fault."""
        faults = [
            f"{name} is {value} {unit}, expected a finite number of at least 0."
            for name, value, unit in (
                ("mass", self.mass, "kg"),
                ("hold", self.hold, "s"),
            )
            if not (np.isfinite(value) and value >= 0)
        ]
        refuse("Load step", faults)


DEFAULT_PATH = (
    *(LoadStep(mass) for mass in (0.0, 2.5, 5.0, 7.5, 10.0)),
    LoadStep(10.0, DWELL),
    *(LoadStep(mass) for mass in (5.0, 2.5, 0.0)),
)
"""Up to the arm's payload of 10 kg, a long wait that shows creep, and down again.

The payload is the paper's (Wu et al. 2024, section 3.1); the nine steps are chosen: it
does not give its own. Up and down pass the same masses, so that history shows.
"""


def parse_path(text: str, hold: float = HOLD) -> tuple[LoadStep, ...]:
    """Read a load path such as `0,5,10,10@120,5,0`.

    Args:
        text: Masses in kg, separated by commas; `mass@seconds` has its own hold.
        hold: Of the steps that give none, in s.

    Raises:
        Unusable: Naming every step that is not a mass, and a loaded start.
    """
    steps, faults = [], []
    for number, item in enumerate(text.split(","), start=1):
        mass, _, seconds = item.partition("@")
        try:
            steps.append(LoadStep(float(mass), float(seconds) if seconds else hold))
        except ValueError:
            faults.append(
                f"step {number} is {item.strip()!r}, expected a mass in kg or "
                "mass@seconds, such as 5 or 10@120."
            )
        except Unusable as error:
            faults += [f"step {number}: {fault}" for fault in error.faults]
    if faults := faults or path_faults(steps):
        raise Unusable(f"Load path {text!r}", faults)
    return tuple(steps)


def stages(path: Sequence[LoadStep]) -> np.ndarray:
    """Return one of `bench.shared.recording.STAGES` for each step.

    No mass: unloaded. The path's largest mass: loaded. Between them the last change
    decides: a mass put on is loading, one taken off is unloading.
    """
    largest = max(step.mass for step in path)
    found, mass = [], 0.0
    for step in path:
        if step.mass == 0.0:
            found.append(UNLOADED)
        elif step.mass == largest:
            found.append(LOADED)
        elif step.mass == mass:
            found.append(found[-1])
        else:
            found.append(LOADING if step.mass > mass else UNLOADING)
        mass = step.mass
    return np.array(found)


def path_faults(path: Sequence[LoadStep]) -> list[str]:
    """Return what is wrong with a path as a whole."""
    if not path:
        return ["the path has no step; start with 0 kg, the unloaded reading."]
    if path[0].mass != 0.0:
        return [
            f"the path starts with {path[0].mass:g} kg; start with 0 kg, the unloaded "
            "reading that deflections are measured from."
        ]
    return []


def directions(path: tuple[LoadStep, ...]) -> Float[np.ndarray, " steps"]:
    """Return +1 for each step whose load last grew, -1 where it last fell."""
    change = np.sign(np.diff([step.mass for step in path], prepend=0.0))
    last = np.maximum.accumulate(np.where(change != 0, np.arange(len(change)), 0))
    return np.where(change[last] < 0, -1.0, 1.0)


# --- Plan -----------------------------------------------------------------------------

MOVE_TIME = 10.0  # s; chosen: a slow move and its settling
PULLEY_PLACES = 6  # chosen: a pull along each half-axis needs six
GOLDEN = (np.sqrt(5.0) - 1.0) / 2.0


@dataclass(frozen=True)
class Plan:
    """Postures in the order they are visited, each loaded along the same path.

    Rows are readings, ordered by time: visit by visit, step by step.

    Attributes:
        posture: Axis angles that are commanded, in rad (slides in m).
        posture_id: Id of each posture; the same id again is the same posture again.
        pulley: Index of the pulley place that guides the rope, from 0.
        path: Masses on the hook, the same in every visit; starts without a load.
        move_time: From the last reading of a visit to the arrival at the next, in s.

    Raises:
        Unusable: Where the arrays disagree or the path does not start unloaded; all
            faults at once.
    """

    name: str
    posture: Float[np.ndarray, "visits axes"]
    posture_id: Int[np.ndarray, " visits"]
    pulley: Int[np.ndarray, " visits"]
    path: tuple[LoadStep, ...] = DEFAULT_PATH
    move_time: float = MOVE_TIME

    def __post_init__(self):
        """Check that all arrays have the same visits, naming every fault."""
        faults = path_faults(self.path)
        if self.posture.ndim != 2 or 0 in self.posture.shape:
            faults.append(
                f"posture has shape {self.posture.shape}, expected (visits, axes)."
            )
        elif not np.all(np.isfinite(self.posture)):
            rows = np.flatnonzero(~np.isfinite(self.posture).all(axis=1))
            faults.append(f"posture is not finite in visits {rows.tolist()}.")
        for name in ("posture_id", "pulley"):
            value, visits = getattr(self, name), self.posture.shape[:1]
            if value.shape != visits:
                faults.append(f"{name} has shape {value.shape}, expected {visits}.")
            elif not np.issubdtype(value.dtype, np.integer) or np.any(value < 0):
                faults.append(f"{name} must hold integers of at least 0.")
        if not (np.isfinite(self.move_time) and self.move_time >= 0):
            faults.append(f"move_time is {self.move_time} s, expected at least 0.")
        if not faults:
            _, first, which = np.unique(self.posture_id, True, True)
            moved = np.any(self.posture != self.posture[first[which]], axis=1)
            faults += [
                f"pose {pose} names two different postures; give each its own id."
                for pose in np.unique(self.posture_id[moved])
            ]
        refuse(f"Plan {self.name!r}", faults)

    @property
    def visits(self) -> int:
        """Number of visits."""
        return len(self.posture)

    @property
    def rows(self) -> int:
        """Number of readings."""
        return self.visits * len(self.path)

    @property
    def row_visit(self) -> Int[np.ndarray, " rows"]:
        """The visit of each row, counted from 0."""
        return np.repeat(np.arange(self.visits), len(self.path))

    @property
    def row_mass(self) -> Float[np.ndarray, " rows"]:
        """Mass on the hook in each row, in kg."""
        return np.tile([step.mass for step in self.path], self.visits)

    @property
    def row_direction(self) -> Float[np.ndarray, " rows"]:
        """+1 in rows whose load last grew, -1 where it last fell."""
        return np.tile(directions(self.path), self.visits)

    @property
    def time(self) -> Float[np.ndarray, " rows"]:
        """Time of each row's reading, in s since the arrival at the first posture.

        The load changes right after the row before and hangs for the step's hold.
        """
        return self._clock(np.cumsum([step.hold for step in self.path]))

    @property
    def load_time(self) -> Float[np.ndarray, " rows"]:
        """Time of the last change of load of each row, in s since the first arrival.

        Arrival at a posture counts, since it changes the torques of the arm's weight; a
        step with the mass of the step before does not.
        """
        changed, now, mass = [], 0.0, None
        for step in self.path:
            changed.append(now if step.mass != mass else changed[-1])
            now, mass = now + step.hold, step.mass
        return self._clock(np.array(changed))

    @property
    def stage(self) -> np.ndarray:
        """Stage of each row, one of `bench.shared.recording.STAGES`; see `stages`."""
        return np.tile(stages(self.path), self.visits)

    def _clock(self, since_arrival: np.ndarray) -> Float[np.ndarray, " rows"]:
        """Return times, in s, of an event that every visit has."""
        lasts = sum(step.hold for step in self.path) + self.move_time
        return (np.arange(self.visits)[:, None] * lasts + since_arrival).ravel()


def repeated(plan: Plan, count: int) -> Plan:
    """Return the plan with some postures visited again after all others.

    Two visits of a pose differ by noise only: posture, pulley and path are the same.
    They are evenly spaced over the plan.

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
        posture_id=plan.posture_id[order],
        pulley=plan.pulley[order],
    )


def evenly_spaced(total: int, count: int) -> Int[np.ndarray, " count"]:
    """Return count different indices below total, in order; both ends from two on."""
    return np.rint(np.linspace(0, max(total - 1, 0), count)).astype(int)


def mixed_pulleys(
    visits: int, places: int = PULLEY_PLACES
) -> Int[np.ndarray, " visits"]:
    """Return a pulley place for each visit, uncorrelated with a grid of postures.

    place = floor(places * frac(visit * golden ratio)): all places come equally often,
    and no period of the postures is a period of the places (Weyl 1916, "Über die
    Gleichverteilung von Zahlen mod. Eins").

    Raises:
        Unusable: Where there is no place.
    """
    if places < 1:
        raise Unusable("Pulley places", [f"{places} places, expected at least 1."])
    return np.floor(places * np.mod(np.arange(visits) * GOLDEN, 1.0)).astype(int)
