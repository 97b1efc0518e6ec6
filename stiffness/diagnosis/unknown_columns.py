"""What is unknown of tracker and markers moves readings in a few ways.

==========  ==========================================================================
Equation    columns: [1, -p x] for the tracker, R_b for a marker's place, smooth
            functions of p for the tracker's field, the same for x, y and z
Source      as `unknowns`
Valid       as `unknowns`
Ignores     as `unknowns`
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True, eq=False)
class UnknownColumns:
    """Columns in m per unit, frame first, then places, then field.

    Attributes:
        frame: Levers of all markers; no last axis where the frame is known.
        turn: Turns of the markers' bodies.
        field: Smooth functions at the markers; none where no field is stated.
        rest: Variance of the field that these leave, in m^2.
        sigma: Prior sigma of each column.
    """

    frame: Float[np.ndarray, "visits markers 3 twist"]
    turn: Float[np.ndarray, "visits markers 3 3"]
    field: Float[np.ndarray, "visits markers waves"]
    rest: Float[np.ndarray, "visits markers"]
    sigma: Float[np.ndarray, " columns"]

    def of(
        self, visits: Int[np.ndarray, " some"]
    ) -> Float[np.ndarray, "some n columns"]:
        """Return the columns of some visits."""
        frame, turn, field = self.frame[visits], self.turn[visits], self.field[visits]
        some, markers, _, first = frame.shape
        waves = field.shape[2]
        total = np.zeros((some, markers, 3, len(self.sigma)))
        total[..., :first] = frame
        for m in range(markers):
            at = first + 3 * m
            total[:, m, :, at : at + 3] = turn[:, m]
        at = first + 3 * markers
        for i in range(3):
            total[:, :, i, at + i * waves : at + (i + 1) * waves] = field
        return total.reshape(some, 3 * markers, -1)
