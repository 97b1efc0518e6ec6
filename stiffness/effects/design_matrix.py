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
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import prod

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from stiffness.effects.base import Hypothesis
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    JointRotation,
    MarkerDisplacement,
    site_number,
    values,
)
from stiffness.experiment.static_state import StaticState
from stiffness.experiment.visits import Kept

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
    situation: StaticState

    def of(self, some: StaticState) -> EffectJacobian:
        """Return the signature of some of the situation's rows."""
        return self.hypothesis.jacobian(some, self.where, self.shape)


def deferred(
    signature: EffectJacobian,
    hypothesis: Hypothesis,
    where: str,
    shape: Float[np.ndarray, " parameters"],
    situation: StaticState,
) -> EffectJacobian | Deferred:
    """Return a signature as it is, or to be worked out where it is large.

    Args:
        signature: The same of all rows.
        hypothesis: Whose; one of several shapes.
        where: At which place.
        shape: With which shape.
        situation: Of all rows.
    """
    if any(
        isinstance(part, BodyTwist | MarkerDisplacement) for part in signature.parts
    ):
        return Deferred(signature.columns, hypothesis, where, shape, situation)
    return signature


# --- Columns --------------------------------------------------------------------------


@dataclass(frozen=True)
class Group:
    """Parts of columns that act at one place in one way.

    Attributes:
        site: Axis from 0 for turns, place from 0 for motions, marker for shifts.
        values: (visits, longest, columns), or with 6 (a twist) or 3 (a shift) before
            the columns.
        slots: Where they stand among all slots.
    """

    site: int
    values: np.ndarray
    slots: slice


