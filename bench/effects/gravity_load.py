"""Gravity load: mass or centre of mass of a part differs from its data sheet.

==========  ==========================================================================
Equation    m' = m + mass_kg, m' c' = m c + mass_kg × com
Source      Newton; size chosen: cables and hoses of 1 kg on a link
Valid       a body at rest
Ignores     the moment of inertia, which has no effect at rest
==========  ==========================================================================

A centre of mass alone is shifted by two of these effects, one with a negative mass.
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form
from bench.kinematic_chain import Anatomy
from bench.shared.errors import Unusable


@dataclass(frozen=True)
class GravityLoad(ModelEffect):
    """A point mass added to a body, or removed from it.

    Attributes:
        mass_kg: Mass added; negative: removed.
        com_x_m, com_y_m, com_z_m: Its position in the body's frame.
    """

    name: ClassVar[str] = "gravity_load"
    mass_kg: float = 1.0
    com_x_m: float = form(0.1)
    com_y_m: float = form(0.0)
    com_z_m: float = form(0.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        added = np.array([self.com_x_m, self.com_y_m, self.com_z_m])
        name = arm.body(self.where)
        if name == "tool" and name not in [b.name for b in spec.bodies]:
            name = arm.flange  # what hangs there, where the model has no such body
        body = spec.body(name)
        if not body.joints and body.mass + self.mass_kg <= 0.0:
            turned = np.zeros(3)  # then of what its carrier has, such as a stated tool
            mujoco.mju_rotVecQuat(turned, added, body.quat)
            added, body = turned + body.pos, body.parent
        own = float(body.mass) if body.explicitinertial else 0.0
        total = own + self.mass_kg
        if not total > 0.0:
            fault = f"{own:g} kg and {self.mass_kg:g} kg leave no mass; take less away."
            raise Unusable(f"Effect {self.name!r} at {self.where!r}", [fault])
        centre = np.asarray(body.ipos, float) if own > 0.0 else np.zeros(3)
        body.ipos = (own * centre + self.mass_kg * added) / total
        body.mass, body.explicitinertial = total, True
