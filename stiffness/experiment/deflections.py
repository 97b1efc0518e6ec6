"""Deflections of the end-effector from pairs of loaded and unloaded readings.

`LoadCases` holds postures and wrenches, `loaded_and_unloaded` pairs each loaded reading
with the unloaded reading of its visit, and `every_plateau` and `one_per_pose` return
the `Deflections`.

==========  ==========================================================================
Equation    d = R (mean of p_loaded - p_unloaded over markers seen in both readings)
            cov(d_i, d_j) = (delta_ij own_i + shared_i . shared_j) T
            + (delta_ij + 1) A_i S A_j^T within a visit, 0 between visits
            T: tracker, one reading; S: force sensor; A: deflection per wrench
Source      Wu et al. 2024, section 3.3: loaded minus unloaded, in the base's frame;
            JCGM 100:2008, 5.2, for the covariance
Needs       an unloaded reading in the visit; markers on the flange or the tool; wrench
Assumes     the markers do not slip and the base stands still within a visit; the
            tracker's volumetric error cancels over a few millimetres
==========  ==========================================================================

The wrench is the difference of the same two readings, which removes a sensor's bias and
constant loads.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np
from jaxtyping import Float, Int

from bench.shared.errors import Unusable
from bench.shared.recording import UNLOADED, Payload, Recording
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import TrackerFrame, tracker_frame
from stiffness.robot.wrench import sensor_in_flange, to_flange, wrench_in_base

# --- Noise of deflections ------------------------------------------------------------


@dataclass(frozen=True)
class Noise:
    """Stated noise of deflections, as contributions of tracker and force sensor.

    Attributes:
        tracker: Covariance of one reading of one target along the base's axes, m^2.
        own: Factor of it in each row from the loaded reading.
        shared: Factor of each target in a row's error from the unloaded reading.
        force: Standard deviation of a force, in N.
        torque: Standard deviation of a torque, in N m.
        visit: Index of the visit; its rows share their unloaded reading.
    """

    tracker: Float[np.ndarray, "3 3"]
    own: Float[np.ndarray, " rows"]
    shared: Float[np.ndarray, "rows targets"]
    force: float
    torque: float
    visit: Int[np.ndarray, " rows"]

    def sigma(self) -> Float[np.ndarray, "rows 3"]:
        """Return each row's standard deviation along the base's axes, in m."""
        share = self.own + np.sum(self.shared**2, axis=1)
        return np.sqrt(share[:, None] * np.diag(self.tracker))

    def whitener(
        self, per_wrench: Float[np.ndarray, "rows 3 6"] | None = None
    ) -> "Whitener":
        """Return the transform that makes errors independent with unit variance.

        Args:
            per_wrench: Deflection per wrench of each row, in m/N and m/(N m), which
                carries the force sensor's errors; None = no such errors.
        """
        visits, first, count = np.unique(
            self.visit, return_index=True, return_counts=True
        )
        order = np.argsort(self.visit, kind="stable")
        start = np.cumsum(count) - count
        assert len(first) == len(visits)
        blocks = []
        for n in np.unique(count):
            rows = order[start[count == n][:, None] + np.arange(n)]
            lower = np.linalg.cholesky(self._covariance(rows, per_wrench))
            blocks.append((rows, np.linalg.inv(lower)))
        return Whitener(tuple(blocks))

    def _covariance(
        self,
        rows: Int[np.ndarray, "visits n"],
        per_wrench: Float[np.ndarray, "rows 3 6"] | None,
    ) -> Float[np.ndarray, "visits coordinates coordinates"]:
        """Return the covariance of all coordinates of some visits of n rows each."""
        visits, n = rows.shape
        shared = self.shared[rows]
        share = shared @ shared.swapaxes(1, 2)
        share[:, np.arange(n), np.arange(n)] += self.own[rows]
        covariance = np.einsum("vij,ab->viajb", share, self.tracker)
        if per_wrench is not None:
            sigma = np.repeat([self.force, self.torque], 3)
            moved = per_wrench[rows] * sigma
            pairs = np.einsum("viaw,vjbw->viajb", moved, moved)
            covariance += pairs * (1.0 + np.eye(n))[:, None, :, None]
        return covariance.reshape(visits, 3 * n, 3 * n)


@dataclass(frozen=True)
class Whitener:
    """Transform of deflections to values with independent errors of unit variance.

    Attributes:
        blocks: Rows of equally long visits, and the inverse Cholesky factor of each.
    """

    blocks: tuple[tuple[np.ndarray, np.ndarray], ...]

    def __call__(
        self, values: Float[np.ndarray, "rows 3 columns"]
    ) -> Float[np.ndarray, "rows 3 columns"]:
        """Whiten each column; rows are combined within a visit only."""
        white = np.empty_like(values)
        for rows, inverse in self.blocks:
            visits, n = rows.shape
            stacked = values[rows].reshape(visits, 3 * n, -1)
            white[rows] = (inverse @ stacked).reshape(visits, n, 3, -1)
        return white


def noise_of_pairs(
    recording: Recording,
    chosen: Int[np.ndarray, " markers"],
    weight: Float[np.ndarray, "rows markers"],
    pair: tuple[np.ndarray, np.ndarray],
    turn: Float[np.ndarray, "3 3"],
) -> Noise:
    """Return the noise of deflections from that of readings, by targets.

    Args:
        recording: With the stated noise of tracker and force sensor.
        chosen: The markers that were averaged; those of a target share their error.
        weight: Weight of each marker in each row's mean.
        pair: The recording's loaded rows, and the row each is compared with.
        turn: Rotation from the tracker's axes to the base's.
    """
    tracker, sensor = recording.tracker, recording.wrench_sensor
    assert tracker is not None and sensor is not None
    markers = [recording.markers[k] for k in chosen]
    names = [m.name if m.target is None else f"target {m.target}" for m in markers]
    belongs = np.array(names)[:, None] == np.unique(names)
    by_target = weight @ belongs.astype(float)
    loaded, unloaded = pair
    count = (
        np.ones(len(recording.time)) if recording.frames is None else recording.frames
    )
    return Noise(
        tracker=(turn * tracker.repeatability**2) @ turn.T,
        own=np.sum(by_target**2, axis=1) / count[loaded],
        shared=by_target / np.sqrt(count[unloaded])[:, None],
        force=sensor.accuracy_force,
        torque=sensor.accuracy_torque,
        visit=recording.visit[loaded],
    )


# --- Load cases -----------------------------------------------------------------------


@dataclass(frozen=True)
class LoadCases:
    """Static load cases to predict deflections for, one per row.

    The deflection is the displacement of the end-effector point, along the base's axes,
    when the wrench is applied to an arm that already bends under its own weight.

    Attributes:
        posture: Joint angles that the motors hold, in rad.
        wrench_in_base: What the world exerts on the robot: force in N, then torque in
            N m about `origin_in_flange`, along the base's axes.
        point_in_flange: The end-effector point of each case, in the flange's frame, m.
        origin_in_flange: The sensor's origin in the flange's frame, in m.
        payload: What is mounted beyond the model; None = nothing.

    Raises:
        Unusable: Where arrays disagree in shape or hold values that are not finite,
            naming all.
    """

    posture: Float[np.ndarray, "cases axes"]
    wrench_in_base: Float[np.ndarray, "cases 6"]
    point_in_flange: Float[np.ndarray, "cases 3"]
    origin_in_flange: Float[np.ndarray, "3"] = field(
        default_factory=lambda: np.zeros(3)
    )
    payload: Payload | None = None

    def __post_init__(self):
        """Check shapes and numbers."""
        cases = len(self.posture)
        faults = []
        for name, columns in (("wrench_in_base", 6), ("point_in_flange", 3)):
            shape = np.shape(getattr(self, name))
            if shape != (cases, columns):
                faults.append(f"{name} is {shape}, expected {(cases, columns)}.")
        for name in ("posture", "wrench_in_base", "point_in_flange"):
            value = getattr(self, name)
            if not np.isfinite(value).all():
                row = int(np.argwhere(~np.isfinite(value))[0][0])
                faults.append(f"{name}, row {row}: not a number.")
        if faults:
            raise Unusable("The load cases", faults)

    def __len__(self) -> int:
        """Return the number of cases."""
        return len(self.posture)

    def take(self, rows: np.ndarray) -> "LoadCases":
        """Return the same with only these rows (indices or a mask)."""
        return replace(
            self,
            posture=self.posture[rows],
            wrench_in_base=self.wrench_in_base[rows],
            point_in_flange=self.point_in_flange[rows],
        )


# --- Pairs of loaded and unloaded readings --------------------------------------------


def loaded_and_unloaded(
    recording: Recording,
) -> tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]:
    """Pair every loaded row with the first unloaded row of its visit.

    A row is loaded where its stage is not `unloaded` and, if the mass on the hook is
    known, it is not zero. Where a visit marks no row as unloaded, its first is used.

    Returns:
        The loaded rows in the order of time, and the row each is compared with.
    """
    loaded = recording.stage != UNLOADED
    if recording.load_mass is not None:
        loaded = loaded & (recording.load_mass > 0.0)
    rows = np.arange(len(recording.time))
    last = len(rows)
    _, number = np.unique(recording.visit, return_inverse=True)
    start = np.full(number.max(initial=-1) + 1, 2 * last)
    np.minimum.at(start, number, rows + last * (recording.stage != UNLOADED))
    compared = start[number] % last
    loaded = loaded & (rows != compared)
    return rows[loaded], compared[loaded]


def usable(arm: Arm, recording: Recording) -> Int[np.ndarray, " markers"]:
    """Return the end-effector's markers; refuse recordings without deflections.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: Any recording.

    Returns:
        The markers on the flange; else on the tool; else on bodies fixed to them.

    Raises:
        Unusable: With every reason why there are no deflections, and what to add.
    """
    faults = []
    bad = np.argwhere(~np.isfinite(recording.posture))
    for axis in np.unique(bad[:, 1]):
        rows = bad[bad[:, 1] == axis, 0]
        first = f"row {rows[0]}" + (f" and {len(rows) - 1} more" * (len(rows) > 1))
        faults.append(f"the posture of axis {arm.axes[axis]} is no number in {first}.")
    if recording.rows != "plateaus":
        faults.append("its rows are a stream; take plateaus, where the arm rests.")
    if recording.wrench is None or recording.wrench_sensor is None:
        faults.append("there is no wrench: give fx_n … tz_nm and [sensors.wrench].")
    elif not np.isfinite(recording.wrench).all():
        row = int(np.argwhere(~np.isfinite(recording.wrench))[0][0])
        faults.append(f"the wrench is no number in row {row}.")
    if recording.tracker is None:
        faults.append("the tracker's noise is unknown: give [sensors.tracker].")
    chosen = end_effector_markers(arm, recording)
    if not len(chosen):
        faults.append("no marker is on the flange or the tool; put one there.")
    unknown = [k for k in chosen if recording.markers[k].position is None]
    if unknown and recording.displacement == "relative":
        faults.append("relative readings need position_mm of the flange's markers.")
    if faults:
        raise Unusable(f"Recording {recording.name!r}", faults)
    return chosen


def end_effector_markers(arm: Arm, recording: Recording) -> Int[np.ndarray, " markers"]:
    """Return markers on the flange; else on the tool; else on bodies fixed to them."""
    bodies = [marker.body for marker in recording.markers]
    for wanted in ("flange", "tool"):
        goal = arm.bodies.get(wanted, wanted)
        found = [k for k, b in enumerate(bodies) if arm.bodies.get(b, b) == goal]
        if found:
            return np.array(found)
    last = arm.attachment("flange").axis
    found = [k for k, body in enumerate(bodies) if arm.attachment(body).axis == last]
    return np.array(found, dtype=int)


# --- Deflections ----------------------------------------------------------------------


@dataclass(frozen=True)
class Deflections:
    """Deflections of the end-effector with their load cases, one row per reading.

    Attributes:
        cases: Posture, wrench and end-effector point: the mean nominal place of the
            markers of that row.
        deflection: Along the base's axes, in m.
        posture_id: Id of the posture visited.
        row: The recording's row of the loaded reading.
        noise: Noise by the instruments' specifications.
        frame: Tracker frame, and its source.
        wrench_in_flange: The wrench along the flange's axes, where the sensor turns
            with it; None where it was given along the base's.
    """

    cases: LoadCases
    deflection: Float[np.ndarray, "rows 3"]
    posture_id: Int[np.ndarray, " rows"]
    row: Int[np.ndarray, " rows"]
    noise: Noise
    frame: TrackerFrame
    wrench_in_flange: Float[np.ndarray, "rows 6"] | None

    @property
    def visit(self) -> Int[np.ndarray, " rows"]:
        """Index of each row's visit; its rows share their unloaded reading."""
        return self.noise.visit

    @property
    def sigma(self) -> Float[np.ndarray, "rows 3"]:
        """Each row's standard deviation by the tracker, in m."""
        return self.noise.sigma()

    def take(self, rows: np.ndarray) -> "Deflections":
        """Return the same with only these rows (indices or a mask)."""
        noise, turning = self.noise, self.wrench_in_flange
        return replace(
            self,
            cases=self.cases.take(rows),
            deflection=self.deflection[rows],
            posture_id=self.posture_id[rows],
            row=self.row[rows],
            noise=replace(
                noise,
                own=noise.own[rows],
                shared=noise.shared[rows],
                visit=noise.visit[rows],
            ),
            wrench_in_flange=None if turning is None else turning[rows],
        )


