"""Friction of the pulley: a share of the weight is lost while the rope moves.

==========  ==========================================================================
Equation    tension = weight (1 - ratio × direction), direction +1 where the load last
            grew and -1 where it last fell
Source      loss per sheave, steel rope: 2 % (Verope's design tables); thin cord on
            ball bearings: 1 to 4 %, chosen
Valid       a rope that crept over the pulley when the load last changed
Ignores     angle of wrap, stiffness of the rope, load
==========  ==========================================================================
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from bench.effects.effect import RopeEffect, size


@dataclass(frozen=True)
class PulleyFriction(RopeEffect):
    """Friction of the pulleys against the last motion of the rope.

    Attributes:
        ratio: Share of the weight that is lost in the rope's tension.
    """

    name: ClassVar[str] = "pulley_friction"
    ratio: float = size(0.02, 0.0, 0.5)

    @override
    def tension(
        self, weight: Float[np.ndarray, " rows"], direction: Float[np.ndarray, " rows"]
    ) -> Float[np.ndarray, " rows"]:
        return -self.ratio * direction * weight
