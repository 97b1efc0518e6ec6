"""A camera pair on a tripod sees marks, each a little beside where it is.

==========  ==========================================================================
Equation    s = tracker_from_base (p + t·base drift); reading = (1 + scale) s
            + t·drift + field(s) + noise / sqrt(frames)
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

from bench.instruments.chance import Streams
from bench.instruments.checks import not_sizes, not_vectors, refuse
from bench.instruments.smooth_field import smooth_field
from bench.instruments.standpoint import inverse, moved, standpoint
from bench.stated import TrackerSpec

STILL = (0.0,) * 6
HOUR = 3600.0


@dataclass(frozen=True)
class Tracker:
    """A C-Track before the robot. Its z axis looks at the arm.

    Attributes:
        repeatability: One sigma of a frame that it states, along its x, y and z, in m.
            The paper's number; (10, 10, 25) µm is what a stereo pair makes of it, whose
            depth is weakest (chosen; a distance of twice the baseline gives 2.5 to 4).
        noise: Its white noise in units of what it states; 0 is silent.
        field: One sigma of a slowly varying error per coordinate, in m, which no
            averaging removes. 15 µm keeps nearly all points within the paper's 0.05 mm.
        volumetric: One sigma of it that the tracker states, in m; None: what it is.
        frames: How many frames a row averages.
        occlusions: Fraction of readings that are missing, at random.
        widest_view: Largest angle between a mark's normal and the line of sight, in
            rad; None: marks are seen from all sides.
        scale: A length reads (1 + scale) times itself.
        drift: How readings wander in an hour along its axes: shift in m, then rotation
            vector about its origin in rad.
        base_drift: The same for the base under it, along and about the base's axes.
        frame_error: What is added to its pose in the manifest, along and about the
            base's axes: shift in m, rotation vector in rad. None: the manifest is
            silent about where it stands.
    """

    repeatability: tuple[float, ...] = (1e-5, 1e-5, 1e-5)
    noise: float = 1.0
    field: float = 0.0
    volumetric: float | None = None
    frames: int = 1
    occlusions: float = 0.0
    widest_view: float | None = None
    scale: float = 0.0
    drift: tuple[float, ...] = STILL
    base_drift: tuple[float, ...] = STILL
    frame_error: tuple[float, ...] | None = None

    def __post_init__(self):
        """Check all sizes at once."""
        names = ("repeatability", "noise", "field", "occlusions")
        sizes = {name: getattr(self, name) for name in names}
        faults = not_sizes(sizes | {"volumetric": self.volumetric or 0.0})
        faults += not_vectors({"repeatability": self.repeatability}, 3)
        wander = {"drift": self.drift, "base_drift": self.base_drift}
        faults += not_vectors(wander | {"frame_error": self.frame_error or STILL}, 6)
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
        """Return the readings, and where the manifest says that it stands.

        Args:
            point: Where the marks are, in the base's frame, in m.
            normal: Where they look, along the base's axes.
            time: Of each row since the start, in s.
            chance: Streams of random numbers.

        Returns:
            Readings in its own frame in m, NaN where not seen; base_from_tracker, None
            where the manifest is silent.
        """
        base_from_tracker = standpoint(chance["tracker_frame"])
        hours = time / HOUR
        seen = moved(point, self.base_drift, hours)
        seen = inverse(base_from_tracker, seen)
        sight = -seen / np.linalg.norm(seen, axis=2, keepdims=True)
        reading = moved((1.0 + self.scale) * seen, self.drift, hours)
        reading += smooth_field(self.field, chance["tracker_field"]).at(seen)
        sigma = self.noise * np.array(self.repeatability) / np.sqrt(self.frames)
        reading += sigma * chance["tracker_noise"].standard_normal(point.shape)
        hidden = chance["occlusions"].random(point.shape[:2]) < self.occlusions
        if self.widest_view is not None:
            facing = np.sum(normal @ base_from_tracker[:3, :3] * sight, axis=2)
            hidden |= facing < np.cos(self.widest_view)
        reading[hidden] = np.nan
        return reading, self._stated(base_from_tracker)

    def spec(self) -> TrackerSpec:
        """Return what it states of itself, faults left out."""
        stated = self.field if self.volumetric is None else self.volumetric
        return TrackerSpec(np.array(self.repeatability), volumetric=stated or None)

    def _stated(
        self, base_from_tracker: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "4 4"] | None:
        if self.frame_error is None:
            return None
        error = np.eye(4)
        error[:3, :3] = Rotation.from_rotvec(self.frame_error[3:]).as_matrix()
        error[:3, 3] = self.frame_error[:3]
        return error @ base_from_tracker
