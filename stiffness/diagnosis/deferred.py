"""Where a grid of shapes moves bodies or markers, rows are worked out when asked for.

Twists and shifts of every shape and row would fill the memory of a long recording;
such laws know no row but their own, so that any few rows can be had alone.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.hypotheses.hypothesis import Hypothesis
from stiffness.diagnosis.signature import Motion, Shift, Signature
from stiffness.diagnosis.situation import Situation


@dataclass(frozen=True, eq=False)
class Deferred:
    """The signature of a hypothesis, to be had for some rows at a time.

    Attributes:
        columns: How many coefficients there are.
        hypothesis: Whose signature.
        where: At which place.
        shape: With which shape.
        situation: Of all rows.
    """

    columns: int
    hypothesis: Hypothesis
    where: str
    shape: Float[np.ndarray, " parameters"]
    situation: Situation

    def of(self, some: Situation) -> Signature:
        """Return the signature of some of the situation's rows."""
        return self.hypothesis.signature(some, self.where, self.shape)


def deferred(
    signature: Signature,
    hypothesis: Hypothesis,
    where: str,
    shape: Float[np.ndarray, " parameters"],
    situation: Situation,
) -> Signature | Deferred:
    """Return a signature as it is, or to be worked out where it is large.

    Args:
        signature: The same of all rows.
        hypothesis: Whose; one of several shapes.
        where: At which place.
        shape: With which shape.
        situation: Of all rows.
    """
    if any(isinstance(part, Motion | Shift) for part in signature.parts):
        return Deferred(signature.columns, hypothesis, where, shape, situation)
    return signature
