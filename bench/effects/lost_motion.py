"""Lost motion of a gear: rotation within its play before the teeth carry.

==========  ==========================================================================
Equation    θ = τ/K + δ, |δ| ≤ width/2; inside the play only a weak centring spring
            acts, which the torque `closing_nm` overcomes; across the axis: δ about
            each of the two directions across it, on its seat, by the moment about it
Source      Harmonic Drive CHA data 1018854: lost motion below 1 arcmin; makers measure
            it between small torques of either sign
Valid       static loads
Ignores     friction inside the play (that is hysteresis)
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, assumed, size
from bench.effects.springs import (
    CLOSED,
    add_parallel,
    add_series,
    add_spring,
    frame_along,
)
from bench.kinematic_chain import Anatomy

CONTACT = 300.0
"""Stiffness of the closed play over the axis' own; chosen: practically rigid."""


@dataclass(frozen=True)
class LostMotion(ModelEffect):
    """A joint in series with the axis' spring, with a stiff stop at either end.

    Attributes:
        width_rad: Full width of the play.
        closing_nm: Torque at which the play closes, in N m; chosen: well below 1 % of
            what the axis carries.
        across: 0: about (along) the axis; 1: across it, as of a slide's guide or a
            bearing that tips to the side of the moment on it.
    """

    name: ClassVar[str] = "lost_motion"
    width_rad: float = size(1.5e-4, 0.0, 0.1)
    closing_nm: float = assumed(0.3, 1e-6, 10000.0)
    across: int = assumed(0, 0, 1)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        half = self.width_rad / 2
        centring = self.closing_nm / half
        if self.across:
            axis = arm.axis(self.where)
            joint = spec.joint(axis)
            for label, way in zip(
                "uv", frame_along(np.array(joint.axis)).T, strict=False
            ):
                name = f"{axis}_guide_play_{label}"
                tilt = add_spring(
                    spec.body(arm.seat(axis)), name, way, centring, pos=joint.pos
                )
                ends = f"{tilt.name}_ends"
                add_parallel(spec, ends, tilt.name, CLOSED, slack=(-half, half))
            return
        play = add_series(spec, arm, self.where, "lost_motion", centring)
        own = float(spec.joint(arm.axis(self.where)).stiffness[0])
        ends = f"{play.name}_ends"
        add_parallel(spec, ends, play.name, CONTACT * own, slack=(-half, half))
