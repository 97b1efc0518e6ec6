"""Coefficients are put back into numbers of the arm: the drawing, tables, laws."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from stiffness.calibration.blocks import SILENT, Blocks, Key
from stiffness.calibration.intervals import Estimate
from stiffness.calibration.stance import Drawn


@dataclass(frozen=True)
class Table:
    """An uneven gear as a sum of waves.

    Attributes:
        order: Of each wave.
        cos: Amplitude of cos(order q), in rad.
        sin: Of sin(order q), in rad.
    """

    order: Float[np.ndarray, " waves"]
    cos: Float[np.ndarray, " waves"]
    sin: Float[np.ndarray, " waves"]

    def at(self, angle: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the output's error at some angles, in rad."""
        wave = angle[:, None] * self.order
        return np.cos(wave) @ self.cos + np.sin(wave) @ self.sin


def estimates_of(
    blocks: Blocks,
    rigid: Drawn,
    known: Int[np.ndarray, " known"],
    x: Float[np.ndarray, " known"],
    half: dict[int, float],
) -> tuple[dict[Key, dict[str, Estimate]], Drawn]:
    """Return numbers with intervals, and the drawing with all corrections.

    Args:
        blocks: The columns.
        rigid: The drawing that they start from.
        known: Columns that were fitted.
        x: Their coefficients.
        half: Half the width of the interval, by number within `known`.
    """
    step = np.zeros(len(rigid.values) + 6 + rigid.places.size)
    found: dict[Key, dict[str, Estimate]] = {}
    for i, width in half.items():
        j = known[i]
        value = float(x[i])
        if blocks.entry[j] >= 0:
            step[blocks.entry[j]] = value
            if blocks.entry[j] < len(rigid.values):
                value += float(rigid.values[blocks.entry[j]])
        if blocks.owner[j] != SILENT:
            own = found.setdefault(blocks.owner[j], {})
            own[blocks.parameter[j]] = Estimate(value, value - width, value + width)
    return found, rigid.stepped(step)


def tables_of(
    blocks: Blocks, known: Int[np.ndarray, " known"], x: Float[np.ndarray, " known"]
) -> dict[str, Table]:
    """Return the uneven gears among the coefficients, by axis."""
    found: dict[str, Table] = {}
    order = blocks.order[known]
    where = np.array([blocks.owner[j][1] for j in known])
    for axis in dict.fromkeys(where[order > 0]):
        own = np.flatnonzero((order > 0) & (where == axis))
        found[str(axis)] = Table(
            order[own[::2]].astype(float), x[own[::2]], x[own[1::2]]
        )
    return found


def largest_waves(
    blocks: Blocks, known: Int[np.ndarray, " known"], x: Float[np.ndarray, " known"]
) -> dict[str, np.ndarray]:
    """Return, by axis, the two coefficients of a table's largest wave."""
    found: dict[str, np.ndarray] = {}
    order = blocks.order[known]
    where = np.array([blocks.owner[j][1] for j in known])
    for axis in dict.fromkeys(where[order > 0]):
        own = np.flatnonzero((order > 0) & (where == axis)).reshape(-1, 2)
        found[str(axis)] = own[np.argmax(np.sum(x[own] ** 2, axis=1))]
    return found
