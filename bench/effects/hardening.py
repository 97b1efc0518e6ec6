"""Hardening of a strain-wave gear: stiffness grows in three steps with the torque.

==========  ==========================================================================
Equation    τ = K1 θ up to T1, slope K2 up to T2, slope K3 beyond, both ways alike
Source      Harmonic Drive, CHA engineering data 1018854, torsional stiffness table
Valid       static torques below the gear's repeated peak
Ignores     hysteresis, the gear's own lost motion
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import ModelEffect, assumed, form, size
from bench.effects.springs import add_parallel
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class Hardening(ModelEffect):
    """Springs in parallel with the axis' own that engage at T1 and at T2.

    Attributes:
        stiffness_ratio: K3 / K1; the table has 1.5 to 1.84.
        torque_nm: T1, where K1 ends, in N m; size 32: 29.
        middle_share: (K2 - K1) / (K3 - K1); size 32, ratio above 50: 0.81.
        second_torque: T2 / T1; size 32: 3.7.
    """

    name: ClassVar[str] = "hardening"
    stiffness_ratio: float = size(1.79, 1.0, 100.0, off=1.0)
    torque_nm: float = form(29.0, 0.0, 1000000.0)
    middle_share: float = assumed(0.81, 0.0, 1.0)
    second_torque: float = assumed(3.72, 1.0, 100.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        k1 = float(spec.joint(axis).stiffness[0])
        k3 = k1 * self.stiffness_ratio
        k2 = k1 + self.middle_share * (k3 - k1)
        first = self.torque_nm / k1
        second = first + (self.second_torque - 1.0) * self.torque_nm / k2
        for step, start in (("1", (first, k2 - k1)), ("2", (second, k3 - k2))):
            wound, extra = start
            add_parallel(
                spec, f"{axis}_hardening_{step}", axis, extra, slack=(-wound, wound)
            )
