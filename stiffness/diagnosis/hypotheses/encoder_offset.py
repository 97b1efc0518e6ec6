"""An axis stands a constant angle beside what its controller reports.

==========  ==========================================================================
Equation    angle of the link = reported angle + offset + wind-up
Source      Slamani et al. 2012 and every calibration: joint zero offsets
Valid       small offsets
Ignores     the change of lever arms under load, a thousandth of the deflection
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.signature import NOTHING, Signature, turn
from stiffness.diagnosis.situation import Situation


@dataclass(frozen=True)
class EncoderOffset(Hypothesis):
    """An axis whose zero is not where the controller believes."""

    effect: ClassVar[str] = "encoder_offset"
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {"offset_rad": (-0.1, 0.1)}

    @override
    def places(self, situation: Situation) -> tuple[str, ...]:
        if situation.recording.displacement == "relative":
            return ()
        return situation.axes

    @override
    def shapes(
        self, situation: Situation, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        return np.zeros((1, 0))

    @override
    def signature(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        return turn(situation.axis(where), np.ones(situation.rows))

    @override
    def variants(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        return NOTHING

    @override
    def parameters(
        self,
        situation: Situation,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        return {"offset_rad": coefficients[0]}
