"""The simulator does what a recording did and says what its instruments would read.

==========  ==========================================================================
Equation    residual = R p_tracker + t - p, p where the marker is in the simulation
Source      definition; faults of instruments in `bench.proving.sensing`
Valid       a recording whose axes are all of the arm's
Ignores     noise
==========  ==========================================================================
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from bench.effects.effect import Effect, RopeEffect
from bench.effects.instrument_effect import InstrumentEffect
from bench.experiment import faulty
from bench.instruments import ForceSensor, Instruments, Markers, Tracker
from bench.proving.replay import QUICK, Replay, replay_of
from bench.proving.sensing import direction, reading_of, true_wrench, turned
from bench.recording import Recording
from bench.rig import Rig
from bench.states import States


@dataclass(frozen=True)
class Assumed:
    """All that a simulation takes to be so.

    Attributes:
        rig: Arm, springs and effects.
        turn: R in p_base = R p_tracker + shift, as stated or fitted.
        shift: In m.
        place: Of each marker in its body's frame, in m.
    """

    rig: Rig
    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    place: Float[np.ndarray, "markers 3"]


@dataclass(frozen=True)
class Seen:
    """What a simulation left over, and what is needed to do better.

    Attributes:
        states: Where everything was.
        point: Where markers are, in the base's frame, in m.
        residual: Reading less simulation along the base's axes, in m; NaN = not seen.
        angle: The same of encoders after the gears, in rad; None without.
    """

    states: States
    point: Float[np.ndarray, "rows markers 3"]
    residual: Float[np.ndarray, "rows markers 3"]
    angle: Float[np.ndarray, "rows axes"] | None


@dataclass(frozen=True)
class World:
    """A recording, laid out for the simulator.

    Attributes:
        recording: What was done and seen.
        replay: How its rows follow each other.
        order: Which of the arm's axes is the recording's a1, a2 …
        body: The model's name of each marker's body.
        sensor_axes: Axes along which the sensor reads, as columns, in the base's frame.
        weight: Of what hangs beyond the sensor, where the readings still hold it, about
            the sensor's origin along the base's axes, in N and N m.
        base: Where the base stands in the world, in m, and how it is turned.
    """

    recording: Recording
    replay: Replay
    order: Int[np.ndarray, " axes"]
    body: tuple[str, ...]
    sensor_axes: Float[np.ndarray, "rows 3 3"]
    weight: Float[np.ndarray, "rows 6"]
    base: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]
    _known: dict = field(default_factory=dict, repr=False)

    def see(self, assumed: Assumed) -> Seen:
        """Simulate and compare."""
        rig, recording = assumed.rig, self.recording
        states = self.states(rig)
        faults = faulty(_perfect(), rig)
        point = self.points(states, assumed.place, faults.markers)
        angle = None
        if recording.link_posture is not None:
            angle = recording.link_posture - states.axis_angle[:, self.order]
        residual = np.full(point.shape, np.nan)
        if recording.points is not None:
            reading = reading_of(
                faults.tracker, (assumed.turn, assumed.shift), point, recording.time
            )
            residual = (recording.points - reading) @ assumed.turn.T
            if recording.displacement == "relative":  # the first row is zero
                first = self.first_rows()
                residual = recording.points @ assumed.turn.T - (point - point[first])
        return Seen(states, point, residual, angle)

    def states(self, rig: Rig) -> States:
        """Simulate; what was asked last time is remembered."""
        key = _mechanical(rig)
        if key not in self._known:
            if len(self._known) > 4:
                self._known.clear()
            self._known[key] = self._simulated(rig)
        return self._known[key]

    def points(
        self,
        states: States,
        place: Float[np.ndarray, "markers 3"],
        slipping: Markers | None = None,
    ) -> Float[np.ndarray, "rows markers 3"]:
        """Return where markers are in some states, in the base's frame, in m."""
        base, turn = self.base
        point = np.empty((len(states.axis_angle), len(self.body), 3))
        for m, marker in enumerate(self.recording.markers):
            own = place[m]
            if slipping is not None and slipping.slips:
                own = own + slipping.slipped(marker.name, self.recording.time)
            b = states.bodies.index(self.body[m])
            at = (states.rotation[:, b] @ own[..., None])[..., 0]
            point[:, m] = (at + states.position[:, b] - base) @ turn
        return point

    def part(self, rows: Bool[np.ndarray, " rows"]) -> "World":
        """Return the world of some visits alone."""
        recording = self.recording.take(rows)
        waits = bool(np.any(~self.replay.read & (self.replay.hold > QUICK)))
        return replace(
            self,
            recording=recording,
            replay=replay_of(recording, waits),
            sensor_axes=self.sensor_axes[rows],
            weight=self.weight[rows],
            _known={},
        )

    def first_rows(self) -> Int[np.ndarray, " rows"]:
        """Return the first row of each row's visit."""
        _, first, index = np.unique(self.replay.visit, True, True)
        return first[index]

    def _simulated(self, rig: Rig) -> States:
        replay, axes = self.replay, len(rig.anatomy.axes)
        posture = np.zeros((len(replay.posture), axes))
        posture[:, self.order] = replay.posture
        wrench = self.wrench(rig)[replay.row]
        states = rig.respond(posture, wrench, replay.hold)
        return replace(
            states,
            position=replay.to_rows(states.position),
            rotation=replay.to_rows(states.rotation),
            axis_angle=replay.to_rows(states.axis_angle),
            wrench=replay.to_rows(states.wrench),
        )

    def wrench(self, rig: Rig) -> Float[np.ndarray, "rows 6"]:
        """Return what pulled at the sensor, along the base's axes, in N and N m."""
        recording = self.recording
        if recording.wrench is None or recording.wrench_sensor is None:
            return np.zeros((self.replay.rows, 6))
        sensor = faulty(_perfect(), rig).force_sensor
        along, reading = self.sensor_axes, recording.wrench
        if recording.wrench_sensor.frame == "base":
            reading = turned(reading, along.transpose(0, 2, 1))
        felt = true_wrench(sensor, reading)
        for effect in rig.effects:
            if isinstance(effect, RopeEffect):
                unit = np.ones(self.replay.rows)
                change = effect.tension(unit, direction(recording))
                felt = felt * (1.0 + change)[:, None]
        return turned(felt, along) - self.weight


def _perfect() -> Instruments:
    return Instruments(Tracker(), ForceSensor(), markers=Markers())


def _mechanical(rig: Rig) -> tuple:
    """Return what a simulation depends on: not on what happens in the tracker."""
    parts: list[Effect] = [
        e
        for e in rig.effects
        if not isinstance(e, InstrumentEffect) or e.where == "wrench_sensor"
    ]
    return (tuple(sorted(map(repr, parts))), rig.springs.tobytes())
