"""Lost motion of a gear: rotation within its play before the teeth carry.

==========  ==========================================================================
Equation    θ = τ/K + δ, |δ| ≤ width/2; inside the play only a weak centring spring
            acts, which the torque `closing_nm` overcomes
Source      Harmonic Drive CHA data 1018854: lost motion below 1 arcmin; makers measure
            it between small torques of either sign
Valid       static loads
Ignores     friction inside the play (that is hysteresis)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import mujoco
from typing_extensions import override

from bench.effects.effect import ModelEffect
from bench.effects.springs import add_parallel, add_series
from bench.kinematic_chain import Anatomy

CONTACT = 300.0
"""Stiffness of the closed play over the axis' own; chosen: practically rigid."""


@dataclass(frozen=True)
class LostMotion(ModelEffect):
    """A joint in series with the axis' spring, with a stiff stop at either end.

    Attributes:
        width_rad: Full width of the play.
        closing_nm: Torque at which the play closes, in N m; chosen: well below 1 % of
            what the axis carries.
    """

    name: ClassVar[str] = "lost_motion"
    places: ClassVar[tuple[str, ...]] = ("axis",)
    at_least: ClassVar[Mapping[str, float]] = {"width_rad": 0.0, "closing_nm": 1e-6}
    at_most: ClassVar[Mapping[str, float]] = {"width_rad": 0.1, "closing_nm": 10000.0}
    width_rad: float = 1.5e-4
    closing_nm: float = 0.3

    @override
    def off(self) -> "LostMotion":
        return replace(self, width_rad=0.0)

    @override
    def parameters(self) -> Mapping[str, float]:
        return {"width_rad": self.width_rad}

    @override
    def build(self, spec: mujoco.MjSpec, arm: Anatomy) -> None:
        if self.width_rad == 0.0:
            return
        half = self.width_rad / 2
        centring = self.closing_nm / half
        play = add_series(spec, arm, self.where, "lost_motion", centring)
        own = float(spec.joint(arm.axis(self.where)).stiffness[0])
        ends = f"{play.name}_ends"
        add_parallel(spec, ends, play.name, CONTACT * own, slack=(-half, half))
