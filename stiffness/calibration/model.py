"""Model of a calibration: readings in 3D or 6D, corrected geometry, arm state.

`Readings` are the targets of the unloaded rows, `Geometry` the corrections of a rigid
arm and `CalibrationState` the arm in all postures, with the Jacobians of its
predictions and the moments of gravity.

Targets in 6D (`Orientations`, `CalibrationState.residual`):

==========  ==========================================================================
Equation    residual = (p_seen - p, λ log(R_seen R')), λ = σ_position / σ_orientation
            in m/rad: one noise for all six; R = R_body mount, mount fitted unless all
            points of the target have stated places
Source      weighted least squares; rotation vector of SO(3)
Valid       orientation errors far below a radian
Ignores     correlation of a target's position and orientation errors
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

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial.transform import Rotation

from bench.shared.errors import refuse
from bench.shared.recording import (
    UNLOADED,
    DrawingAccuracy,
    LastMoves,
    Payload,
    Recording,
    targets_of,
    transform_of,
)
from stiffness.experiment.visits import commanded_lags
from stiffness.robot.arm import Arm
from stiffness.robot.chain import Chain, corrected_chain, link_axes, seats_of
from stiffness.robot.kinematics import ArmState, cross
from stiffness.robot.tracker_frame import rotations

# --- Readings without a load ----------------------------------------------------------

FEWEST = 30
"""Minimum number of poses; chosen: as many as the parameters of a six-axis arm's
geometry."""
FLAT = 1e-3
"""Width of a target's points over their length below which they show no orientation;
chosen."""


@dataclass(frozen=True)
class Orientations:
    """What 6D targets showed beside their positions.

    Attributes:
        turn: Rotation from the target's axes to the tracker's; identity where not seen.
        metres_per_rad: Sigma of position over sigma of orientation, which makes an
            orientation error a length; 0 where none was seen.
        stated: Whether a target's axes are those of its body, because all of its points
            have stated places; else how it is mounted is unknown.
    """

    turn: Float[np.ndarray, "rows 3 3"]
    metres_per_rad: Float[np.ndarray, " rows"]
    stated: Bool[np.ndarray, " markers"]

    @property
    def seen(self) -> Bool[np.ndarray, " rows"]:
        """Mask of the rows with an orientation."""
        return self.metres_per_rad > 0.0


@dataclass(frozen=True)
class Readings:
    """Targets at rest without load: a row per pose and target, by time.

    Attributes:
        posture: Reported joint angles, in rad (m for a prismatic axis).
        moves: How each axis came to each row.
        seen: Position of the target, in the tracker's frame, in m.
        marker: Index of the target in `names`.
        hours: Time since the middle of the recording, in h.
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
    moves: LastMoves
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
    orientations: Orientations | None = None

    @property
    def coordinates(self) -> Int[np.ndarray, " rows"]:
        """Number of coordinates of each row: 3, or 6 with an orientation."""
        if self.orientations is None:
            return np.full(len(self.seen), 3)
        return np.where(self.orientations.seen, 6, 3)

    def turned(
        self, residual: Float[np.ndarray, "rows coordinates"]
    ) -> Float[np.ndarray, "rows 3"] | None:
        """Return a residual's rotation vectors, in rad; None without 6D targets.

        Rows without an orientation are NaN.
        """
        if self.orientations is None:
            return None
        metres = np.where(
            self.orientations.seen, self.orientations.metres_per_rad, np.nan
        )
        return residual[:, 3:] / metres[:, None]

    def take(self, rows: np.ndarray) -> "Readings":
        """Return the same with only these rows (indices or a mask)."""
        turns = self.orientations
        if turns is not None:
            turns = replace(
                turns, turn=turns.turn[rows], metres_per_rad=turns.metres_per_rad[rows]
            )
        return Readings(
            self.arm, self.posture[rows], self.moves.take(rows), self.seen[rows],
            self.marker[rows], self.posture_id[rows], self.hours[rows],
            self.names, self.bodies, self.places, self.stated, self.tool,
            self.told_lag, self.placed, self.drawing, turns,
        )  # fmt: skip


