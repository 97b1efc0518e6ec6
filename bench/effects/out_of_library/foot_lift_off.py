"""Lift-off of a foot that is bolted down on one side only.

==========  ==========================================================================
Equation    turn about the foot's centre = compliance × moment about it where that is
            above `preload_nm`, counted from there; else none
Source      unilateral contact (Signorini 1933); size chosen, as of
            `bench.effects.base_compliance`
Valid       small turns
Ignores     the foot's rotation about its edge, which moves as the gap opens
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form, size
from bench.effects.springs import NEVER, add_parallel, add_spring
from bench.kinematic_chain import Anatomy

CLOSED = 1000.0
"""Stiffness of the foot on its plate over that of the gap; chosen: rigid."""


@dataclass(frozen=True)
class FootLiftOff(ModelEffect):
    """A hinge along an edge with a stop where the foot stands on its plate.

    Attributes:
        edge_rad_per_nm: Compliance of the open side.
        angle_rad: Direction of the edge about the base's z, from its x.
        preload_nm: Moment at which it lifts.
    """

    name: ClassVar[str] = "foot_lift_off"
    places: ClassVar[tuple[str, ...]] = ("base",)
    edge_rad_per_nm: float = size(1e-6, 0.0)
    angle_rad: float = form(0.0)
    preload_nm: float = form(5.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        foot = arm.end(arm.axes[0]) if arm.base == "world" else arm.base
        edge = np.array([np.cos(self.angle_rad), np.sin(self.angle_rad), 0.0])
        stiffness = 1.0 / self.edge_rad_per_nm
        hinge = add_spring(spec.body(foot), "foot_edge", edge, stiffness)
        hinge.springref = -self.preload_nm * self.edge_rad_per_nm  # holds it closed
        stop = (CLOSED - 1.0) * stiffness
        add_parallel(spec, "foot_stop", hinge.name, stop, slack=(0.0, NEVER))
