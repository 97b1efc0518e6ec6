"""Within a visit a marker rests where it likes; what moves it is the load.

==========  ==========================================================================
Equation    y_mr = rest_m + G_m xi_br + noise; with the rest marginalised the body's
            twists xi have information sum_m L_m (x) G_m' T^-1 G_m, where
            L_m = diag(w) - w w'/sum(w) over rows; with low-rank noise U of wrenches
            information - information U (1 + U' information U)^-1 U' information
Source      Gauss-Markov with nuisance marginalised; Woodbury's identity
Valid       small motions of rigid bodies; noise of rows independent but for U
Ignores     the change of a tracker's smooth error over a few millimetres
==========  ==========================================================================
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from stiffness.diagnosis.columns import Columns, Group, contract, levers


@dataclass(frozen=True)
class Within:
    """What differences within visits say about twists, visit by visit.

    Attributes:
        body: Information on each body's twists; index order row, component.
        score: The same times the twists that the readings ask for.
        carried: Whether a place carries a body.
        screw: Twist of what an axis carries per radian along it.
        noise: Turns of the axes, one sigma, that the wrench's errors feign; index
            order axis, row.
        square: Whitened sum of squares of each visit's differences.
        freedom: How many differences of coordinates each visit has.
    """

    body: Float[np.ndarray, "bodies visits n n"]
    score: Float[np.ndarray, "bodies visits n"]
    carried: Bool[np.ndarray, "places bodies"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    noise: Float[np.ndarray, "visits turns errors"]
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
            frame: `carried`, `screw` and `noise`.
        """
        visits, rows, markers = weight.shape
        carried, screw, noise = frame
        total = weight.sum(axis=1)
        total = np.where(total > 0, total, 1.0)
        laplace = -np.einsum("vrm,vsm->vmrs", weight, weight) / total[..., None, None]
        laplace[:, :, range(rows), range(rows)] += weight.transpose(0, 2, 1)
        lever = levers(point)  # (visits, markers, 3, 6)
        pull = np.einsum("vmai,ab->vmib", lever, inverse)
        hessian = pull @ lever
        contrast = np.einsum("vmrs,vsma->vmra", laplace, residual)
        asked = np.einsum("vmib,vmrb->vmri", pull, contrast)
        bodies = carried.shape[1]
        information = np.zeros((bodies, visits, rows, 6, rows, 6))
        score = np.zeros((bodies, visits, rows, 6))
        for m in range(markers):
            information[body[m]] += (
                laplace[:, m, :, None, :, None] * hessian[:, m, None, :, None, :]
            )
            score[body[m]] += asked[:, m]
        square = np.einsum("vsma,ab,vmsb->v", residual, inverse, contrast)
        seen = (weight > 0).sum(axis=1)
        return cls(
            body=information.reshape(bodies, visits, rows * 6, rows * 6),
            score=score.reshape(bodies, visits, rows * 6),
            carried=carried,
            screw=screw,
            noise=noise,
            square=square,
            freedom=3.0 * np.maximum(seen - 1, 0).sum(axis=1),
        )

    @cached_property
    def _kernel(self) -> np.ndarray:
        """U (1 + U' information U)^-1 U' of the wrench's errors."""
        axes = range(self.screw.shape[2])
        turns = np.concatenate([self._to_turns(k, False) for k in axes], axis=1)
        u = self.noise
        inner = np.eye(u.shape[2]) + u.swapaxes(1, 2) @ turns @ u
        return u @ np.linalg.solve(inner, u.swapaxes(1, 2))

    @cached_property
    def _taken(self) -> np.ndarray:
        return (self._kernel @ self._onto_turns()[:, :, None])[:, :, 0]

    def whitened_square(self) -> Float[np.ndarray, " visits"]:
        """Return each visit's sum of squares with the wrench's errors taken out."""
        return self.square - np.einsum("vi,vi->v", self._onto_turns(), self._taken)

    def less(
        self, columns: Columns, coefficients: Float[np.ndarray, " columns"]
    ) -> "Within":
        """Return the same data without what these columns do."""
        score = self.score.copy()
        square = self.square.copy()
        twists = np.zeros((len(self.carried), *self.screw.shape[:2], 6))
        for group in columns.turns:
            law = group.values @ coefficients[group.column]
            twists[group.place + 1] += law[..., None] * self.screw[:, :, group.place]
        for group in columns.motions:
            twists[group.place] += group.values @ coefficients[group.column]
        for b in range(len(score)):
            moved = twists[self.carried[:, b]].sum(axis=0).reshape(*score[b].shape, 1)
            change = (self.body[b] @ moved)[..., 0]
            square -= np.einsum("vi,vi->v", moved[..., 0], 2 * score[b] - change)
            score[b] -= change
        fresh = replace(self, score=score, square=square)
        for name in ("_kernel", "_sums", "_through", "_middles"):
            if name in self.__dict__:
                fresh.__dict__[name] = self.__dict__[name]
        return fresh

    def scores(self, columns: Columns) -> Float[np.ndarray, "visits columns"]:
        """Return each visit's scores of columns."""
        score = np.zeros((len(self.square), columns.count))
        for group, x in self._sides(columns):
            score[:, group.column] += self._score(group, x)
        return score

    @cached_property
    def _sums(self) -> dict[tuple[int, ...], np.ndarray]:
        return {}

    @cached_property
    def _middles(self) -> dict[tuple[int, bool, int, bool], np.ndarray]:
        return {}

    @cached_property
    def _through(self) -> dict[tuple[int, bool], np.ndarray]:
        return {}

    @property
    def rows(self) -> int:
        """Rows of a visit."""
        return self.screw.shape[1]

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

    def cross(
        self, one: Columns, other: Columns, fold: Int[np.ndarray, " visits"], folds: int
    ) -> Float[np.ndarray, "folds one other"]:
        """Return the products of some columns with others, fold by fold."""
        same = one is other
        sides = self._sides(one)
        others = sides if same else self._sides(other)
        gram = np.zeros((folds, one.count, other.count))
        chosen = [np.flatnonzero(fold == f) for f in range(folds)]
        for i, (near, x) in enumerate(sides):
            moves = x.shape[2] != self.rows
            for far, y in others[: i + 1] if same else others:
                middle = self._between(near, moves, far, y)
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
        sides = self._sides(columns)
        gram = np.zeros((len(self.square), columns.count, columns.count))
        for i, (one, x) in enumerate(sides):
            for other, y in sides[: i + 1]:
                middle = self._between(one, x.shape[2] != self.rows, other, y)
                block = x @ middle
                at = np.ix_(np.arange(len(block)), one.column, other.column)
                gram[at] += block
                if other is not one:
                    at = np.ix_(np.arange(len(block)), other.column, one.column)
                    gram[at] += block.swapaxes(1, 2)
        return gram

    def _sides(self, columns: Columns) -> list[tuple[Group, np.ndarray]]:
        """Return groups with their values as (visits, columns, rows or rows x 6)."""
        sides = []
        for group in columns.turns:
            sides.append((group, np.ascontiguousarray(group.values.swapaxes(1, 2))))
        for group in columns.motions:
            visits, rows, six, count = group.values.shape
            flat = group.values.reshape(visits, rows * six, count)
            sides.append((group, np.ascontiguousarray(flat.swapaxes(1, 2))))
        return sides

    def _between(
        self, one: Group, one_moves: bool, other: Group, y: np.ndarray
    ) -> np.ndarray:
        """Return information between a group and another group's columns."""
        other_moves = y.shape[2] != self.rows
        key = (one.place, one_moves, other.place, other_moves)
        if key not in self._middles:
            p = one.place if one_moves else one.place + 1
            q = other.place if other_moves else other.place + 1
            middle = self._information(p, q)
            if not one_moves:
                middle = self._along(middle, one.place, first=True)
            if not other_moves:
                middle = self._along(middle, other.place, first=False)
            a = self._to_turns(one.place, one_moves)
            b = self._to_turns(other.place, other_moves)
            self._middles[key] = middle - (a @ self._kernel) @ b.swapaxes(1, 2)
        return self._middles[key] @ y.swapaxes(1, 2)

    def _score(self, group: Group, x: np.ndarray) -> np.ndarray:
        moves = x.shape[2] != self.rows
        place = group.place if moves else group.place + 1
        score = np.einsum("b,bvn->vn", self.carried[place].astype(float), self.score)
        if not moves:
            shaped = score.reshape(len(score), self.rows, 6)
            score = np.einsum("vri,vri->vr", shaped, self.screw[:, :, group.place])
        through = self._to_turns(group.place, moves)
        score = score - np.einsum("vij,vj->vi", through, self._taken)
        return (x @ score[..., None])[..., 0]

    def _information(self, p: int, q: int) -> np.ndarray:
        both = np.flatnonzero(self.carried[p] & self.carried[q])
        cache = self._sums
        key = tuple(both.tolist())
        if key not in cache:
            cache[key] = sum(self.body[b] for b in both) + np.zeros(self.body.shape[1:])
        return cache[key]

    def _along(self, matrix: np.ndarray, axis: int, first: bool) -> np.ndarray:
        visits, n, m = matrix.shape
        screw = self.screw[:, :, axis]
        if first:
            shaped = matrix.reshape(visits, self.rows, 6, m)
            return (screw[:, :, None] @ shaped)[:, :, 0]
        shaped = matrix.reshape(visits, n, self.rows, 6).swapaxes(1, 2)
        return (shaped @ screw[..., None])[..., 0].swapaxes(1, 2)

    def _to_turns(self, place: int, moves: bool) -> np.ndarray:
        """Return information between a place (or an axis) and all axes' turns."""
        cache = self._through
        if (place, moves) not in cache:
            at = place if moves else place + 1
            blocks = []
            for k in range(self.screw.shape[2]):
                block = self._along(self._information(at, k + 1), k, first=False)
                if not moves:
                    block = self._along(block, place, first=True)
                blocks.append(block)
            cache[place, moves] = np.concatenate(blocks, axis=2)
        return cache[place, moves]

    def _onto_turns(self) -> np.ndarray:
        pieces = []
        for k in range(self.screw.shape[2]):
            on = self.carried[k + 1].astype(float)
            score = np.einsum("b,bvn->vn", on, self.score)
            shaped = score.reshape(len(score), self.rows, 6)
            pieces.append(np.einsum("vri,vri->vr", shaped, self.screw[:, :, k]))
        return np.concatenate(pieces, axis=1)
