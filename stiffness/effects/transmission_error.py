"""Transmission error of a gear: harmonics of the angle, with or without a load.

==========  ==========================================================================
Equation    angle of the link = reported angle q + sum over up to three orders n of
            (s_n sin nq + c_n cos nq) + wind-up; amplitude = √(s² + c²), phase =
            atan2(c, s), of the wave whose amplitude is largest
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

    Its shape holds the order of each wave; the strongest one is reported. For an axis
    that hardly turns only one value of the error is visible, as an encoder offset; the
    smallest amplitude with that value is reported.
    """

    effect: ClassVar[str] = "transmission_error"
    sized_by: ClassVar[str] = "amplitude_rad"
    shape_names: ClassVar[tuple[str, ...]] = ("order",)
    is_sum: ClassVar[bool] = True
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
        angle = situation.recording.posture[:, k]
        return turn(k, *(f(n * angle) for n in shape for f in (np.sin, np.cos)))

    @override
    def further(
        self, found: Mapping[str, float], shape: Shape, coefficients: Coeffs
    ) -> list[dict[str, float]]:
        return harmonics(shape, coefficients)[1:]

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        if still(situation, k):
            return NOTHING
        phase = [n * situation.recording.posture[:, k] for n in others(shape)]
        return turn(k, *(f(x) for x in phase for f in (np.sin, np.cos)))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        if len(coefficients) == 1:  # all of a sine at its crest where the axis stands
            angle = situation.recording.posture[:, situation.axis(where)]
            at = shape[0] * float(np.mean(angle))
            coefficients = coefficients[0] * np.array([np.sin(at), np.cos(at)])
        return harmonics(shape, coefficients)[0]


def harmonics(shape: Shape, coefficients: Coeffs) -> list[dict[str, float]]:
    """Return the parameters of each wave of an error, the strongest first."""
    of_wave = coefficients.reshape(-1, 2)
    found = [
        {"amplitude_rad": np.hypot(s, c), "order": n, "phase_rad": np.arctan2(c, s)}
        for n, (s, c) in zip(shape, of_wave, strict=True)
    ]
    return sorted(found, key=lambda wave: -wave["amplitude_rad"])


def others(orders: Shape) -> list[float]:
    """Return the harmonics of a turn other than some orders, and twice these."""
    near, found = 0.5 * HARMONICS[0], list[float]()
    for n in (*HARMONICS, *(2.0 * order for order in orders)):
        if all(abs(n - other) > near for other in (*orders, *found)):
            found.append(n)
    return found
