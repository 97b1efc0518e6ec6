"""Encoder offset: a constant difference between true and reported angle of an axis.

==========  ==========================================================================
Equation    q = q_reported + offset_rad
Source      Mooring, Roth, Driels 1991, "Fundamentals of manipulator calibration";
            size: zeros err by 0.2 to 1 mrad before calibration (Slamani 2012)
Valid       always
Ignores     eccentricity of the encoder (that is transmission_error)
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import Command, CommandEffect
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class EncoderOffset(CommandEffect):
    """Error of the zero of one axis.

    Attributes:
        offset_rad: True angle less the reported one.
    """

    name: ClassVar[str] = "encoder_offset"
    offset_rad: float = 5e-4

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        reference = np.zeros_like(posture)
        reference[:, arm.axes.index(arm.axis(self.where))] = self.offset_rad
        return Command(reference, np.zeros_like(posture))
