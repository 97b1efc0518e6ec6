"""Drift of tracker or base: a slow rigid motion at constant speed.

==========  ==========================================================================
Equation    p' = exp(t [(rx, ry, rz)]×) p + t (x, y, z): at `tracker` the reading p,
            along its own axes, at `base` the arm's points p, along the base's
Source      rigid motion at constant speed; size chosen: rooms and machines that warm up
            move tens of µm in an hour
Valid       t since the start, plateaus short against an hour
Ignores     the changed direction of gravity and rope relative to a base that turned
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.instrument_effect import InstrumentEffect, plus
from bench.instruments import Instruments


@dataclass(frozen=True)
class Drift(InstrumentEffect):
    """Rigid motion of the tracker's frame or the arm's base at constant speed.

    Attributes:
        x_m_per_h: Shift of the points in an hour along x.
        y_m_per_h: The same along y.
        z_m_per_h: The same along z.
        rx_rad_per_h: Rotation vector in an hour along x, about the frame's origin.
        ry_rad_per_h: The same along y.
        rz_rad_per_h: The same along z.
    """

    name: ClassVar[str] = "drift"
    places: ClassVar[tuple[str, ...]] = ("tracker", "base")
    x_m_per_h: float = 3e-5
    y_m_per_h: float = 0.0
    z_m_per_h: float = 0.0
    rx_rad_per_h: float = 0.0
    ry_rad_per_h: float = 0.0
    rz_rad_per_h: float = 0.0

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        tracker, rate = instruments.tracker, tuple(self.parameters().values())
        if self.where == "base":
            tracker = replace(tracker, base_drift=plus(tracker.base_drift, rate))
        else:
            tracker = replace(tracker, drift=plus(tracker.drift, rate))
        return replace(instruments, tracker=tracker)
