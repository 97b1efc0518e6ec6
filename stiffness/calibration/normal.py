"""A least-squares problem is its normal equations, fold by fold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.calibration.blocks import Blocks
from stiffness.calibration.stance import Stance

CHUNK = 500
"""Rows whose columns are held at a time."""


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

    def left(self, x: Float[np.ndarray, " columns"]) -> float:
        """Return the sum of squares that a solution leaves, in m^2."""
        return float(self.square - 2.0 * x @ self.aim + x @ self.gram @ x)


def normals_of(
    blocks: Blocks, stance: Stance, fold: Int[np.ndarray, " rows"], count: int
) -> list[Normal]:
    """Return the normal equations of each fold; rows below zero are in none."""
    width = len(blocks.owner)
    found = []
    for f in range(count):
        gram, aim = np.zeros((width, width)), np.zeros(width)
        rows = np.flatnonzero(fold == f)
        square = 0.0
        for start in range(0, len(rows), CHUNK):
            own = rows[start : start + CHUNK]
            a, y = blocks.problem(stance, own)
            gram += a.T @ a
            aim += a.T @ y
            square += float(y @ y)
        found.append(Normal(gram, aim, square, 3 * len(rows)))
    return found


def total_of(parts: Sequence[Normal]) -> Normal:
    """Put all sets of rows together."""
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
