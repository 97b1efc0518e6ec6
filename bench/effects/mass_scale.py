"""Mass scale: all masses of the arm differ from its data sheet by one factor.

==========  ==========================================================================
Equation    m' = ratio m of every body that an axis carries, centres as they are
Source      a model of another payload class or material, or a total mass shared out
            among the links; size chosen: 30 %
Valid       a body at rest
Ignores     that a tool, its sensor and what hangs on them were weighed: they stay
==========  ==========================================================================
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, size
from bench.kinematic_chain import Anatomy

MOUNTED = ("sensor_near_side", "sensor_far_side")
"""Bodies of the cell on the flange."""


@dataclass(frozen=True)
class MassScale(ModelEffect):
    """All links heavier, or lighter, by one factor; what other effects add as well.

    Attributes:
        ratio: Mass over the model's.
    """

    name: ClassVar[str] = "mass_scale"
    ratio: float = size(1.3, 0.01, off=1.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        roots = [arm.links[k] for k, parent in enumerate(arm.parents) if parent < 0]
        for body in _carried([spec.body(name) for name in roots]):
            if body.explicitinertial:
                body.mass *= self.ratio
                body.inertia = self.ratio * np.asarray(body.inertia)
                body.fullinertia = self.ratio * np.asarray(body.fullinertia)


def _carried(bodies: list[mujoco.MjsBody]) -> Iterator[mujoco.MjsBody]:
    for body in bodies:
        if body.name not in MOUNTED:
            yield body
            yield from _carried(list(body.bodies))
