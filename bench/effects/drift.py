"""Drift of tracker or base: a slow rigid motion that lasts or comes to rest.

==========  ==========================================================================
Equation    p' = exp(s [(rx, ry, rz)]×) p + s (x, y, z), s = T (1 - exp(-t/T)): at
            `tracker` the reading p, along its own axes, at `base` the arm's points p,
            along the base's
Source      rigid motion; s of a body that warms up by Newton's law of cooling; size
            chosen: rooms and machines that warm up move tens of µm in an hour
Valid       t since the start, plateaus short against an hour
Ignores     the changed direction of gravity and rope relative to a base that turned
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.effect import InstrumentEffect, form
from bench.instruments import Instruments
from bench.instruments.tracker import STEADY, DriftCourse

AXES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class Drift(InstrumentEffect):
    """Rigid motion of the tracker's frame or the arm's base, steady or warming up.

    Attributes:
        x_m_per_h, y_m_per_h, z_m_per_h: Shift of the points in an hour, at the speed of
            the start.
        rx_rad_per_h, ry_rad_per_h, rz_rad_per_h: Rotation vector in an hour, about the
            frame's origin.
        time_s: Time constant T in s; far above the recording's length the speed stays.
    """

    name: ClassVar[str] = "drift"
    x_m_per_h: float = 3e-5
    y_m_per_h: float = 0.0
    z_m_per_h: float = 0.0
    rx_rad_per_h: float = 0.0
    ry_rad_per_h: float = 0.0
    rz_rad_per_h: float = 0.0
    time_s: float = form(STEADY, 1e-3)

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        tracker = instruments.tracker
        rate = tuple(getattr(self, f"{name}_per_h") for name in AXES)
        if not any(rate):
            return instruments
        course = DriftCourse(rate, self.time_s)
        if self.where == "base":
            tracker = replace(tracker, base_drift=(*tracker.base_drift, course))
        else:
            tracker = replace(tracker, drift=(*tracker.drift, course))
        return replace(instruments, tracker=tracker)
