"""Static state row by row: configuration, wrenches and joint torques at equilibrium.

A `StaticState` is the recorded experiment under the fitted nominal model, along the
base's axes, in SI units and radians. A *place* is a compliant point of the arm: place 0
is the base's foot, place k is axis k (counted from 1); a place carries all bodies
beyond it.

Forces, moments and torques (`static_state_of`):

==========  ==========================================================================
Equation    F_p = sum m g + F_load; M_p = sum (c - o_p) x m g + (s - o_p) x F_load + T
            over all that place p carries; torque of axis k = z_k . M_k (slide: z_k . F)
            with o_p and z_k of the row; places for lever arms: with the mean wind-up of
            the row's visit
Source      Siciliano et al. 2009, "Robotics: Modelling, Planning and Control", 7.3
Valid       an arm at rest
Ignores     compliance beyond the axes' own springs
==========  ==========================================================================
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from bench.shared.recording import Recording
from stiffness.experiment.sensor_noise import clear_channels, tared
from stiffness.experiment.visits import held_at_mean
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium
from stiffness.robot.kinematics import ArmState
from stiffness.robot.tracker_frame import TrackerFit
from stiffness.robot.wrench import axes_of_sensor, felt_body, wrench_in_base

# --- Situation ------------------------------------------------------------------------

WAY_POINTS = 25
"""Points of a way between postures, both ends too; chosen: 7.5° of half a turn, over
which gravity's torque hardly bends."""
AT_ONCE = 400
"""Ways that are laid out together; chosen: some 10 MB."""


@dataclass(frozen=True)
class CurvedSpring:
    """Spring of an axis whose slope changes with its torque, by a named effect.

    Attributes:
        initial: Its slope at no torque over the compliance that is fitted beside it.
        wound: Torque that winds a spring of that slope up as far as a torque does this
            one, both in N m.
        slope: Slope at a torque over the slope at no torque.
    """

    initial: float
    wound: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]


Law = tuple[str, str]
"""An effect and where it is."""


@dataclass(frozen=True, eq=False)
class Gear:
    """What named laws make of the gear of one axis.

    Attributes:
        curves: By effect, the curve that it gives to the axis' spring.
        parallel: Torque that each law carries beside the spring in each row, in N m.
        unknown: Turns of the axis, one sigma a column, by the state in which the gear
            arrives at each visit, in rad; None where the recording tells it.
    """

    curves: Mapping[str, CurvedSpring] = field(default_factory=dict)
    parallel: Mapping[Law, Float[np.ndarray, " rows"]] = field(default_factory=dict)
    unknown: Float[np.ndarray, "rows states"] | None = None

    def curves_but(self, effect: str) -> list[CurvedSpring]:
        """Return the curves of all other effects, in the order in which they act."""
        return [
            self.curves[own]
            for own in sorted(self.curves, reverse=True)
            if own != effect
        ]

    def curve(
        self, torque: Float[np.ndarray, "*_"], effect: str
    ) -> tuple[Float[np.ndarray, "*_"], Float[np.ndarray, "*_"]]:
        """Return wind-ups and slopes, as in `CurvedSpring`, without an effect's curve.

        Each curve acts through those before it.
        """
        wound, slope = torque, np.ones_like(torque)
        for one in self.curves_but(effect):
            more, change = one.wound(wound) - wound, one.slope(wound) - 1.0
            wound, slope = wound + slope * more, slope * (1.0 + slope * change)
        return wound, slope

    def some(self, rows: Int[np.ndarray, " some"]) -> "Gear":
        """Return the same in some rows."""
        own = {law: torque[rows] for law, torque in self.parallel.items()}
        unknown = None if self.unknown is None else self.unknown[rows]
        return replace(self, parallel=own, unknown=unknown)


NO_WAY = 1e-6
"""Share of a torque over which a slope is taken at a point; chosen for rounding."""
LINEAR = Gear()
"""The gear of an axis of which nothing is named."""


