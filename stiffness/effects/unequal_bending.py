"""Bending and torsion of a link whose section is unequal across.

==========  ==========================================================================
Equation    as `link_bending`, EI = bending_nm2 about the direction u of an axis across
            the link, bending_ratio times as much about w x u; u is the link's own axis,
            or the next where the link lies along its own
Source      beams of unsymmetric section: Gere, Timoshenko 1997; a casting is alike on
            both sides of the plane in which its axis swings it (chosen)
Valid       as `link_bending`
Ignores     as `link_bending`; sections whose stiffest direction lies between (a
            variant)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Coeffs, Shape
from stiffness.effects.jacobian import EffectJacobian, hstack, mixture
from stiffness.effects.link_bending import LinkBending, bending, hinges
from stiffness.experiment.static_state import StaticState

EACH = np.eye(4)
"""Columns of `bending` one by one; the third couples both directions."""


@dataclass(frozen=True)
class UnequalBending(LinkBending):
    """Link that bends less in one direction than across it."""

    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **LinkBending.limits,
        "bending_ratio": (0.0, np.inf),
    }

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        whole = bending(situation, where, bool(shape[0]))
        return mixture(whole, EACH[:, [0, 1, 3]])

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        whole = bending(situation, where, bool(shape[0]))
        askew = mixture(whole, EACH[:, 2:3])
        return hstack([askew, *hinges(situation, where)])

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        about, across, torsion = coefficients
        equal = super().parameters(situation, where, shape, np.array([about, torsion]))
        return {**equal, "bending_ratio": about / across}
