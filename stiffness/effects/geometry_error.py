"""Geometry error of a link: length and orientation of the next axis.

==========  ==========================================================================
Equation    all that the next axis carries shifts by R (x, y, z) and turns by R (rx, ry,
            rz) about that axis' origin as drawn, R the link's axes; a load that these
            turn or move changes its torques, as with an encoder's offset
Source      Veitschegger, Wu 1986, "Robot accuracy analysis based on kinematics"; small
            errors enter to first order
Valid       errors below a degree and some millimetres
Ignores     the changed direction of gravity, a thousandth of the deflection
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, absolute, axes_of
from stiffness.effects.jacobian import BodyTwist, EffectJacobian, six_motions
from stiffness.effects.statics import turned_load, wind_up
from stiffness.experiment.static_state import StaticState
from stiffness.robot.chain import link_error_of

NAMES = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")


@dataclass(frozen=True)
class GeometryError(Hypothesis):
    """Link whose far end has a pose error with respect to the drawing.

    The rotation about the next axis alone is identical to that axis' encoder offset.
    """

    effect: ClassVar[str] = "geometry_error"
    turns_load: ClassVar[bool] = True
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
        key = ("link", where)
        own = situation.once_standing(key, lambda: _motion_of(situation, where))
        loaded = wind_up(situation, own.torque)
        return EffectJacobian(6, (own.motion, *loaded.parts))

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
        return dict(zip(NAMES, link_error_of(coefficients), strict=True))


@dataclass(frozen=True)
class _Motion:
    """What an error of a link does per unit of each of its six numbers.

    Attributes:
        motion: Of all that the next axis carries.
        torque: Change of the axes' torques, in N m.
    """

    motion: BodyTwist
    torque: Float[np.ndarray, "rows axes 6"]


def _motion_of(situation: StaticState, link: str) -> _Motion:
    _, place = situation.ends_of(link)
    axes = axes_of(situation, link)
    motion = six_motions(place, axes, _end_as_drawn(situation, link))
    return _Motion(motion, turned_load(situation, place - 1, motion.twist))


def _end_as_drawn(situation: StaticState, link: str) -> Float[np.ndarray, "rows 3"]:
    """Return the origin about which a link's error is told, in the base's frame, in m.

    It stays where it is on the link, so that an error is the same screw about any
    kinematics.
    """
    start, end = situation.ends_of(link)
    chain = situation.arm.chain
    back = chain.nominal_origin[end - 1] - chain.before[end - 1, :3, 3]
    return situation.origin[:, end] + situation.frame[:, start] @ back
