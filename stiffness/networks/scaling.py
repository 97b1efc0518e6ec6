"""A network learns faster where all numbers it sees have mean zero and size one.

==========  ==========================================================================
Equation    z = (x - mean) / scale, scale = the standard deviation over the rows
Source      LeCun, Bottou, Orr, Müller 1998, "Efficient BackProp", section 4.3
Valid       rows drawn as those that come later
Ignores     correlation between columns
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

CONSTANT = 1e-9
"""A column that varies less is constant; chosen: rounding of sines is 1e-16."""


@dataclass(frozen=True)
class Scaling:
    """Takes units away and gives them back.

    A column that never varied has an infinite scale, so that it is always zero: a
    network cannot have learnt what it was never shown, and is not to answer at random.

    Attributes:
        mean: Of each column.
        scale: Of each column; infinite where it never varied.
    """

    mean: Float[np.ndarray, " columns"]
    scale: Float[np.ndarray, " columns"]

    @classmethod
    def of(cls, values: Float[np.ndarray, "rows columns"]) -> "Scaling":
        """Take mean and standard deviation of each column."""
        scale = values.std(axis=0)
        return cls(values.mean(axis=0), np.where(scale > CONSTANT, scale, np.inf))

    def unitless(
        self, values: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Take units away."""
        return (values - self.mean) / self.scale

    def in_units(
        self, values: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows columns"]:
        """Give units back; constant columns are at their mean."""
        return self.mean + values * np.where(np.isfinite(self.scale), self.scale, 0.0)
