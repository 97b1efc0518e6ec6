"""Wrench misalignment: rotation and offset of the force sensor on the flange.

==========  ==========================================================================
Equation    reading = exp([(rx, ry, rz)]×)ᵀ [F; M - (x, y, z) × F]
Source      rotation vector (Rodrigues 1840); moments about two points: statics; size
            chosen: half a degree is what a dowel pin with play allows
Valid       always; M about where the sensor's origin should be
Ignores     nothing
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.effect import InstrumentEffect, plus
from bench.instruments import Instruments


@dataclass(frozen=True)
class WrenchMisalignment(InstrumentEffect):
    """Rotation and offset of the sensor from the pose that the manifest states.

    Several misalignments add their vectors.

    Attributes:
        rx_rad, ry_rad, rz_rad: Rotation vector from the stated axes to its own, along
            the stated ones.
        x_m, y_m, z_m: Shift of its origin along the stated axes.
    """

    name: ClassVar[str] = "wrench_misalignment"
    rx_rad: float = 0.0
    ry_rad: float = 0.0
    rz_rad: float = 0.0087
    x_m: float = 0.0
    y_m: float = 0.0
    z_m: float = 0.0

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        sensor = instruments.force_sensor
        turn = plus(sensor.mounting, (self.rx_rad, self.ry_rad, self.rz_rad))
        shift = plus(sensor.offset, (self.x_m, self.y_m, self.z_m))
        seated = replace(sensor, mounting=turn, offset=shift)
        return replace(instruments, force_sensor=seated)
