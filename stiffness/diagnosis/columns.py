"""Signatures stand side by side as the columns of one linear model.

A column that turns an axis is kept as its law along the axis, any other as a twist;
what both mean for readings is the business of `within` and `between`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.signature import Motion, Part, Shift, Signature, Turn
from stiffness.diagnosis.visits import Visits


@dataclass(frozen=True)
class Group:
    """Columns that act at one place in one way.

    Attributes:
        place: Axis from 0 for turns, place from 0 for motions, marker for shifts.
        values: (visits, longest, columns), or with 6 (a twist) or 3 (a shift) before
            the columns.
        column: Number of each column in the whole model.
    """

    place: int
    values: np.ndarray
    column: Int[np.ndarray, " columns"]


@dataclass(frozen=True)
class Columns:
    """The columns of a linear model, sorted by where they act.

    Attributes:
        count: How many.
        turns: Along axes.
        motions: Of what places carry.
        shifts: Of single markers.
    """

    count: int
    turns: tuple[Group, ...]
    motions: tuple[Group, ...]
    shifts: tuple[Group, ...]


def columns_of(signatures: Sequence[Signature], visits: Visits) -> Columns:
    """Put signatures side by side, in their order.

    Args:
        signatures: Each with columns of its own.
        visits: How rows lie side by side.
    """
    sorts: dict[type, dict[int, list[tuple[np.ndarray, np.ndarray]]]] = {
        Turn: {},
        Motion: {},
        Shift: {},
    }
    start = 0
    for signature in signatures:
        numbers = np.arange(start, start + signature.columns)
        for part in signature.parts:
            if type(part) in sorts:
                place, values = _at(part)
                sorts[type(part)].setdefault(place, []).append((values, numbers))
        start += signature.columns
    turns, motions, shifts = (_groups(sorts[kind], visits) for kind in sorts)
    return Columns(start, turns, motions, shifts)


def _at(part: Part) -> tuple[int, np.ndarray]:
    if isinstance(part, Turn):
        return part.axis, part.law
    if isinstance(part, Motion):
        return part.place, part.twist
    if isinstance(part, Shift):
        return part.marker, part.displacement
    return part.axis, part.angle


def _groups(
    found: dict[int, list[tuple[np.ndarray, np.ndarray]]], visits: Visits
) -> tuple[Group, ...]:
    """Join what acts at the same place; columns named twice there add up."""
    groups = []
    for place, pieces in sorted(found.items()):
        values = np.concatenate([v for v, _ in pieces], axis=-1)
        number = np.concatenate([n for _, n in pieces])
        once, where = np.unique(number, return_inverse=True)
        if len(once) < len(number):
            summed = np.zeros((*values.shape[:-1], len(once)))
            for k, column in enumerate(where):
                summed[..., column] += values[..., k]
            values, number = summed, once
        groups.append(Group(place, visits.gather(values), number))
    return tuple(groups)


def levers(
    point: Float[np.ndarray, "*many 3"],
) -> Float[np.ndarray, "*many 3 6"]:
    """Return what takes a twist to the displacement of a point: [1, -point x]."""
    many = point.shape[:-1]
    taken = np.zeros((*many, 3, 6))
    taken[..., range(3), range(3)] = 1.0
    x, y, z = np.moveaxis(point, -1, 0)
    taken[..., 0, 4], taken[..., 0, 5] = z, -y
    taken[..., 1, 3], taken[..., 1, 5] = -z, x
    taken[..., 2, 3], taken[..., 2, 4] = y, -x
    return taken


def contract(
    one: Float[np.ndarray, "visits a n"], other: Float[np.ndarray, "visits n b"]
) -> Float[np.ndarray, "a b"]:
    """Sum the products of two stacks of matrices over visits."""
    visits, a, n = one.shape
    return one.transpose(1, 0, 2).reshape(a, visits * n) @ other.reshape(visits * n, -1)
