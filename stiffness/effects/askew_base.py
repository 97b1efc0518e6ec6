"""Base compliance whose softest tilt is about a direction between x and y.

==========  ==========================================================================
Equation    as `base_compliance`, and turn about x = rxy_rad_per_nm x moment about y,
            about y alike
Source      Klimchik et al. 2011: symmetric 6 x 6 compliance; the base's x and y are
            chosen by whoever writes the model
Valid       as `base_compliance`; rxy is the root of rx ry at most
Ignores     other couplings (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.effects.base import Shape
from stiffness.effects.base_compliance import SOFT_TURN, BaseCompliance
from stiffness.effects.jacobian import EffectJacobian, hstack, mixture
from stiffness.experiment.static_state import StaticState

EACH = np.eye(7)
"""Its variants one by one: the coupling of both level tilts comes first."""


@dataclass(frozen=True)
class AskewBase(BaseCompliance):
    """Six springs between the floor and the base, the two tilts coupled."""

    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        **BaseCompliance.limits,
        "rxy_rad_per_nm": (-1e-4, 1e-4),
    }

    @override
    def jacobian(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        at = situation, where, shape
        coupled = mixture(super().variants(*at), EACH[:, :1])
        return hstack([super().jacobian(*at), coupled])

    @override
    def prior_sigma(
        self, situation: StaticState, where: str
    ) -> Float[np.ndarray, " columns"]:
        return np.append(super().prior_sigma(situation, where), SOFT_TURN)

    @override
    def variants(
        self, situation: StaticState, where: str, shape: Shape
    ) -> EffectJacobian:
        return mixture(super().variants(situation, where, shape), EACH[:, 1:])
