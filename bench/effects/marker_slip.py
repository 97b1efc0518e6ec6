"""Marker slip: a marker's place on its body changes by a step during the measurement.

==========  ==========================================================================
Equation    place = nominal + (x, y, z) from `time_s` on, along its body's axes
Source      a step in time; size chosen: a film of glue gives 5 to 20 µm
Valid       one step per effect; several add
Ignores     slow creep of the glue
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.effect import InstrumentEffect, form
from bench.instruments import Instruments, Slip


@dataclass(frozen=True)
class MarkerSlip(InstrumentEffect):
    """Displacement of one marker on its body from a given time on.

    Attributes:
        x_m, y_m, z_m: Displacement along its body's axes.
        time_s: Time of the step since the start, in s.
    """

    name: ClassVar[str] = "marker_slip"
    x_m: float = 5e-5
    y_m: float = 0.0
    z_m: float = 0.0
    time_s: float = form(1800.0, 0.0)

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        shift = (self.x_m, self.y_m, self.z_m)
        if not any(shift):
            return instruments
        slip = Slip(self.where.removeprefix("marker:"), self.time_s, shift)
        markers = instruments.markers
        slipping = tuple(sorted((*markers.slips, slip), key=repr))
        return replace(instruments, markers=replace(markers, slips=slipping))
