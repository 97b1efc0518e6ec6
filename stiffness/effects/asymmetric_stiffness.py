"""Asymmetric stiffness of a gear: compliance depends on the sign of the torque.

==========  ==========================================================================
Equation    θ = C τ + a s |u|, u and s = du/dτ as in `hysteresis`, τ and 1 for a linear
            spring; ratio = K+/K- = (C - a)/(C + a), C at no torque
Source      even part of any law of two slopes; no source for a gear
Valid       torques of either sign; C the mean compliance of both ways
Ignores     hardening of either side
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, reversing, sprung
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class AsymmetricStiffness(Hypothesis):
    """Axis whose stiffness depends on the direction of the torque."""

    effect: ClassVar[str] = "asymmetric_stiffness"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "ratio": (0.05, 20.0),
    }

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        soft = sprung(situation)
        return tuple(a for a in reversing(situation) if a in soft)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        wound = situation.wound(k, situation.torque[:, k])
        return turn(k, situation.softness_of(k) * np.abs(wound))

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        mean = situation.unloaded_compliance(situation.axis(where))
        half = coefficients[0]
        return {"ratio": (mean - half) / (mean + half)}
