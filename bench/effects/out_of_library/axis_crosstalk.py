"""Crosstalk of axes: torque on one axis turns its neighbour through a shared casting.

==========  ==========================================================================
Equation    as `bench.effects.wrist_coupling`, on axes outside the wrist
Source      reciprocity of elastic bodies (Betti 1872); size chosen: a twentieth of the
            axes' own compliance
Valid       small wind-ups
Ignores     friction
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import ModelEffect
from bench.effects.wrist_coupling import WristCoupling
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class AxisCrosstalk(ModelEffect):
    """A spring across the drives of two axes near the base.

    Attributes:
        with_axis: The other axis.
        compliance_rad_per_nm: Turn of either axis per torque on the other.
    """

    name: ClassVar[str] = "axis_crosstalk"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    absent: ClassVar[Mapping[str, float]] = {"compliance_rad_per_nm": 0.0}
    with_axis: str = "a2"
    compliance_rad_per_nm: float = 1e-6

    @override
    def parameters(self) -> Mapping[str, float | str]:
        return {
            "compliance_rad_per_nm": self.compliance_rad_per_nm,
            "with": self.with_axis,
        }

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        coupling = WristCoupling(self.where, self.with_axis, self.compliance_rad_per_nm)
        coupling.build(spec, arm)
