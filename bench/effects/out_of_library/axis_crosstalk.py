"""Crosstalk of axes: torque on one axis turns its neighbour through a shared casting.

==========  ==========================================================================
Equation    as `bench.effects.wrist_coupling`, on axes outside the wrist
Source      reciprocity of elastic bodies (Betti 1872); size chosen: a twentieth of the
            axes' own compliance
Valid       small wind-ups
Ignores     friction
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

from bench.effects.effect import form
from bench.effects.wrist_coupling import WristCoupling


@dataclass(frozen=True)
class AxisCrosstalk(WristCoupling):
    """A spring across the drives of two axes near the base."""

    name: ClassVar[str] = "axis_crosstalk"
    with_axis: str = form("a2")
    compliance_rad_per_nm: float = 1e-6
