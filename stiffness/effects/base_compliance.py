"""Compliance of the base under the whole arm, in all directions.

==========  ==========================================================================
Equation    turn about each axis of the base = compliance x moment about it, shift along
            it = compliance x force; about a point of the base's z axis
Source      six springs without coupling; Klimchik et al. 2011: diagonal compliance
Valid       small motions
Ignores     coupling of rotations with each other, and of each tilt with the shift
            across it (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, Shapes
from stiffness.effects.jacobian import BodyTwist, EffectJacobian, rotate, translate
from stiffness.experiment.static_state import StaticState
from stiffness.robot.kinematics import cross

TURNS = ("rx_rad_per_nm", "ry_rad_per_nm", "rz_rad_per_nm")
SHIFTS = ("x_m_per_n", "y_m_per_n", "z_m_per_n")

CENTRES = (-0.5, -0.25, -0.1, 0.0, 0.1, 0.25)
"""Heights of the springs' point above the base's origin in m; chosen: a plate on the
floor, a pedestal below it, a flange above it."""
SOFT_TURN, SOFT_SHIFT = 3e-6, 3e-7
"""Prior sigma of what a foot gives way by, in rad/(N m) and m/N. Chosen: three times
what the softest pedestals do; what readings hold is not moved by it."""


@dataclass(frozen=True)
class BaseCompliance(Hypothesis):
    """Six springs between the floor and the base.

    Springs along other directions, or about a point of their own for either tilt, are
    its variants: they couple two rotations, or a tilt with the shift across it. See
    `askew_base`.
    """

    effect: ClassVar[str] = "base_compliance"
    linear: ClassVar[bool] = True
    shape_names: ClassVar[tuple[str, ...]] = ("centre_m",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **dict.fromkeys(TURNS, (0.0, 1e-4)),
        **dict.fromkeys(SHIFTS, (0.0, 1e-5)),
    }
    magnitudes: ClassVar[tuple[str, ...]] = (*TURNS, *SHIFTS)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return ("base",)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return np.array(CENTRES)[:, None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        moment, centre = about(situation, shape[0])
        eye, force = np.eye(3), situation.force[:, 0]
        turn = rotate(0, eye * moment[:, None, :], centre).twist
        shift = translate(0, eye * force[:, None, :]).twist
        return EffectJacobian(6, (BodyTwist(0, np.concatenate([turn, shift], axis=2)),))

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        return np.repeat([SOFT_TURN, SOFT_SHIFT], 3)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        moment, centre = about(situation, shape[0])
        force = situation.force[:, 0]
        turn, shift = np.zeros((2, situation.rows, 3, 7))
        for column, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            turn[:, i, column], turn[:, j, column] = moment[:, j], moment[:, i]
        pairs = ((0, 1), (1, 0), (2, 0), (2, 1))
        for column, (i, j) in enumerate(pairs, start=3):
            shift[:, i, column], turn[:, j, column] = moment[:, j], force[:, i]
        twist = rotate(0, turn, centre).twist + translate(0, shift).twist
        return EffectJacobian(7, (BodyTwist(0, twist),))


def about(
    situation: StaticState, height: float
) -> tuple[Float[np.ndarray, "rows 3"], Float[np.ndarray, "rows 3"]]:
    """Return the moment on the base about a point of its z axis, and the point."""
    centre = np.broadcast_to([0.0, 0.0, height], (situation.rows, 3))
    return situation.moment[:, 0] - cross(centre, situation.force[:, 0]), centre
