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


@dataclass(frozen=True)
class Wave:
    """One wave of a table, with half the width of its size's interval.

    Attributes:
        order: Waves a turn.
        size: Amplitude, in rad.
        phase: Of size sin(order q + phase), in rad.
        half: Half the width of the interval of `size`, in rad.
    """

    order: int
    size: float
    phase: float
    half: float

    @property
    def clear(self) -> bool:
        """Whether the interval holds no zero."""
        return bool(self.size > self.half)


def estimates_of(
    blocks: Blocks,
    known: Int[np.ndarray, " known"],
    x: Float[np.ndarray, " known"],
    half: dict[int, float],
) -> dict[Key, dict[str, Estimate]]:
    """Return numbers with intervals.

    Args:
        blocks: The columns.
        known: Columns that were fitted.
        x: Their coefficients.
        half: Half the width of the interval, by number within `known`.
    """
    found: dict[Key, dict[str, Estimate]] = {}
    for i, width in half.items():
        j, value = known[i], float(x[i])
        if blocks.owner[j] != SILENT:
            own = found.setdefault(blocks.owner[j], {})
            own[blocks.parameter[j]] = Estimate(value, value - width, value + width)
    return found


def drawn_of(
    blocks: Blocks,
    rigid: Drawn,
    known: Int[np.ndarray, " known"],
    x: Float[np.ndarray, " known"],
) -> Drawn:
    """Return the drawing as corrected by what was fitted, and by nothing else.

    Args:
        blocks: The columns.
        rigid: The drawing that they start from.
        known: Columns that were fitted.
        x: Their coefficients.
    """
    step = np.zeros(len(rigid.values) + 6 + rigid.places.size)
    step[: len(rigid.values)] = -rigid.values
    for j, value in zip(known, x, strict=True):
        if blocks.entry[j] >= 0:
            step[blocks.entry[j]] = value - blocks.start[j]
    return rigid.stepped(step)


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
    blocks: Blocks,
    known: Int[np.ndarray, " known"],
    x: Float[np.ndarray, " known"],
    count: int,
) -> dict[str, np.ndarray]:
    """Return, by axis, the two coefficients of each of a table's largest waves."""
    found: dict[str, np.ndarray] = {}
    order = blocks.order[known]
    where = np.array([blocks.owner[j][1] for j in known])
    for axis in dict.fromkeys(where[order > 0]):
        own = np.flatnonzero((order > 0) & (where == axis)).reshape(-1, 2)
        size = np.sum(x[own] ** 2, axis=1)
        found[str(axis)] = own[np.argsort(-size, kind="stable")[:count]]
    return found


def wave_of(
    blocks: Blocks,
    known: Int[np.ndarray, " known"],
    x: Float[np.ndarray, " known"],
    waves: Int[np.ndarray, "waves 2"],
    half: Float[np.ndarray, "waves 2"],
) -> Wave:
    """Return the largest of some waves that is clearly there, or else the largest."""
    size, width = np.hypot(*x[waves].T), half.max(axis=1)
    clear = np.flatnonzero(size > width)
    at = int(clear[0]) if len(clear) else 0
    c, s = x[waves[at]]
    order = int(blocks.order[known[waves[at, 0]]])
    return Wave(order, float(size[at]), float(np.arctan2(c, s)), float(width[at]))
