"""Tilt of a joint bearing that is softest between the two directions of the model.

==========  ==========================================================================
Equation    as `bearing_tilt`, and rotation w (x (y . M_c) + y (x . M_c)), w =
            uv_rad_per_nm
Source      Klimchik et al. 2011: symmetric 6 x 6 joint compliance; the directions x and
            y across an axis are chosen by whoever writes the model
Valid       as `bearing_tilt`; w is the root of u v at most
Ignores     radial and axial compliance
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.jacobian import EffectJacobian, hstack
from stiffness.experiment.static_state import StaticState

ALIGNED = BearingTilt()


@dataclass(frozen=True)
class AskewTilt(Hypothesis):
    """A hinge that tilts about one direction as the moment about the other says."""

    effect: ClassVar[str] = BearingTilt.effect
    linear: ClassVar[bool] = True
    shape_names: ClassVar[tuple[str, ...]] = BearingTilt.shape_names
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **BearingTilt.limits,
        "uv_rad_per_nm": (-1e-3, 1e-3),
    }
    magnitudes: ClassVar[tuple[str, ...]] = BearingTilt.magnitudes

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return ALIGNED.places(situation)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return ALIGNED.shapes(situation, where)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        at = situation, where, shape
        return hstack([ALIGNED.jacobian(*at), ALIGNED.variants(*at)])

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        aligned = ALIGNED.parameters(situation, where, shape, coefficients[:2])
        return {**aligned, "uv_rad_per_nm": coefficients[2]}
