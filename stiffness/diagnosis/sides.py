"""Columns between visits are means over rows, side by side by where they act."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.columns import contract


@dataclass(frozen=True)
class Side:
    """A group's columns, averaged over the rows of each visit.

    Attributes:
        column: Number of each column in the whole model.
        mean: Twists or shifts of each visit.
        onto: What takes them to whitened data.
        first: First coordinate of the marker that shifts; -1 where bodies move.
    """

    column: Int[np.ndarray, " columns"]
    mean: Float[np.ndarray, "visits k columns"]
    onto: Float[np.ndarray, "visits n k"]
    first: int = -1

    def products(
        self, white: Float[np.ndarray, "some n b"], visits: Int[np.ndarray, " some"]
    ) -> Float[np.ndarray, "columns b"]:
        """Return the products of the columns with whitened ones, over some visits."""
        asked = self.onto[visits].swapaxes(1, 2) @ white
        return contract(self.mean[visits].swapaxes(1, 2), asked)


@dataclass(frozen=True)
class Stack:
    """Shifts of many markers with equally many columns each, computed at once.

    Attributes:
        column: Number of each column, marker by marker.
        first: First coordinate of each marker.
        mean: Shifts; index order marker, column, visit, coordinate.
    """

    column: Int[np.ndarray, " columns"]
    first: Int[np.ndarray, " markers"]
    mean: Float[np.ndarray, "markers each visits 3"]

    def of(self, visits: np.ndarray) -> "Stack":
        """Return the same of some visits."""
        return replace(self, mean=np.ascontiguousarray(self.mean[:, :, visits]))

    def products(self, back: Float[np.ndarray, "visits n b"]) -> np.ndarray:
        """Return the products of all columns with others: (columns, b)."""
        markers, count, visits, _ = self.mean.shape
        shaped = back.reshape(visits, -1, 3, back.shape[2])[:, self.first // 3]
        right = np.ascontiguousarray(shaped.transpose(1, 0, 2, 3))
        right = right.reshape(markers, visits * 3, -1)
        left = self.mean.reshape(markers, count, visits * 3)
        return (left @ right).reshape(markers * count, -1)


def stacked(sides: list[Side]) -> list[Stack]:
    """Put the shifts among sides together that have equally many columns."""
    by_count: dict[int, list[Side]] = {}
    for side in sides:
        if side.first >= 0:
            by_count.setdefault(len(side.column), []).append(side)
    return [
        Stack(
            np.concatenate([s.column for s in alike]),
            np.array([s.first for s in alike]),
            np.stack([s.mean.transpose(2, 0, 1) for s in alike]),
        )
        for alike in by_count.values()
    ]


def mean_over_rows(
    share: Float[np.ndarray, "visits 1 rows"], values: np.ndarray
) -> Float[np.ndarray, "visits k columns"]:
    """Return weighted means of twists or shifts over the rows of each visit."""
    visits, rows, k, count = values.shape
    return (share @ values.reshape(visits, rows, k * count)).reshape(visits, k, count)


def against(
    sides: list[Side],
    count: int,
    white: Float[np.ndarray, "some n b"],
    root: Float[np.ndarray, "some n n"],
    visits: Int[np.ndarray, " some"],
) -> Float[np.ndarray, "b columns"]:
    """Return the products of whitened columns with those of all sides.

    Args:
        sides: Columns, `count` in all.
        count: How many.
        white: Other columns, whitened, of some visits.
        root: Square roots of the inverse covariances of these visits.
        visits: Which they are.
    """
    total = np.zeros((white.shape[2], count))
    for side in sides:
        if side.first < 0:
            total[:, side.column] += side.products(white, visits).T
    stacks = stacked(sides)
    back = root.swapaxes(1, 2) @ white if stacks else white
    for stack in stacks:
        every = np.arange(white.shape[2])
        add(total, every, stack.column, stack.of(visits).products(back).T)
    return total


def add(
    total: Float[np.ndarray, "all many"],
    rows: Int[np.ndarray, " a"],
    columns: Int[np.ndarray, " b"],
    block: Float[np.ndarray, "a b"],
) -> None:
    """Add a block where it belongs; a column that shifts many markers comes often."""
    np.add.at(total, np.ix_(rows, columns), block)
