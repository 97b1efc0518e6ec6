"""A strain-wave gear's wind-up grows ever less with torque.

==========  ==========================================================================
Equation    θ = τ/K3 + a b tanh(τ/b); soft: 1/K1 = 1/K3 + a, stiff: K3; b: the bend
Source      smooth form of Harmonic Drive's three-piece table (CHA engineering data
            1018854): compliance falls from 1/K1 at rest to 1/K3 under full torque;
            where the table's K1 ends, at T1, the mean slope asks for b = 1.5 T1
Valid       static torques of either sign, both ways alike
Ignores     hysteresis; the two separate knees of the table (its variants)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.signature import Signature, turn
from stiffness.diagnosis.situation import Situation

BEND_OVER_KNEE = 1.5
"""b / T1; chosen: a tanh fitted to two pieces of slope 1 and 1/1.8 over 0 … 4 T1."""


KNEES = tuple(np.geomspace(0.35, 6.0, 14))
"""Where other forms may bend, over T1; chosen: so close that a knee between two of them
is met to a percent, and far enough out for a table's second knee at 3.7 T1."""


@dataclass(frozen=True)
class Hardening(Hypothesis):
    """An axis whose gear grows stiffer the harder it is wound."""

    effect: ClassVar[str] = "hardening"
    shape_names: ClassVar[tuple[str, ...]] = ("torque_nm",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "stiffness_ratio": (1.0, 10.0),
        "torque_nm": (0.0, np.inf),
    }

    @override
    def places(self, situation: Situation) -> tuple[str, ...]:
        sprung = situation.compliance > 0.0
        return tuple(a for a, soft in zip(situation.axes, sprung, strict=True) if soft)

    @override
    def shapes(
        self, situation: Situation, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        largest = np.max(np.abs(situation.torque[:, situation.axis(where)]))
        return (largest * np.array([0.06, 0.1, 0.2, 0.35, 0.6]))[:, None]

    @override
    def signature(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        k = situation.axis(where)
        bend = BEND_OVER_KNEE * shape[0]
        return turn(k, bend * np.tanh(situation.torque[:, k] / bend))

    @override
    def variants(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        k = situation.axis(where)
        torque, knee = situation.torque[:, k], shape[0]
        pieces = [np.clip(torque, -x * knee, x * knee) for x in KNEES]
        return turn(k, *pieces)

    @override
    def parameters(
        self,
        situation: Situation,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        stiff = situation.compliance[situation.axis(where)]
        ratio = (stiff + coefficients[0]) / stiff
        return {"stiffness_ratio": ratio, "torque_nm": shape[0]}
