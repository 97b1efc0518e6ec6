"""Transmission error of a gear: output angle errs periodically, with or without load.

==========  ==========================================================================
Equation    q = q_reported + amplitude sin(order q_reported + phase)
Source      Tuttle 1992, "Understanding and modeling the behavior of a harmonic drive";
            size: Harmonic Drive CHA data 1018854, 1 arcmin from peak to peak
Valid       at rest
Ignores     the share that grows with load (Ghorbel 2001)
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import Command, CommandEffect, form
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class TransmissionError(CommandEffect):
    """Periodic error of an axis' output angle.

    Attributes:
        amplitude_rad: Half the error from peak to peak.
        order: Periods per turn of the axis; 2 times the ratio of a strain-wave gear.
            Chosen: 2, as of an encoder disc that is out of round.
        phase_rad: Phase at the axis' zero.
    """

    name: ClassVar[str] = "transmission_error"
    amplitude_rad: float = 1.45e-4
    order: float = form(2.0)
    phase_rad: float = form(0.0)

    @override
    def command(
        self, posture: Float[np.ndarray, "visits axes"], nominal: Command, arm: Anatomy
    ) -> Command:
        a = arm.axes.index(arm.axis(self.where))
        error = np.sin(self.order * posture[:, a] + self.phase_rad)
        reference = np.zeros_like(posture)
        reference[:, a] = self.amplitude_rad * error
        return Command(reference, np.zeros_like(posture))
