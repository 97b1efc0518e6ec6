"""Where the arm stood and what acted in it, row by row, under the fitted nominal model.

Everything is along the base's axes, in SI units and radians. A *place* is where an arm
can give way: place 0 is the base's foot, place k is axis k (counted from 1); a place
carries all bodies beyond it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from bench.recording import Recording
from stiffness.arm import Arm


@dataclass(frozen=True, eq=False)
class Situation:
    """What hypotheses see of an experiment; displacements themselves are not in it.

    Attributes:
        recording: What was done: times, visits, stages, loads. A hypothesis does not
            look at `points` or `link_posture`.
        arm: The nominal arm with the recording's names.
        compliance: Of each axis, as fitted silently (0 where rigid), in rad/(N m).
        rest: Where the links rest under gravity and load, in rad.
        torque: About (along) each axis, of gravity and load on all it carries, N m.
        load_torque: The load's part of it, in N m.
        force: Exerted by gravity and load on all that a place carries, in N.
        moment: The same forces' moment about the place's origin as it is in that row,
            in N m; its component along axis k there is the torque of axis k.
        origin: Of each place's frame with a visit's mean wind-up, in m; the base's is
            zero.
        frame: Axes of each place's frame as columns, turning with its axis; the third
            is the axis.
        seat: The same before the axis turns: fixed in the link before.
        wrench: What the world exerts on the robot about the sensor's origin.
        sensor: The sensor's origin, in m.
        sensor_axes: The sensor's own axes as columns: there it errs, even where a
            controller reports its readings along the base's.
        carried: Whether each place carries each body of `bodies`.
        bodies: Names of the bodies with markers.
        tracker: Transform from the tracker's frame to the base's, as stated or fitted;
            None: nobody knows.
        spots: Where each marker sits in its body's frame as fitted, in m; None: as
            stated.
        giving: What was named and gives way in proportion to loads: what each does in
            any situation, as parts of a signature.
    """

    recording: Recording
    arm: Arm
    compliance: Float[np.ndarray, " axes"]
    rest: Float[np.ndarray, "rows axes"]
    torque: Float[np.ndarray, "rows axes"]
    load_torque: Float[np.ndarray, "rows axes"]
    force: Float[np.ndarray, "rows places 3"]
    moment: Float[np.ndarray, "rows places 3"]
    origin: Float[np.ndarray, "rows places 3"]
    frame: Float[np.ndarray, "rows places 3 3"]
    seat: Float[np.ndarray, "rows places 3 3"]
    wrench: Float[np.ndarray, "rows 6"]
    sensor: Float[np.ndarray, "rows 3"]
    sensor_axes: Float[np.ndarray, "rows 3 3"]
    carried: Bool[np.ndarray, "places bodies"]
    bodies: tuple[str, ...]
    tracker: Float[np.ndarray, "4 4"] | None = None
    spots: Float[np.ndarray, "markers 3"] | None = None
    giving: tuple[Callable[["Situation"], tuple], ...] = ()

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(self.recording.time)

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """What the axes are called in an answer: a1 … aN."""
        return tuple(f"a{k + 1}" for k in range(len(self.arm.axes)))

    @cached_property
    def links(self) -> tuple[str, ...]:
        """What the links between axes are called: link_1 … link_(N-1)."""
        return tuple(f"link_{k + 1}" for k in range(len(self.axes) - 1))

    def axis(self, where: str) -> int:
        """Return the number of an axis from its name, counted from 0."""
        return self.axes.index(where)

    def spot(self, marker: int) -> Float[np.ndarray, "3"] | None:
        """Return where a marker sits in its body's frame, in m, if anybody knows."""
        stated = self.recording.markers[marker].position
        return stated if self.spots is None else self.spots[marker]

    @cached_property
    def screw(self) -> Float[np.ndarray, "rows axes 6"]:
        """Twist of all that an axis carries per radian (metre) along the axis."""
        along, at = self.frame[:, 1:, :, 2], self.origin[:, 1:]
        twist = np.concatenate([np.cross(at, along), along], axis=2)
        slides = self.arm.slides
        twist[:, slides] = np.concatenate([along, 0 * along], axis=2)[:, slides]
        return twist

    @cached_property
    def pose(self) -> Int[np.ndarray, " rows"]:
        """Index of each row's pose among the poses, from 0."""
        return np.unique(self.recording.pose, return_inverse=True)[1]

    @cached_property
    def visit(self) -> Int[np.ndarray, " rows"]:
        """Index of each row's visit among the visits, from 0."""
        return np.unique(self.recording.visit, return_inverse=True)[1]

    @cached_property
    def steps(self) -> Int[np.ndarray, "visits longest"]:
        """Rows of each visit in the order of time; short visits repeat their last."""
        order = np.argsort(self.visit, kind="stable")
        count = np.bincount(self.visit)
        start = np.cumsum(count) - count
        at = np.minimum(np.arange(count.max()), count[:, None] - 1)
        return order[start[:, None] + at]

    def from_steps(
        self, values: Float[np.ndarray, "visits longest"]
    ) -> Float[np.ndarray, " rows"]:
        """Bring values that were computed along `steps` back to the rows."""
        flat = np.empty(self.rows)
        flat[self.steps[:, ::-1].ravel()] = values[:, ::-1].ravel()
        return flat

    def with_compliance(self, compliance: Float[np.ndarray, " axes"]) -> "Situation":
        """Return the same, saying that the axes have this compliance."""
        return replace(self, compliance=compliance)

    def some(self, rows: Int[np.ndarray, " some"]) -> "Situation":
        """Return some rows of the same, for laws that know no row but their own."""
        per_row = (
            "rest", "torque", "load_torque", "force", "moment", "origin", "frame",
            "seat", "wrench", "sensor", "sensor_axes",
        )  # fmt: skip
        taken = {name: getattr(self, name)[rows] for name in per_row}
        return replace(self, recording=self.recording.take(rows), **taken)
