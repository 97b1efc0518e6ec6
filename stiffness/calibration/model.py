"""Model of a calibration: readings, spatial folds, corrected geometry, arm state.

What can be calibrated on is where targets stood while nothing pulled at the arm.

Poses near each other share what a model learns, so whole regions are left out.

==========  ==========================================================================
Equation    k-means over the places of targets in the base's frame; whole regions go to
            the hold-out, the others in turn to folds; seeds from SHA-256 of what was
            seen, before anything is fitted
Source      leave-group-out validation; Lloyd 1982, "Least squares quantization in PCM"
Valid       at least as many poses as regions
Ignores     that regions at the edge are further from the rest
==========  ==========================================================================

The drawing of an arm is a little wrong, and not in all of its numbers visibly.

==========  ==========================================================================
Equation    q = q_reported + offset; the seat of the next axis in its link's frame:
            p' = p + (x, y, z), R' = exp([(rx, ry, rz)]x) R
Source      Mooring, Roth, Driels 1991, "Fundamentals of manipulator calibration";
            rotation vector (Rodrigues 1840)
Valid       always
Ignores     nothing of a rigid arm: frame and places of targets take up the rest
==========  ==========================================================================

The arm as drawn so far, standing in every posture, with what gravity does to it.
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
from bench.shared.recording import UNLOADED, Payload, Recording
from stiffness.robot.arm import Arm
from stiffness.robot.chain import Chain, Place
from stiffness.robot.kinematics import ArmState

# --- Readings without a load ----------------------------------------------------------

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
        posture_id: Id of the pose.
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
    posture_id: Int[np.ndarray, " rows"]
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
            self.marker[rows], self.posture_id[rows], self.hours[rows],
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
        side=_sides(posture)[v],
        seen=total[v, m] / count[v, m][:, None],
        marker=m,
        posture_id=rest.posture_id[first][v],
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


# --- Spatial folds --------------------------------------------------------------------

REGIONS, LEFT_OUT, FOLDS = 30, 8, 22
"""Of all poses; kept back until the end; of the others, for choosing. Chosen: 8 of 30
regions are about a quarter, and each of the others is a fold of its own."""


@dataclass(frozen=True)
class SpatialFolds:
    """Where poses lie together.

    Attributes:
        region: Of each row.
        held: Regions that nothing is fitted to.
        fold: Of each row: −1 kept back, else 0 … count.
        count: Of folds.
    """

    region: Int[np.ndarray, " rows"]
    held: tuple[int, ...]
    fold: Int[np.ndarray, " rows"]
    count: int

    @property
    def kept_back(self) -> Bool[np.ndarray, " rows"]:
        """Rows that decide at the end."""
        return self.fold < 0


def spatial_folds_of(readings: Readings, draw: int = 0) -> SpatialFolds:
    """Draw regions, hold-out and folds.

    Args:
        readings: What was seen.
        draw: Another number draws other regions.
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
    """One number of the drawing.

    Attributes:
        effect: `encoder_offset` or `geometry_error`.
        where: Axis or link.
        parameter: Its name in the vocabulary.
    """

    effect: str
    where: str
    parameter: str


def entries_of(chain: Chain) -> tuple[Entry, ...]:
    """Return all numbers of a drawing, in the order of their vector.

    First an offset of each axis, then six numbers for each axis that is carried by
    another one: they belong to the link between the two.
    """
    offsets = [
        Entry("encoder_offset", f"a{k + 1}", "offset_m" if slides else "offset_rad")
        for k, slides in enumerate(chain.slides)
    ]
    links = [
        Entry("geometry_error", f"link_{chain.parent[k] + 1}", name)
        for k in seats_of(chain)
        for name in NAMES
    ]
    return (*offsets, *links)


def seats_of(chain: Chain) -> list[int]:
    """Return the axes that another axis carries."""
    return [k for k, parent in enumerate(chain.parent) if parent >= 0]


def corrected_chain(chain: Chain, values: Float[np.ndarray, " entries"]) -> Chain:
    """Return a chain whose seats are moved and turned; offsets act on postures."""
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
    """Return a link's own axes, as columns, in the frame of the axis that moves it."""
    place = chain.places.get(f"link_{axis + 1}", Place(axis, np.eye(4)))
    return place.placement[:3, :3]


def columns(
    standing: ArmState,
    points: Float[np.ndarray, "rows 3"],
    carried: Sequence[int],
) -> Float[np.ndarray, "rows 3 entries"]:
    """Return how points move with each number of the drawing.

    This is Pinocchio's kinematic regressor, for many postures at once.

    Args:
        standing: The arm.
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
    """Return how points move per unit of an axis, in m/rad (m/m where it slides)."""
    if axis not in carried:
        return np.zeros_like(points)
    along = standing.rotation[axis, :, :, 2]
    if standing.chain.slides[axis]:
        return along
    return np.cross(along, points - standing.origin[axis])


# --- State of the arm -----------------------------------------------------------------


@dataclass(frozen=True)
class Geometry:
    """All that a rigid prediction needs.

    Attributes:
        values: Of the drawing's numbers, see `geometry.entries_of`.
        base_from_tracker: In m.
        places: Of targets in their bodies' frames, in m.
    """

    values: Float[np.ndarray, " entries"]
    base_from_tracker: Float[np.ndarray, "4 4"]
    places: Float[np.ndarray, "markers 3"]

    def stepped(self, step: Float[np.ndarray, " silent"]) -> "Geometry":
        """Move on by a step of entries, of the frame (3 + 3) and of the places."""
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
    """Where targets should be, and every lever that could move them.

    Attributes:
        readings: What was seen.
        geometry: What the arm is taken to be.
        standing: The arm in the rows' postures.
        point: Where the targets should be, in the base's frame, in m.
        carried: Of each target, the axes that carry it.
    """

    readings: Readings
    geometry: Geometry
    standing: ArmState
    point: Float[np.ndarray, "rows 3"]
    carried: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, readings: Readings, model_geometry: Geometry) -> "CalibrationState":
        """Stand the arm as drawn."""
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
        """Seen less said, along the base's axes, in m."""
        frame = self.geometry.base_from_tracker
        return self.readings.seen @ frame[:3, :3].T + frame[:3, 3] - self.point

    @cached_property
    def lever(self) -> Float[np.ndarray, "axes rows 3"]:
        """How targets move per unit of each axis."""
        axes = range(len(self.standing.chain.parent))
        return np.stack([self._by_marker(turning, k) for k in axes])

    @cached_property
    def moment(self) -> Float[np.ndarray, "axes rows 3"]:
        """Moment of gravity, the tool's too, about each axis' origin, in N m."""
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
        """Gravity's torque about each axis, in N m (N along one that slides)."""
        return self.standing.gravity_torque(self.readings.tool)

    def tilting(self, axis: int, about: Float[np.ndarray, "rows 3"]) -> np.ndarray:
        """Return how targets move per turn of an axis' seat about a direction."""
        moved = np.cross(about, self.point - self.standing.origin[axis])
        return np.where(self._hangs_on(axis)[:, None], moved, 0.0)

    def nuisance_jacobian(self) -> Float[np.ndarray, "rows 3 silent"]:
        """Return how predictions move with entries, frame and places."""
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
