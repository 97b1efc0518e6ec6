"""Thrust rotation: helical teeth turn an axis that is pulled along itself.

==========  ==========================================================================
Equation    φ = c ((1 - r) τ + r L F), x = c L (r τ + (1 - r) L F) for a torque τ about
            the axis and a force F along it: a spring t (φ - x/L)²/2 beside two of 1/c
            and 1/(c L²), t = r/(c (1 - 2r))
Source      Sherman and Morrison 1950 for the inverse; a screw has r → 1/2; r = 0.45 and
            L chosen, about teeth at 20° on a radius of 0.1 m
Valid       small turns
Ignores     friction of the teeth
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form, size
from bench.effects.springs import HINGE, add_series, add_spring, add_tendon
from bench.kinematic_chain import Anatomy

TOGETHER = 0.45
"""r, coupling of rotation and shift by the thread; chosen, below 1/2."""


@dataclass(frozen=True)
class ThrustTurn(ModelEffect):
    """A hinge and a slide on the axis' seat, coupled like nut and screw.

    Attributes:
        compliance_rad_per_nm: c, of the springs beside the thread.
        lead_m: L, shift along the axis per radian, in m.
    """

    name: ClassVar[str] = "thrust_turn"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    compliance_rad_per_nm: float = size(4e-6, 0.0)
    lead_m: float = form(0.1, 1e-3)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = spec.joint(axis)
        if own.type != HINGE:
            return
        stiffness = 1.0 / self.compliance_rad_per_nm
        nut = add_series(spec, arm, self.where, "thrust", stiffness)
        seat, along = spec.body(arm.seat(axis)), np.asarray(own.axis, float)
        axial = stiffness / self.lead_m**2
        screw = add_spring(seat, f"{axis}_thrust_shift", along, axial, slide=True)
        tendon = add_tendon(spec, f"{axis}_thread")
        tendon.stiffness = [stiffness * TOGETHER / (1 - 2 * TOGETHER), 0.0, 0.0]
        tendon.wrap_joint(nut.name, 1.0)
        tendon.wrap_joint(screw.name, -1.0 / self.lead_m)
