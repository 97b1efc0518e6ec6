"""Gravity compensator: a spring between a link and the part below it.

==========  ==========================================================================
Equation    τ = torque_nm sin x (1 - f (1 - r)/√(1 + r² ± 2 r cos x)), positive about
            the axis; x = q - phase_rad, r = arm_ratio, f = free_length_ratio, ± the
            sign of torque_nm
Source      spring of length s = √(a² + b² + 2ab cos x), stiffness k and free length s₀:
            energy k (s - s₀)²/2, torque k a b sin x (1 - s₀/s), r = a/b,
            f = s₀/(b - a) (Klimchik et al. 2013, arXiv 1311.6810); without
            free length: Herder 2001, "Energy-free systems"; size chosen, the small KUKA
            arms have none
Valid       any turn; a spring that pulls with F + k s, as a gas cylinder does, has a
            free length of -F/k
Ignores     a gas cylinder's temperature, friction at its ends
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
"""Distance of the spring's end on the part before from the axis, in m; chosen."""
FAR = 1e3
"""Free length in m of the soft second spring whose push is that of a free length: both
together have the stiffness of one; chosen."""


@dataclass(frozen=True)
class GravityCompensator(ModelEffect):
    """A stretched spring from the link before to the link, in parallel with the gear.

    Attributes:
        torque_nm: Largest torque on the axis without free length: the part that grows
            with the spring's length.
        phase_rad: Axis angle of zero torque: an unstable equilibrium of the spring
            where torque_nm is positive, a stable one where it is negative.
        free_length_ratio: Free length of the spring over its shortest length; negative
            where it pulls at no length.
        arm_ratio: Distance from the axis to the nearer end over that to the farther.
    """

    name: ClassVar[str] = "gravity_compensator"
    torque_nm: float = 50.0
    phase_rad: float = form(0.0)
    free_length_ratio: float = form(0.0, -1e3, 1.0)
    arm_ratio: float = form(0.5, 1e-2, 0.99)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        axis = arm.axis(self.where)
        own = spec.joint(axis)
        u, v, _ = frame_along(np.asarray(own.axis, float)).T
        nearest = self.phase_rad + (np.pi if self.torque_nm > 0 else 0.0) - own.ref
        on_end = np.cos(nearest) * u + np.sin(nearest) * v
        stiffness = abs(self.torque_nm) / (self.arm_ratio * ARM**2)
        shortest = (1.0 - self.arm_ratio) * ARM
        push = stiffness * self.free_length_ratio * shortest / FAR
        pull = add_tendon(spec, f"{axis}_compensator")
        pull.stiffness = [stiffness - push, 0.0, 0.0]
        tendons = [pull]
        if push != 0.0:  # MuJoCo has no spring of negative free length
            label = f"{axis}_compensator_free_length"
            tendons.append(add_tendon(spec, label, (FAR, FAR)))
            tendons[1].stiffness = [push, 0.0, 0.0]
        for label, body, direction in (
            ("end", arm.end(axis), self.arm_ratio * on_end),
            ("link", own.parent.name, u),
        ):
            place = np.asarray(own.pos, float) + ARM * direction
            spec.body(body).add_site(name=f"{pull.name}_{label}", pos=place)
            for tendon in tendons:
                tendon.wrap_site(f"{pull.name}_{label}")
