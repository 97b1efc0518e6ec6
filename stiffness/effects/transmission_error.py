"""Transmission error of a gear: harmonics of the angle, with or without a load.

==========  ==========================================================================
Equation    angle of the link = reported angle q + s sin nq + c cos nq + wind-up;
            amplitude = √(s² + c²), phase = atan2(c, s)
Source      Ghorbel, Gandhi, Alpeter 2001, "On the kinematic error in harmonic drive
            gears"; eccentric encoder discs have n = 1 and 2
Valid       orders n up to 6, q the reported angle
Ignores     the share that grows with load; rotation of a sensor beyond, a thousandth of
            the deflection (an axis at rest: see `encoder_offset`); the hundreds of
            orders of a gear's teeth; further harmonics of a turn (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import (
    Coeffs,
    Hypothesis,
    Shape,
    Shapes,
    absolute,
    middle_angle,
    orders,
    still,
)
from stiffness.effects.jacobian import NOTHING, EffectJacobian, turn
from stiffness.effects.statics import encoder_offset_response
from stiffness.experiment.static_state import StaticState

HARMONICS = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
"""Harmonics of a turn: an error of the angle recurs with it, in whatever form; up to
the highest of `orders`."""


@dataclass(frozen=True)
class TransmissionError(Hypothesis):
    """Axis whose angle has an error with a few periods per turn.

    For an axis that hardly turns only one value of the error is visible, as an
    encoder offset; the smallest amplitude with that value is reported.
    """

    effect: ClassVar[str] = "transmission_error"
    shape_names: ClassVar[tuple[str, ...]] = ("order",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "amplitude_rad": (0.0, 1e-2),
        "order": (0.0, 1e3),
        "phase_rad": (-np.pi, np.pi),
    }
    magnitudes: ClassVar[tuple[str, ...]] = ("amplitude_rad",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if not absolute(situation):
            return ()
        turns = ~situation.arm.slides
        return tuple(a for a, t in zip(situation.axes, turns, strict=True) if t)

    @override
    def shapes(self, situation: StaticState, where: str) -> Shapes:
        found = orders(situation, situation.axis(where))
        return found[:, None] if len(found) else np.ones((1, 1))

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        if still(situation, k):
            return encoder_offset_response(situation, k)
        phase = shape[0] * situation.recording.posture[:, k]
        return turn(k, np.sin(phase), np.cos(phase))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        if still(situation, k):
            return NOTHING
        phase = [n * situation.recording.posture[:, k] for n in others(shape[0])]
        return turn(k, *(f(x) for x in phase for f in (np.sin, np.cos)))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        s, c = coefficients[0], coefficients[-1]
        if len(coefficients) == 1:  # all of a sine at its crest where the axis stands
            at = shape[0] * middle_angle(situation, situation.axis(where))
            s, c = c * np.sin(at), c * np.cos(at)
        return {
            "amplitude_rad": np.hypot(s, c),
            "order": shape[0],
            "phase_rad": np.arctan2(c, s),
        }


def others(order: float) -> list[float]:
    """Return the harmonics of a turn other than an order, and twice that order."""
    near = 0.5 * HARMONICS[0]
    found = [n for n in HARMONICS if abs(n - order) > near]
    own = 2.0 * order
    return found if min(abs(n - own) for n in found) < near else [*found, own]
