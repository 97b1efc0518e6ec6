"""Smooth hardening of a gear: stiffness grows with the torque, without a kink.

==========  ==========================================================================
Equation    τ = K3 θ - (K3 - K1) θc arctan(θ/θc), so dτ/dθ climbs from K1 to K3;
            θc = 1.2 T1/K1
Source      law: a smooth alternative to the catalogue's three slopes; θc chosen so that
            it meets Harmonic Drive's size 32 (CHA data 1018854) at 60 and 100 N m
Valid       static torques below the gear's repeated peak
Ignores     hysteresis, the gear's own lost motion
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form, size
from bench.effects.springs import add_parallel
from bench.kinematic_chain import Anatomy

KNOTS = np.concatenate([np.linspace(0.1, 1.9, 10), np.geomspace(2.2, 12.0, 8)])
"""Deflections at which the mechanism's slope steps up, over θc; chosen: keeps within
0.5 % of the torque."""


@dataclass(frozen=True)
class SmoothHardening(ModelEffect):
    """Springs in parallel with the axis' own that engage one after the other.

    Attributes:
        stiffness_ratio: K3 / K1.
        torque_nm: T1, about where the stiffness begins to climb, in N m.
    """

    name: ClassVar[str] = "hardening"
    stiffness_ratio: float = size(1.79, 1.0, off=1.0)
    torque_nm: float = form(29.0, 1e-3)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        k1 = float(spec.joint(axis).stiffness[0])
        unit = 1.2 * self.torque_nm / k1
        middles = np.concatenate([[0.0], (KNOTS[1:] + KNOTS[:-1]) / 2, [np.inf]])
        slope = 1.0 - 1.0 / (1.0 + middles**2)  # of the extra torque, over K3 - K1
        extra = np.diff(slope) * (self.stiffness_ratio - 1.0) * k1
        for i, (knot, stiffness) in enumerate(zip(KNOTS, extra, strict=True)):
            slack = (-knot * unit, knot * unit)
            add_parallel(spec, f"{axis}_smooth_{i}", axis, stiffness, slack=slack)
