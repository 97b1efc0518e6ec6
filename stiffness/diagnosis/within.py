"""Within a visit a marker rests where it likes; what moves it is the load.

==========  ==========================================================================
Equation    y_mr = rest_m + G_m xi_br + noise; score = sum L_m (x) G_m' T^-1 y_m of each
            body; a column's score and Gram matrix from it and from `Information`
Source      Gauss-Markov with the rest positions marginalised
Valid       as `Information`
Ignores     as `Information`
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from stiffness.diagnosis.columns import Columns, Group, contract, levers
from stiffness.diagnosis.information import Information, Site


@dataclass(frozen=True, eq=False)
class Within:
    """What differences within visits say about twists, visit by visit.

    Attributes:
        information: On twists.
        score: Information times the twists that the readings ask for.
        square: Whitened sum of squares of each visit's differences.
        freedom: How many differences of coordinates each visit has.
    """

    information: Information
    score: Float[np.ndarray, "bodies visits n"]
    square: Float[np.ndarray, " visits"]
    freedom: Float[np.ndarray, " visits"]

    @classmethod
    def of(
        cls,
        residual: Float[np.ndarray, "visits rows markers 3"],
        weight: Float[np.ndarray, "visits rows markers"],
        inverse: Float[np.ndarray, "3 3"],
        point: Float[np.ndarray, "visits markers 3"],
        body: Int[np.ndarray, " markers"],
        frame: tuple[np.ndarray, np.ndarray, np.ndarray],
    ) -> "Within":
        """Compress readings to what they say about bodies.

        Args:
            residual: Reading less nominal place, along the base's axes, in m.
            weight: Of each reading: frames averaged, less where it is an outlier, 0
                where it was not seen.
            inverse: Inverse covariance of one frame's reading, along the base's axes.
            point: Where markers are in each visit, in m.
            body: Index of each marker's body.
            frame: `carried`, `screw` and `noise` of `Information`.
        """
        visits, rows, markers = weight.shape
        carried, screw, noise = frame
        total = weight.sum(axis=1)
        total = np.where(total > 0, total, 1.0)
        laplace = -np.einsum("vrm,vsm->vmrs", weight, weight) / total[..., None, None]
        laplace[:, :, range(rows), range(rows)] += weight.transpose(0, 2, 1)
        lever = levers(point)  # (visits, markers, 3, 6)
        pull = lever.swapaxes(2, 3) @ inverse
        hessian = pull @ lever
        contrast = laplace @ residual.transpose(0, 2, 1, 3)
        asked = contrast @ pull.swapaxes(2, 3)
        bodies = carried.shape[1]
        information = np.zeros((bodies, visits, rows, 6, rows, 6))
        score = np.zeros((bodies, visits, rows, 6))
        for m in range(markers):
            information[body[m]] += (
                laplace[:, m, :, None, :, None] * hessian[:, m, None, :, None, :]
            )
            score[body[m]] += asked[:, m]
        white = contrast.transpose(0, 2, 1, 3) @ inverse
        seen = (weight > 0).sum(axis=1)
        return cls(
            Information(
                information.reshape(bodies, visits, rows * 6, rows * 6),
                carried,
                screw,
                noise,
            ),
            score=score.reshape(bodies, visits, rows * 6),
            square=np.sum(residual * white, axis=(1, 2, 3)),
            freedom=3.0 * np.maximum(seen - 1, 0).sum(axis=1),
        )

    @cached_property
    def _feigned(self) -> np.ndarray:
        """Turns that the wrench's errors most likely feigned."""
        return (self.information.kernel @ self._on_turns[:, :, None])[:, :, 0]

    @cached_property
    def _on_turns(self) -> np.ndarray:
        info = self.information
        pieces = [info.onto(self.score, (k, False)) for k in info.axes]
        return np.concatenate(pieces, axis=1)

    def whitened_square(self) -> Float[np.ndarray, " visits"]:
        """Return each visit's sum of squares with the wrench's errors taken out."""
        return self.square - np.sum(self._on_turns * self._feigned, axis=1)

    def less(
        self, columns: Columns, coefficients: Float[np.ndarray, " columns"]
    ) -> "Within":
        """Return the same data without what these columns do."""
        info = self.information
        score, square = self.score.copy(), self.square.copy()
        visits, rows = info.screw.shape[:2]
        twists = np.zeros((len(info.carried), visits, rows, 6))
        for group in columns.turns:
            law = group.values @ coefficients[group.column]
            twists[group.place + 1] += law[..., None] * info.screw[:, :, group.place]
        for group in columns.motions:
            twists[group.place] += group.values @ coefficients[group.column]
        for b in range(len(score)):
            moved = twists[info.carried[:, b]].sum(axis=0).reshape(visits, -1)
            change = (info.body[b] @ moved[..., None])[..., 0]
            square -= np.sum(moved * (2 * score[b] - change), axis=1)
            score[b] -= change
        return replace(self, score=score, square=square)

    def products(
        self, columns: Columns, fold: Int[np.ndarray, " visits"], folds: int
    ) -> tuple[
        Float[np.ndarray, "folds columns columns"], Float[np.ndarray, "visits columns"]
    ]:
        """Return the Gram matrix of each fold and each visit's scores.

        Args:
            columns: With groups laid out by the same visits.
            fold: Which fold each visit is in.
            folds: How many folds there are.
        """
        return self.cross(columns, columns, fold, folds), self.scores(columns)

    def scores(self, columns: Columns) -> Float[np.ndarray, "visits columns"]:
        """Return each visit's scores of columns."""
        score = np.zeros((len(self.square), columns.count))
        for group, site, x in _sides(columns):
            through = self.information.to_turns(site) @ self._feigned[..., None]
            own = self.information.onto(self.score, site) - through[..., 0]
            score[:, group.column] += (x @ own[..., None])[..., 0]
        return score

    def cross(
        self, one: Columns, other: Columns, fold: Int[np.ndarray, " visits"], folds: int
    ) -> Float[np.ndarray, "folds one other"]:
        """Return the products of some columns with others, fold by fold."""
        same = one is other
        sides = _sides(one)
        others = sides if same else _sides(other)
        gram = np.zeros((folds, one.count, other.count))
        chosen = [np.flatnonzero(fold == f) for f in range(folds)]
        for i, (near, site, x) in enumerate(sides):
            for far, far_site, y in others[: i + 1] if same else others:
                middle = self.information.between(site, far_site) @ y.swapaxes(1, 2)
                for f, visits in enumerate(chosen):
                    if not len(visits):
                        continue
                    block = contract(x[visits], middle[visits])
                    gram[f][np.ix_(near.column, far.column)] += block
                    if same and far is not near:
                        gram[f][np.ix_(far.column, near.column)] += block.T
        return gram

    def by_visit(self, columns: Columns) -> Float[np.ndarray, "visits n n"]:
        """Return each visit's own Gram matrix; for few columns."""
        sides = _sides(columns)
        visits = np.arange(len(self.square))
        gram = np.zeros((len(visits), columns.count, columns.count))
        for near, site, x in sides:
            for far, far_site, y in sides:
                middle = self.information.between(site, far_site) @ y.swapaxes(1, 2)
                gram[np.ix_(visits, near.column, far.column)] += x @ middle
        return gram


def _sides(columns: Columns) -> list[tuple[Group, Site, np.ndarray]]:
    """Return groups, where they act, and (visits, columns, rows or rows x 6)."""
    sides = []
    for group in columns.turns:
        values = np.ascontiguousarray(group.values.swapaxes(1, 2))
        sides.append((group, (group.place, False), values))
    for group in columns.motions:
        visits, rows, six, count = group.values.shape
        flat = group.values.reshape(visits, rows * six, count)
        values = np.ascontiguousarray(flat.swapaxes(1, 2))
        sides.append((group, (group.place, True), values))
    return sides
