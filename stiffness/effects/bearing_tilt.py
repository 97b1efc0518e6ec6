"""Tilt of a joint bearing: rotation across the axis in proportion to the moment.

==========  ==========================================================================
Equation    rotation = u x (x . M_c) + v y (y . M_c) about c = o + h z, M_c = M_o - h z
            x F; x, y, z: the seat's axes, o its origin; h = centre, of a slide at
            position q: centre - q, for its guide stays
Source      Klimchik et al. 2011: diagonal 6 x 6 joint compliance
Valid       small tilts; a bearing whose centre of tilt is on the axis
Ignores     radial and axial compliance; coupling of the two tilts of a bearing whose
            soft direction lies between x and y (`askew_tilt`, its variant); growth of
            the stiffness with the moment (`hardening_tilt`)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, Shapes
from stiffness.effects.jacobian import EffectJacobian, rotation_about
from stiffness.experiment.static_state import StaticState
from stiffness.robot.kinematics import cross


@dataclass(frozen=True)
class BearingTilt(Hypothesis):
    """A hinge, or a slide's guide, that tilts about the two directions across it."""

    effect: ClassVar[str] = "bearing_tilt"
    linear: ClassVar[bool] = True
    shape_names: ClassVar[tuple[str, ...]] = ("centre_m",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "u_rad_per_nm": (0.0, 1e-3),
        "v_rad_per_nm": (0.0, 1e-3),
        "centre_m": (-0.5, 0.5),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("u_rad_per_nm", "v_rad_per_nm")

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        return situation.axes

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        return np.array([-0.3, -0.15, -0.05, 0.0, 0.05, 0.15, 0.3])[:, None]

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        seat, about, centre = across(situation, where, shape[0])
        rotation = seat * about[:, None, :]
        return rotation_about(situation.axis(where) + 1, rotation, centre)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        seat, about, centre = across(situation, where, shape[0])
        askew = np.einsum("rij,rj->ri", seat, about[:, ::-1])[:, :, None]
        return rotation_about(situation.axis(where) + 1, askew, centre)

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        u, v = coefficients
        return {"u_rad_per_nm": u, "v_rad_per_nm": v, "centre_m": shape[0]}


def across(
    situation: StaticState, where: str, centre: float
) -> tuple[
    Float[np.ndarray, "rows 3 2"],
    Float[np.ndarray, "rows 2"],
    Float[np.ndarray, "rows 3"],
]:
    """Return the two directions across a seat, moments about them, and the centre.

    In N m about the centre, and in m.

    Args:
        situation: Where the arm stood.
        where: The axis.
        centre: Of the bearing, along the axis from its origin, in m.
    """
    place = situation.axis(where) + 1
    seat = situation.seat[:, place]
    along = np.full(situation.rows, centre)
    if situation.arm.slides[place - 1]:  # its guide stays where it is
        along -= situation.recording.posture[:, place - 1]
    arm = along[:, None] * seat[:, :, 2]
    moment = situation.moment[:, place] - cross(arm, situation.force[:, place])
    two = seat[:, :, :2]
    about = np.einsum("rij,ri->rj", two, moment)
    return two, about, situation.origin[:, place] + arm
