"""Lost motion of a gear: rotation within its play before the teeth carry.

==========  ==========================================================================
Equation    θ = C τ + width/2 erf(√π/2 τ/c); c: the torque that would close the play
            at its initial rate
Source      dead zone: Nordin, Gutman 2002, "Controlling mechanical systems with
            backlash - a survey"; rounded by contacts whose torques spread normally
            (chosen)
Valid       torques of either sign; a play that a tenth of the largest load closes
Ignores     friction within the play; a sharp dead zone and a tanh (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.special import erf
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, Shapes, reversing
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.effects.statics import ROUNDING
from stiffness.experiment.static_state import StaticState

CLOSING = (0.003, 0.01, 0.03, 0.06, 0.1)
"""c over the axis' largest torque by a load, or at all where there is none; chosen:
makers measure lost motion at 5 % of the rated torque, and a knee at more than a tenth
is hardening."""


@dataclass(frozen=True)
class LostMotion(Hypothesis):
    """Axis that jumps by the width of its play when its torque reverses."""

    effect: ClassVar[str] = "lost_motion"
    sized_by: ClassVar[str] = "width_rad"
    shape_names: ClassVar[tuple[str, ...]] = ("closing_nm",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "width_rad": (0.0, 1e-2),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("width_rad",)
    size_of_variants: ClassVar[float | None] = 1.0

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return reversing(situation)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        k = situation.axis(where)
        largest = np.max(np.abs(situation.torque[:, k]))
        loaded = np.max(np.abs(situation.load_torque[:, k]))
        largest = loaded if ROUNDING < loaded < largest else largest
        return (largest * np.array(CLOSING))[:, None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        closed = erf(np.sqrt(np.pi) / 2.0 * situation.torque[:, k] / shape[0])
        return turn(k, 0.5 * closed)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        share = situation.torque[:, k] / shape[0]
        return turn(k, 0.5 * np.clip(share, -1.0, 1.0), 0.5 * np.tanh(share))
