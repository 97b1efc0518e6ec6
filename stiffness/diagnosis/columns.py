"""Signatures stand side by side as the columns of one linear model.

A column that turns an axis is kept as its law along the axis, any other as a twist;
what both mean for readings is the business of `within` and `between`. Every part of a
column has a slot of its own, sorted by where it acts; slots of a column add up.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from stiffness.diagnosis.deferred import Deferred
from stiffness.diagnosis.signature import Motion, Shift, Signature, Turn, values
from stiffness.diagnosis.situation import Situation


@dataclass(frozen=True)
class Group:
    """Parts of columns that act at one place in one way.

    Attributes:
        place: Axis from 0 for turns, place from 0 for motions, marker for shifts.
        values: (visits, longest, columns), or with 6 (a twist) or 3 (a shift) before
            the columns.
        slots: Where they stand among all slots.
    """

    place: int
    values: np.ndarray
    slots: slice


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns of a linear model in some visits, sorted by where they act.

    Attributes:
        count: How many columns.
        column: Number of the column that each slot belongs to.
        turns: Along axes.
        motions: Of what places carry.
        shifts: Of single markers.
    """

    count: int
    column: Int[np.ndarray, " slots"]
    turns: tuple[Group, ...]
    motions: tuple[Group, ...]
    shifts: tuple[Group, ...]

    @cached_property
    def _sums(self) -> sparse.csr_array:
        """What adds up the slots of each column: (columns, slots)."""
        slots = np.arange(len(self.column))
        shape = (self.count, len(slots))
        return sparse.csr_array((np.ones(len(slots)), (self.column, slots)), shape)

    def joined(
        self, slots: Float[np.ndarray, "*many slots"]
    ) -> Float[np.ndarray, "*many columns"]:
        """Add up the slots of each column."""
        many = slots.shape[:-1]
        flat = slots.reshape(prod(many), slots.shape[-1])
        return (self._sums @ flat.T).T.reshape(*many, self.count)

    def both_joined(
        self, slots: Float[np.ndarray, "slots slots"]
    ) -> Float[np.ndarray, "columns columns"]:
        """Add up the slots of rows and of columns."""
        return self._sums @ slots @ self._sums.T


def columns_of(
    signatures: Sequence[Signature | Deferred],
    row: Int[np.ndarray, "visits longest"],
) -> Columns:
    """Put signatures side by side, in their order.

    Args:
        signatures: Each with columns of its own.
        row: The recording's rows of the visits that are asked for. Deferred signatures
            are all of one situation.
    """
    kinds = (Turn, Motion, Shift)
    found: dict[tuple[int, int], list[tuple[np.ndarray, np.ndarray]]] = {}
    local = np.arange(row.size).reshape(row.shape)
    some: Situation | None = None
    count = 0
    for signature in signatures:
        numbers = np.arange(count, count + signature.columns)
        at, own = row, signature
        if isinstance(own, Deferred):
            some = own.situation.some(row.ravel()) if some is None else some
            at, own = local, own.of(some)
        for part in own.parts:
            if isinstance(part, kinds):
                where = (kinds.index(type(part)), _place(part))
                found.setdefault(where, []).append((values(part)[at], numbers))
        count += signature.columns
    groups: tuple[list[Group], ...] = ([], [], [])
    column: list[np.ndarray] = []
    start = 0
    for (kind, place), pieces in sorted(found.items(), key=lambda one: one[0]):
        laid = np.concatenate([law for law, _ in pieces], axis=-1)
        slots = slice(start, start + laid.shape[-1])
        groups[kind].append(Group(place, laid, slots))
        column.extend(numbers for _, numbers in pieces)
        start = slots.stop
    of_slot = np.concatenate(column) if column else np.zeros(0, dtype=int)
    turns, motions, shifts = (tuple(of_kind) for of_kind in groups)
    return Columns(count, of_slot, turns, motions, shifts)


def _place(part: Turn | Motion | Shift) -> int:
    if isinstance(part, Turn):
        return part.axis
    return part.place if isinstance(part, Motion) else part.marker


def contract(
    one: Float[np.ndarray, "visits n a"], other: Float[np.ndarray, "visits n b"]
) -> Float[np.ndarray, "a b"]:
    """Sum the products of two stacks of columns over visits."""
    visits, n, a = one.shape
    return one.reshape(visits * n, a).T @ other.reshape(visits * n, -1)
