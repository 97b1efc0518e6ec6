"""Between visits, where markers stand speaks of geometry, sensors and gravity.

==========  ==========================================================================
Equation    mean_m = R_b(q) place_m + frame + field(p_m) + J_m arrival + noise;
            X~ = X - N G, G = (N'N + P)^-1 N'X for unknown places, frame and field N
            with prior information P; rows of a visit are whitened by (1 + A A')^-1/2,
            A what a visit's arrival of the axes and error of the force feign
Source      Bayesian linear model with nuisance marginalised
Valid       absolute readings; visits err independently but for the field
Ignores     ageing of the field over the day
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve

from stiffness.diagnosis.columns import Columns, levers
from stiffness.diagnosis.roots import inverse_root
from stiffness.diagnosis.sides import Side, add, against, mean_over_rows, stacked


@dataclass(frozen=True)
class Between:
    """Per-visit means of markers, whitened, with what is unknown projected out.

    Attributes:
        root: Square roots of inverse covariances, per visit over markers' coordinates.
        embed: Whitened displacement of all markers per twist of each place.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it, in each row.
        nuisance: Whitened columns of places, frame and field, scaled.
        scale: Of these columns over those in m, rad and sigma.
        factor: Cholesky factor of their information, prior included.
        residual: Whitened mean residuals with the unknown taken out.
        moved: What the unknown was estimated to be.
    """

    root: Float[np.ndarray, "visits n n"]
    embed: Float[np.ndarray, "visits places n 6"]
    share: Float[np.ndarray, "visits rows"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    nuisance: Float[np.ndarray, "visits n nuisances"]
    scale: Float[np.ndarray, " nuisances"]
    factor: tuple[np.ndarray, bool]
    residual: Float[np.ndarray, "visits n"]
    moved: Float[np.ndarray, " nuisances"]

    @classmethod
    def of(
        cls,
        mean: Float[np.ndarray, "visits markers 3"],
        precision: Float[np.ndarray, "visits markers 3 3"],
        feigned: Float[np.ndarray, "visits n errors"],
        nuisance: tuple[np.ndarray, np.ndarray],
        place: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    ) -> "Between":
        """Whiten and project.

        Args:
            mean: Mean residual of each visit, along the base's axes, in m.
            precision: Inverse covariance of it by the tracker's noise; 0 = not seen.
            feigned: What errors of a visit feign, one sigma each, in m.
            nuisance: Columns (visits, n, nuisances) in m, and their prior sigmas.
            place: `point` of markers, `share` of rows, whether places carry markers,
                `screw`.
        """
        visits, markers = mean.shape[:2]
        n = 3 * markers
        root = inverse_root(precision, feigned)
        point, share, carried, screw = place
        lever = levers(point).reshape(visits, n, 6)
        on = np.repeat(carried, 3, axis=1)  # (places, n)
        embed = root[:, None] @ (lever[:, None] * on[None, :, :, None])
        columns, sigma = nuisance
        white = root @ columns
        flat = white.reshape(visits * n, -1)
        information = flat.T @ flat + np.diag(sigma**-2.0)
        scale = 1.0 / np.sqrt(np.diag(information))
        factor = cho_factor(information * scale * scale[:, None])
        white = white * scale
        y = (root @ mean.reshape(visits, n, 1))[..., 0]
        solved = cho_solve(factor, white.reshape(visits * n, -1).T @ y.ravel())
        left = y - white @ solved
        return cls(
            root, embed, share, screw, white, scale, factor, left, scale * solved
        )

    def absorbed(self, columns: Columns) -> Float[np.ndarray, "nuisances columns"]:
        """Return what each unknown would take of one unit of each column."""
        return self.scale[:, None] * self._taken(self._sides(columns), columns.count)

    def less(
        self, columns: Columns, coefficients: Float[np.ndarray, " columns"]
    ) -> "Between":
        """Return the same data without what these columns do."""
        left = self.residual - self.design(columns) @ coefficients
        return replace(self, residual=left)

    def design(self, columns: Columns) -> Float[np.ndarray, "visits n columns"]:
        """Return whitened columns with what is unknown projected out; for few."""
        sides = self._sides(columns)
        white = np.zeros((*self.residual.shape, columns.count))
        for side in sides:
            white[..., side.column] += side.onto @ side.mean
        return white - self.nuisance @ self._taken(sides, columns.count)

    def products(
        self, columns: Columns, fold: Int[np.ndarray, " visits"], folds: int
    ) -> tuple[
        Float[np.ndarray, "folds columns columns"], Float[np.ndarray, "visits columns"]
    ]:
        """Return the Gram matrix of each fold, adding up, and each visit's scores."""
        gram = self.cross(columns, columns, fold, folds)
        return gram, self.scores(columns)

    def cross(
        self, one: Columns, other: Columns, fold: Int[np.ndarray, " visits"], folds: int
    ) -> Float[np.ndarray, "folds one other"]:
        """Return the products of some columns with others, fold by fold."""
        same = one is other
        sides = self._sides(one)
        others = sides if same else self._sides(other)
        taken = self._taken(sides, one.count)
        other_taken = taken if same else self._taken(others, other.count)
        gram = np.zeros((folds, one.count, other.count))
        for f in range(folds):
            visits = np.flatnonzero(fold == f)
            if not len(visits):
                continue
            stacks = [stack.of(visits) for stack in stacked(others)]
            for side in sides:
                white = side.onto[visits] @ side.mean[visits]
                for far in others:
                    if far.first < 0 and not (same and side.first >= 0):
                        block = far.products(white, visits)
                        gram[f][np.ix_(side.column, far.column)] += block.T
                back = self.root[visits].swapaxes(1, 2) @ white if stacks else white
                for stack in stacks:
                    block = stack.products(back).T
                    add(gram[f], side.column, stack.column, block)
                    if same and side.first < 0:
                        add(gram[f], stack.column, side.column, block.T)
            common = self._common(sides, one.count, visits)
            far_common = common if same else self._common(others, other.count, visits)
            gram[f] -= 0.5 * (common.T @ other_taken + taken.T @ far_common)
        return gram

    def scores(self, columns: Columns) -> Float[np.ndarray, "visits columns"]:
        """Return each visit's scores of columns."""
        sides = self._sides(columns)
        taken = self._taken(sides, columns.count)
        score = -(self.residual[:, None] @ self.nuisance)[:, 0] @ taken
        for side in sides:
            asked = self.residual[:, None] @ side.onto
            score[:, side.column] += (asked @ side.mean)[:, 0]
        return score

    def raw(self, columns: Columns) -> Float[np.ndarray, " columns"]:
        """Return each column's information before the unknown is projected out."""
        raw = np.zeros(columns.count)
        for side in self._sides(columns):
            square = side.onto.swapaxes(1, 2) @ side.onto
            raw[side.column] += np.sum(side.mean * (square @ side.mean), axis=(0, 1))
        return raw

    def by_visit(self, columns: Columns) -> Float[np.ndarray, "visits n n"]:
        """Return each visit's own Gram matrix; for few columns."""
        white = self.design(columns)
        return white.swapaxes(1, 2) @ white

    def _sides(self, columns: Columns) -> list[Side]:
        """Return the mean of every group's columns over the rows of each visit."""
        share = self.share[:, None]
        sides = []
        for group in columns.turns:
            screw = share.swapaxes(1, 2) * self.screw[:, :, group.place]
            mean = screw.swapaxes(1, 2) @ group.values
            sides.append(Side(group.column, mean, self.embed[:, group.place + 1]))
        for group in columns.motions:
            mean = mean_over_rows(share, group.values)
            sides.append(Side(group.column, mean, self.embed[:, group.place]))
        for group in columns.shifts:
            at = 3 * group.place
            mean = mean_over_rows(share, group.values)
            sides.append(Side(group.column, mean, self.root[:, :, at : at + 3], at))
        return sides

    def _common(self, sides: list[Side], count: int, visits: np.ndarray) -> np.ndarray:
        """Return information between the unknown and columns over some visits."""
        nuisance, root = self.nuisance[visits], self.root[visits]
        return against(sides, count, nuisance, root, visits)

    def _taken(self, sides: list[Side], count: int) -> np.ndarray:
        everyone = np.arange(len(self.residual))
        return cho_solve(self.factor, self._common(sides, count, everyone))
