"""Encoder offset: a constant angle between encoder and link.

==========  ==========================================================================
Equation    angle of the link = reported angle + offset + wind-up; per radian of offset
            about a through o a load (F, M) at the sensor p gains (a x F, a x M +
            (a x (p - o)) x F) for the axes before; one that is stated along the base's
            axes gains (0, (a x (p - o)) x F) for these and (-a x F, -a x M) for a and
            the axes beyond
Source      Slamani et al. 2012 and every calibration: joint zero offsets; the load:
            rotation vector to first order
Valid       small offsets
Ignores     the changed direction of gravity and of the wind-up itself: a thousandth of
            the deflection per milliradian
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.statics import encoder_offset_response
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class EncoderOffset(Hypothesis):
    """Axis whose true zero differs from the controller's.

    A sensor beyond the axis is turned with it: for a last axis with markers at unknown
    places this is the only visible effect.
    """

    effect: ClassVar[str] = "encoder_offset"
    turns_load: ClassVar[bool] = True
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"offset_rad": (-0.1, 0.1)}
    magnitudes: ClassVar[tuple[str, ...]] = ("offset_rad",)
    shares_rate_with: ClassVar[str] = "geometry_error"  # a turn of the link before it

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if situation.recording.displacement == "relative":
            return ()
        return situation.axes

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return encoder_offset_response(situation, situation.axis(where))

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        drawing, slides = situation.recording.drawing, situation.arm.slides
        slide = slides[situation.axis(where)]
        return np.array([drawing.length if slide else drawing.offset])
