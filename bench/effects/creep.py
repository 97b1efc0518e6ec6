"""Creep of a gear: viscoelastic wind-up that grows with the time under load.

==========  ==========================================================================
Equation    θ(t) = τ/K (1 + ratio (1 - exp(-t/T))) for a load τ applied at t = 0
Source      standard linear solid (Zener 1948); sizes chosen, no source for a gear
Valid       small creep, one relaxation time
Ignores     recovery of different speed, temperature
==========  ==========================================================================
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import Effect, ModelEffect, form, size
from bench.effects.springs import add_series, own_name
from bench.kinematic_chain import Anatomy


@dataclass(frozen=True)
class Creep(ModelEffect):
    """A spring and a damper in parallel, in series with the axis' own spring.

    Attributes:
        ratio: Wind-up gained in the end over the immediate one.
        time_s: Time constant T, in s.
    """

    name: ClassVar[str] = "creep"
    ratio: float = size(0.03, 0.0, 10.0)
    time_s: float = form(20.0, 1e-3, 10000000.0)

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        own = float(spec.joint(arm.axis(self.where)).stiffness[0])
        stiffness = own / self.ratio
        joint = add_series(spec, arm, self.where, "creep", stiffness)
        joint.damping = [stiffness * self.time_s, 0.0, 0.0]


def creeping(
    effects: Iterable[Effect], model: mujoco.MjModel, arm: Anatomy
) -> dict[int, float]:
    """Return each joint that creeps in a built model and its time constant, in s."""
    times: dict[str, float] = {}
    for effect in effects:
        if isinstance(effect, Creep) and effect.ratio != 0.0:
            joint = own_name(f"{arm.axis(effect.where)}_creep", times)
            times[joint] = effect.time_s
    return {model.joint(joint).id: time for joint, time in times.items()}
