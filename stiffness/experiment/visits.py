"""Visits: stays at one configuration while the load is applied and removed.

Within a visit only the load changes, so differences of a marker's positions are due to
the load; between visits the configuration changes, and only visit means are compared.
A gear that remembers arrives at a visit with what the visit before left in it
(`carried_states`).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import sem
from scipy.stats import t as student

from bench.shared.recording import Recording

LONGEST = 40
"""Maximum number of rows compared with each other; longer visits are cut into such
stays, each with a rest position of its own. Chosen: cost grows with its square."""


@dataclass(frozen=True)
class Visits:
    """Row indices of every stay, side by side.

    Attributes:
        row: The recording's rows of each stay in the order of time; short stays repeat
            their last.
        counts: Whether an entry is a row and not a repetition.
        posture_index: Index of each stay's pose.
    """

    row: Int[np.ndarray, "visits longest"]
    counts: Bool[np.ndarray, "visits longest"]
    posture_index: Int[np.ndarray, " visits"]

    def gather(self, values: np.ndarray) -> np.ndarray:
        """Gather values of rows by stay: (visits, longest, …)."""
        return values[self.row]

    def poses(self) -> int:
        """Return the number of poses."""
        return int(self.posture_index.max()) + 1


def visits_of(
    visit: Int[np.ndarray, " rows"], pose: Int[np.ndarray, " rows"]
) -> Visits:
    """Group the rows of a recording by visits.

    Args:
        visit: Index of each row's visit, from 0.
        pose: Index of each row's pose, from 0.
    """
    stays = []
    for rows in np.split(
        np.argsort(visit, kind="stable"), np.cumsum(np.bincount(visit))[:-1]
    ):
        pieces = -(-len(rows) // LONGEST)
        stays.extend(np.array_split(rows, pieces))
    longest = max(len(rows) for rows in stays)
    row = np.stack([np.pad(rows, (0, longest - len(rows)), "edge") for rows in stays])
    counts = np.arange(longest) < np.array([len(rows) for rows in stays])[:, None]
    return Visits(row, counts, pose[row[:, 0]])


def held_at_mean(
    visit: Int[np.ndarray, " rows"], values: Float[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """Return the mean of each row's visit, row by row; visits have any labels."""
    index = np.unique(visit, return_inverse=True)[1]
    total = np.zeros((index.max() + 1, values.shape[1]))
    np.add.at(total, index, values)
    return (total / np.bincount(index)[:, None])[index]


def mean_of(
    values: Float[np.ndarray, "visits longest markers 3"],
    weight: Float[np.ndarray, "visits longest markers"],
) -> Float[np.ndarray, "visits markers 3"]:
    """Return weighted means over the rows of each stay; 0 where there is no weight."""
    total = weight.sum(axis=1)
    share = weight / np.where(total > 0, total, 1.0)[:, None]
    return np.einsum(
        "vrm,vrmi->vmi", share, np.where(share[..., None] > 0, values, 0.0)
    )


STRETCH = 48
"""Number of visits computed together; chosen: their matrices stay in the cache."""


def stretches(
    visits: int, label: Int[np.ndarray, " visits"] | None = None
) -> list[Int[np.ndarray, " some"]]:
    """Cut visits into short stretches, each with one label."""
    if label is None:
        label = np.zeros(visits, dtype=int)
    order = np.argsort(label, kind="stable")
    own = np.split(order, np.cumsum(np.bincount(label))[:-1])
    return [one[at : at + STRETCH] for one in own for at in range(0, len(one), STRETCH)]


MAX_KEPT = 12
"""Number of stretches of visits whose design is cached; chosen: an experiment of some
hundred visits is computed once, a long one never fills the memory."""
Laid = TypeVar("Laid")


