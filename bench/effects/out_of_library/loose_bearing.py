"""Loose bearing: tilt in one direction only, after its preload was lost.

==========  ==========================================================================
Equation    tilt = compliance × moment about u where that is above zero, else none; its
            even part is compliance |moment| / 2
Source      unilateral contact (Signorini 1933) of one row of rollers; size chosen, as
            of `bench.effects.bearing_tilt`
Valid       small tilts
Ignores     growth of the contact's stiffness with its load
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form, size
from bench.effects.springs import NEVER, add_parallel, add_spring, frame_along
from bench.kinematic_chain import Anatomy

CLOSED = 300.0
"""Stiffness of the closed side over that of the open one; chosen: practically rigid."""


@dataclass(frozen=True)
class LooseBearing(ModelEffect):
    """A hinge across the axis with a stop on one side.

    Attributes:
        u_rad_per_nm: Compliance of the open side.
        angle_rad: Of u about the axis, from the first direction across it.
    """

    name: ClassVar[str] = "loose_bearing"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    u_rad_per_nm: float = size(4e-6, 0.0)
    angle_rad: float = form(0.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own, seat = spec.joint(axis), spec.body(arm.seat(axis))
        u, v, _ = frame_along(np.asarray(own.axis, float)).T
        across = np.cos(self.angle_rad) * u + np.sin(self.angle_rad) * v
        stiffness, name = 1.0 / self.u_rad_per_nm, f"{axis}_loose"
        pos = np.asarray(own.pos, float)
        hinge = add_spring(seat, name, across, stiffness, pos=pos)
        stop = (CLOSED - 1.0) * stiffness
        add_parallel(spec, f"{name}_stop", hinge.name, stop, slack=(0.0, NEVER))
