"""Bending and torsion of a link under load, as of a beam.

==========  ==========================================================================
Equation    a force F across the end: deflection F L³/3EI, slope F L²/2EI; a moment M:
            slope M L/EI, deflection M L²/2EI; a torque T along it: twist T L/GJ
Source      Euler-Bernoulli beam, held at one axis and loaded at the next; size: an
            aluminium tube of 150 mm with 8 mm wall, EI = 6.3e5 N m², GJ = 4.7e5 N m²
            (chosen; cast links differ)
Valid       small deflections; a straight link of one section
Ignores     shear, stretch, the bend under the link's own distributed weight; where
            bearings sit: the beam goes from joint origin to joint origin of the model
            (on the KR10's link_4 that is 9 degrees off the forearm's centre line)
==========  ==========================================================================
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, size
from bench.effects.springs import add_spring, frame_along
from bench.kinematic_chain import Anatomy, pose_in
from bench.shared.errors import Unusable


@dataclass(frozen=True)
class LinkBending(ModelEffect):
    """Hinges L/EI and L/GJ at mid-link, slides L³/12EI across it: an exact equivalent.

    Attributes:
        bending_nm2: EI, the same in all directions across the link; inf is rigid.
        torsion_nm2: GJ; inf is rigid.
    """

    name: ClassVar[str] = "link_bending"
    bending_nm2: float = size(6.3e5, 1.0, off=math.inf)
    torsion_nm2: float = size(4.7e5, 1.0, off=math.inf)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        link = arm.body(self.where)
        end = spec.body(arm.end_of(self.where))
        rotation, origin = pose_in(end, spec.body(link))
        start = rotation.T @ (_anchor(spec, arm, link) - origin)  # in the end's frame
        tip = _anchor(spec, arm, end.name)
        length = float(np.linalg.norm(tip - start))
        if length < 1e-4:
            fault = f"{link!r} has no length between its axes; it cannot bend."
            raise Unusable(f"Effect {self.name!r} at {self.where!r}", [fault])
        u, v, w = frame_along(tip - start).T
        middle = (start + tip) / 2
        bend, name = self.bending_nm2 / length, f"{link}_bend"
        if math.isfinite(bend):
            shear = 12 * bend / length**2
            add_spring(end, f"{name}_u", u, bend, pos=middle)
            add_spring(end, f"{name}_v", v, bend, pos=middle)
            add_spring(end, f"{name}_along_u", u, shear, slide=True)
            add_spring(end, f"{name}_along_v", v, shear, slide=True)
        if math.isfinite(self.torsion_nm2):
            add_spring(end, f"{name}_twist", w, self.torsion_nm2 / length, pos=middle)


def _anchor(spec: mujoco.MjSpec, arm: Anatomy, body: str) -> np.ndarray:
    """Return where the axis on a link or an end is held, in that body's frame, in m."""
    held = {arm.end(axis): axis for axis in arm.axes}
    held |= dict(zip(arm.links, arm.axes, strict=True))
    return np.array(spec.joint(held[body]).pos) if body in held else np.zeros(3)
