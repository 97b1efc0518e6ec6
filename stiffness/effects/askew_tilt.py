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

from stiffness.effects.base import Coeffs, Shape
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.jacobian import NOTHING, EffectJacobian, hstack
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class AskewTilt(BearingTilt):
    """A hinge that tilts about one direction as the moment about the other says."""

    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **BearingTilt.limits,
        "uv_rad_per_nm": (-1e-3, 1e-3),
    }

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        at = situation, where, shape
        return hstack([super().jacobian(*at), super().variants(*at)])

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        """Return nothing: the coupling of both tilts is a column of its own."""
        return NOTHING

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        aligned = super().parameters(situation, where, shape, coefficients[:2])
        return {**aligned, "uv_rad_per_nm": coefficients[2]}
