"""Tracker misalignment: error of the tracker frame stated in the manifest.

==========  ==========================================================================
Equation    stated = E true, each base_from_tracker; E turns by exp([(rx, ry, rz)]×)
            about the base's origin, then shifts by (x, y, z) along its axes
Source      rotation vector (Rodrigues 1840); size chosen: a frame fitted to a few
            points of a base
Valid       always
Ignores     nothing
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.effect import InstrumentEffect, plus
from bench.instruments import Instruments
from bench.instruments.tracker import STILL


@dataclass(frozen=True)
class TrackerMisalignment(InstrumentEffect):
    """Error of the stated tracker frame; a tracker without one then states one.

    Attributes:
        x_m, y_m, z_m: Shift along the base's axes.
        rx_rad, ry_rad, rz_rad: Rotation vector along the base's axes, about its origin.
    """

    name: ClassVar[str] = "tracker_misalignment"
    x_m: float = 5e-4
    y_m: float = 0.0
    z_m: float = 0.0
    rx_rad: float = 0.0
    ry_rad: float = 0.0
    rz_rad: float = 1e-3

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        error = tuple(self.parameters().values())
        if not any(error):
            return instruments
        tracker = instruments.tracker
        error = plus(tracker.frame_error or STILL, error)
        return replace(instruments, tracker=replace(tracker, frame_error=error))
