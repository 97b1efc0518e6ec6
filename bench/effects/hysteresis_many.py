"""Hysteresis of a gear with many contacts: exponential first loading, Masing branches.

==========  ==========================================================================
Equation    from rest the friction grows as F(θ) = Fc (1 - exp(-θ/θ₀)); after each
            turning point as 2 F(Δθ/2); the full loop is 2 Fc/K wide at zero torque
Source      first loading: Dahl 1968; turning points: Masing 1926, as sums of slipping
            springs obey them (Iwan 1967); size as in `hysteresis`
Valid       slow loads; rate-independent
Ignores     Stribeck effect, ageing of the contact
==========  ==========================================================================
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import assumed
from bench.effects.hysteresis import Hysteresis
from bench.effects.springs import add_parallel
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class ManyContacts(Hysteresis):
    """Maxwell-slip elements that follow the first loading curve within 1 % of Fc.

    Attributes:
        stiffening: Fc/θ₀, about the sum of their stiffness, over the axis' own; chosen.
    """

    elements: int = assumed(12, 1, 100)
    stiffening: float = assumed(1.0, 1e-3, 100.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = float(spec.joint(axis).stiffness[0])
        step = np.arange(1, self.elements + 1) / (self.elements + 1)
        slip = -2 * np.log1p(-step)  # over θ₀; spaced for equal errors of the chords
        friction = -np.expm1(-slip)
        chord = np.diff(friction / friction[-1], prepend=0) / np.diff(slip, prepend=0)
        share = -np.diff(chord, append=0.0)
        reach = self.width_rad / 2 / self.stiffening  # θ₀ in rad
        for i in range(self.elements):
            add_parallel(
                spec,
                f"{axis}_contact_{i}",
                axis,
                share[i] * self.stiffening * own,
                springyield=float(slip[i] * reach),
            )