Selection: TypeAlias = Callable[
    [Arm, Recording, Float[np.ndarray, " axes"] | None], Deflections
]
"""Function that takes deflections from a recording: `every_plateau`, `one_per_pose`."""


def every_plateau(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"] | None = None,
) -> Deflections:
    """Compare every loaded reading with the unloaded one of its visit.

    Args:
        arm: The nominal arm, with the recording's names.
        recording: Plateaus with markers on the flange, else the tool, and a wrench.
        compliance: Springs on which the unloaded arm sags, in rad/(N m); only used
            where the tracker's frame is estimated from the arm's markers.

    Returns:
        One row per loaded plateau whose visit has an unloaded reading.

    Raises:
        Unusable: Where the recording contains no deflections, with all faults.
    """
    chosen = usable(arm, recording)
    points, tracker = recording.points, recording.tracker
    sensor = recording.wrench_sensor
    assert points is not None and tracker is not None and sensor is not None
    loaded, unloaded = loaded_and_unloaded(recording)
    moved = points[loaded][:, chosen] - points[unloaded][:, chosen]
    seen = np.asarray(np.isfinite(moved).all(axis=-1))
    some = seen.any(axis=-1)
    loaded, unloaded, moved, seen = (a[some] for a in (loaded, unloaded, moved, seen))
    if not len(loaded):
        fault = "no visit has both a loaded and an unloaded reading of a marker."
        raise Unusable(f"Recording {recording.name!r}", [fault])
    weight = seen / seen.sum(axis=1, keepdims=True)
    frame = tracker_frame(arm, recording, compliance)
    turn = frame.base_from_tracker[:3, :3]
    places = _places(arm, recording, chosen, frame)
    standing = arm.at(recording.posture)
    wrench = wrench_in_base(recording, standing)
    wrench = wrench[loaded] - wrench[unloaded]
    turning = None
    if sensor.frame == "sensor":
        flange = standing.turn("flange")[loaded]
        parts = [np.einsum("cji,cj->ci", flange, wrench[:, k : k + 3]) for k in (0, 3)]
        turning = np.concatenate(parts, axis=1)
    return Deflections(
        cases=LoadCases(
            posture=recording.posture[loaded],
            wrench_in_base=wrench,
            point_in_flange=weight @ places,
            origin_in_flange=sensor_in_flange(arm, recording),
            payload=recording.tool,
        ),
        deflection=np.einsum(
            "cm,cmi->ci", weight, np.where(seen[..., None], moved, 0.0)
        )
        @ turn.T,
        posture_id=recording.posture_id[loaded],
        row=loaded,
        noise=noise_of_pairs(recording, chosen, weight, (loaded, unloaded), turn),
        frame=frame,
        wrench_in_flange=turning,
    )


