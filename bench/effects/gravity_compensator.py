"""Gravity compensator: a spring between a link and the part below it.

==========  ==========================================================================
Equation    τ = torque_nm sin(q - phase_rad), positive about the axis
Source      ideal spring of length s = √(a² + b² - 2ab cos α) and stiffness k without
            free length: energy k s²/2, torque k a b sin α (Herder 2001, "Energy-free
            systems"); size chosen, the small KUKA arms have none
Valid       any turn
Ignores     free length (with it: k (1 - s₀/s) a b sin α), a gas spring's temperature
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from typing_extensions import override

from bench.effects.effect import ModelEffect, form
from bench.effects.springs import add_tendon, frame_along
from bench.kinematic_chain import Anatomy

ARM = 0.1
"""Distance of both ends of the spring from the axis, in m; chosen."""


@dataclass(frozen=True)
class GravityCompensator(ModelEffect):
    """A stretched spring from the link before to the link, in parallel with the gear.

    Attributes:
        torque_nm: Largest torque on the axis.
        phase_rad: Axis angle of zero torque: an unstable equilibrium of the spring
            where torque_nm is positive, a stable one where it is negative.
    """

    name: ClassVar[str] = "gravity_compensator"
    torque_nm: float = 50.0
    phase_rad: float = form(0.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = spec.joint(axis)
        u, v, _ = frame_along(np.asarray(own.axis, float)).T
        nearest = self.phase_rad + (np.pi if self.torque_nm > 0 else 0.0) - own.ref
        on_end = np.cos(nearest) * u + np.sin(nearest) * v
        tendon = add_tendon(spec, f"{axis}_compensator")
        tendon.stiffness = [abs(self.torque_nm) / ARM**2, 0.0, 0.0]
        for label, body, direction in (
            ("end", arm.end(axis), on_end),
            ("link", own.parent.name, u),
        ):
            place = np.asarray(own.pos, float) + ARM * direction
            spec.body(body).add_site(name=f"{tendon.name}_{label}", pos=place)
            tendon.wrap_site(f"{tendon.name}_{label}")
