"""Model of a calibration: readings, spatial folds, corrected geometry, arm state.

`Readings` are the target positions of the unloaded rows, `SpatialFolds` their split for
validation, `Geometry` the corrections of a rigid arm and `CalibrationState` the arm in
all postures, with the Jacobians of its predictions and the moments of gravity.

Spatial folds (`spatial_folds_of`), since neighbouring poses share their errors:

==========  ==========================================================================
Equation    k-means over the places of targets in the base's frame; whole regions go to
            the hold-out, the others in turn to folds; seeds from SHA-256 of the
            readings, before anything is fitted
Source      leave-group-out validation; Lloyd 1982, "Least squares quantization in PCM"
Valid       at least as many poses as regions
Ignores     the larger distance of regions at the edge from the others
==========  ==========================================================================

Corrections of the geometry (`corrected_chain`, `columns`):

==========  ==========================================================================
Equation    q = q_reported + offset; the seat of the next axis in its link's frame:
            p' = p + (x, y, z), R' = exp([(rx, ry, rz)]x) R
Source      Mooring, Roth, Driels 1991, "Fundamentals of manipulator calibration";
            rotation vector (Rodrigues 1840)
Valid       always
Ignores     nothing of a rigid arm: tracker frame and target positions take up the rest
==========  ==========================================================================
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.cluster.vq import kmeans2
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.recording import UNLOADED, DrawingAccuracy, Payload, Recording
from stiffness.experiment.visits import commanded_lags
from stiffness.robot.arm import Arm
from stiffness.robot.chain import Chain, Place
from stiffness.robot.kinematics import ArmState

# --- Readings without a load ----------------------------------------------------------

FEWEST = 30
"""Minimum number of poses; chosen: as many as the parameters of a six-axis arm's
geometry."""


@dataclass(frozen=True)
class Readings:
    """Target positions at rest without load: a row per pose and target, by time.

    Attributes:
        arm: The nominal arm.
        posture: Reported joint angles, in rad (m for a prismatic axis).
        side: Direction in which each axis last moved: −1, 0 (unknown), 1.
        seen: Position of the target, in the tracker's frame, in m.
        marker: Index of the target in `names`.
        posture_id: Id of the pose.
        hours: Time since the middle of the recording, in h.
        names: Names of the targets.
        bodies: Bodies that the targets sit on.
        places: Nominal target positions in their bodies' frames, in m; zero where
            unknown.
        stated: Stated standard deviation of a coordinate, in m; NaN where not stated.
        tool: What the arm carries besides its own weight, on the flange.
        told_lag: How far each reported angle lags behind its command, in rad; NaN =
            no command was recorded.
        placed: Whether a target's nominal position is stated.
        drawing: How true the model is taken to be.
    """

    arm: Arm
    posture: Float[np.ndarray, "rows axes"]
    side: Float[np.ndarray, "rows axes"]
    seen: Float[np.ndarray, "rows 3"]
    marker: Int[np.ndarray, " rows"]
    posture_id: Int[np.ndarray, " rows"]
    hours: Float[np.ndarray, " rows"]
    names: tuple[str, ...]
    bodies: tuple[str, ...]
    places: Float[np.ndarray, "markers 3"]
    stated: float
    tool: Payload
    told_lag: Float[np.ndarray, " axes"]
    placed: Bool[np.ndarray, " markers"]
    drawing: DrawingAccuracy

    def take(self, rows: np.ndarray) -> "Readings":
        """Return the same with only these rows (indices or a mask)."""
        return Readings(
            self.arm, self.posture[rows], self.side[rows], self.seen[rows],
            self.marker[rows], self.posture_id[rows], self.hours[rows],
            self.names, self.bodies, self.places, self.stated, self.tool,
            self.told_lag,
            self.placed, self.drawing,
        )  # fmt: skip


def readings_of(recording: Recording, arm: Arm) -> Readings:
    """Return the unloaded rows of a recording: a mean for each visit and target.

    Of a 6D target only the first point is used; its rotation is kept for a check.

    Raises:
        Unusable: Where no target was tracked, positions are relative only, or there
            are too few poses.
    """
    faults = []
    if not recording.markers or recording.points is None:
        faults.append("nothing was tracked; calibration needs a target's positions.")
    if recording.displacement != "absolute":
        faults.append('displacement is "relative"; calibration needs "absolute".')
    if recording.rows != "plateaus":
        faults.append('rows are a "stream"; calibration needs "plateaus".')
    if not faults and len(np.unique(recording.posture_id)) < FEWEST:
        count = len(np.unique(recording.posture_id))
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
        side=rest.side[first][v],
        seen=total[v, m] / count[v, m][:, None],
        marker=m,
        posture_id=rest.posture_id[first][v],
        hours=hours[v],
        names=tuple(x.name for x in markers),
        bodies=tuple(x.body for x in markers),
        places=np.array(nominal),
        stated=np.nan if sigma is None else float(np.mean(sigma.repeatability)),
        tool=recording.tool or Payload(),
        told_lag=commanded_lags(recording)[:, 0],
        placed=np.array([x.position is not None for x in markers]),
        drawing=recording.drawing,
    )


def _first_of_each_target(recording: Recording) -> list[int]:
    chosen, known = [], set()
    for k, marker in enumerate(recording.markers):
        if marker.target is None or marker.target not in known:
            chosen.append(k)
            known.add(marker.target)
    return chosen


# --- Spatial folds --------------------------------------------------------------------

REGIONS, LEFT_OUT, FOLDS = 30, 8, 22
"""Number of regions; how many of them are kept back for the final test; number of folds
of the others, for selection. Chosen: 8 of 30 regions are about a quarter, and each of
the others is a fold of its own."""


@dataclass(frozen=True)
class SpatialFolds:
    """Split of the rows into spatial regions, folds and a hold-out.

    Attributes:
        region: Region of each row.
        held: Regions of the hold-out, which no fit uses.
        fold: Fold of each row: −1 in the hold-out, else 0 … count.
        count: Number of folds.
    """

    region: Int[np.ndarray, " rows"]
    held: tuple[int, ...]
    fold: Int[np.ndarray, " rows"]
    count: int

    @property
    def kept_back(self) -> Bool[np.ndarray, " rows"]:
        """Mask of the rows in the hold-out."""
        return self.fold < 0


def spatial_folds_of(readings: Readings, draw: int = 0) -> SpatialFolds:
    """Split the rows into regions, hold-out and folds.

    Args:
        readings: The readings.
        draw: Number of the split; another number gives other regions.
    """
    ids, first, index = np.unique(
        readings.posture_id, return_index=True, return_inverse=True
    )
    digest = hashlib.sha256(np.ascontiguousarray(readings.seen).tobytes()).digest()
    seed = [int.from_bytes(digest[:8], "big"), draw]
    rng = np.random.default_rng(seed)
    count = min(REGIONS, max(len(ids) // 3, 6))
    place = readings.seen[first]
    label = kmeans2(place, count, minit="++", rng=rng)[1]
    label = np.unique(label, return_inverse=True)[1]  # k-means may leave one empty
    count = int(label.max()) + 1
    order = rng.permutation(count)
    left_out = max(1, round(LEFT_OUT / REGIONS * count))
    folds = min(FOLDS, count - left_out)
    fold_of = np.full(count, -1)
    fold_of[order[left_out:]] = np.arange(count - left_out) % folds
    held = tuple(sorted(int(r) for r in order[:left_out]))
    region = label[index]
    return SpatialFolds(region, held, fold_of[region], folds)


# --- Geometry -------------------------------------------------------------------------

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Entry:
    """One parameter of the geometry.

    Attributes:
        effect: `encoder_offset` or `geometry_error`.
        where: Axis or link.
        parameter: Its name in the vocabulary.
    """

    effect: str
    where: str
    parameter: str


def entries_of(chain: Chain) -> tuple[Entry, ...]:
    """Return all parameters of a geometry, in the order of their vector.

    First an offset of each axis, then six numbers for each axis that is carried by
    another one: they belong to the link between the two.
    """
    offsets = [
        Entry("encoder_offset", f"a{k + 1}", "offset_m" if slides else "offset_rad")
        for k, slides in enumerate(chain.slides)
    ]
    links = [
        Entry("geometry_error", link, name) for link in chain.links for name in NAMES
    ]
    return (*offsets, *links)


PLACED = 1e-3
"""One sigma of a stated position of a target, in m; chosen: what counts as nominal in
a diagnosis too."""


def prior_sizes(readings: Readings) -> Float[np.ndarray, " silent"]:
    """Return one sigma of geometry, frame and target positions before the readings.

    Infinite where nothing is stated: the tracker's frame, targets without a place.
    """
    drawing = readings.drawing
    of_kind = {"offset_rad": drawing.offset, "offset_m": drawing.length}
    of_kind |= dict.fromkeys(NAMES[:3], drawing.length)
    of_kind |= dict.fromkeys(NAMES[3:], drawing.angle)
    sizes = [of_kind[e.parameter] for e in entries_of(readings.arm.chain)]
    places = np.where(np.repeat(readings.placed, 3), PLACED, np.inf)
    return np.concatenate([sizes, np.full(6, np.inf), places])


def corrections_of(
    readings: Readings, geometry: "Geometry"
) -> Float[np.ndarray, " silent"]:
    """Return how far a geometry is from what is stated; 0 where nothing is."""
    moved = np.where(readings.placed[:, None], geometry.places - readings.places, 0.0)
    return np.concatenate([geometry.values, np.zeros(6), moved.ravel()])


def seats_of(chain: Chain) -> list[int]:
    """Return the axes that another axis carries."""
    return list(chain.links.values())


def corrected_chain(chain: Chain, values: Float[np.ndarray, " entries"]) -> Chain:
    """Return a chain with corrected seats; offsets are added to the postures."""
    axes = len(chain.parent)
    before = chain.before.copy()
    for k, twist in zip(
        seats_of(chain), np.reshape(values[axes:], (-1, 6)), strict=True
    ):
        axes_of_link = link_axes(chain, chain.parent[k])
        before[k, :3, 3] += axes_of_link @ twist[:3]
        turn = Rotation.from_rotvec(axes_of_link @ twist[3:]).as_matrix()
        before[k, :3, :3] = turn @ before[k, :3, :3]
    return replace(chain, before=before)


def link_axes(chain: Chain, axis: int) -> Float[np.ndarray, "3 3"]:
    """Return the axes of a link's frame, as columns, in its moving axis' frame."""
    place = chain.places.get(f"link_{axis + 1}", Place(axis, np.eye(4)))
    return place.placement[:3, :3]


def columns(
    standing: ArmState,
    points: Float[np.ndarray, "rows 3"],
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 3 entries"]:
    """Return the Jacobian of points with respect to the parameters of the geometry.

    This is Pinocchio's kinematic regressor, for many postures at once.

    Args:
        standing: The arm in its postures.
        points: On one body, in the base's frame, in m.
        carried: The axes that carry that body.
    """
    chain, rows = standing.chain, len(points)
    moved = [turning(standing, points, k, carried) for k in range(len(chain.parent))]
    for k in seats_of(chain):
        parent = chain.parent[k]
        axes = standing.rotation[parent] @ link_axes(chain, parent)
        for turns in (False, True):
            for j in range(3):
                if k not in carried:
                    moved.append(np.zeros((rows, 3)))
                elif turns:
                    moved.append(np.cross(axes[:, :, j], points - standing.origin[k]))
                else:
                    moved.append(axes[:, :, j])
    return np.stack(moved, axis=2)


def turning(
    standing: ArmState,
    points: Float[np.ndarray, "rows 3"],
    axis: int,
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 3"]:
    """Return the Jacobian of points, in m/rad of an axis (m/m if prismatic)."""
    if axis not in carried:
        return np.zeros_like(points)
    along = standing.rotation[axis, :, :, 2]
    if standing.chain.slides[axis]:
        return along
    return np.cross(along, points - standing.origin[axis])


# --- State of the arm -----------------------------------------------------------------


@dataclass(frozen=True)
class Geometry:
    """Corrections of the geometry, the tracker frame and the target positions.

    Attributes:
        values: Parameters of the geometry, in the order of `entries_of`.
        base_from_tracker: Transform, lengths in m.
        places: Target positions in their bodies' frames, in m.
    """

    values: Float[np.ndarray, " entries"]
    base_from_tracker: Float[np.ndarray, "4 4"]
    places: Float[np.ndarray, "markers 3"]

    def stepped(self, step: Float[np.ndarray, " silent"]) -> "Geometry":
        """Add a step of parameters, frame (3 + 3) and target positions."""
        n = len(self.values)
        away = np.eye(4)
        away[:3, :3] = Rotation.from_rotvec(-step[n + 3 : n + 6]).as_matrix()
        away[:3, 3] = -step[n : n + 3]
        return Geometry(
            self.values + step[:n],
            away @ self.base_from_tracker,
            self.places + step[n + 6 :].reshape(-1, 3),
        )


@dataclass(frozen=True)
class CalibrationState:
    """The arm in the postures of all rows: predictions, residuals and Jacobians.

    Attributes:
        readings: The readings.
        geometry: Corrections that the predictions assume.
        standing: The arm in the rows' postures.
        point: Predicted target positions, in the base's frame, in m.
        carried: Axes that carry each target.
    """

    readings: Readings
    geometry: Geometry
    standing: ArmState
    point: Float[np.ndarray, "rows 3"]
    carried: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, readings: Readings, model_geometry: Geometry) -> "CalibrationState":
        """Return the state for a corrected geometry."""
        arm = readings.arm
        axes = len(arm.axes)
        chain = corrected_chain(arm.chain, model_geometry.values)
        drawn_arm = replace(arm, chain=chain)
        standing = drawn_arm.at(readings.posture + model_geometry.values[:axes])
        point = np.zeros_like(readings.seen)
        carried = []
        for m, body in enumerate(readings.bodies):
            own = readings.marker == m
            point[own] = standing.point(body, model_geometry.places[m])[own]
            carried.append(tuple(chain.carriers(drawn_arm.attachment(body).axis)))
        return cls(readings, model_geometry, standing, point, tuple(carried))

    @cached_property
    def residual(self) -> Float[np.ndarray, "rows 3"]:
        """Observed less predicted positions, along the base's axes, in m."""
        frame = self.geometry.base_from_tracker
        return self.readings.seen @ frame[:3, :3].T + frame[:3, 3] - self.point

    @cached_property
    def lever(self) -> Float[np.ndarray, "axes rows 3"]:
        """Jacobian of the targets with respect to the axes."""
        axes = range(len(self.standing.chain.parent))
        return np.stack([self._by_marker(turning, k) for k in axes])

    @cached_property
    def moment(self) -> Float[np.ndarray, "axes rows 3"]:
        """Moment of gravity, including the tool's, about each axis' origin, in N m."""
        standing, chain = self.standing, self.standing.chain
        masses = standing.masses(self.readings.tool)
        moment = np.zeros_like(standing.origin)
        for axis, mass, at in zip(*masses, strict=True):
            for k in chain.carriers(axis):
                arm = at - standing.origin[k]
                moment[k] += np.cross(arm, mass * chain.gravity)
        return moment

    @cached_property
    def torque(self) -> Float[np.ndarray, "rows axes"]:
        """Gravity torque about each axis, in N m (N for a prismatic one)."""
        return self.standing.gravity_torque(self.readings.tool)

    def bearing(
        self, axis: int
    ) -> tuple[
        tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"]],
        Float[np.ndarray, "rows 3"],
        Float[np.ndarray, "rows 3"],
    ]:
        """Return how an axis' bearing, or a slide's guide, stands and is loaded.

        Returns:
            The two directions across the axis, which do not turn with it; the centre,
            where the axis' origin is at zero, in m; gravity's moment about it, in N m.
        """
        q = self.readings.posture[:, axis, None] + self.geometry.values[axis]
        x, y, z = np.moveaxis(self.standing.rotation[axis], 2, 0)
        centre, moment = self.standing.origin[axis], self.moment[axis]
        if not self.standing.chain.slides[axis]:
            cos, sin = np.cos(q), np.sin(q)
            return (cos * x - sin * y, sin * x + cos * y), centre, moment
        weight = self.standing.chain.gravity * self._mass_on(axis)
        return (x, y), centre - q * z, moment + np.cross(q * z, weight)

    def tilting(
        self,
        axis: int,
        about: Float[np.ndarray, "rows 3"],
        centre: Float[np.ndarray, "rows 3"],
    ) -> Float[np.ndarray, "rows 3"]:
        """Return the target displacement per tilt of a seat about a direction."""
        moved = np.cross(about, self.point - centre)
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)

    def _mass_on(self, axis: int) -> float:
        """Return the mass that an axis carries, the tool's included, in kg."""
        axes, mass, _ = self.standing.masses(self.readings.tool)
        chain = self.standing.chain
        carried = [axis in chain.carriers(k) for k in axes]
        return float(np.sum(np.asarray(mass)[carried]))

    def nuisance_jacobian(self) -> Float[np.ndarray, "rows 3 silent"]:
        """Return the Jacobian of predictions: geometry, frame, target positions."""
        entries = columns
        drawing = np.zeros((*self.point.shape, len(self.geometry.values)))
        places = np.zeros((*self.point.shape, 3 * len(self.readings.bodies)))
        for m, body in enumerate(self.readings.bodies):
            own = self.readings.marker == m
            drawing[own] = entries(self.standing, self.point, self.carried[m])[own]
            places[own, :, 3 * m : 3 * m + 3] = self.standing.turn(body)[own]
        frame = np.zeros((*self.point.shape, 6))
        frame[:, :, :3] = np.eye(3)
        for j, along in enumerate(np.eye(3)):
            frame[:, :, 3 + j] = np.cross(along, self.point)
        return np.concatenate([drawing, frame, places], axis=2)

    def _hangs_on(self, axis: int) -> np.ndarray:
        hangs = np.array([axis in carried for carried in self.carried])
        return hangs[self.readings.marker]

    def _by_marker(self, function, axis: int) -> Float[np.ndarray, "rows 3"]:
        moved = function(self.standing, self.point, axis, range(len(self.moment)))
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)
