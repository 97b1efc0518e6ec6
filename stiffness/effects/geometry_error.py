"""Geometry error of a link: length and orientation of the next axis.

==========  ==========================================================================
Equation    all that the next axis carries shifts by R (x, y, z) and turns by R (rx, ry,
            rz) about that axis' origin, R the link's axes
Source      Veitschegger, Wu 1986, "Robot accuracy analysis based on kinematics"; small
            errors enter to first order
Valid       errors below a degree and some millimetres
Ignores     the change of lever arms under load, a thousandth of the deflection
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, absolute, axes_of
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    rotate,
    translate,
)
from stiffness.experiment.static_state import StaticState

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class GeometryError(Hypothesis):
    """Link whose far end has a pose error with respect to the drawing.

    The rotation about the next axis alone is identical to that axis' encoder offset.
    """

    effect: ClassVar[str] = "geometry_error"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        name: (-0.1, 0.1) for name in NAMES
    }
    magnitudes: ClassVar[tuple[str, ...]] = NAMES

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return situation.links if absolute(situation) else ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        _, place = situation.ends_of(where)
        axes = axes_of(situation, where)
        shift = translate(place, axes).twist
        turned = rotate(place, axes, situation.origin[:, place]).twist
        return EffectJacobian(
            6, (BodyTwist(place, np.concatenate([shift, turned], axis=2)),)
        )

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        drawing = situation.recording.drawing
        return np.repeat([drawing.length, drawing.angle], 3)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return dict(zip(NAMES, coefficients, strict=True))
