"""Sets of effects are judged on folds of regions that they were not fitted to."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_solve

from stiffness.calibration.blocks import Blocks
from stiffness.calibration.normal import Normal, total_of
from stiffness.calibration.ridge import FAINT, Sizes, Solved, solved

Columns = Int[np.ndarray, " _"]


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
        fits = [self.fit(self.total - f, columns) for f in self.folds]
        return Trial(self, columns, self.fit(self.total, columns), fits)

    def fit(self, normal: Normal, columns: Columns) -> Solved:
        """Fit some columns to some rows."""
        return solved(normal.only(columns), self.blocks.band[columns], self.sizes)


@dataclass(frozen=True)
class Trial:
    """A set of columns, fitted with each fold left out.

    Attributes:
        judge: Whose folds.
        columns: The set.
        whole: Fitted to all folds.
        fits: Fitted to all but each.
    """

    judge: Judge
    columns: Columns
    whole: Solved
    fits: Sequence[Solved]

    @cached_property
    def left(self) -> Float[np.ndarray, " folds"]:
        """The sum of squares on each fold left out, in m^2."""
        return self._left(self.columns, [fit.x for fit in self.fits])

    def with_columns(
        self, own: Columns
    ) -> tuple[Float[np.ndarray, " folds"], Float[np.ndarray, " own"]]:
        """Return what is left with columns added, and their coefficients on all."""
        folds, total = self.judge.folds, self.judge.total
        pairs = zip(folds, self.fits, strict=True)
        x = [np.concatenate(self._added(total - f, fit, own)) for f, fit in pairs]
        left = self._left(np.concatenate([self.columns, own]), x)
        return left, self._added(total, self.whole, own)[1]

    def without(self, inside: Columns) -> Float[np.ndarray, " folds"]:
        """Return what is left without some; numbers within the set."""
        found = []
        for fit in self.fits:
            c = fit.inverse(inside)
            found.append(fit.x - c @ np.linalg.solve(c[inside], fit.x[inside]))
        return self._left(self.columns, found)

    def _left(self, columns: Columns, solutions: Sequence[np.ndarray]) -> np.ndarray:
        pairs = zip(self.judge.folds, solutions, strict=True)
        return np.array([fold.only(columns).left(x) for fold, x in pairs])

    def _added(
        self, normal: Normal, fit: Solved, own: Columns
    ) -> tuple[Float[np.ndarray, " known"], Float[np.ndarray, " own"]]:
        """Return the solution with columns added, by elimination of the others."""
        sizes, band = self.judge.sizes, self.judge.blocks.band[own]
        cross = normal.gram[np.ix_(self.columns, own)] / sizes.noise
        through = cho_solve(fit.factor, cross)
        inner = normal.gram[np.ix_(own, own)] / sizes.noise - cross.T @ through
        faint = FAINT * np.diag(normal.gram)[own] / sizes.noise
        prior = faint
        if len(sizes.variance):
            tabled = 1.0 / sizes.variance[np.maximum(band, 0)]
            prior = np.where(band >= 0, tabled, faint)
        aim = normal.aim[own] / sizes.noise - cross.T @ fit.x
        x = np.linalg.solve(inner + np.diag(prior), aim)
        return fit.x - through @ x, x


def compared(
    before: Float[np.ndarray, " folds"], after: Float[np.ndarray, " folds"]
) -> tuple[float, float]:
    """Return the mean gain of the logarithm of what is left, and its standard error."""
    each = np.log(before / after)
    return float(each.mean()), float(each.std(ddof=1) / np.sqrt(len(each)))
