"""Compliance of the base under the whole arm: six springs at one point.

==========  ==========================================================================
Equation    turn = compliance × moment about each axis of the base's frame, shift =
            compliance × force along each
Source      six springs at a point of the base's z axis; size chosen: anchor bolts and
            plate give 1e6 to 5e6 N m/rad, a welded pedestal about 1e7
Valid       small motions
Ignores     a pedestal that bends: its tilt and its shift are about two points
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, assumed, optional, size
from bench.effects.springs import add_spring, softest_directions
from bench.kinematic_chain import Anatomy, pose_in

LABELS = ("rx", "ry", "rz", "x", "y", "z")


@dataclass(frozen=True)
class BaseCompliance(ModelEffect):
    """Up to six springs under the base; a compliance of zero is rigid.

    Attributes:
        rx_rad_per_nm, ry_rad_per_nm, rz_rad_per_nm: Tilts about the base's x and y,
            turn about its z.
        x_m_per_n, y_m_per_n, z_m_per_n: Shifts along its axes.
        rxy_rad_per_nm: Tilt about x per moment about y, and about y per moment about x:
            the softest level direction lies between them.
        centre_m: Height of the springs' point above the base's origin, along its z.
    """

    name: ClassVar[str] = "base_compliance"
    rx_rad_per_nm: float = size(5e-7, 0.0)
    ry_rad_per_nm: float = size(5e-7, 0.0)
    rz_rad_per_nm: float = size(0.0, 0.0)
    x_m_per_n: float = size(0.0, 0.0)
    y_m_per_n: float = size(0.0, 0.0)
    z_m_per_n: float = size(0.0, 0.0)
    rxy_rad_per_nm: float = optional(0.0)
    centre_m: float = assumed(0.0, -10.0, 10.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        # an arm that stands on the world without a base gives way below its first axis
        foot = arm.end(arm.axes[0]) if arm.base == "world" else arm.base
        rotation, origin = pose_in(spec.body(foot), spec.body(arm.base))
        centre = rotation.T @ (np.array([0.0, 0.0, self.centre_m]) - origin)
        level = self.rx_rad_per_nm, self.ry_rad_per_nm, self.rxy_rad_per_nm
        tilts, across = softest_directions(*level)
        turns = [*tilts, self.rz_rad_per_nm]
        shifts = self.x_m_per_n, self.y_m_per_n, self.z_m_per_n
        directions = [*(across.T @ rotation[:2]), rotation[2], *rotation]
        for i, compliance in enumerate((*turns, *shifts)):
            if compliance > 0.0:
                add_spring(
                    spec.body(foot),
                    f"base_{LABELS[i]}",
                    directions[i],
                    1.0 / compliance,
                    pos=centre,
                    slide=i >= 3,
                )
