"""A force sensor sits on the flange a little turned.

==========  ==========================================================================
Equation    reading = exp([(rx, ry, rz)]×)ᵀ wrench, force and torque alike
Source      rotation vector (Rodrigues 1840); size chosen: half a degree is what a dowel
            pin with play allows
Valid       always; about the sensor's origin
Ignores     a sensor that sits beside its place
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.instrument_effect import InstrumentEffect, plus
from bench.instruments import Instruments


@dataclass(frozen=True)
class WrenchMisalignment(InstrumentEffect):
    """Rotation vector from the axes that the manifest states to the sensor's own.

    Attributes:
        rx_rad: About the stated x.
        ry_rad: About the stated y.
        rz_rad: About the stated z; several misalignments add their vectors.
    """

    name: ClassVar[str] = "wrench_misalignment"
    places: ClassVar[tuple[str, ...]] = ("wrench_sensor",)
    rx_rad: float = 0.0
    ry_rad: float = 0.0
    rz_rad: float = 0.0087

    @override
    def off(self) -> "WrenchMisalignment":
        return replace(self, **dict.fromkeys(self.parameters(), 0.0))

    @override
    def parameters(self) -> Mapping[str, float]:
        return {f.name: getattr(self, f.name) for f in fields(self)[1:]}

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        sensor = instruments.force_sensor
        turn = plus(sensor.mounting, tuple(self.parameters().values()))
        return replace(instruments, force_sensor=replace(sensor, mounting=turn))