def one_per_pose(
    arm: Arm,
    recording: Recording,
    compliance: Float[np.ndarray, " axes"] | None = None,
) -> Deflections:
    """Return the first reading of every pose under its largest load; see above."""
    every = every_plateau(arm, recording, compliance)
    force = np.linalg.norm(every.cases.wrench_in_base[:, :3], axis=1)
    mass = recording.load_mass
    heavy = force if mass is None else mass[every.row]
    slack = 0.01 if mass is None else 0.0  # readings of one weight differ by noise
    kept = []
    for pose in np.unique(every.posture_id):
        rows = np.flatnonzero(every.posture_id == pose)
        heaviest = rows[heavy[rows] >= (1.0 - slack) * heavy[rows].max()]
        kept.append(heaviest[0])
    return every.take(np.array(kept))


def _places(
    arm: Arm,
    recording: Recording,
    chosen: Int[np.ndarray, " markers"],
    frame: TrackerFrame,
) -> Float[np.ndarray, "markers 3"]:
    """Return the markers' places in the flange's frame, in m; fitted if not stated."""
    assert recording.points is not None
    places = []
    for k in chosen:
        marker = recording.markers[k]
        if marker.position is not None:
            what = f"Marker {marker.name!r}"
            places.append(to_flange(arm, marker.body, what, marker.position))
            continue
        seen = np.isfinite(recording.points[:, k]).all(axis=1)
        flange = arm.at(recording.posture[seen]).placement("flange")
        base_from_tracker = frame.base_from_tracker
        point = recording.points[seen, k] @ base_from_tracker[:3, :3].T
        point = point + base_from_tracker[:3, 3] - flange[:, :3, 3]
        places.append(np.einsum("cji,cj->ci", flange[:, :3, :3], point).mean(axis=0))
    return np.stack(places)
