"""Wrist coupling: torque on one wrist axis turns another through shared gears.

==========  ==========================================================================
Equation    θ = C τ for the pair, with C₁₂ = C₂₁ = c = compliance_rad_per_nm and
            Cᵢᵢ = (1 - r)/Kᵢ, r = |c| √(K₁ K₂)
Source      a spring t (√K₁ θ₁ ∓ √K₂ θ₂)²/2 beside the two drives, t = r/(1 - 2r),
            inverted by Sherman and Morrison 1950; size chosen: a twentieth of a
            wrist's own compliance
Valid       r < 1/2
Ignores     friction and play between the two trains
==========  ==========================================================================

A spring in parallel with two springs can only stiffen, so each axis' own compliance
falls by the share r; of all such springs the one that takes equal shares from both was
chosen.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form
from bench.effects.springs import add_tendon
from bench.kinematic_chain import Anatomy
from bench.shared.errors import Unusable

MAX_SHARE = 0.45
"""Largest share r; chosen: below 1/2, where the spring would have to be rigid."""


@dataclass(frozen=True)
class WristCoupling(ModelEffect):
    """A spring that couples the drives of two axes.

    Attributes:
        with_axis: The other axis, nearer to the base.
        compliance_rad_per_nm: Turn of either axis per torque on the other.
    """

    name: ClassVar[str] = "wrist_coupling"
    with_axis: str = form("a4")
    compliance_rad_per_nm: float = 5e-6

    @override
    def parameters(self) -> Mapping[str, float | str]:
        return {
            "compliance_rad_per_nm": self.compliance_rad_per_nm,
            "with": self.with_axis,
        }

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        pair = [arm.axis(self.with_axis), arm.axis(self.where)]
        root = np.sqrt([float(spec.joint(axis).stiffness[0]) for axis in pair])
        share = abs(self.compliance_rad_per_nm) * root[0] * root[1]
        if share > MAX_SHARE or pair[0] == pair[1]:
            largest = MAX_SHARE / (root[0] * root[1])
            fault = (
                f"it couples {pair[1]} with {pair[0]} by "
                f"{self.compliance_rad_per_nm:g} rad/(N m); "
                f"use two axes and at most {largest:.3g}."
            )
            raise Unusable(f"Effect {self.name!r} at {self.where!r}", [fault])
        tendon = add_tendon(spec, f"{pair[1]}_with_{pair[0]}")
        tendon.stiffness = [root[0] * root[1] * share / (1 - 2 * share), 0.0, 0.0]
        balance = np.sqrt(root[0] / root[1])
        tendon.wrap_joint(pair[0], balance)
        tendon.wrap_joint(pair[1], -np.sign(self.compliance_rad_per_nm) / balance)
