"""How well an experiment is watched is a matter of flags in data sheets' units."""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from bench.errors import Unusable
from bench.instruments import Encoders, ForceSensor, Instruments, Markers, Tracker
from bench.instruments.tracker import STILL


@dataclass(frozen=True)
class Watching:
    """What watches."""

    targets: Literal["all", "flange"] = "all"
    """Bodies with markers: base, links and flange, or the flange alone."""
    noise_mm: tuple[float, ...] = (0.010,)
    """Tracker noise, one sigma, or one each for x, y, z; 0: silent."""
    volumetric_mm: float = 0.0
    """Slowly varying error of the tracker, one sigma."""
    occlusions: float = 0.0
    """Fraction of marker readings that are missing."""
    placement_mm: float = 0.0
    """How far markers sit from their nominal places, one sigma."""
    state_frame: bool = False
    """Say in the manifest where the tracker stands."""
    wrench_noise: float = 1.0
    """Noise of the force sensor, in units of what it states; 0: silent."""
    direction_deg: float = 0.0
    """Error of the force's direction that a visit shares, one sigma about each axis."""
    size_percent: float = 0.0
    """Error of the force's size that a visit shares, one sigma."""
    arrival_urad: float = 0.0
    """Scatter of what the motors reach around what they report, one sigma."""
    link_encoders: bool = False
    """Measure the angles after the gears too."""

    def instruments(self) -> Instruments:
        """Return the instruments.

        Raises:
            Unusable: Where a flag cannot be.
        """
        sigma = self.noise_mm
        if len(sigma) not in (1, 3) or (any(sigma) and not min(sigma) > 0.0):
            fault = f"--noise-mm is {sigma}, expected 0, or one or three above 0."
            raise Unusable("Flags", [fault])
        tracker = Tracker(
            noise=float(any(sigma)),
            field=self.volumetric_mm / 1e3,
            occlusions=self.occlusions,
            frame_error=STILL if self.state_frame else None,
        )
        if any(sigma):
            stated = np.broadcast_to(np.array(sigma) / 1e3, 3)
            tracker = replace(tracker, repeatability=tuple(stated.tolist()))
        return Instruments(
            tracker=tracker,
            force_sensor=ForceSensor(
                noise=self.wrench_noise,
                turn=float(np.deg2rad(self.direction_deg)),
                size=self.size_percent / 100,
            ),
            encoders=Encoders(
                arrival=self.arrival_urad / 1e6, link_side=self.link_encoders
            ),
            markers=Markers(self.targets, placement=self.placement_mm / 1e3),
        )
