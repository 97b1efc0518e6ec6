"""Tilt of a joint bearing: compliance about the two directions across the axis.

==========  ==========================================================================
Equation    tilt about u = u_rad_per_nm × moment about u + uv_rad_per_nm × moment about
            v, and the same for v, both about a centre on the axis; beyond
            moment_nm, compliance_ratio times as much per moment
Source      Klimchik 2011: a joint's tilt compliance is 13 % of its torsional one;
            scaled to 63 kN m/rad this is 1 / 480 kN m/rad
Valid       small tilts
Ignores     shift along and across the axis; what the moment about one direction changes
            about the other where the bearing grows stiffer
==========  ==========================================================================

The directions u and v are those of `bench.effects.springs.frame_along`: for an axis
along z they are x and y of the seat, which does not turn with the axis.
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form, optional, size
from bench.effects.springs import (
    CLOSED,
    add_parallel,
    add_spring,
    frame_along,
    softest_directions,
)
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class BearingTilt(ModelEffect):
    """Two hinges across the axis, on its seat.

    Attributes:
        u_rad_per_nm: Compliance about the first direction across the axis.
        v_rad_per_nm: Compliance about the second.
        centre_m: Where the bearing sits, along the axis from the joint's origin.
        uv_rad_per_nm: Tilt about either direction per moment about the other, where the
            softest one lies between them.
        compliance_ratio: Compliance beyond moment_nm over that below; 0: small moments
            take up a play.
        moment_nm: Moment about a direction from which the bearing is stiffer.
    """

    name: ClassVar[str] = "bearing_tilt"
    u_rad_per_nm: float = size(1 / 480e3, 0.0)
    v_rad_per_nm: float = size(1 / 480e3, 0.0)
    centre_m: float = form(0.0)
    uv_rad_per_nm: float = optional(0.0)
    compliance_ratio: float = optional(1.0, 0.0, 1.0)
    moment_nm: float = optional(10.0, 1e-9, 1e6)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own, seat = spec.joint(axis), spec.body(arm.seat(axis))
        u, v, w = frame_along(np.asarray(own.axis, float)).T
        centre = np.asarray(own.pos, float) + self.centre_m * w
        own_of = self.u_rad_per_nm, self.v_rad_per_nm, self.uv_rad_per_nm
        compliances, across = softest_directions(*own_of)
        directions = np.column_stack([u, v]) @ across
        for label, direction, compliance in zip(
            "uv", directions.T, compliances, strict=True
        ):
            if compliance <= 0.0:
                continue
            soft = 1.0 / compliance
            tilt = add_spring(seat, f"{axis}_tilt_{label}", direction, soft, pos=centre)
            share = max(self.compliance_ratio, min(1.0, soft / CLOSED))
            if share < 1.0:
                end = self.moment_nm * compliance
                name, more = f"{tilt.name}_beyond", soft / share - soft
                add_parallel(spec, name, tilt.name, more, slack=(-end, end))
