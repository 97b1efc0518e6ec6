"""An effect is believed when regions of poses that it was not fitted to confirm it.

==========  ==========================================================================
Equation    gain of a fold = log of what the set leaves there − log of what set and
            effect leave, both fitted on the other folds: each region counts alike;
            believed where the mean gain is more than two of its standard errors over
            folds; the one that gains most goes first, of those that gain alike a
            common one
Source      Breiman et al. 1984, "Classification and Regression Trees" (margins of one
            standard error; two here, for there are many candidates)
Valid       folds that share no region of poses
Ignores     that sizes of tables' bands are learnt from all folds together
==========  ==========================================================================
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stiffness.calibration.alike import MARGIN, is_rare
from stiffness.calibration.blocks import SILENT, Blocks, Key
from stiffness.calibration.eliminated import Columns
from stiffness.calibration.judging import Judge, Trial, compared
from stiffness.calibration.pruning import alike, budget_of, common, pruned

ALIKE = 0.99
"""Share of the best gain from which on another is as good; chosen: laws are no truer
than a tenth of their size, squared."""
DRAWING: Key = ("geometry_error", "all links")
"""The corrections of the drawing, which are tried together."""
BELIEVED, NO_GAIN, IMPOSSIBLE = "believed", "no gain", "out of bounds"


@dataclass(frozen=True)
class Step:
    """One effect that was tried when it was its turn.

    Attributes:
        key: Effect and place.
        parameters: Which of its coefficients.
        rms: What is left on folds left out, 3-D per reading, in m; with it if believed.
        gain: Of the logarithm of the mean square on a fold left out.
        error: Its standard error over folds.
        verdict: `believed`, `no gain` or `out of bounds`.
    """

    key: Key
    parameters: tuple[str, ...]
    rms: float
    gain: float
    error: float
    verdict: str


@dataclass(frozen=True)
class Selected:
    """What was believed.

    Attributes:
        columns: All that are fitted, the silent ones included.
        steps: What was believed, in order; then what was refused.
        budget: Of each effect believed, how the logarithm of the mean square on folds
            left out grows when it alone is taken out, and its standard error.
        alike: Of each effect believed, those that would do as well in its stead.
    """

    columns: Columns
    steps: tuple[Step, ...]
    budget: dict[Key, tuple[float, float]]
    alike: dict[Key, tuple[Key, ...]]


def selected(judge: Judge, said: Callable[[str], None] = lambda _: None) -> Selected:
    """Choose forward, then take out what folds left out are better without.

    Args:
        judge: Holds the folds.
        said: Is told what was believed.
    """
    trial = judge.on(judge.blocks.columns_of([SILENT]))
    rest = _units(judge.blocks)
    steps: list[Step] = []
    while rest:
        tried = list(zip(_tried(trial, rest), rest, strict=True))
        good = [t for t in tried if t[0].verdict == BELIEVED]
        if not good:
            steps += [step for step, _ in tried]
            break
        most = max(t[0].gain for t in good)
        best, unit = min(
            (t for t in good if t[0].gain >= ALIKE * most),
            key=lambda t: (is_rare(t[1]), -t[0].gain),
        )
        steps.append(best)
        said(
            f"{best.key[0]}@{best.key[1]}: {1e3 * best.rms:.4f} mm on regions left out"
        )
        trial = trial.joined_by(unit[1])
        rest = [u for u in rest if u is not unit]
    trial = common(pruned(trial))
    budget = budget_of(trial)
    return Selected(trial.columns, tuple(steps), budget, alike(trial, budget))


def _units(blocks: Blocks) -> list[tuple[Key, Columns]]:
    """Return what enters together: the drawing, each table, each bounded number."""
    claims = np.array([owner != SILENT for owner in blocks.owner])
    drawing = np.flatnonzero((blocks.entry >= 0) & claims)
    units: list[tuple[Key, Columns]] = [(DRAWING, drawing)] if len(drawing) else []
    for key in blocks.keys:
        if key[0] not in ("encoder_offset", "geometry_error"):
            units += [(key, own) for own in blocks.parts(key)]
    return units


def _tried(trial: Trial, units: Sequence[tuple[Key, Columns]]) -> Iterator[Step]:
    """Try units, each by itself."""
    blocks = trial.judge.blocks
    every, solutions = trial.with_each([own for _, own in units])
    for (key, own), left, x in zip(units, every.T, solutions.T, strict=True):
        gain, error = compared(trial.left, left)
        verdict = BELIEVED if gain > max(MARGIN * error, 0.0) else NO_GAIN
        if not blocks.holds(own, x[own]):
            verdict = IMPOSSIBLE
        square = (left if verdict == BELIEVED else trial.left).sum()
        rms = float(np.sqrt(max(square, 0.0) / trial.judge.total.count * 3.0))
        names = tuple(blocks.parameter[j] for j in own)
        yield Step(key, names, rms, gain, error, verdict)