def readings_of(recording: Recording, arm: Arm) -> Readings:
    """Return the unloaded rows of a recording: a mean for each visit and target.

    The first point of a 6D target is its position, all of them are its orientation.

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
    refuse(f"Recording {recording.name!r}", faults)
    assert recording.points is not None
    rest = recording.take(np.flatnonzero(np.equal(recording.stage, UNLOADED)))
    assert rest.points is not None
    targets = targets_of(recording)
    chosen = [own[0] for own in targets.values()]
    names, first, index = np.unique(rest.visit, return_index=True, return_inverse=True)
    order = np.argsort(rest.time[first], kind="stable")
    first = first[order]
    rank = np.empty(len(names), dtype=int)
    rank[order] = np.arange(len(names))
    visit = rank[index]
    means = np.full((len(names), len(recording.markers), 3), np.nan)
    for k in range(len(recording.markers)):
        seen = np.isfinite(rest.points[:, k]).all(axis=1)
        count = np.bincount(visit[seen], minlength=len(names))
        for i in range(3):
            total = np.bincount(visit[seen], rest.points[seen, k, i], len(names))
            means[count > 0, k, i] = total[count > 0] / count[count > 0]
    v, m = np.nonzero(np.isfinite(means[:, chosen, 0]))
    posture = rest.posture[first]
    hours = (rest.time[first] - rest.time.mean()) / 3600.0
    markers = [recording.markers[k] for k in chosen]
    nominal = [np.zeros(3) if x.position is None else x.position for x in markers]
    sigma = recording.tracker
    return Readings(
        arm=arm,
        posture=posture[v],
        moves=rest.moves.take(first[v]),
        seen=means[v, np.array(chosen)[m]],
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
        orientations=_orientations(recording, list(targets.values()), means, v, m),
    )


def _orientations(
    recording: Recording,
    targets: Sequence[Sequence[int]],
    means: Float[np.ndarray, "visits points 3"],
    visit: Int[np.ndarray, " rows"],
    marker: Int[np.ndarray, " rows"],
) -> Orientations | None:
    """Return the orientations of 6D targets, None where no target is in 6D.

    The points of a target err by one sigma of a reading at their distance from its
    first point, as importers write them: sigma of position over sigma of orientation is
    that distance. Means of each visit's points are in m, NaN where not seen; the rows
    of the readings have a visit and a target.
    """
    turn = np.tile(np.eye(3), (len(visit), 1, 1))
    metres = np.zeros(len(visit))
    stated = np.zeros(len(targets), dtype=bool)
    for t, own in enumerate(targets):
        rows = np.flatnonzero(marker == t)
        apart = means[visit[rows]][:, own[1:]] - means[visit[rows]][:, own[:1]]
        whole = np.isfinite(apart).all(axis=(1, 2))
        if not whole.any() or len(own) < 3:
            continue
        places = [recording.markers[k].position for k in own]
        known = [p for p in places if p is not None]
        stated[t] = len(known) == len(places)
        shape = apart[whole][0]
        if stated[t]:
            shape = np.array(known[1:]) - known[0]
        size = np.linalg.svd(shape, compute_uv=False)
        if size[1] <= FLAT * size[0]:
            continue
        turn[rows[whole]] = rotations(shape, apart[whole])
        metres[rows[whole]] = np.sqrt(np.mean(np.sum(shape**2, axis=1)))
    return Orientations(turn, metres, stated) if metres.any() else None


# --- Geometry -------------------------------------------------------------------------

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Entry:
    """One parameter of the geometry."""

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


def columns(
    standing: ArmState,
    points: Float[np.ndarray, "rows 3"],
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 6 entries"]:
    """Return the Jacobian of points with respect to the parameters of the geometry.

    Six rows: velocity of the point, then angular velocity, along the base's axes.

    This is Pinocchio's kinematic regressor, for many postures at once. Points, in m in
    the base's frame, are on the one body that the carried axes move.
    """
    chain = standing.chain
    axes, seats = len(chain.parent), seats_of(chain)
    moved = np.zeros((len(points), 6, axes + 6 * len(seats)))
    for k in carried:
        moved[:, :, k] = turning(standing, points, k, carried)
    for first, k in enumerate(seats):
        if k not in carried:
            continue
        parent, j = chain.parent[k], axes + 6 * first
        link = standing.rotation[parent] @ link_axes(chain, parent)
        moved[:, :3, j : j + 3] = link
        for i in range(3):
            moved[:, :, j + 3 + i] = twist(link[:, :, i], points - standing.origin[k])
    return moved


def twist(
    about: Float[np.ndarray, "rows 3"], arm: Float[np.ndarray, "rows 3"]
) -> Float[np.ndarray, "rows 6"]:
    """Return the velocity of a point at an arm from a rotation, and the rotation."""
    return np.hstack([cross(about, arm), about])


def turning(
    standing: ArmState,
    points: Float[np.ndarray, "rows 3"],
    axis: int,
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 6"]:
    """Return the twist of points per rad of an axis, per m if it is prismatic."""
    none = np.zeros_like(points)
    if axis not in carried:
        return np.hstack([none, none])
    along = standing.rotation[axis, :, :, 2]
    if standing.chain.slides[axis]:
        return np.hstack([along, none])
    return twist(along, points - standing.origin[axis])


# --- State of the arm -----------------------------------------------------------------


@dataclass(frozen=True)
class Geometry:
    """Corrections of the geometry, the tracker frame and the target positions.

    Attributes:
        values: Parameters of the geometry, in the order of `entries_of`.
        places: Target positions in their bodies' frames, in m.
        mounts: Rotations from the axes of 6D targets to their bodies'; None: no target
            is in 6D.
    """

    values: Float[np.ndarray, " entries"]
    base_from_tracker: Float[np.ndarray, "4 4"]
    places: Float[np.ndarray, "markers 3"]
    mounts: Float[np.ndarray, "markers 3 3"] | None = None

    @property
    def parameter_count(self) -> int:
        """Number of parameters, frame, target positions and mounts included."""
        per_target = 3 if self.mounts is None else 6
        return len(self.values) + 6 + per_target * len(self.places)

    def stepped(self, step: Float[np.ndarray, " silent"]) -> "Geometry":
        """Add a step of parameters, frame (3 + 3), target positions, and mounts."""
        n, last = len(self.values), len(self.values) + 6 + self.places.size
        back = Rotation.from_rotvec(-step[n + 3 : n + 6]).as_matrix()
        away = transform_of(back, -step[n : n + 3])
        return Geometry(
            self.values + step[:n],
            away @ self.base_from_tracker,
            self.places + step[n + 6 : last].reshape(-1, 3),
            None
            if self.mounts is None
            else Rotation.from_rotvec(step[last:].reshape(-1, 3)).as_matrix()
            @ self.mounts,
        )


@dataclass(frozen=True)
class CalibrationState:
    """The arm in the postures of all rows: predictions, residuals and Jacobians.

    A slide stands where gravity and the model's spring put it, since its compliance is
    not fitted: what it carries weighs about the same wherever it is.

    Attributes:
        point: Predicted target positions, in the base's frame, in m.
        turn: Predicted rotations from the targets' axes to the base's; None where none
            is in 6D.
        carried: Axes that carry each target.
    """

    readings: Readings
    geometry: Geometry
    standing: ArmState
    point: Float[np.ndarray, "rows 3"]
    turn: Float[np.ndarray, "rows 3 3"] | None
    carried: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, readings: Readings, model_geometry: Geometry) -> "CalibrationState":
        """Return the state for a corrected geometry."""
        arm = readings.arm
        axes = len(arm.axes)
        links = np.reshape(model_geometry.values[axes:], (-1, 6))
        chain = corrected_chain(arm.chain, links)
        drawn_arm = replace(arm, chain=chain)
        posture = readings.posture + model_geometry.values[:axes]
        standing = drawn_arm.at(posture)
        if sprung := [k for k in range(axes) if arm.slides[k] and arm.stiffness[k] > 0]:
            torque = standing.gravity_torque(readings.tool)[:, sprung]
            posture[:, sprung] += torque / arm.stiffness[sprung]
            standing = drawn_arm.at(posture)
        point = np.zeros_like(readings.seen)
        mounts = model_geometry.mounts
        turn = None if mounts is None else np.empty((*point.shape, 3))
        carried = []
        for m, body in enumerate(readings.bodies):
            own = readings.marker == m
            point[own] = standing.point(body, model_geometry.places[m])[own]
            if turn is not None and mounts is not None:
                turn[own] = standing.turn(body)[own] @ mounts[m]
            carried.append(tuple(chain.carriers(drawn_arm.attachment(body).axis)))
        return cls(readings, model_geometry, standing, point, turn, tuple(carried))

    @cached_property
    def residual(self) -> Float[np.ndarray, "rows coordinates"]:
        """Observed less predicted positions, along the base's axes, in m.

        With 6D targets three more: the orientation's, as a rotation vector along the
        base's axes times `metres_per_rad`.
        """
        frame = self.geometry.base_from_tracker
        left = self.readings.seen @ frame[:3, :3].T + frame[:3, 3] - self.point
        if self.turn is None or self.readings.orientations is None:
            return left
        seen = frame[:3, :3] @ self.readings.orientations.turn
        turned = Rotation.from_matrix(seen @ self.turn.swapaxes(1, 2)).as_rotvec()
        return self.as_read(np.hstack([left, turned]))

    def as_read(
        self, twists: Float[np.ndarray, "rows 6 *columns"]
    ) -> Float[np.ndarray, "rows coordinates *columns"]:
        """Return twists of the targets as the coordinates of their readings, in m."""
        if self.readings.orientations is None:
            return twists[:, :3]
        scale = np.ones(twists.shape[:2])
        scale[:, 3:] = self.readings.orientations.metres_per_rad[:, None]
        return twists * scale.reshape(*scale.shape, *[1] * (twists.ndim - 2))

    @cached_property
    def lever(self) -> Float[np.ndarray, "axes rows coordinates"]:
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
    ) -> Float[np.ndarray, "rows coordinates"]:
        """Return the target displacement per tilt of a seat about a direction."""
        moved = self.as_read(twist(about, self.point - centre))
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)

    def _mass_on(self, axis: int) -> float:
        """Return the mass that an axis carries, the tool's included, in kg."""
        axes, mass, _ = self.standing.masses(self.readings.tool)
        chain = self.standing.chain
        carried = [axis in chain.carriers(k) for k in axes]
        return float(np.sum(np.asarray(mass)[carried]))

    @cached_property
    def frame_jacobian(self) -> Float[np.ndarray, "rows coordinates 6"]:
        """Return the Jacobian of predictions that move and turn with the base."""
        frame = np.zeros((len(self.point), 6, 6))
        frame[:, :3, :3] = np.eye(3)
        for j, along in enumerate(np.eye(3)):
            about = np.broadcast_to(along, self.point.shape)
            frame[:, :, 3 + j] = twist(about, self.point)
        return self.as_read(frame)

    def nuisance_jacobian(self) -> Float[np.ndarray, "rows coordinates silent"]:
        """Return the Jacobian of predictions: geometry, frame, target positions.

        The mounts of 6D targets follow; those that are stated stay as they are.
        """
        count = len(self.readings.bodies)
        drawing = np.zeros((len(self.point), 6, len(self.geometry.values)))
        places = np.zeros((len(self.point), 6, 3 * count))
        mounts = np.zeros((len(self.point), 6, 0 if self.turn is None else 3 * count))
        for m, body in enumerate(self.readings.bodies):
            own = np.flatnonzero(self.readings.marker == m)
            standing, axes = self.standing.take(own), slice(3 * m, 3 * m + 3)
            turn = standing.turn(body)
            drawing[own] = columns(standing, self.point[own], self.carried[m])
            places[own, :3, axes] = turn
            turns = self.readings.orientations
            if turns is not None and mounts.size and not turns.stated[m]:
                mounts[own, 3:, axes] = turn
        twists = [self.as_read(part) for part in (drawing, places, mounts)]
        return np.concatenate([twists[0], self.frame_jacobian, *twists[1:]], axis=2)

    def _hangs_on(self, axis: int) -> np.ndarray:
        hangs = np.array([axis in carried for carried in self.carried])
        return hangs[self.readings.marker]

    def _by_marker(self, function, axis: int) -> Float[np.ndarray, "rows coordinates"]:
        moved = function(self.standing, self.point, axis, range(len(self.moment)))
        moved = self.as_read(moved)
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)
