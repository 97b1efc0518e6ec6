"""Design matrix: Jacobians of effects side by side, grouped by the body they move.

Where a grid of shapes moves bodies or markers, rows are worked out when asked for.

Twists and shifts of every shape and row would fill the memory of a long recording;
such laws know no row but their own, so that any few rows can be had alone.

Signatures stand side by side as the columns of one linear model.

A column that turns an axis is kept as its law along the axis, any other as a twist;
what both mean for readings is the business of `within` and `between`. Every part of a
column has a slot of its own, sorted by where it acts; slots of a column add up.

What a group of columns does to the mean of a visit, it does at one site.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import Motion, Shift, Signature, Turn, values
from stiffness.experiment.static_state import Situation

# --- Columns worked out on demand -----------------------------------------------------


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


# --- Columns --------------------------------------------------------------------------


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


# --- Columns that act on a single body ------------------------------------------------


@dataclass(frozen=True, eq=False)
class Site:
    """Slots of one group, averaged over the rows of each visit.

    Attributes:
        slots: Where they stand among all slots.
        mean: Twists or shifts of each visit.
        place: The place that moves; -1 where a marker shifts.
        marker: The marker that shifts; -1 where bodies move.
    """

    slots: slice
    mean: Float[np.ndarray, "visits k columns"]
    place: int = -1
    marker: int = -1


def sites_of(
    columns: Columns,
    share: Float[np.ndarray, "visits rows"],
    screw: Float[np.ndarray, "visits rows axes 6"],
) -> list[Site]:
    """Return the means of all groups of columns.

    Args:
        columns: In some visits.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it.
    """
    of_row = share[:, None]
    sites = []
    for group in columns.turns:
        along = share[..., None] * screw[:, :, group.place]
        mean = along.swapaxes(1, 2) @ group.values
        sites.append(Site(group.slots, mean, place=group.place + 1))
    for group in (*columns.motions, *columns.shifts):
        visits, rows, k, count = group.values.shape
        flat = of_row @ group.values.reshape(visits, rows, k * count)
        mean = flat.reshape(visits, k, count)
        at = {"place" if k == 6 else "marker": group.place}
        sites.append(Site(group.slots, mean, **at))
    return sites
