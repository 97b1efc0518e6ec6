"""Softening of a preloaded joint once the torque exceeds its preload.

==========  ==========================================================================
Equation    τ = K θ up to |τ| = torque_nm, slope ratio K beyond, both ways alike
Source      joint diagram of preloaded bolts, VDI 2230: parts that no longer touch leave
            the bolt alone to carry; sizes chosen
Valid       static loads
Ignores     friction between the parts
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import ModelEffect, form, size
from bench.effects.springs import add_parallel
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class Softening(ModelEffect):
    """A spring of negative stiffness in parallel with the axis' own, from a wind-up on.

    Attributes:
        ratio: Stiffness beyond the preload over that below.
        torque_nm: Torque at which the parts separate, in N m.
    """

    name: ClassVar[str] = "softening"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    ratio: float = size(0.8, 0.2, off=1.0)
    torque_nm: float = form(20.0, 0.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = float(spec.joint(axis).stiffness[0])
        wound = self.torque_nm / own
        lost = (self.ratio - 1.0) * own
        add_parallel(spec, f"{axis}_softening", axis, lost, slack=(-wound, wound))
