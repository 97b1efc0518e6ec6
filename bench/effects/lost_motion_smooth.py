"""Smooth lost motion of a gear: stiffness grows gradually until the teeth carry.

==========  ==========================================================================
Equation    θ = τ/K + (width/2) tanh(τ/closing), as twelve straight pieces
Source      law: the usual smooth dead zone; Harmonic Drive CHA data 1018854: lost
            motion below 1 arcmin
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
from bench.effects.lost_motion import CONTACT
from bench.effects.springs import add_parallel, add_series
from bench.kinematic_chain import Anatomy

KNOTS = np.array([0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.4, 2.8, 3.5])
"""Torques at which the slope steps up, over the closing torque; chosen."""


@dataclass(frozen=True)
class SmoothLostMotion(ModelEffect):
    """A joint in series with the axis' spring, whose springs engage one by one.

    Attributes:
        width_rad: Full width of the play.
        closing_nm: Torque that closes 76 % of it, in N m; chosen.
    """

    name: ClassVar[str] = "lost_motion"
    width_rad: float = size(1.5e-4, 0.0, 0.1)
    closing_nm: float = assumed(1.5, 1e-6, 10000.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        own = float(spec.joint(arm.axis(self.where)).stiffness[0])
        turned = self.width_rad / 2 * np.tanh(KNOTS)
        pieces = np.diff(KNOTS, prepend=0.0) * self.closing_nm
        slope = pieces / np.diff(turned, prepend=0.0)
        slope = np.append(slope, slope[-1] + CONTACT * own)
        play = add_series(spec, arm, self.where, "smooth_play", slope[0])
        for i, (start, extra) in enumerate(zip(turned, np.diff(slope), strict=True)):
            name = f"{play.name}_{i}"
            add_parallel(spec, name, play.name, extra, slack=(-start, start))
