"""Compliance of the base under the whole arm, in all directions.

==========  ==========================================================================
Equation    turn about each axis of the base = compliance x moment about it, shift along
            it = compliance x force; about the base's origin
Source      six springs without coupling; Klimchik et al. 2011: diagonal compliance
Valid       small motions
Ignores     coupling of rotations with each other, and of a tilt with the shift across
            it (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape
from stiffness.effects.jacobian import BodyTwist, EffectJacobian
from stiffness.experiment.static_state import StaticState

TURNS = ("rx_rad_per_nm", "ry_rad_per_nm", "rz_rad_per_nm")
SHIFTS = ("x_m_per_n", "y_m_per_n", "z_m_per_n")

SOFT_TURN, SOFT_SHIFT = 3e-6, 3e-7
"""Prior sigma of what a foot gives way by, in rad/(N m) and m/N. Chosen: three times
what the softest pedestals do; what readings hold is not moved by it."""


@dataclass(frozen=True)
class BaseCompliance(Hypothesis):
    """Six springs between the floor and the base.

    Springs along other directions, or about a point below, are its variants: they
    couple two rotations, or a rotation about a level axis with the shift across it.
    """

    effect: ClassVar[str] = "base_compliance"
    linear: ClassVar[bool] = True
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **dict.fromkeys(TURNS, (0.0, 1e-4)),
        **dict.fromkeys(SHIFTS, (0.0, 1e-5)),
    }
    magnitudes: ClassVar[tuple[str, ...]] = (*TURNS, *SHIFTS)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return ("base",)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        give = np.zeros((situation.rows, 6, 6))
        along = np.arange(3)
        give[:, 3 + along, along] = situation.moment[:, 0]
        give[:, along, 3 + along] = situation.force[:, 0]
        return EffectJacobian(6, (BodyTwist(0, give),))

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        return np.repeat([SOFT_TURN, SOFT_SHIFT], 3)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        moment, force = situation.moment[:, 0], situation.force[:, 0]
        give = np.zeros((situation.rows, 6, 5))
        for column, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            give[:, 3 + i, column] = moment[:, j]
            give[:, 3 + j, column] = moment[:, i]
        for column, (i, j) in enumerate(((0, 1), (1, 0)), start=3):
            give[:, i, column] = moment[:, j]
            give[:, 3 + j, column] = force[:, i]
        return EffectJacobian(5, (BodyTwist(0, give),))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return dict(zip((*TURNS, *SHIFTS), coefficients, strict=True))
