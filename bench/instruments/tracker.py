"""Tracker: noise, volumetric error, drift and placement of a camera pair.

Volumetric error, which varies slowly over the measuring volume (`smooth_field`):

==========  ==========================================================================
Equation    f(p) = sd sqrt(2/M) Σ cos(k_m·p + φ_m) per coordinate, k ~ N(0, 1/L²),
            M features; covariance sd² exp(-d²/(2 L²)) at distance d, |f| ≤ sd sqrt(2 M)
Source      Rahimi & Recht 2007, "Random features for large-scale kernel machines"
Valid       inside the measuring volume
Ignores     growth towards the volume's edges, change over the day
==========  ==========================================================================

Placement (`standpoint`): base_from_tracker, p_base = R p_tracker + t. The tracker's z
axis points at the middle of the arm's postures, its y axis down.

Readings (`Tracker.read`):

==========  ==========================================================================
Equation    s = tracker_from_base (p + base drift(t)); reading = (1 + scale) s
            + drift(t) + field(s) + noise / sqrt(frames)
Source      C-Track of Wu et al. 2024, section 3.1: repeatability 0.01 mm, volumetric
            accuracy 0.05 mm; further sizes at each attribute
Valid       plateaus; t is the time since the start
Ignores     lens distortion beyond the smooth field, light, moving marks
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bench.instruments.random_streams import Streams
from bench.shared.errors import not_sizes, not_vectors, refuse
from bench.shared.recording import TrackerSpec, transform_of

# --- Volumetric error -----------------------------------------------------------------

FEATURES = 64
"""M; chosen: the sum is then near enough to a normal distribution."""
CORRELATION_LENGTH = 0.5
"""L in m; chosen: a third of the measuring volume's side."""


@dataclass(frozen=True)
class SmoothField:
    """Smooth random vector field, fixed once it is drawn.

    Attributes:
        wave: Wave vectors k, in rad/m.
        phase: Phases φ, in rad.
        sd: One sigma of each coordinate, in m.
    """

    wave: Float[np.ndarray, "features 3 3"]
    phase: Float[np.ndarray, "features 3"]
    sd: float

    def at(self, place: Float[np.ndarray, "*rows 3"]) -> Float[np.ndarray, "*rows 3"]:
        """Return the field at some points, in m."""
        if self.sd == 0.0:
            return np.zeros_like(place)
        total = np.zeros_like(place)
        for wave, phase in zip(self.wave, self.phase, strict=True):
            total += np.cos(place @ wave.T + phase)
        return self.sd * np.sqrt(2.0 / len(self.phase)) * total


def smooth_field(sd: float, random: np.random.Generator) -> SmoothField:
    """Draw a smooth random vector field; `sd` is one sigma of each coordinate, in m."""
    wave = random.standard_normal((FEATURES, 3, 3)) / CORRELATION_LENGTH
    phase = random.uniform(0.0, 2.0 * np.pi, (FEATURES, 3))
    return SmoothField(wave, phase, sd)


# --- Placement ------------------------------------------------------------------------

MIDDLE = np.array([0.4, 0.0, 0.7])
"""Point that it is aimed at in the base's frame, in m; chosen: the middle of the
postures."""
DISTANCE = (2.0, 2.5)
"""Range of its distance from there, in m; chosen: inside a volume of 9.1 m³."""
AZIMUTH = (-np.pi / 3, np.pi / 3)
"""Range of its direction from there, about the base's z, in rad; chosen: before the
arm."""
RISE = (0.0, 0.8)
"""Range of its height above that point, in m; chosen: a tripod."""
TILT = np.deg2rad(5.0)
"""Standard deviation of its rotation about each axis, in rad; chosen."""


