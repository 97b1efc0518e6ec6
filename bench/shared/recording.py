"""Recording: what was commanded, and what encoders, force sensor and tracker read.

Real and synthetic experiments are the same type. A recording never contains the truth.
In memory everything is SI and radians; `bench.shared.format` converts on reading and
writing.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from bench.shared.errors import refuse

# --- Stated specifications of instruments ---------------------------------------------

ASSUMED = 3e-5
"""Repeatability where nothing is stated and nothing shows it, one sigma in m; chosen:
between a laser tracker's 0.01 mm and a camera's 0.1 mm."""


@dataclass(frozen=True)
class TrackerSpec:
    """Stated specification of a tracker.

    Attributes:
        repeatability: One sigma of a row (of a frame, where the recording counts
            frames) along x, y, z of the tracker, in m.
        volumetric: Size of its slowly varying error, in m; None where not stated.
        is_stated: Whether somebody stated the repeatability; else it is `ASSUMED`, or
            was measured.
    """

    repeatability: Float[np.ndarray, "3"]
    volumetric: float | None = None
    is_stated: bool = True


@dataclass(frozen=True)
class WrenchSpec:
    """Stated specification of a force sensor.

    Attributes:
        accuracy_force: One sigma of a row, in N.
        accuracy_torque: One sigma of a row, in N m.
        body: The body it is mounted on.
        position: Its origin in that body's frame, in m.
        quaternion_wxyz: v_body = R(quaternion) v_sensor.
        frame: Axes along which the readings are given.
        includes_tool_weight: Whether the weight beyond the sensor is still in them.
    """

    accuracy_force: float
    accuracy_torque: float
    body: str = "flange"
    position: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    quaternion_wxyz: Float[np.ndarray, "4"] = field(
        default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0])
    )
    frame: Literal["sensor", "base"] = "sensor"
    includes_tool_weight: bool = False

    @property
    def sigma(self) -> Float[np.ndarray, "6"]:
        """One sigma of each channel of a row, in N and N m."""
        return np.repeat([self.accuracy_force, self.accuracy_torque], 3)


# --- Stages and moves -----------------------------------------------------------------

UNLOADED, LOADING, LOADED, UNLOADING = "unloaded", "loading", "loaded", "unloading"
STAGES = (UNLOADED, LOADING, LOADED, UNLOADING)


MOVED = 2e-4
"""Turn in rad (m along a slide) from which it counts as a move; chosen: ten times the
error of an encoder."""


def last_moves(
    posture: Float[np.ndarray, "rows axes"],
) -> Float[np.ndarray, "rows axes"]:
    """Return the direction in which each axis last moved before or in each row.

    1, −1, or 0 before the first move. An axis goes on until it has come back by more
    than `MOVED`; angles are in rad (slides in m), in the order of time.
    """
    side = np.zeros_like(posture)
    for axis, angles in enumerate(posture.T.tolist()):
        turn, way = angles[0], 0.0
        for row, angle in enumerate(angles):
            gone = angle - turn
            if abs(gone) > MOVED:
                way = 1.0 if gone > 0.0 else -1.0
            if gone * way > 0.0:
                turn = angle
            side[row, axis] = way
    return side


def move_shares(
    posture: Float[np.ndarray, "rows axes"],
) -> Float[np.ndarray, "rows axes"]:
    """Return each axis' share of the last move before or in each row.

    ==========  ======================================================================
    Equation    share_k = Δq_k / max_j |Δq_j|, Δq the move from where the arm stood
    Source      synchronised point-to-point motion: all axes start and arrive together
    Valid       moves from one stand straight to the next
    Ignores     stands that were not recorded; that a slide's metres are no radians
    ==========  ======================================================================

    From −1 to 1; 0 of all axes before the first move. Angles are in rad (slides in m),
    in the order of time.
    """
    share = np.zeros_like(posture)
    stood, last = posture[0], share[0]
    for row, angles in enumerate(posture):
        gone = angles - stood
        most = np.abs(gone).max(initial=0.0)
        if most > MOVED:
            stood, last = angles, gone / most
        share[row] = last
    return share


@dataclass(frozen=True)
class LastMoves:
    """How each axis came to where it stands.

    Attributes:
        side: Direction in which it last moved: 1, −1, or 0 before its first move.
        share: Its share of the arm's last move, see `move_shares`.
    """

    side: Float[np.ndarray, "rows axes"]
    share: Float[np.ndarray, "rows axes"]

    @classmethod
    def of(cls, posture: Float[np.ndarray, "rows axes"]) -> "LastMoves":
        """Return the moves between postures in the order of time, in rad."""
        return cls(last_moves(posture), move_shares(posture))

    def take(self, rows: np.ndarray) -> "LastMoves":
        """Return those of some rows (indices or a mask)."""
        return LastMoves(self.side[rows], self.share[rows])

    def of_axes(self, axes: Int[np.ndarray, " axes"], count: int) -> "LastMoves":
        """Return those of an arm of more axes, of which these are some.

        The others stood still.
        """
        side, share = np.zeros((2, len(self.side), count))
        side[:, axes], share[:, axes] = self.side, self.share
        return LastMoves(side, share)


@dataclass(frozen=True)
class Marker:
    """A point on a body that the tracker follows.

    Attributes:
        name: Its column's prefix.
        body: The body it is stuck to: `base`, `link_1` …, `flange`, `tool`, or a
            body of the model.
        position: Nominal place in the body's frame, in m; None where unknown.
        target: Name of the 6D target it belongs to; None for a single point.
    """

    name: str
    body: str
    position: Float[np.ndarray, "3"] | None = None
    target: str | None = None


@dataclass(frozen=True)
class Payload:
    """A mass that is mounted beyond the model's last body.

    Attributes:
        mass: In kg.
        com: Its centre in the flange's frame, in m.
    """

    mass: float = 0.0
    com: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class DrawingAccuracy:
    """How true a nominal model is taken to be: one sigma of each kind of number.

    The defaults are twice the usual error of an uncalibrated arm (Slamani et al. 2012:
    0.5 mm, 1 mrad) for lengths and angles, twice as much again for zeros, which are
    set by hand after each exchange of a motor, and a tenth for masses, which makers
    round and cables and covers add to.

    Attributes:
        length: Of a link's lengths and of a slide's zero, in m.
        angle: Of the angles between axes, in rad.
        offset: Of an axis' zero, in rad.
        mass_ratio: Of a link's mass, as a share of it.
    """

    length: float = 1e-3
    angle: float = math.radians(0.1)
    offset: float = math.radians(0.2)
    mass_ratio: float = 0.1


@dataclass(frozen=True, repr=False)
class Recording:
    """One experiment, one row per measured state, in the order of time.

    Attributes:
        name: Name of the experiment.
        time: When each row was read, since the start, in s; never decreasing.
        posture_id: Id of the posture visited (of the motion, in a stream).
        visit: Counts visits from 0; the same pose again is another visit.
        posture: Axis angles the controller reports, in rad (slides in m).
        commanded: Those that it was told, likewise; NaN = not recorded.
        last_move: How each axis came to each row, where rows before were left out;
            None: as the rows say.
        load_time: When the load of each row last changed, in s.
        stage: One of `STAGES` for each row.
        axes: The model's joints for a1, a2 …; empty: from base to tip.
        bodies: Names of this format mapped to the model's own.
        slides: Whether each axis slides; empty: all turn.
        wrench: What the world exerts on the robot about the sensor's origin, force in
            N then torque in N m, along `wrench_sensor.frame`; None where not measured.
        load_mass: Nominal mass on the hook, in kg.
        markers: The points that were followed.
        points: Their positions in the tracker's frame, in m; NaN = not seen.
        spread: One sigma of each of `points`, in m; NaN = as `tracker` says.
        link_posture: Angles measured after the gear, in rad; NaN = no such encoder.
        axis_torque: From motor current, output side, in N m; NaN = not measured.
        temperature: In °C.
        frames: Number of frames averaged in each row.
        base_from_tracker: 4 x 4 transform, m; None where unknown.
        tracker: Stated noise of `points`.
        wrench_sensor: Stated noise and mounting of `wrench`.
        encoder_repeatability: One sigma of a link-side angle, in rad.
        torque_accuracy: One sigma of `axis_torque`, in N m.
        tool: What is mounted beyond the model, sensor included; None where nothing.
        drawing: How true the model is taken to be.
        robot: Informative name of the robot.
        rows: Whether a row is a plateau or an instant of a stream.
        displacement: `relative`: only differences within a visit mean anything.
        notes: What was seen on reading it that is no fault.

    Raises:
        Unusable: Where arrays disagree in shape, naming each.
    """

    name: str
    time: Float[np.ndarray, " rows"]
    posture_id: Int[np.ndarray, " rows"]
    visit: Int[np.ndarray, " rows"]
    posture: Float[np.ndarray, "rows axes"]
    load_time: Float[np.ndarray, " rows"]
    stage: np.ndarray
    axes: tuple[str, ...] = ()
    bodies: Mapping[str, str] = field(default_factory=dict)
    slides: tuple[bool, ...] = ()
    wrench: Float[np.ndarray, "rows 6"] | None = None
    load_mass: Float[np.ndarray, " rows"] | None = None
    markers: tuple[Marker, ...] = ()
    points: Float[np.ndarray, "rows markers 3"] | None = None
    spread: Float[np.ndarray, "rows markers 3"] | None = None
    commanded: Float[np.ndarray, "rows axes"] | None = None
    last_move: LastMoves | None = None
    link_posture: Float[np.ndarray, "rows axes"] | None = None
    axis_torque: Float[np.ndarray, "rows axes"] | None = None
    temperature: Float[np.ndarray, " rows"] | None = None
    frames: Int[np.ndarray, " rows"] | None = None
    base_from_tracker: Float[np.ndarray, "4 4"] | None = None
    tracker: TrackerSpec | None = None
    wrench_sensor: WrenchSpec | None = None
    encoder_repeatability: float | None = None
    torque_accuracy: float | None = None
    tool: Payload | None = None
    drawing: DrawingAccuracy = DrawingAccuracy()
    robot: str = ""
    rows: Literal["plateaus", "stream"] = "plateaus"
    displacement: Literal["absolute", "relative"] = "absolute"
    notes: tuple[str, ...] = field(default=(), compare=False)

    def __repr__(self):
        """Return what it is in a line, without its readings."""
        poses, axes = len(np.unique(self.posture_id)), self.posture.shape[1]
        seen = f"{len(self.markers)} markers, " if self.markers else ""
        wrench = "no wrench" if self.wrench is None else "a wrench"
        return (
            f"Recording {self.name!r}: {len(self.time)} rows of {self.rows}, {poses} "
            f"poses, {axes} axes, {seen}{wrench}"
        )

    def __post_init__(self):
        """Check that all arrays have the same rows, axes and markers."""
        rows = len(self.time)
        axes = self.posture.shape[1] if self.posture.ndim == 2 else -1
        expected: dict[str, tuple[int, ...]] = {
            "posture_id": (rows,),
            "visit": (rows,),
            "posture": (rows, axes),
            "load_time": (rows,),
            "stage": (rows,),
            "wrench": (rows, 6),
            "load_mass": (rows,),
            "points": (rows, len(self.markers), 3),
            "spread": (rows, len(self.markers), 3),
            "commanded": (rows, axes),
            "link_posture": (rows, axes),
            "axis_torque": (rows, axes),
            "temperature": (rows,),
            "frames": (rows,),
        }
        faults = []
        for name, shape in expected.items():
            value = getattr(self, name)
            if value is not None and np.shape(value) != shape:
                faults.append(f"{name} has shape {np.shape(value)}, expected {shape}.")
        if self.markers and self.points is None:
            faults.append("there are markers but no points.")
        refuse(f"Recording {self.name!r}", faults)

    @cached_property
    def moves(self) -> LastMoves:
        """How each axis came to each row; at a plateau, to its visit's first."""
        if self.last_move is not None:
            return self.last_move
        told = self.posture if self.commanded is None else self.commanded
        angles = np.where(np.isnan(told), self.posture, told)
        if self.rows != "plateaus":
            return LastMoves.of(angles)
        first, visit = np.unique(self.visit, return_index=True, return_inverse=True)[1:]
        return LastMoves.of(angles[first]).take(visit)

    @property
    def side(self) -> Float[np.ndarray, "rows axes"]:
        """Direction of each axis' last move, 1 or −1; 0 before the first."""
        return self.moves.side

    def take(self, rows: np.ndarray) -> "Recording":
        """Return the same recording with only these rows (indices or a mask)."""
        per_row = {
            "time", "posture_id", "visit", "posture", "load_time", "stage", "wrench",
            "load_mass", "points", "spread", "commanded", "link_posture",
            "axis_torque", "temperature", "frames",
        }  # fmt: skip
        kept = {
            name: getattr(self, name)[rows]
            for name in per_row
            if getattr(self, name) is not None
        }
        return replace(self, **kept, last_move=self.moves.take(rows))

    def watching(
        self, markers: Sequence[int] | Int[np.ndarray, " markers"]
    ) -> "Recording":
        """Return the same recording with only these markers, by their numbers."""
        kept = {
            name: value[:, np.asarray(markers, dtype=int)]
            for name in ("points", "spread")
            if (value := getattr(self, name)) is not None
        }
        return replace(self, **kept, markers=tuple(self.markers[m] for m in markers))


def transform_of(
    turn: Float[np.ndarray, "3 3"], shift: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """Return the transform of points that turns them, then shifts them by m."""
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = turn, shift
    return transform


def targets_of(recording: Recording) -> dict[str, list[int]]:
    """Return the markers of each 6D target; of a single point itself, by its name."""
    found: dict[str, list[int]] = {}
    for m, marker in enumerate(recording.markers):
        found.setdefault(marker.target or marker.name, []).append(m)
    return found
