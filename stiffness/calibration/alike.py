"""What these data cannot tell from a name is said with it.

==========  ==========================================================================
Equation    u = A_k x_k, what a name does beyond the other known columns; another block
            c comes near where |P_c u|² > 0.8 |u|², P_c onto its columns beyond the same
            ones; it does as well where folds left out are predicted, with it in the
            name's stead, no worse than two standard errors or a hundredth of what the
            name gains
Source      Hotelling 1936, "Relations between two sets of variates"; margins as
            `selection`
Valid       names of few coefficients
Ignores     what only two others together could replace; tables as substitutes
==========  ==========================================================================
"""

from collections.abc import Sequence

import numpy as np

from stiffness.calibration.blocks import SILENT, Blocks, Key
from stiffness.calibration.eliminated import Columns
from stiffness.calibration.judging import Trial, compared

MARGIN, SLIGHT = 2.0, 0.01
"""Standard errors of a loss, and share of what the name gains, that count as none;
chosen: laws are no truer than a tenth of their size, squared."""
NEAR = 0.8
"""Share of a name's square that another must do at least; chosen: cosine 0.9."""
FEW = 12
"""Columns of a block that is looked at; chosen: twice a link's numbers."""
RARE = ("bearing_tilt", "tracker_scale")
"""What explains only where nothing common does: seats and trackers are stiffer and more
true than gears and drawings by an order of magnitude."""

LENGTHS: Key = ("geometry_error", "lengths")
"""All links longer or shorter together: what a tracker's scale looks like."""

Unit = tuple[Key, Columns]


def is_rare(unit: Unit) -> bool:
    """Return whether an effect is rarer than those that look like it."""
    return unit[0][0] in RARE


def others_of(trial: Trial) -> list[Unit]:
    """Return the small blocks that a trial does not hold, the commoner ones first."""
    blocks = trial.judge.blocks
    known = set(trial.columns.tolist())
    units = [(key, part) for key in blocks.keys for part in blocks.parts(key)]
    lengths = lengths_of(blocks)
    if len(lengths):
        units.append((LENGTHS, lengths))
    few = [(k, c) for k, c in units if len(c) <= FEW or k == LENGTHS]
    free = [(k, c) for k, c in few if not known & set(c.tolist())]
    return sorted(free, key=is_rare)


def lengths_of(blocks: Blocks) -> Columns:
    """Return the columns that make links longer or shorter."""
    return np.array(
        [
            j
            for j, (key, name) in enumerate(
                zip(blocks.owner, blocks.parameter, strict=True)
            )
            if key[0] == "geometry_error" and name.endswith("_m") and key != SILENT
        ],
        dtype=int,
    )


def substitutes(trial: Trial, own: Columns, units: Sequence[Unit]) -> list[Unit]:
    """Return the units that would do as well as some columns of a trial.

    Args:
        trial: What is believed.
        own: Columns in it.
        units: Blocks that are not in it.
    """
    judge = trial.judge
    rest = np.setdiff1d(trial.columns, own)
    whole, x = judge.whole_on(rest), trial.x[own]
    size = float(x @ whole.inner(own, own) @ x)
    near = []
    for unit in units:
        cross = whole.inner(unit[1], own) @ x
        inside = cross @ np.linalg.solve(whole.inner(unit[1], unit[1]), cross)
        if inside > NEAR * size:
            near.append(unit)
    if not near:
        return []
    less = judge.on(rest)
    gain = compared(less.left, trial.left)[0]
    every, solutions = less.with_each([c for _, c in near])
    return [
        (key, columns)
        for (key, columns), left, x in zip(near, every.T, solutions.T, strict=True)
        if judge.blocks.holds(columns, x[columns]) and _as_good(trial, left, gain)
    ]


def _as_good(trial: Trial, left: np.ndarray, gain: float) -> bool:
    loss, error = compared(left, trial.left)
    return loss <= max(MARGIN * error, SLIGHT * gain)
