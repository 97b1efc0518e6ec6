"""Tilt of the base: base compliance reduced to two rotations.

==========  ==========================================================================
Equation    turn about x and y of the base = compliance x moment about them, about the
            base's origin
Source      bolts and plates are soft in tilt alone: Klimchik et al. 2011, diagonal
            compliance
Valid       as `base_compliance`, with four springs less to fit
Ignores     turn about the vertical, shifts, couplings (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape
from stiffness.effects.base_compliance import TURNS, BaseCompliance
from stiffness.effects.jacobian import BodyTwist, EffectJacobian, values
from stiffness.experiment.static_state import StaticState

AT_ORIGIN = np.zeros(1)
"""Height of the point about which it tilts; at another one, see `BaseCompliance`."""


@dataclass(frozen=True)
class BaseTilt(Hypothesis):
    """Two springs between the floor and the base."""

    effect: ClassVar[str] = "base_compliance"
    linear: ClassVar[bool] = True
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        name: BaseCompliance.limits[name] for name in TURNS[:2]
    }
    magnitudes: ClassVar[tuple[str, ...]] = TURNS[:2]

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return ("base",)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return springs(situation, where, (0, 1))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        beside = springs(situation, where, (2, 3, 4, 5))
        coupled = BaseCompliance().variants(situation, where, AT_ORIGIN)
        twists = [values(part) for part in (*beside.parts, *coupled.parts)]
        return EffectJacobian(11, (BodyTwist(0, np.concatenate(twists, axis=2)),))


def springs(
    situation: StaticState, where: str, chosen: tuple[int, ...]
) -> EffectJacobian:
    """Return some of the six springs: rx, ry, rz, x, y, z."""
    parts = BaseCompliance().jacobian(situation, where, AT_ORIGIN).parts
    moved = [p.twist[:, :, chosen] for p in parts if isinstance(p, BodyTwist)]
    return EffectJacobian(len(chosen), tuple(BodyTwist(0, twist) for twist in moved))
