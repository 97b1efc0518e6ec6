"""Normal equations: Gram matrices by fold, score vectors by pose, sums of squares.

What readings say about columns is their Gram matrix and each pose's score.

==========  ==========================================================================
Equation    gram = X' S^-1 X by fold; score_p = X_p' S^-1 y_p by pose;
            without K: gram~ = gram - gram_cK gram_KK^-1 gram_Kc, score~ likewise
Source      Gauss-Markov; Frisch-Waugh-Lovell
Valid       S as stated, block A (within visits) and B (between) independent
Ignores     nothing that is linear
==========  ==========================================================================

A least-squares problem is its normal equations, fold by fold.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

# --- Normal equations -----------------------------------------------------------------


@dataclass(frozen=True)
class NormalEquations:
    """Gram matrices by fold of poses, scores by pose.

    Attributes:
        gram: Of each fold.
        score: Of each pose.
        fold: Of each pose.
        raw: Each column's information before the unknown was projected out.
    """

    gram: Float[np.ndarray, "folds columns columns"]
    score: Float[np.ndarray, "poses columns"]
    fold: Int[np.ndarray, " poses"]
    raw: Float[np.ndarray, " columns"]


# --- Normal equations by fold ---------------------------------------------------------


@dataclass(frozen=True)
class Normal:
    """Sums over rows.

    Attributes:
        gram: A'A, in m^2 per square of each column's unit.
        aim: A'y.
        square: y'y, in m^2.
        count: Of coordinates.
    """

    gram: Float[np.ndarray, "columns columns"]
    aim: Float[np.ndarray, " columns"]
    square: float
    count: int

    def __add__(self, other: "Normal") -> "Normal":
        """Put two sets of rows together."""
        return Normal(
            self.gram + other.gram,
            self.aim + other.aim,
            self.square + other.square,
            self.count + other.count,
        )

    def __sub__(self, other: "Normal") -> "Normal":
        """Take rows out again."""
        return Normal(
            self.gram - other.gram,
            self.aim - other.aim,
            self.square - other.square,
            self.count - other.count,
        )

    def only(self, columns: Int[np.ndarray, " some"]) -> "Normal":
        """Return the problem of some columns alone."""
        gram = self.gram[np.ix_(columns, columns)]
        return Normal(gram, self.aim[columns], self.square, self.count)

    def residual_square(self, x: Float[np.ndarray, " columns"]) -> float:
        """Return the sum of squares that a solution leaves, in m^2."""
        return float(self.square - 2.0 * x @ self.aim + x @ self.gram @ x)


def total_of(parts: Sequence[Normal]) -> Normal:
    """Put all sets of rows together."""
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
