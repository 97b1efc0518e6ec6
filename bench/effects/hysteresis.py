"""Hysteresis of a gear: friction makes its wind-up depend on the path of the load.

==========  ==========================================================================
Equation    τ = K θ + Σ fᵢ, each fᵢ an ideal elastic-slipping element (Maxwell slip);
            fully slipped, the loop is 2 Σ max|fᵢ| / K wide at zero torque
Source      Iwan 1966; Lampaert, Swevers, Al-Bender 2002 (Maxwell-slip friction);
            Harmonic Drive CHA data 1018854: hysteresis loss below 1 arcmin
Valid       slow loads; rate-independent
Ignores     Stribeck effect, ageing of the contact
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, assumed, size
from bench.effects.springs import add_parallel
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class Hysteresis(ModelEffect):
    """Maxwell-slip elements of equal stiffness in parallel with the axis' spring.

    Attributes:
        width_rad: Full width of the loop at zero torque, all elements slipped.
        elements: Number of slipping springs, whose slip torques are spread out; chosen.
        stiffening: Sum of their stiffness over the axis' own; chosen.
    """

    name: ClassVar[str] = "hysteresis"
    width_rad: float = size(1.5e-4, 0.0, 0.1)
    elements: int = assumed(4, 1, 100)
    stiffening: float = assumed(0.6, 1e-3, 100.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = float(spec.joint(axis).stiffness[0])
        each = self.stiffening * own / self.elements
        share = np.arange(1, self.elements + 1, dtype=float)
        slips = share / share.sum() * (self.width_rad * own / 2) / each  # rad
        for i, slip in enumerate(slips):
            add_parallel(spec, f"{axis}_slip_{i}", axis, each, springyield=float(slip))