def standpoint(random: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """Draw a tracker's pose: base_from_tracker, in m."""
    distance, azimuth, rise = (random.uniform(*r) for r in (DISTANCE, AZIMUTH, RISE))
    level = np.sqrt(distance**2 - rise**2)
    away = np.array([level * np.cos(azimuth), level * np.sin(azimuth), rise])
    forward = -away / distance
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    aim = np.column_stack([right, np.cross(forward, right), forward])
    tilt = Rotation.from_rotvec(TILT * random.standard_normal(3)).as_matrix()
    return transform_of(aim @ tilt, MIDDLE + away)


def inverse(
    base_from_tracker: Float[np.ndarray, "4 4"], point: Float[np.ndarray, "*rows 3"]
) -> Float[np.ndarray, "*rows 3"]:
    """Return points of the base's frame in the tracker's: Rᵀ (p - t), in m."""
    return (point - base_from_tracker[:3, 3]) @ base_from_tracker[:3, :3]


def misplacement(error: tuple[float, ...]) -> Float[np.ndarray, "4 4"]:
    """Return the error of a stated pose: shift in m, then rotation vector in rad."""
    turn = Rotation.from_rotvec(error[3:]).as_matrix()
    return transform_of(turn, np.array(error[:3]))


# --- Drift ----------------------------------------------------------------------------

STILL = (0.0,) * 6
HOUR = 3600.0
STEADY = 1e9
"""Time constant of a drift at constant speed, in s; chosen: 30 years."""


@dataclass(frozen=True)
class DriftCourse:
    """Rigid motion in time, at constant speed or until it comes to rest.

    Attributes:
        rate: Speed at the start in an hour: shift in m, then rotation vector in rad.
        time_constant: T in s of a drift T (1 - exp(-t/T)) times its speed; the speed
            stays where T is far above all times.
    """

    rate: tuple[float, ...]
    time_constant: float = STEADY

    def __post_init__(self):
        """Check all sizes at once."""
        faults = not_vectors({"rate": self.rate}, 6)
        if not 0.0 < self.time_constant < np.inf:
            faults.append(f"time_constant is {self.time_constant} s, expected above 0.")
        refuse("DriftCourse", faults)

    def displacement(
        self, time: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, "rows 6"]:
        """Return the motion by each time since the start in s, in m and rad."""
        constant = self.time_constant
        course = -constant * np.expm1(-time / constant)
        return np.outer(course / HOUR, self.rate)


def displaced(
    point: Float[np.ndarray, "rows markers 3"],
    courses: tuple[DriftCourse, ...],
    time: Float[np.ndarray, " rows"],
) -> Float[np.ndarray, "rows markers 3"]:
    """Return points under rigid drift: exp(r) p + v, in m, of all courses' sum."""
    moved = sum(
        (course.displacement(time) for course in courses), np.zeros((len(time), 6))
    )
    turn = Rotation.from_rotvec(moved[:, 3:]).as_matrix()
    return np.einsum("nij,nmj->nmi", turn, point) + moved[:, None, :3]


# --- Tracker --------------------------------------------------------------------------


@dataclass(frozen=True)
class Tracker:
    """Camera pair on a tripod before the robot, by default a C-Track.

    Attributes:
        repeatability: One sigma of a frame that it states, along its x, y and z, in m.
            The paper's number; (10, 10, 25) µm is what a stereo pair makes of it, whose
            depth is weakest (chosen; a distance of twice the baseline gives 2.5 to 4).
        noise: Its white noise in units of what it states; 0: none.
        field: One sigma of a slowly varying error per coordinate, in m, which no
            averaging removes. 15 µm keeps nearly all points within the paper's 0.05 mm.
        volumetric: One sigma of it that the tracker states, in m; None: the true one.
        frames: Number of frames averaged in a row.
        occlusions: Fraction of readings that are missing, at random.
        widest_view: Largest angle between a mark's normal and the line of sight, in
            rad; None: marks are seen from all sides.
        scale: A length reads (1 + scale) times itself.
        drift: Drifts of readings along its axes and about its origin.
        base_drift: Drifts of the base under it, along and about the base's axes.
        frame_error: Error of its pose in the manifest, along and about the
            base's axes: shift in m, rotation vector in rad. None: the manifest
            does not state its pose.
    """

    repeatability: tuple[float, ...] = (1e-5, 1e-5, 1e-5)
    noise: float = 1.0
    field: float = 0.0
    volumetric: float | None = None
    frames: int = 1
    occlusions: float = 0.0
    widest_view: float | None = None
    scale: float = 0.0
    drift: tuple[DriftCourse, ...] = ()
    base_drift: tuple[DriftCourse, ...] = ()
    frame_error: tuple[float, ...] | None = None

    def __post_init__(self):
        """Check all sizes at once."""
        names = ("repeatability", "noise", "field", "occlusions")
        sizes = {name: getattr(self, name) for name in names}
        faults = not_sizes(sizes | {"volumetric": self.volumetric or 0.0})
        faults += not_vectors({"repeatability": self.repeatability}, 3)
        faults += not_vectors({"frame_error": self.frame_error or STILL}, 6)
        if self.frames < 1:
            faults.append(f"frames is {self.frames}, expected at least 1.")
        if self.occlusions >= 1.0:
            faults.append(f"occlusions is {self.occlusions}, expected below 1.")
        if not np.isfinite(self.scale) or self.scale <= -1.0:
            faults.append(f"scale is {self.scale}, expected above -1.")
        refuse("Tracker", faults)

    def read(
        self,
        point: Float[np.ndarray, "rows markers 3"],
        normal: Float[np.ndarray, "rows markers 3"],
        time: Float[np.ndarray, " rows"],
        chance: Streams,
    ) -> tuple[Float[np.ndarray, "rows markers 3"], Float[np.ndarray, "4 4"] | None]:
        """Return the readings, and the tracker's pose as the manifest states it.

        Marks and their normals are in the base's frame, in m, the time in s.

        Returns:
            Readings in its own frame in m, NaN where not seen; base_from_tracker, None
            where the manifest does not state it.
        """
        base_from_tracker = standpoint(chance["tracker_frame"])
        seen = displaced(point, self.base_drift, time)
        seen = inverse(base_from_tracker, seen)
        toward = -seen / np.linalg.norm(seen, axis=2, keepdims=True)
        reading = displaced((1.0 + self.scale) * seen, self.drift, time)
        reading += smooth_field(self.field, chance["tracker_field"]).at(seen)
        sigma = self.noise * np.array(self.repeatability) / np.sqrt(self.frames)
        reading += sigma * chance["tracker_noise"].standard_normal(point.shape)
        hidden = chance["occlusions"].random(point.shape[:2]) < self.occlusions
        if self.widest_view is not None:
            facing = np.sum(normal @ base_from_tracker[:3, :3] * toward, axis=2)
            hidden |= facing < np.cos(self.widest_view)
        reading[hidden] = np.nan
        return reading, self._stated(base_from_tracker)

    def spec(self) -> TrackerSpec:
        """Return its specification, without its faults."""
        stated = self.field if self.volumetric is None else self.volumetric
        return TrackerSpec(np.array(self.repeatability), volumetric=stated or None)

    def _stated(
        self, base_from_tracker: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "4 4"] | None:
        if self.frame_error is None:
            return None
        return misplacement(self.frame_error) @ base_from_tracker