@dataclass(frozen=True, eq=False)
class DesignMatrix:
    """The columns of a linear model in some visits, sorted by where they act.

    Attributes:
        count: How many columns.
        column: Number of the column that each slot belongs to.
        rotations: Along axes.
        twists: Of what places carry.
        marker_displacements: Of single markers.
    """

    count: int
    column: Int[np.ndarray, " slots"]
    rotations: tuple[Group, ...]
    twists: tuple[Group, ...]
    marker_displacements: tuple[Group, ...]

    @cached_property
    def _sums(self) -> sparse.csr_array:
        """What adds up the slots of each column: (columns, slots)."""
        slots = np.arange(len(self.column))
        shape = (self.count, len(slots))
        return sparse.csr_array((np.ones(len(slots)), (self.column, slots)), shape)

    @cached_property
    def body_slots(self) -> int:
        """How many slots move bodies; those of single markers come after them."""
        return max((g.slots.stop for g in (*self.rotations, *self.twists)), default=0)

    @cached_property
    def _body_sums(self) -> sparse.csr_array:
        return self._sums[:, : self.body_slots]

    def joined(
        self, slots: Float[np.ndarray, "*many slots"]
    ) -> Float[np.ndarray, "*many columns"]:
        """Add up the slots of each column."""
        many = slots.shape[:-1]
        flat = slots.reshape(prod(many), slots.shape[-1])
        return (self._sums @ flat.T).T.reshape(*many, self.count)

    def add(
        self,
        total: Float[np.ndarray, "bodies *many columns"],
        bodies: Bool[np.ndarray, " bodies"],
        group: Group,
        moved: Float[np.ndarray, "*many slots"],
    ) -> None:
        """Add what the slots of a group do to the columns of some bodies."""
        column = self.column[group.slots]
        one_each = len(np.unique(column)) == len(column)
        for body in np.flatnonzero(bodies):
            if one_each:
                total[body][..., column] += moved
                continue
            for slot, to in enumerate(column):
                total[body][..., to] += moved[..., slot]

    @cached_property
    def _of_one_column(self) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of slots that belong to the same column."""
        return (self._sums.T @ self._sums).nonzero()

    def diagonal(
        self, slots: Float[np.ndarray, "slots slots"]
    ) -> Float[np.ndarray, " columns"]:
        """Return the diagonal of `both_joined`."""
        one, other = self._of_one_column
        total = np.zeros(self.count)
        np.add.at(total, self.column[one], slots[one, other])
        return total

    def both_joined(
        self, slots: Float[np.ndarray, "slots slots"]
    ) -> Float[np.ndarray, "columns columns"]:
        """Add up the slots of rows and of columns of a symmetric matrix.

        It may be that of the slots which move bodies alone; they come first.
        """
        sums = self._sums if len(slots) == len(self.column) else self._body_sums
        return sums @ (sums @ slots).T


def design_matrix_of(
    signatures: Sequence[EffectJacobian | Deferred],
    row: Int[np.ndarray, "visits longest"],
) -> DesignMatrix:
    """Put signatures side by side, in their order.

    Args:
        signatures: Each with columns of its own.
        row: The recording's rows of the visits that are asked for. Deferred signatures
            are all of one situation.
    """
    kinds = (JointRotation, BodyTwist, MarkerDisplacement)
    found: dict[tuple[int, int], list[tuple[np.ndarray, np.ndarray]]] = {}
    local = np.arange(row.size).reshape(row.shape)
    some: StaticState | None = None
    count = 0
    for signature in signatures:
        numbers = np.arange(count, count + signature.columns)
        at, own = row, signature
        if isinstance(own, Deferred):
            some = own.situation.some(row.ravel()) if some is None else some
            at, own = local, own.of(some)
        for part in own.parts:
            if isinstance(part, kinds):
                where = (kinds.index(type(part)), site_number(part))
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
    return DesignMatrix(count, of_slot, turns, motions, shifts)


KEPT_VISITS = 400
"""Visits up to which the columns of a library are kept; chosen: half a gigabyte."""


@dataclass(frozen=True, eq=False)
class KeptColumns:
    """Signatures that are asked for again and again, laid out once in each stretch.

    Attributes:
        signatures: Each with columns of its own.
        kept: Their design matrices.
    """

    signatures: Sequence[EffectJacobian | Deferred]
    kept: Kept[DesignMatrix] = field(default_factory=Kept[DesignMatrix])

    def of(
        self, row: Int[np.ndarray, "visits longest"], some: Int[np.ndarray, " some"]
    ) -> DesignMatrix:
        """Return the columns in some visits.

        Args:
            row: The recording's rows of all visits.
            some: Numbers of the visits.
        """

        def lay(visits: Int[np.ndarray, " some"]) -> DesignMatrix:
            return design_matrix_of(self.signatures, row[visits])

        return self.kept.of(some, lay) if len(row) <= KEPT_VISITS else lay(some)


def side_by_side(one: DesignMatrix, other: DesignMatrix) -> DesignMatrix:
    """Return the columns of one and then those of another; nothing is copied."""
    first = len(one.column)

    def after(groups: tuple[Group, ...]) -> tuple[Group, ...]:
        ends = [(first + g.slots.start, first + g.slots.stop) for g in groups]
        each = zip(groups, ends, strict=True)
        return tuple(replace(g, slots=slice(*at)) for g, at in each)

    return DesignMatrix(
        one.count + other.count,
        np.concatenate([one.column, one.count + other.column]),
        one.rotations + after(other.rotations),
        one.twists + after(other.twists),
        one.marker_displacements + after(other.marker_displacements),
    )


def contract(
    one: Float[np.ndarray, "visits n a"], other: Float[np.ndarray, "visits n b"]
) -> Float[np.ndarray, "a b"]:
    """Sum the products of two stacks of columns over visits."""
    visits, n, a = one.shape
    return one.reshape(visits * n, a).T @ other.reshape(visits * n, -1)


def contract_each(
    one: Float[np.ndarray, "visits n a"], other: Float[np.ndarray, "visits n b"]
) -> Float[np.ndarray, "visits a b"]:
    """Return the products of two stacks of columns, visit by visit."""
    return one.swapaxes(1, 2) @ other


# --- Columns that act on a single body ------------------------------------------------


@dataclass(frozen=True, eq=False)
class SiteMean:
    """Slots of one group, averaged over the rows of each visit.

    Attributes:
        slots: Where they stand among all slots.
        mean: Twists or shifts of each visit.
        site: The place that moves; -1 where a marker shifts.
        marker: The marker that shifts; -1 where bodies move.
    """

    slots: slice
    mean: Float[np.ndarray, "visits k columns"]
    site: int = -1
    marker: int = -1


def site_means_of(
    columns: DesignMatrix,
    share: Float[np.ndarray, "visits rows"],
    screw: Float[np.ndarray, "visits rows axes 6"],
) -> list[SiteMean]:
    """Return the means of all groups of columns.

    Args:
        columns: In some visits.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it.
    """
    of_row = share[:, None]
    sites = []
    for group in columns.rotations:
        along = share[..., None] * screw[:, :, group.site]
        mean = along.swapaxes(1, 2) @ group.values
        sites.append(SiteMean(group.slots, mean, site=group.site + 1))
    for group in (*columns.twists, *columns.marker_displacements):
        visits, rows, k, count = group.values.shape
        flat = of_row @ group.values.reshape(visits, rows, k * count)
        mean = flat.reshape(visits, k, count)
        at = {"site" if k == 6 else "marker": group.site}
        sites.append(SiteMean(group.slots, mean, **at))
    return sites