@dataclass(frozen=True, eq=False)
class StaticState:
    """Loads and configurations of an experiment, the input of all hypotheses.

    Attributes:
        recording: Times, visits, stages and loads. A hypothesis must not use its
            `points` or `link_posture`.
        arm: The nominal arm with the recording's names.
        compliance: Of each axis, fitted as a nuisance parameter (0 where rigid), in
            rad/(N m).
        rest: Link-side joint angles under gravity and load, in rad.
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
        sensor_axes: The sensor's own axes as columns: its errors are along these, even
            where a controller reports its readings along the base's.
        carried: Whether each place carries each body of `bodies`.
        bodies: Names of the bodies with markers.
        frames: Fitted pose of the tracker and positions of markers; None: as stated.
        giving: Named effects that are linear in the loads: for each the blocks of its
            Jacobian in any static state.
        gears: Of the axes of whose gears laws are named.
        standing: What was worked out from `recording`, `arm`, `origin`, `frame` and
            `wrench` alone; states of other loads share it.
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
    frames: TrackerFit | None = None
    giving: tuple[Callable[["StaticState"], tuple], ...] = ()
    gears: Mapping[int, Gear] = field(default_factory=dict)
    standing: dict = field(default_factory=dict, repr=False)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self.recording.time)

    @property
    def wander(self) -> Float[np.ndarray, " markers"]:
        """Variance by which each marker wanders on its body along no law, in m²."""
        found = self.frames.wander if self.frames else ()
        return np.array(found) if found else np.zeros(len(self.recording.markers))

    @cached_property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes in an answer: a1 … aN."""
        return tuple(f"a{k + 1}" for k in range(len(self.arm.axes)))

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of the links between axes, see `Chain.links`."""
        return tuple(self.arm.chain.links)

    def ends_of(self, link: str) -> tuple[int, int]:
        """Return the places between which a link is: its own axis and the next one."""
        after = self.arm.chain.links[link]
        return self.arm.chain.parent[after] + 1, after + 1

    def axis(self, where: str) -> int:
        """Return the index of an axis from its name, counted from 0."""
        return self.axes.index(where)

    def marker_position(self, marker: int) -> Float[np.ndarray, "3"] | None:
        """Return a marker's position in its body's frame, in m; None where unknown."""
        if self.frames is not None:
            return self.frames.marker_positions[marker]
        return self.recording.markers[marker].position

    @property
    def tracker(self) -> Float[np.ndarray, "4 4"] | None:
        """Transform from the tracker's frame to the base's, in m; None: unknown."""
        fitted, stated = self.frames, self.recording.base_from_tracker
        return stated if fitted is None else fitted.transform

    @cached_property
    def screw(self) -> Float[np.ndarray, "rows axes 6"]:
        """Twist of all that an axis carries per radian (metre) along the axis."""
        return self.once_standing("screw", self._screw)

    def _screw(self) -> Float[np.ndarray, "rows axes 6"]:
        return _screw(self.frame[:, 1:, :, 2], self.origin[:, 1:], self.arm.slides)

    @cached_property
    def posture_index(self) -> Int[np.ndarray, " rows"]:
        """Index of each row's pose among the poses, from 0."""
        return np.unique(self.recording.posture_id, return_inverse=True)[1]

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

    @property
    def way_torque(self) -> Float[np.ndarray, "visits points axes"]:
        """Gravity's torque on the way to each visit, from the posture before, N m.

        All axes move evenly from posture to posture, without a load. The first visit
        has no way and stands in its posture throughout.
        """
        return self.once_standing("way_torque", self._way_torque)

    def _way_torque(self) -> Float[np.ndarray, "visits points axes"]:
        to = self.recording.posture[self.steps[:, 0]]
        start = np.concatenate([to[:1], to[:-1]])
        share = np.linspace(0.0, 1.0, WAY_POINTS)[:, None]
        way = start[:, None] + share * (to - start)[:, None]
        torque = np.empty_like(way)
        for some in np.array_split(np.arange(len(way)), 1 + len(way) // AT_ONCE):
            standing = self.arm.at(way[some].reshape(-1, way.shape[2]))
            own = standing.gravity_torque(self.recording.tool)
            torque[some] = own.reshape(torque[some].shape)
        return torque

    def from_steps(
        self, values: Float[np.ndarray, "visits longest"]
    ) -> Float[np.ndarray, " rows"]:
        """Map values that were computed along `steps` back to the rows."""
        flat = np.empty(self.rows)
        flat[self.steps[:, ::-1].ravel()] = values[:, ::-1].ravel()
        return flat

    def with_compliance(self, compliance: Float[np.ndarray, " axes"]) -> "StaticState":
        """Return the same state with another compliance of the axes."""
        return replace(self, compliance=compliance)

    def with_curve(self, axis: int, effect: str, spring: CurvedSpring) -> "StaticState":
        """Return the same state where an effect curves an axis' spring.

        Args:
            axis: Its index, counted from 0.
            effect: Whose curve it is.
            spring: The curve.
        """
        gear = self.gears.get(axis, LINEAR)
        gear = replace(gear, curves={**gear.curves, effect: spring})
        return replace(self, gears={**self.gears, axis: gear})

    def with_unknown(
        self, turns: Mapping[int, Float[np.ndarray, "rows states"]]
    ) -> "StaticState":
        """Return the same state where gears of axes arrive in states nobody knows."""
        gears = dict(self.gears)
        for axis, own in turns.items():
            gears[axis] = replace(gears.get(axis, LINEAR), unknown=own)
        return replace(self, gears=gears)

    def is_curved(self, axis: int) -> bool:
        """Return whether a named effect curves an axis' spring."""
        return bool(self.gears.get(axis, LINEAR).curves)

    def softness_of(self, axis: int, effect: str = "") -> Float[np.ndarray, " rows"]:
        """Return the slope of an axis' wind-up over the slope at no torque.

        It is the mean slope between the gear's torque and its spring's: what a law
        beside the spring takes from it counts over this way.

        Args:
            axis: Its index, counted from 0.
            effect: Whose curve does not count; empty: all curves do.
        """
        key = ("softness", axis, effect)
        return self.once(key, lambda: self._mean_slope(axis, effect))

    def once(self, key: Hashable, work: Callable[[], np.ndarray]) -> np.ndarray:
        """Return what is worked out once for this state.

        Args:
            key: What it is.
            work: How it is worked out.
        """
        if key not in self._worked_out:
            self._worked_out[key] = work()
        return self._worked_out[key]

    def once_standing(self, key: Hashable, work: Callable[[], Any]) -> Any:
        """Return what is worked out once for all states that stand alike.

        Args:
            key: What it is.
            work: How it is worked out, from what `standing` says.
        """
        own = (self.recording, self.arm, self.origin, self.frame, self.wrench)
        of, found = self.standing.get(key, (None, None))
        if of is None or any(a is not b for a, b in zip(of, own, strict=True)):
            found = work()
            self.standing[key] = own, found
        return found

    @cached_property
    def _worked_out(self) -> dict[Hashable, np.ndarray]:
        return {}

    def _mean_slope(self, axis: int, effect: str) -> Float[np.ndarray, " rows"]:
        whole, spring = self.torque[:, axis], self.spring_torque(axis)
        gear = self.gears.get(axis, LINEAR)
        (far, slope), near = gear.curve(whole, effect), gear.curve(spring, effect)[0]
        way = whole - spring
        some = np.abs(way) > NO_WAY * np.maximum(np.abs(whole), np.abs(spring))
        return np.where(some, (far - near) / np.where(some, way, 1.0), slope)

    def spring_torque(self, axis: int, law: Law | None = None) -> np.ndarray:
        """Return the torque that an axis' gear leaves to its spring, in N m.

        Args:
            axis: Its index, counted from 0.
            law: Whose own torque counts too. All counts for one that is not named: it
                may stand in the place of a named one as well as beside it.
        """
        beside = self.gears.get(axis, LINEAR).parallel
        if law is not None and law not in beside:
            return self.torque[:, axis]
        carried = [torque for other, torque in beside.items() if other != law]
        return self.torque[:, axis] - sum(carried)

    def wound(
        self, axis: int, torque: Float[np.ndarray, "*_"], effect: str = ""
    ) -> Float[np.ndarray, "*_"]:
        """Return torques of an axis that would wind it up alike were it linear.

        Args:
            axis: Its index, counted from 0.
            torque: In N m.
            effect: As in `softness_of`.
        """
        return self.gears.get(axis, LINEAR).curve(torque, effect)[0]

    def unloaded_compliance(self, axis: int, effect: str = "") -> float:
        """Return the slope of an axis' wind-up at no torque, in rad/(N m).

        Args:
            axis: Its index, counted from 0.
            effect: As in `softness_of`.
        """
        others = self.gears.get(axis, LINEAR).curves_but(effect)
        initial = sum(one.initial - 1.0 for one in others)
        return float(self.compliance[axis]) * (1.0 + initial)

    def some(self, rows: Int[np.ndarray, " some"]) -> "StaticState":
        """Return some rows of the same, for laws that act on each row separately."""
        per_row = (
            "rest", "torque", "load_torque", "force", "moment", "origin", "frame",
            "seat", "wrench", "sensor", "sensor_axes",
        )  # fmt: skip
        taken = {name: getattr(self, name)[rows] for name in per_row}
        gears = {axis: gear.some(rows) for axis, gear in self.gears.items()}
        recording = self.recording.take(rows)
        return replace(self, recording=recording, gears=gears, standing={}, **taken)


# --- Static equilibrium under gravity and load ----------------------------------------


def static_state_of(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"],
    bodies: Sequence[str],
) -> StaticState:
    """Return the arm's equilibrium in every row, with all forces and torques.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: The experiment.
        compliance: Of each axis, in rad/(N m); 0 = rigid.
        bodies: Bodies whose motion is needed.
    """
    rest = rest_of(arm, recording, compliance)
    midway = _midway(recording, rest)
    return _state(arm, recording, compliance, bodies, rest, midway)


def moved_to(situation: StaticState, rest: np.ndarray) -> StaticState:
    """Return the state where the links rest elsewhere than their springs alone say.

    The sensor turns with them, and with it the wrench that it reads. Lever arms are
    those halfway: a chord is as long as the turn about its middle says.

    Args:
        situation: Static state.
        rest: Link-side joint angles, (rows, axes) in rad.
    """
    arm, recording = situation.arm, situation.recording
    midway = _midway(recording, (situation.rest + rest) / 2.0)
    compliance, bodies = situation.compliance, situation.bodies
    state = _state(arm, recording, compliance, bodies, rest, midway)
    return replace(
        state,
        frames=situation.frames,
        giving=situation.giving,
        gears=situation.gears,
    )


def _state(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"],
    bodies: Sequence[str],
    rest: Float[np.ndarray, "rows axes"],
    midway: Float[np.ndarray, "rows axes"],
) -> StaticState:
    """Return all forces and torques where the links rest, lever arms midway."""
    standing = arm.at(rest)
    rows, axes = rest.shape
    sensor, sensor_axes = _sensor(recording, standing)
    wrench = _felt(recording, standing)
    force, moment = _carried(recording, standing, wrench, sensor)
    origin, frame = _places(arm.at(midway))
    load = np.zeros((rows, axes))
    if recording.wrench is not None and recording.wrench_sensor is not None:
        spec = recording.wrench_sensor
        load = standing.load_torque(wrench, spec.body, spec.position)
    along = standing.rotation[..., 2].transpose(1, 0, 2)
    torque = np.where(
        arm.slides,
        np.einsum("rai,rai->ra", along, force[:, 1:]),
        np.einsum("rai,rai->ra", along, moment[:, 1:]),
    )
    seat = frame.copy()
    cos, sin = np.cos(midway)[..., None], np.sin(midway)[..., None]
    x, y = frame[:, 1:, :, 0], frame[:, 1:, :, 1]
    turns = ~arm.slides
    seat[:, 1:, :, 0][:, turns] = (cos * x - sin * y)[:, turns]
    seat[:, 1:, :, 1][:, turns] = (sin * x + cos * y)[:, turns]
    carried = np.ones((axes + 1, len(bodies)), dtype=bool)
    for b, body in enumerate(bodies):
        under = arm.chain.carriers(arm.attachment(body).axis)
        carried[1:, b] = np.isin(np.arange(axes), under)
    return StaticState(
        recording=recording,
        arm=arm,
        compliance=compliance,
        rest=rest,
        torque=torque,
        load_torque=load,
        force=force,
        moment=moment,
        origin=origin,
        frame=frame,
        seat=seat,
        wrench=wrench,
        sensor=sensor,
        sensor_axes=sensor_axes,
        carried=carried,
        bodies=tuple(bodies),
    )


def rest_of(
    arm: Arm, recording: Recording, compliance: Float[np.ndarray, " axes"]
) -> Float[np.ndarray, "rows axes"]:
    """Return the links' rest posture in rad, under a wrench that turns with its sensor.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: The experiment.
        compliance: Of each axis, in rad/(N m); 0 = rigid.

    Raises:
        BenchError: Where there is no rest: the springs are too soft for the load.
    """
    posture, tool, spec = recording.posture, recording.tool, recording.wrench_sensor
    if spec is None or recording.wrench is None:
        return equilibrium(arm, posture, compliance, payload=tool)
    felt = partial(_felt, recording)
    return equilibrium(arm, posture, compliance, felt, spec.position, tool, spec.body)


def _felt(recording: Recording, standing: ArmState) -> Float[np.ndarray, "rows 6"]:
    """Return the wrench along the base's axes, without directions of noise only."""
    spec, (_, axes) = recording.wrench_sensor, _sensor(recording, standing)
    if spec is None or recording.wrench is None:
        return np.zeros((len(axes), 6))
    wrench = tared(recording, wrench_in_base(recording, standing), axes)
    return clear_channels(spec, wrench, axes)


def _sensor(recording: Recording, standing: ArmState) -> tuple[np.ndarray, np.ndarray]:
    """Return the sensor's origin and its own axes, in whatever axes it reports."""
    spec = recording.wrench_sensor
    if spec is None:
        return standing.point("flange", np.zeros(3)), standing.turn("flange")
    at = standing.point(spec.body, spec.position)
    return at, axes_of_sensor(spec, standing)


def screw_of(standing: ArmState) -> Float[np.ndarray, "rows axes 6"]:
    """Return the twist of all that an axis carries per radian (metre) along it."""
    along = standing.rotation[..., 2].swapaxes(0, 1)
    return _screw(along, standing.origin.swapaxes(0, 1), standing.chain.slides)


def _screw(
    along: Float[np.ndarray, "rows axes 3"],
    at: Float[np.ndarray, "rows axes 3"],
    slides: Bool[np.ndarray, " axes"],
) -> Float[np.ndarray, "rows axes 6"]:
    twist = np.concatenate([np.cross(at, along), along], axis=2)
    twist[:, slides] = np.concatenate([along, 0 * along], axis=2)[:, slides]
    return twist


def _midway(
    recording: Recording, rest: Float[np.ndarray, "rows axes"]
) -> Float[np.ndarray, "rows axes"]:
    """Return the links' posture with the mean wind-up of a row's visit.

    Lever arms are computed there, at the mean configuration of a visit: the bodies of a
    place move with it under load, and a constant rotation is independent of the load.
    """
    wound = rest - recording.posture
    return recording.posture + held_at_mean(recording.visit, wound)


def _places(standing: ArmState) -> tuple[np.ndarray, np.ndarray]:
    """Return origin and frame of every place."""
    axes, rows = standing.origin.shape[:2]
    origin = np.zeros((rows, axes + 1, 3))
    frame = np.tile(np.eye(3), (rows, axes + 1, 1, 1))
    origin[:, 1:] = standing.origin.transpose(1, 0, 2)
    frame[:, 1:] = standing.rotation.transpose(1, 0, 2, 3)
    return origin, frame


def _carried(
    recording: Recording, standing: ArmState, wrench: np.ndarray, sensor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return force and moment at every place."""
    chain = standing.chain
    origin, _ = _places(standing)
    force, moment = np.zeros_like(origin), np.zeros_like(origin)
    pulls = [
        (axis, mass * chain.gravity, at)
        for axis, mass, at in zip(*standing.masses(recording.tool), strict=True)
    ]
    pulls.append((-1, chain.foot_mass * chain.gravity, chain.foot_centre[None]))
    if recording.wrench is not None:
        felt = standing.attachment(felt_body(recording)).axis
        pulls.append((felt, wrench[:, :3], sensor))
    for axis, pull, at in pulls:
        for place in [0, *(k + 1 for k in chain.carriers(axis))]:
            arm = at - origin[:, place]
            force[:, place] += pull
            moment[:, place] += np.cross(arm, np.broadcast_to(pull, arm.shape))
    if recording.wrench is not None:
        felt = standing.attachment(felt_body(recording)).axis
        for place in [0, *(k + 1 for k in chain.carriers(felt))]:
            moment[:, place] += wrench[:, 3:]
    return force, moment
