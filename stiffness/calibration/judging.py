"""Sets of effects are judged on folds of regions that they were not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from stiffness.calibration.blocks import Blocks
from stiffness.calibration.eliminated import Columns, Eliminated
from stiffness.calibration.normal import Normal, total_of
from stiffness.calibration.ridge import Sizes, precision_of

Tried = Float[np.ndarray, "folds tried"]


@dataclass(frozen=True)
class Judge:
    """Everything needed to fit a set on all folds but one and to look at that one.

    Attributes:
        blocks: The columns.
        folds: Normal equations of each fold.
        sizes: Of noise and tables' bands.
    """

    blocks: Blocks
    folds: Sequence[Normal]
    sizes: Sizes

    @cached_property
    def total(self) -> Normal:
        """All folds together."""
        return total_of(self.folds)

    def on(self, columns: Columns) -> "Trial":
        """Fit a set of columns with each fold left out in turn."""
        fits = [self._without(out).joined_by(columns) for out in self.folds]
        return Trial(self, self.whole_on(columns), fits)

    def whole_on(self, columns: Columns) -> Eliminated:
        """Fit a set of columns to all folds."""
        return self._without(None).joined_by(columns)

    def _without(self, out: Normal | None) -> Eliminated:
        square = np.diag(self.total.gram)
        if out is not None:
            square = square - np.diag(out.gram)
        own = precision_of(square, self.blocks.band, self.sizes)
        return Eliminated.of(self.total, out, self.sizes.noise, own)


@dataclass(frozen=True)
class Trial:
    """A set of columns, fitted with each fold left out.

    Attributes:
        judge: Whose folds.
        whole: Fitted to all folds.
        fits: Fitted to all but each.
    """

    judge: Judge
    whole: Eliminated
    fits: Sequence[Eliminated]

    @property
    def columns(self) -> Columns:
        """The set, in the order in which it grew."""
        return self.whole.known

    @property
    def x(self) -> Float[np.ndarray, " columns"]:
        """The solution on all folds; zeros elsewhere."""
        return self.whole.with_each([np.zeros(0, dtype=int)])[:, 0]

    @cached_property
    def left(self) -> Float[np.ndarray, " folds"]:
        """The sum of squares on each fold left out, in m^2."""
        none = np.zeros(0, dtype=int)
        return left_of(self.judge.folds, [f.with_each([none]) for f in self.fits])[:, 0]

    def with_each(self, blocks: Sequence[Columns]) -> tuple[Tried, np.ndarray]:
        """Return what is left with each block added, and the solutions on all."""
        tried = (fit.with_each(blocks) for fit in self.fits)
        return left_of(self.judge.folds, tried), self.whole.with_each(blocks)

    def joined_by(self, own: Columns) -> "Trial":
        """Believe a block."""
        fits = [fit.joined_by(own) for fit in self.fits]
        return Trial(self.judge, self.whole.joined_by(own), fits)

    def without_each(self, blocks: Sequence[Columns]) -> Tried:
        """Return what is left when each block alone is taken out of the set."""
        place = np.full(len(self.whole.precision), -1)
        place[self.columns] = np.arange(len(self.columns))
        none = np.zeros(0, dtype=int)
        tried = []
        for fit in self.fits:
            c, x = fit.inverse(), fit.with_each([none])
            x = np.repeat(x, len(blocks), axis=1)
            for j, block in enumerate(blocks):
                own = place[block]
                less = np.linalg.solve(c[np.ix_(own, own)], x[block, j])
                x[fit.known, j] -= c[:, own] @ less
                x[block, j] = 0.0
            tried.append(x)
        return left_of(self.judge.folds, tried)


def left_of(folds: Sequence[Normal], solutions) -> Tried:
    """Return the sum of squares that each fold's solutions leave on it, in m^2."""
    found = []
    for fold, x in zip(folds, solutions, strict=True):
        both = np.sum(x * (fold.gram @ x), axis=0)
        found.append(fold.square - 2.0 * fold.aim @ x + both)
    return np.array(found)


def compared(
    before: Float[np.ndarray, " folds"], after: Float[np.ndarray, " folds"]
) -> tuple[float, float]:
    """Return the mean gain of the logarithm of what is left, and its standard error."""
    each = np.log(before / after)
    return float(each.mean()), float(each.std(ddof=1) / np.sqrt(len(each)))
