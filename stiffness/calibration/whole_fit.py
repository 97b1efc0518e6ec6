"""What was chosen is fitted once more: tables in full, about the arm as it came out.

==========  ==========================================================================
Equation    as `ridge`; done again about the corrected drawing where that moved away
Source      Gauss-Newton
Valid       corrections that are small beside the arm
Ignores     what was not chosen: it stays as the model has it
==========  ==========================================================================
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from stiffness.calibration.blocks import SILENT, Blocks, Key
from stiffness.calibration.claims import drawn_of
from stiffness.calibration.columns import candidates_of
from stiffness.calibration.normal import normals_of
from stiffness.calibration.readings import Readings
from stiffness.calibration.ridge import Sizes, Solved, learnt, solved
from stiffness.calibration.rigid_fit import RigidFit
from stiffness.calibration.stance import Drawn, Stance

MOVED = 2e-4
"""Change of the drawing in rad or m from which columns are made anew; chosen: its
square times an arm's length is less than a tenth of a tracker's noise."""
ROUNDS = 3


@dataclass(frozen=True)
class WholeFit:
    """A set of columns, fitted.

    Attributes:
        blocks: All columns.
        stance: What they were made in.
        known: Those that were fitted.
        fit: Their solution.
        sizes: Of noise and bands.
        drawn: The drawing as corrected.
        residual: What is left on all rows, in m.
        used: How many coefficients the data have settled, for each coordinate fitted.
    """

    blocks: Blocks
    stance: Stance
    known: Int[np.ndarray, " known"]
    fit: Solved
    sizes: Sizes
    drawn: Drawn
    residual: Float[np.ndarray, "rows 3"]
    used: float


def whole_fit(
    readings: Readings,
    keep: Bool[np.ndarray, " rows"],
    rigid: RigidFit,
    wanted: set[tuple[Key, str]],
    sprung: set[Key],
    highest: int,
) -> WholeFit:
    """Fit what is nominal and what is wanted to the rows that are kept.

    Args:
        readings: All that was seen.
        keep: Rows that may be fitted.
        rigid: Where the drawing stands to begin with, and which of it shows.
        wanted: Names and parameters that are fitted.
        sprung: Springs that the model has.
        highest: Order below which tables end.
    """
    found = _about(readings, keep, rigid, wanted, sprung, highest)
    for _ in range(ROUNDS - 1):
        before, now = found.stance.drawn, found.drawn
        moved = np.abs(now.values - before.values).max(initial=0.0)
        turned = np.abs(now.base_from_tracker - before.base_from_tracker).max()
        if max(moved, turned) < MOVED:
            break
        fit = RigidFit(now, rigid.kept)
        found = _about(readings, keep, fit, wanted, sprung, highest)
    return found


def _about(readings, keep, rigid, wanted, sprung, highest) -> WholeFit:
    stance = Stance.of(readings, rigid.drawn)
    keys = {owner for owner, _ in wanted}
    every = [
        c
        for c in candidates_of(stance, highest)
        if c.key in keys or c.key in sprung
        if c.orders or (c.key, c.parameters[0]) in wanted or c.key in sprung
    ]
    full = Blocks.of(rigid, stance, every, sprung)
    names = zip(full.owner, full.parameter, strict=True)
    known = np.array(
        [
            j
            for j, (owner, name) in enumerate(names)
            if full.order[j] or owner == SILENT or (owner, name) in wanted
        ]
    )
    one = np.where(keep, 0, -1)
    normal = normals_of(full, stance, one, 1)[0].only(known)
    _, sizes = learnt(normal, full.band[known])
    fit = solved(normal, full.band[known], sizes)
    left = np.empty_like(stance.residual)
    for start in range(0, len(left), 500):
        rows = np.arange(start, min(start + 500, len(left)))
        a, y = full.problem(stance, rows)
        left[rows] = (y - a[:, known] @ fit.x).reshape(-1, 3)
    drawn = drawn_of(full, rigid.drawn, known, fit.x)
    used = float(np.sum(1.0 - fit.precision * fit.spread())) / normal.count
    return WholeFit(full, stance, known, fit, sizes, drawn, left, used)


def springs_of(
    found: WholeFit, nominal: Float[np.ndarray, " axes"]
) -> dict[str, float]:
    """Return the stiffness of each spring of the model as fitted, in N m/rad.

    A decade either way is nominal; what these postures do not show stays as it is.
    """
    softer = {}
    for j, value in zip(found.known.tolist(), found.fit.x.tolist(), strict=True):
        if found.blocks.owner[j] == SILENT and found.blocks.entry[j] < 0:
            where = _axis_of(found.blocks, j)
            usual = 1.0 / nominal[int(where[1:]) - 1]
            softer[where] = float(1.0 / np.clip(value, usual / 10.0, 10.0 * usual))
    return softer


def _axis_of(blocks: Blocks, column: int) -> str:
    at = int(np.sum(blocks.entry >= 0))
    for candidate in blocks.candidates:
        at += len(candidate.parameters)
        if column < at:
            return candidate.where
    raise AssertionError("a column of no block")
