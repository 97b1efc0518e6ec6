"""Wrench bias: a constant offset of the force sensor's reading.

==========  ==========================================================================
Equation    reading = wrench + bias, along the sensor's axes
Source      linear calibration of six-axis sensors; size chosen: a tare taken an hour
            ago
Valid       as long as temperature and mounting stay as they are
Ignores     drift of the bias
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

from typing_extensions import override

from bench.effects.effect import InstrumentEffect, plus
from bench.instruments import Instruments


@dataclass(frozen=True)
class WrenchBias(InstrumentEffect):
    """Constant offset of the sensor's reading.

    Attributes:
        fx_n, fy_n, fz_n: Force along the sensor's axes.
        tx_nm, ty_nm, tz_nm: Torque about the sensor's axes.
    """

    name: ClassVar[str] = "wrench_bias"
    fx_n: float = 0.5
    fy_n: float = 0.0
    fz_n: float = 0.0
    tx_nm: float = 0.0
    ty_nm: float = 0.0
    tz_nm: float = 0.0

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        sensor = instruments.force_sensor
        bias = plus(sensor.bias, tuple(self.parameters().values()))
        return replace(instruments, force_sensor=replace(sensor, bias=bias))
