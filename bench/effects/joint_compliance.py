"""Compliance of a joint beyond the model's own, in proportion to its torque.

==========  ==========================================================================
Equation    θ = τ/K + compliance τ
Source      Spong 1987, "Modeling and control of elastic joint robots"; size: about the
            axes of a 10 kg robot, 50 kN m/rad
Valid       static torques below the gear's repeated peak
Ignores     hardening, hysteresis, compliance of the bearing and the links
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import ModelEffect, size
from bench.effects.springs import add_series
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class JointCompliance(ModelEffect):
    """A spring in series with the axis' own.

    Attributes:
        compliance_rad_per_nm: Compliance added to the axis' own.
    """

    name: ClassVar[str] = "joint_compliance"
    compliance_rad_per_nm: float = size(2e-5, 0.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        stiffness = 1.0 / self.compliance_rad_per_nm
        add_series(spec, arm, self.where, "compliance", stiffness)
