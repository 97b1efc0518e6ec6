"""Deflection compensation: the controller takes out a share of the arm's own sag.

==========  ==========================================================================
Equation    angle of the link = reported angle - ratio c torque + wind-up; torque of
            the weights of links and tool at the reported angles, c the model's own
            compliance
Source      model-based compensation of elastic errors in controllers: Klimchik,
            Pashkevich, Chablat, Hovland 2013, "Compliance error compensation technique
            for parallel robots composed of non-perfect serial chains"
Valid       absolute readings of axes whose springs a measured load shows: without a
            load, a stiffer spring does the same
Ignores     loads that a controller measures or is told; a force sensor beyond the axis
            is turned with it, a thousandth of the deflection
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Hypothesis, Shape, absolute
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.effects.statics import ROUNDING
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class DeflectionCompensation(Hypothesis):
    """Axis that the controller turns back by a share of its modelled sag."""

    effect: ClassVar[str] = "deflection_compensation"
    sized_by: ClassVar[str] = "ratio"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"ratio": (0.0, 3.0)}
    magnitudes: ClassVar[tuple[str, ...]] = ("ratio",)

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        if not absolute(situation):
            return ()
        seen = (np.abs(_weight_torque(situation)) > ROUNDING).any(axis=0)
        seen &= (np.abs(situation.load_torque) > ROUNDING).any(axis=0)
        seen &= (situation.compliance > 0.0) & (situation.arm.compliance > 0.0)
        return tuple(a for a, s in zip(situation.axes, seen, strict=True) if s)

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        k = situation.axis(where)
        modelled = float(situation.arm.compliance[k])
        return turn(k, -modelled * _weight_torque(situation)[:, k])


def _weight_torque(situation: StaticState) -> Float[np.ndarray, "rows axes"]:
    """Return the torque of the model's weights at the reported angles, in N m."""
    arm, recording = situation.arm, situation.recording
    return situation.once_standing(
        "weight_torque", lambda: arm.gravity_torque(recording.posture, recording.tool)
    )
