"""Wrench gain: scale errors of the force sensor's channels.

==========  ==========================================================================
Equation    reading_k = (1 + gain_k) wrench_k, channel by channel
Source      linear calibration of six-axis sensors; size chosen: makers state 1 to 2 %
            of full scale
Valid       within the sensor's range
Ignores     crosstalk, for which `ForceSensor.gain` has off-diagonal entries
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from typing_extensions import override

from bench.effects.effect import InstrumentEffect, plus
from bench.instruments import Instruments


@dataclass(frozen=True)
class WrenchGain(InstrumentEffect):
    """Scale error of each channel, as a share of its load.

    Attributes:
        fx, fy, fz: Of the force along the sensor's axes.
        tx, ty, tz: Of the torque about the sensor's axes.
    """

    name: ClassVar[str] = "wrench_gain"
    fx: float = 0.01
    fy: float = 0.0
    fz: float = 0.0
    tx: float = 0.0
    ty: float = 0.0
    tz: float = 0.0

    @override
    def fault(self, instruments: Instruments) -> Instruments:
        sensor = instruments.force_sensor
        own = np.diag(list(self.parameters().values()))
        rows = zip(sensor.gain, own, strict=True)
        gain = tuple(plus(before, tuple(row)) for before, row in rows)
        return replace(instruments, force_sensor=replace(sensor, gain=gain))
