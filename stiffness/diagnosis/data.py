"""What was read is kept as two blocks: differences within visits, means of visits."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from stiffness.diagnosis.between import Between
from stiffness.diagnosis.columns import columns_of
from stiffness.diagnosis.signature import Signature
from stiffness.diagnosis.visits import Visits, stretches
from stiffness.diagnosis.within import Within


@dataclass(frozen=True)
class Data:
    """Both blocks of a recording's readings.

    Attributes:
        visits: How rows lie side by side.
        within: Differences within visits.
        between: Means of visits; None where readings are relative.
    """

    visits: Visits
    within: Within
    between: Between | None

    @property
    def unknowns(self) -> int:
        """How many unknowns there are in the means."""
        return 0 if self.between is None else len(self.between.scale)

    def less(
        self,
        signatures: Sequence[Signature],
        coefficients: Float[np.ndarray, " columns"],
    ) -> "Data":
        """Return the data without what these columns do."""
        row, between = self.visits.row, self.between
        mix = coefficients[:, None]
        pull, square = self.within.pull.copy(), self.within.square.copy()
        asked = np.zeros((self.unknowns, 1))
        white = []
        for some in stretches(len(row)):
            columns = columns_of(signatures, row[some])
            within = self.within.some(some)
            moved = within.moved(columns) @ mix
            change = within.cleaned(within.raw_pulls(moved))
            square[some] -= np.sum(moved * (2 * pull[:, some] - change), axis=(0, 2, 3))
            pull[:, some] -= change
            if between is not None:
                means = between.some(some)
                one = means.roots.white(means.moved(columns) @ mix)
                back = means.roots.back(one)
                asked += np.sum(means.unknown.swapaxes(1, 2) @ back, axis=0)
                white.append(one)
        within = self.within.less(pull, square)
        if between is None:
            return Data(self.visits, within, None)
        residual, taken = between.residual.copy(), between.taken(asked)
        for some, one in zip(stretches(len(row)), white, strict=True):
            means = between.some(some)
            residual[some] += means.roots.white(means.unknown @ taken) - one
        return Data(self.visits, within, between.less(residual))
