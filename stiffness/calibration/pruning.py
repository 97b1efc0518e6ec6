"""What folds left out are better without goes, and rare effects that others replace.

==========  ==========================================================================
Equation    loss of a name = mean over folds left out of log of what is left without it
            less log of what is left with it; idle where that is not above zero
Source      backward elimination; Breiman et al. 1984, "Classification and Regression
            Trees"
Valid       folds that share no region of poses
Ignores     names that only two others together would replace
==========  ==========================================================================
"""

import numpy as np

from stiffness.calibration.alike import (
    FEW,
    LENGTHS,
    MARGIN,
    is_rare,
    others_of,
    substitutes,
)
from stiffness.calibration.blocks import Key
from stiffness.calibration.eliminated import Columns
from stiffness.calibration.judging import Trial, compared


def pruned(trial: Trial) -> Trial:
    """Take out what became impossible, then what folds are better without."""
    judge = trial.judge
    while True:
        x, inside = trial.x, inside_of(trial)
        gone = [
            own
            for key in inside
            for own in judge.blocks.parts(key)
            if np.isin(own, trial.columns).all() and not judge.blocks.holds(own, x[own])
        ]
        if not gone:
            budget = budget_of(trial)
            idle = [
                key
                for key, (loss, _) in budget.items()
                if loss <= 0.0 and not _is_constant(key, inside)
            ]
            if not idle:
                return trial
            gone = [inside[min(idle, key=lambda key: budget[key][0])]]
        trial = judge.on(np.setdiff1d(trial.columns, np.concatenate(gone)))


def _is_constant(key: Key, inside: dict[Key, Columns]) -> bool:
    """Return whether an offset is the constant about which a table's waves go.

    Without it slow waves would make one, and run away where no pose was fitted.
    """
    return key[0] == "encoder_offset" and ("transmission_error", key[1]) in inside


def inside_of(trial: Trial) -> dict[Key, Columns]:
    """Return the columns of each effect that a trial holds."""
    blocks, known = trial.judge.blocks, np.sort(trial.columns)
    own = {k: np.intersect1d(blocks.columns_of([k]), known) for k in blocks.keys}
    return {key: columns for key, columns in own.items() if len(columns)}


def budget_of(trial: Trial) -> dict[Key, tuple[float, float]]:
    """Return what each effect's going alone would lose, with its standard error."""
    inside = inside_of(trial)
    left = trial.without_each(list(inside.values()))
    return {
        key: compared(one, trial.left) for key, one in zip(inside, left.T, strict=True)
    }


def common(trial: Trial) -> Trial:
    """Put a common effect in the place of each rare one that it can replace."""
    blocks = trial.judge.blocks
    for key in inside_of(trial):
        for own in blocks.parts(key):
            if not is_rare((key, own)) or not np.isin(own, trial.columns).all():
                continue
            common = [u for u in others_of(trial) if not is_rare(u)]
            found = substitutes(trial, own, common)
            if found:
                rest = np.setdiff1d(trial.columns, own)
                trial = trial.judge.on(np.union1d(rest, found[0][1]))
    return trial


def alike(trial: Trial, budget: dict[Key, tuple[float, float]]):
    """Return what would do as well as each name, by name."""
    units, found = others_of(trial), {}
    for key, own in inside_of(trial).items():
        loss, error = budget[key]
        if len(own) <= FEW and loss > MARGIN * error:
            names = [unit[0] for unit in substitutes(trial, own, units)]
            if LENGTHS in names:  # all links' together
                links = [k for k in trial.judge.blocks.keys if k[0] == LENGTHS[0]]
                names = [n for n in names if n != LENGTHS] + links
            found[key] = tuple(dict.fromkeys(n for n in names if n != key))
    return found
