"""Simulation of a recording: replay of states and wrenches, simulated readings.

Rows become steps of a visit. Where a load changed a while after the reading before,
the load before goes on acting unread until then; visits shorter than the longest end
in steps that nobody reads.

What instruments with faults read, forwards or backwards (`reading_of`):

==========  ==========================================================================
Equation    tracker: as `bench.instruments.tracker`, noise left out; force sensor:
            wrench = [F; T + offset x F], F and T the halves of
            exp(mounting) (1 + gain)^-1 (reading - bias)
Source      the instruments' own equations
Valid       faults that the instruments know
Ignores     noise
==========  ==========================================================================

What the simulator leaves of a recording (`ReplaySimulation.see`):

==========  ==========================================================================
Equation    residual = R p_tracker + t - p, p where the marker is in the simulation
Source      definition; faults of instruments in `bench.proof.simulation`
Valid       a recording whose axes are all of the arm's
Ignores     noise
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bench.effects.effect import Effect, InstrumentEffect, RopeEffect
from bench.equilibrium import GearStates
from bench.experiment import faulty
from bench.instruments import ForceSensor, Instruments, Markers, Tracker
from bench.instruments.tracker import STILL, displaced, inverse, misplacement
from bench.patch import Patch
from bench.rig import Memory, Rig, States
from bench.shared.recording import LastMoves, Recording, transform_of

STARTS = (-1.0, 0.0, 1.0)
"""Torque of what slips in a gear at arrival, over the one at which it slips, one as
likely as the other, where nothing tells it; chosen: it comes from either side, or from
rest."""
BY_ROW = ("position", "rotation", "axis_angle", "wrench")

# --- Replay ---------------------------------------------------------------------------

SAME = 1e-7
"""Change of a posture within a visit that is none, in rad; chosen: an encoder's last
digit."""
QUICK = 1e-9
"""How long a step lasts that nobody reads, in s."""
SOON = 1e-3
"""Share of a hold that may pass before the load changes; chosen: no creep shows it."""


@dataclass(frozen=True)
class Replay:
    """Visits, each of the same number of steps.

    Attributes:
        posture: Of each visit, in rad (slides in m).
        row: Whose wrench acts in each step.
        read: Whether that row is read at the end of the step.
        hold: For how long each step lasts, in s.
        visit: Index of each row's stay, from 0, by which differences are taken.
        way: How long the way to each visit took, in s; the first has none.
        moves: How each axis arrived at each visit.
    """

    posture: Float[np.ndarray, "visits axes"]
    row: Int[np.ndarray, "visits steps"]
    read: Bool[np.ndarray, "visits steps"]
    hold: Float[np.ndarray, "visits steps"]
    visit: Int[np.ndarray, " rows"]
    way: Float[np.ndarray, " visits"]
    moves: LastMoves

    @property
    def rows(self) -> int:
        """How many rows there are."""
        return len(self.visit)

    def to_rows(self, values: np.ndarray) -> np.ndarray:
        """Bring values of all steps, visit after visit, back to the rows."""
        order = np.empty(self.rows, dtype=int)
        order[self.row[self.read]] = np.flatnonzero(self.read.ravel())
        return values[order]


def replay_of(recording: Recording, waits: bool = True) -> Replay:
    """Lay out what was done in a recording; `waits`: something creeps, time matters."""
    visit = np.unique(recording.visit, return_inverse=True)[1]
    starts = np.flatnonzero(np.diff(visit, prepend=-1))
    stays = np.split(np.arange(len(visit)), starts[1:])
    posture = recording.posture
    still = all(np.ptp(posture[rows], axis=0).max() < SAME for rows in stays)
    if not still:  # a stream: each instant is a state of its own
        stays = [np.array([row]) for row in range(len(visit))]
    steps = [_steps(recording, rows, waits) for rows in stays]
    longest = max(len(s) for s in steps)
    shape = (len(stays), longest)
    row, read, hold = np.zeros(shape, int), np.zeros(shape, bool), np.zeros(shape)
    for v, course in enumerate(steps):
        own = list(zip(*course, strict=True))
        row[v], hold[v] = own[0][-1], QUICK
        row[v, : len(course)], read[v, : len(course)], hold[v, : len(course)] = own
    first = np.array([rows[0] for rows in stays])
    last = np.array([rows[-1] for rows in stays])
    way = np.zeros(len(stays))
    way[1:] = np.maximum(
        recording.load_time[first[1:]] - recording.time[last[:-1]], 0.0
    )
    hold, moves = np.maximum(hold, QUICK), recording.moves.take(first)
    return Replay(posture[first], row, read, hold, visit, way, moves)


def _steps(
    recording: Recording, rows: np.ndarray, waits: bool
) -> list[tuple[int, bool, float]]:
    """Return whose wrench acts, whether it is read, and for how long, step by step."""
    time, changed = recording.time, recording.load_time
    course: list[tuple[int, bool, float]] = []
    before: int | None = None
    for row in rows:
        begins = float(changed[row] if before is None else time[before])
        change = float(np.clip(changed[row], begins, time[row]))
        total = float(time[row] - begins)
        if before is not None and waits and change - begins > SOON * total:
            course.append((before, False, float(change - begins)))
            total = float(time[row] - change)
        course.append((int(row), True, total))
        before = int(row)
    return course


# --- Readings of faulty instruments ---------------------------------------------------


def true_wrench(
    sensor: ForceSensor, reading: Float[np.ndarray, "rows 6"]
) -> Float[np.ndarray, "rows 6"]:
    """Return the wrench that a sensor with these faults reads so, along true axes."""
    crosstalk = np.eye(6) + np.array(sensor.gain)
    felt = np.linalg.solve(crosstalk, (reading - np.array(sensor.bias)).T).T
    seated = Rotation.from_rotvec(sensor.mounting)
    force, torque = (seated.apply(part) for part in np.hsplit(felt, 2))
    return np.hstack([force, torque + np.cross(sensor.offset, force)])


def direction(recording: Recording) -> Float[np.ndarray, " rows"]:
    """Return +1 where the load last grew, -1 where it last fell, visit by visit."""
    mass = recording.load_mass
    if mass is None:
        assert recording.wrench is not None
        mass = np.linalg.norm(recording.wrench[:, :3], axis=1)
    sign, last = np.ones(len(mass)), 1.0
    for row in range(1, len(mass)):
        same = recording.visit[row] == recording.visit[row - 1]
        change = np.sign(mass[row] - mass[row - 1]) if same else 1.0
        last = change or last
        sign[row] = last
    return sign


def reading_of(
    tracker: Tracker,
    frame: tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]],
    point: Float[np.ndarray, "rows markers 3"],
    time: Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows markers 3"]:
    """Return what a tracker would read, in its own frame, in m.

    The frame is R and t of p_base = R p_tracker + t, as stated or fitted; points are in
    the base's frame, in m, the time in s.
    """
    if (tracker.base_drift, tracker.drift, tracker.frame_error) == ((), (), None):
        seen = (point - frame[1]) @ frame[0]
        return (1.0 + tracker.scale) * seen
    error = misplacement(tracker.frame_error or STILL)
    true = np.linalg.inv(error) @ transform_of(*frame)
    seen = inverse(true, displaced(point, tracker.base_drift, time))
    return displaced((1.0 + tracker.scale) * seen, tracker.drift, time)


def turned(
    wrench: Float[np.ndarray, "rows 6"], turn: Float[np.ndarray, "rows 3 3"]
) -> Float[np.ndarray, "rows 6"]:
    """Turn force and torque alike, row by row."""
    halves = [np.einsum("nij,nj->ni", turn, part) for part in np.hsplit(wrench, 2)]
    return np.hstack(halves)


# --- Simulated readings ---------------------------------------------------------------


@dataclass(frozen=True)
class NominalState:
    """All that a simulation takes to be so.

    Attributes:
        turn: R in p_base = R p_tracker + shift, as stated or fitted.
        shift: In m.
        marker_positions: Of each marker in its body's frame, in m.
    """

    rig: Rig
    turn: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]
    marker_positions: Float[np.ndarray, "markers 3"]


@dataclass(frozen=True)
class SimulatedReadings:
    """What a simulation left over, and what is needed to do better.

    Attributes:
        point: Where markers are, in the base's frame, in m.
        residual: Reading less simulation along the base's axes, in m; NaN = not seen.
        angle: The same of encoders after the gears, in rad; None without.
    """

    states: States
    point: Float[np.ndarray, "rows markers 3"]
    residual: Float[np.ndarray, "rows markers 3"]
    angle: Float[np.ndarray, "rows axes"] | None


@dataclass(frozen=True)
class ReplaySimulation:
    """A recording, laid out for the simulator.

    Attributes:
        order: Which of the arm's axes is the recording's a1, a2 …
        body: The model's name of each marker's body.
        sensor_axes: Axes along which the sensor reads, as columns, in the base's frame.
        weight: Of what hangs beyond the sensor, where the readings still hold it, about
            the sensor's origin along the base's axes, in N and N m.
        base: Where the base stands in the world, in m, and how it is turned.
        memory: Whether gears keep what slipped and crept from visit to visit.
        memories: The same of single axes' gears; of those in an unknown state the mean
            over `STARTS` is simulated.
    """

    recording: Recording
    replay: Replay
    order: Int[np.ndarray, " axes"]
    body: tuple[str, ...]
    sensor_axes: Float[np.ndarray, "rows 3 3"]
    weight: Float[np.ndarray, "rows 6"]
    base: tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]
    memory: Memory = "forgotten"
    memories: Mapping[str, str] = field(default_factory=dict)
    _known: dict = field(default_factory=dict, repr=False)

    def see(self, assumed: NominalState) -> SimulatedReadings:
        """Simulate and compare."""
        return self.read(assumed, self.states(assumed.rig))

    def read(self, assumed: NominalState, states: States) -> SimulatedReadings:
        """Compare the readings with states that were simulated."""
        rig, recording = assumed.rig, self.recording
        faults = faulty(_perfect(), rig)
        places = assumed.marker_positions
        point = self.points(rig, states, places, faults.markers)
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
        return SimulatedReadings(states, point, residual, angle)

    def states(
        self, rig: Rig, keep: bool = True, about: States | None = None
    ) -> States:
        """Simulate; what was asked the last few times is remembered.

        A small change of an arm is simulated with what gears bring to each visit
        `about` it: one visit after the other takes six times as long.
        """
        key = _mechanical(rig)
        if key in self._known:
            return self._known[key]
        states = self._simulated(rig, about)
        if keep:
            if len(self._known) > 4:
                del self._known[next(iter(self._known))]
            self._known[key] = states
        return states

    def points(
        self,
        rig: Rig,
        states: States,
        marker_positions: Float[np.ndarray, "markers 3"],
        slipping: Markers | None = None,
    ) -> Float[np.ndarray, "rows markers 3"]:
        """Return where markers are in some states, in the base's frame, in m."""
        base, turn = self.base
        point = np.empty((len(states.axis_angle), len(self.body), 3))
        for m, marker in enumerate(self.recording.markers):
            own = marker_positions[m]
            if slipping is not None and slipping.slips:
                own = own + slipping.slipped(marker.name, self.recording.time)
            at = rig.mark(states, self.body[m], own)
            point[:, m] = (at - base) @ turn
        return point

    def part(self, rows: Bool[np.ndarray, " rows"]) -> "ReplaySimulation":
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

    def remembering(self, patch: Patch) -> "ReplaySimulation":
        """Return the world whose gears remember what a patch says."""
        return replace(self, memory=patch.memory, memories=patch.memories)

    def _by_memory(self, rig: Rig, kind: str) -> tuple[str, ...]:
        """Return the arm's axes whose gears remember so."""
        said = {rig.anatomy.axis(where): one for where, one in self.memories.items()}
        every = rig.remembering
        return tuple(axis for axis in every if said.get(axis, self.memory) == kind)

    def untold(self, rig: Rig) -> tuple[str, ...]:
        """Return the axes in which something slips from a state that nothing tells."""
        return tuple(a for a in self._by_memory(rig, "unknown") if a in rig.slipping)

    def begun(
        self, rig: Rig, told: GearStates | None, share: Mapping[str, float]
    ) -> GearStates:
        """Return what arrives with shares of the torque at which axes' gears slip."""
        visits = len(self.replay.posture)
        more = {
            tendon: np.full(visits, size)
            for axis, size in share.items()
            for tendon in rig.slipping[axis]
        }
        told = GearStates() if told is None else told
        return replace(told, slipped={**told.slipped, **more})

    def _simulated(self, rig: Rig, about: States | None) -> States:
        told, every = None, rig.remembering
        if carried := self._by_memory(rig, "carried"):
            whole = self.responded(rig, in_turn=True) if about is None else about
            others = {name for a in every if a not in carried for name in every[a]}
            if about is None and not others:
                return whole
            told = None if whole.initial is None else whole.initial.leaving_out(others)
        untold = self.untold(rig)
        if not untold:
            return self.responded(rig, told)
        of_starts = [
            self.responded(rig, self.begun(rig, told, dict.fromkeys(untold, s)))
            for s in STARTS
        ]
        mean = {
            name: np.mean([getattr(states, name) for states in of_starts], axis=0)
            for name in BY_ROW
        }
        return replace(of_starts[0], **mean, initial=told)

    def responded(
        self, rig: Rig, initial: GearStates | None = None, in_turn: bool = False
    ) -> States:
        """Simulate from what arrives, or visit after visit; see `Rig.respond`."""
        replay, axes = self.replay, len(rig.anatomy.axes)
        posture = np.zeros((len(replay.posture), axes))
        posture[:, self.order] = replay.posture
        moves = replay.moves.of_axes(self.order, axes)
        wrench = self.wrench(rig)[replay.row]
        way = replay.way if in_turn else None
        states = rig.respond(posture, wrench, replay.hold, way, moves, initial)
        by_row = {name: replay.to_rows(getattr(states, name)) for name in BY_ROW}
        return replace(states, **by_row)

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