@dataclass(frozen=True, eq=False)
class Kept(Generic[Laid]):
    """Cache of the designs of the most recent stretches."""

    laid: dict[bytes, Laid] = field(default_factory=dict)

    def of(
        self,
        visits: Int[np.ndarray, " some"],
        lay: Callable[[Int[np.ndarray, " some"]], Laid],
    ) -> Laid:
        """Return the design of these visits, from the cache or newly computed."""
        key = visits.tobytes()
        if key not in self.laid:
            if len(self.laid) >= MAX_KEPT:
                del self.laid[next(iter(self.laid))]
            self.laid[key] = lay(visits)
        return self.laid[key]


# --- Commanded beside reported angles -------------------------------------------------


def commanded_lags(recording: Recording) -> Float[np.ndarray, "axes 2"]:
    """Return how far reported angles lag behind commanded ones along the last move.

    ==========  ======================================================================
    Equation    lag = mean over visits of (commanded - reported) s, s = ±1 the last
                move's direction; ± Student's t times its standard error
    Source      definition
    Valid       readings at rest; the unit of independence is the visit
    Ignores     where the axis rests: the two angles alone do not say that
    ==========  ======================================================================

    Args:
        recording: The experiment.

    Returns:
        Lag of each axis and half its 95 % interval, in rad (m along a slide); NaN where
        nothing was recorded, or too few visits.
    """
    found = np.full((recording.posture.shape[1], 2), np.nan)
    if recording.commanded is None or recording.rows != "plateaus":
        return found
    first = np.unique(recording.visit, return_index=True)[1]
    side = recording.side[first]
    ahead = (recording.commanded - recording.posture)[first] * side
    for k in range(len(found)):
        own = ahead[np.isfinite(ahead[:, k]) & (side[:, k] != 0.0), k]
        if len(own) > 2:
            found[k] = own.mean(), student.ppf(0.975, len(own) - 1) * sem(own)
    return found


# --- Memory from visit to visit -------------------------------------------------------

NOTHING, GRAVITY, BEFORE, UNKNOWN = 0, 1, 2, 3
"""What a gear's memory holds at arrival: nothing, so that gravity's torque grows from
zero there; gravity's torque, under which it came to rest; what the visit before and the
way from it left; any state between its bounds, another in each visit."""
MEMORIES = (NOTHING, GRAVITY, BEFORE)
"""Memories whose state follows from a recording."""
ALIKE = {NOTHING: (GRAVITY,), GRAVITY: (NOTHING,), BEFORE: (), UNKNOWN: ()}
"""Memories between which a gear may be: it came to rest in part. What a visit before
left is known wholly or not at all."""


def memories(visit: Int[np.ndarray, " rows"]) -> tuple[int, ...]:
    """Return the memories that visits can tell apart.

    Args:
        visit: Number of each row's visit; where numbers are missing, what was before a
            visit is not known.
    """
    known = np.unique(visit)
    follow = len(known) > 1 and bool(np.all(np.diff(known) == 1))
    return MEMORIES if follow else MEMORIES[:BEFORE]


def carried_states(
    least: Float[np.ndarray, " visits"],
    most: Float[np.ndarray, " visits"],
    bound: float,
    change: Float[np.ndarray, " visits"] | None = None,
) -> Float[np.ndarray, " visits"]:
    """Return the state at each visit's beginning, left by all visits before; first 0.

    A stop that is bounded at both sides ends at the clipped sum of its start and the
    change of what it follows; any other state ends at a line between two of its ends.

    Args:
        least: State at each visit's end where it begins at the lower bound.
        most: The same from the upper bound.
        bound: Of the state, either sign.
        change: Of what a stop follows, over each visit; None: it is no stop.
    """
    bound, arrival = float(bound), [0.0]
    moved = np.zeros(len(least)) if change is None else change
    ends = zip(least.tolist(), most.tolist(), moved.tolist(), strict=True)
    for low, high, step in list(ends)[:-1]:  # of plain numbers: ten times as fast
        start = arrival[-1]
        if change is None:
            arrival.append(low + (high - low) * (start + bound) / (2.0 * bound))
        else:
            arrival.append(min(max(start + step, low), high))
    return np.array(arrival)
