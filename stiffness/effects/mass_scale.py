"""Mass scale: all masses of the arm differ from the model's by one factor.

==========  ==========================================================================
Equation    torque of gravity on the axes, tool left out, times ratio
Source      linear in the masses: Gautier, Khalil 1990, "Direct calculation of minimum
            set of inertial parameters of serial robots"
Valid       absolute readings of axes whose springs a measured load shows: without a
            load, springs softer by the same factor do the same
Ignores     masses that differ one by one: they are `gravity_load`
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Coeffs, Hypothesis, Shape, absolute
from stiffness.effects.jacobian import EffectJacobian
from stiffness.effects.statics import (
    CarriedLoads,
    carried_loads,
    felt,
    given_way,
    wind_up,
)
from stiffness.experiment.static_state import StaticState


@dataclass(frozen=True)
class MassScale(Hypothesis):
    """All links heavier, or lighter, by one factor."""

    effect: ClassVar[str] = "mass_scale"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"ratio": (0.2, 5.0)}
    neutral: ClassVar[Mapping[str, float]] = {"ratio": 1.0}

    @override
    def places(self, situation: StaticState) -> tuple[str, ...]:
        seen = absolute(situation) and len(felt(situation, _torque(situation)))
        return ("arm",) if seen else ()

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return wind_up(situation, _torque(situation))

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return given_way(situation, [partial(heavier, share=1.0)])

    @override
    def parameters(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> Mapping[str, float]:
        return {"ratio": 1.0 + coefficients[0]}

    @override
    def acting(
        self, situation: StaticState, where: str, shape: Shape, coefficients: Coeffs
    ) -> StaticState:
        return heavier(situation, float(coefficients[0]))


def heavier(situation: StaticState, share: float) -> StaticState:
    """Return the state with a share of each link's mass added at its centre."""
    weights = situation.once_standing("weights", lambda: _weights(situation))
    return weights.added_to(situation, np.array([share]))


def _weights(situation: StaticState) -> CarriedLoads:
    """Return what the weights of all links exert together, as one column."""
    chain, each = situation.arm.chain, list[CarriedLoads]()
    for k, mass in enumerate(chain.mass):
        weight = np.tile(mass * chain.gravity[:, None], (situation.rows, 1, 1))
        frame, origin = situation.frame[:, k + 1], situation.origin[:, k + 1]
        own = weight, np.zeros_like(weight), origin + frame @ chain.centre[k]
        each.append(carried_loads(situation, f"link_{k + 1}", *own))
    return CarriedLoads(
        np.sum([one.force for one in each], axis=0),
        np.sum([one.moment for one in each], axis=0),
        np.sum([one.torque for one in each], axis=0),
    )


def _torque(situation: StaticState) -> Float[np.ndarray, "rows axes 1"]:
    return (heavier(situation, 1.0).torque - situation.torque)[:, :, None]
