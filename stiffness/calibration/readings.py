"""What can be calibrated on is where targets stood while nothing pulled at the arm."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from bench.errors import Unusable
from bench.recording import UNLOADED, Payload, Recording
from stiffness.arm import Arm

FEWEST = 30
"""Poses; chosen: as many as the parameters of a six-axis arm's geometry."""
MOVED = 2e-4
"""Turn in rad (m where an axis slides) from which on it is a move; chosen: ten times
what an encoder errs."""


@dataclass(frozen=True)
class Readings:
    """One row per pose and target, in the order of time.

    Attributes:
        arm: The nominal arm.
        posture: Reported, in rad (m where an axis slides).
        side: Of each axis, the direction in which it last moved: −1, 0 (unknown), 1.
        seen: Of the target, in the tracker's frame, in m.
        marker: Which target, by its number in `names`.
        pose: Id of the pose.
        hours: Since the middle of the recording.
        names: Of the targets.
        bodies: That the targets sit on.
        places: Nominal, in m; zero where unknown.
        stated: One sigma of a coordinate as stated, in m; NaN where it is not.
        tool: What the arm carries besides its own weight, on the flange.
    """

    arm: Arm
    posture: Float[np.ndarray, "rows axes"]
    side: Float[np.ndarray, "rows axes"]
    seen: Float[np.ndarray, "rows 3"]
    marker: Int[np.ndarray, " rows"]
    pose: Int[np.ndarray, " rows"]
    hours: Float[np.ndarray, " rows"]
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    places: Float[np.ndarray, "markers 3"]
    stated: float
    tool: Payload

    def take(self, rows: np.ndarray) -> "Readings":
        """Return the same with only these rows (indices or a mask)."""
        return Readings(
            self.arm, self.posture[rows], self.side[rows], self.seen[rows],
            self.marker[rows], self.pose[rows], self.hours[rows],
            self.names, self.bodies, self.places, self.stated, self.tool,
        )  # fmt: skip


def readings_of(recording: Recording, arm: Arm) -> Readings:
    """Take the unloaded rows of a recording, a mean for each visit and target.

    Of a 6D target only the first point counts; its turn is left for a check.

    Raises:
        Unusable: Where nothing was tracked, only differences mean anything, or there
            are too few poses.
    """
    faults = []
    if not recording.markers or recording.points is None:
        faults.append("nothing was tracked; calibration needs a target's positions.")
    if recording.displacement != "absolute":
        faults.append('displacement is "relative"; calibration needs "absolute".')
    if recording.rows != "plateaus":
        faults.append('rows are a "stream"; calibration needs "plateaus".')
    if not faults and len(np.unique(recording.pose)) < FEWEST:
        count = len(np.unique(recording.pose))
        faults.append(f"it has {count} poses; calibration needs {FEWEST} or more.")
    if faults:
        raise Unusable(f"Recording {recording.name!r}", faults)
    assert recording.points is not None
    rest = recording.take(np.flatnonzero(np.equal(recording.stage, UNLOADED)))
    assert rest.points is not None
    chosen = _first_of_each_target(recording)
    names, first, index = np.unique(rest.visit, return_index=True, return_inverse=True)
    order = np.argsort(rest.time[first], kind="stable")
    first = first[order]
    rank = np.empty(len(names), dtype=int)
    rank[order] = np.arange(len(names))
    visit = rank[index]
    places = rest.points[:, chosen]
    seen = np.asarray(np.all(np.isfinite(places), axis=2))
    total = np.zeros((len(names), len(chosen), 3))
    np.add.at(total, visit, np.where(seen[:, :, None], places, 0.0))
    count = np.zeros((len(names), len(chosen)))
    np.add.at(count, visit, seen)
    v, m = np.nonzero(count)
    posture = rest.posture[first]
    hours = (rest.time[first] - rest.time.mean()) / 3600.0
    markers = [recording.markers[k] for k in chosen]
    nominal = [np.zeros(3) if x.position is None else x.position for x in markers]
    sigma = recording.tracker
    return Readings(
        arm=arm,
        posture=posture[v],
        side=_sides(posture)[v],
        seen=total[v, m] / count[v, m][:, None],
        marker=m,
        pose=rest.pose[first][v],
        hours=hours[v],
        names=tuple(x.name for x in markers),
        bodies=tuple(x.body for x in markers),
        places=np.array(nominal),
        stated=np.nan if sigma is None else float(np.mean(sigma.repeatability)),
        tool=recording.tool or Payload(),
    )


def _first_of_each_target(recording: Recording) -> list[int]:
    chosen, known = [], set()
    for k, marker in enumerate(recording.markers):
        if marker.target is None or marker.target not in known:
            chosen.append(k)
            known.add(marker.target)
    return chosen


def _sides(posture: Float[np.ndarray, "visits axes"]) -> np.ndarray:
    """Return the direction of each axis' last move before each visit."""
    side = np.zeros_like(posture)
    for v in range(1, len(posture)):
        step = posture[v] - posture[v - 1]
        side[v] = np.where(np.abs(step) > MOVED, np.sign(step), side[v - 1])
    return side
