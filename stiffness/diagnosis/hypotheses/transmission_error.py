"""An axis' output does not follow its input evenly, loaded or not.

==========  ==========================================================================
Equation    angle of the link = reported angle q + s sin nq + c cos nq + wind-up;
            amplitude = √(s² + c²), phase = atan2(c, s)
Source      Ghorbel, Gandhi, Alpeter 2001, "On the kinematic error in harmonic drive
            gears"; eccentric encoder discs have n = 1 and 2
Valid       orders n up to 6, q the reported angle
Ignores     the share that grows with load; the hundreds of orders of a gear's teeth;
            the second harmonic (its variant)
==========  ==========================================================================
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float
from typing_extensions import override

from stiffness.diagnosis.hypotheses.axes import absolute, orders
from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.signature import Signature, turn
from stiffness.diagnosis.situation import Situation


@dataclass(frozen=True)
class TransmissionError(Hypothesis):
    """An axis whose angle errs with a few periods per turn."""

    effect: ClassVar[str] = "transmission_error"
    shape_names: ClassVar[tuple[str, ...]] = ("order",)
    limits: ClassVar[Mapping[str, tuple[float, float]]] = {
        "amplitude_rad": (0.0, 1e-2),
        "order": (0.0, 1e3),
        "phase_rad": (-np.pi, np.pi),
    }

    @override
    def places(self, situation: Situation) -> tuple[str, ...]:
        if not absolute(situation):
            return ()
        return tuple(
            a for a in situation.axes if len(orders(situation, situation.axis(a)))
        )

    @override
    def shapes(
        self, situation: Situation, where: str
    ) -> Float[np.ndarray, "shapes parameters"]:
        return orders(situation, situation.axis(where))[:, None]

    @override
    def signature(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        k = situation.axis(where)
        phase = shape[0] * situation.recording.posture[:, k]
        return turn(k, np.sin(phase), np.cos(phase))

    @override
    def variants(
        self, situation: Situation, where: str, shape: Float[np.ndarray, " parameters"]
    ) -> Signature:
        return self.signature(situation, where, 2.0 * shape)

    @override
    def parameters(
        self,
        situation: Situation,
        where: str,
        shape: Float[np.ndarray, " parameters"],
        coefficients: Float[np.ndarray, " columns"],
    ) -> Mapping[str, float]:
        s, c = coefficients
        return {
            "amplitude_rad": np.hypot(s, c),
            "order": shape[0],
            "phase_rad": np.arctan2(c, s),
        }
