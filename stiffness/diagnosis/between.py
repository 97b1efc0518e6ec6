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

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve

from stiffness.diagnosis.columns import Columns
from stiffness.diagnosis.means import Means
from stiffness.diagnosis.roots import Roots
from stiffness.diagnosis.signature import levers
from stiffness.diagnosis.sites import sites_of
from stiffness.diagnosis.unknown_columns import UnknownColumns
from stiffness.diagnosis.visits import Kept, stretches


@dataclass(frozen=True, eq=False)
class Between:
    """Per-visit means of markers, whitened, with what is unknown projected out.

    Attributes:
        roots: Square roots of inverse covariances of the means.
        lever: What takes a twist to a marker's displacement.
        carries: Whether a place carries a marker.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it, in each row.
        unknown: Columns of places, frame and field.
        scale: Of these columns over those in m, rad and sigma.
        factor: Cholesky factor of their information, prior included, scaled.
        residual: Whitened mean residuals with the unknown taken out.
        moved: What the unknown was estimated to be.
        inner: The unknown's own Gram matrix by folds, for every division asked for.
        kept: What is laid out for the visits asked for last.
    """

    roots: Roots
    lever: Float[np.ndarray, "visits markers 3 6"]
    carries: Bool[np.ndarray, "places markers"]
    share: Float[np.ndarray, "visits rows"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    unknown: UnknownColumns
    scale: Float[np.ndarray, " unknowns"]
    factor: tuple[np.ndarray, bool]
    residual: Float[np.ndarray, "visits n 1"]
    moved: Float[np.ndarray, " unknowns"]
    inner: dict[bytes, np.ndarray] = field(default_factory=dict)
    kept: Kept[Means] = field(default_factory=Kept[Means])

    @classmethod
    def of(
        cls,
        mean: Float[np.ndarray, "visits markers 3"],
        precision: Float[np.ndarray, "visits markers 3 3"],
        feigned: Float[np.ndarray, "visits n errors"],
        unknown: UnknownColumns,
        place: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    ) -> "Between":
        """Whiten and project.

        Args:
            mean: Mean residual of each visit, along the base's axes, in m.
            precision: Inverse covariance of it by the tracker's noise; 0 = not seen.
            feigned: What errors of a visit feign, one sigma each, in m.
            unknown: Columns of what is unknown, in m, and their prior sigmas.
            place: `point` of markers, `share` of rows, whether places carry markers,
                `screw`.
        """
        visits, markers = mean.shape[:2]
        roots = Roots.of(precision, feigned)
        point, share, carried, screw = place
        information = np.diag(unknown.sigma**-2.0)
        asked = np.zeros((len(information), 1))
        y = roots.white(mean.reshape(visits, 3 * markers, 1))
        for some in stretches(visits):
            white = roots.some(some).white(unknown.of(some))
            flat = white.reshape(-1, len(information))
            information += flat.T @ flat
            asked += flat.T @ y[some].reshape(-1, 1)
        scale = 1.0 / np.sqrt(np.diag(information))
        factor = cho_factor(information * scale * scale[:, None])
        moved = scale * cho_solve(factor, scale * asked[:, 0])
        left = y
        for some in stretches(visits):
            white = roots.some(some).white(unknown.of(some))
            left[some] -= white @ moved[:, None]
        lever = levers(point)
        return cls(
            roots, lever, carried, share, screw, unknown, scale, factor, left, moved
        )

    def absorbed(self, columns: Columns) -> Float[np.ndarray, "unknowns columns"]:
        """Return what each unknown would take of one unit of each column.

        Args:
            columns: In all visits.
        """
        everyone = np.arange(len(self.residual))
        means = self.some(everyone)
        asked = means.of_unknown(
            sites_of(columns, means.share, means.screw), len(columns.column)
        )
        return self.taken(columns.joined(asked))

    def some(self, visits: Int[np.ndarray, " some"]) -> Means:
        """Return what means of some visits could say."""
        return self.kept.of(visits, self._means)

    def _means(self, visits: Int[np.ndarray, " some"]) -> Means:
        return Means(
            self.roots.some(visits),
            self.lever[visits],
            self.carries,
            self.share[visits],
            self.screw[visits],
            self.unknown.of(visits),
        )

    def taken(
        self, asked: Float[np.ndarray, "unknowns columns"]
    ) -> Float[np.ndarray, "unknowns columns"]:
        """Return what the unknown takes of columns from their products with it."""
        scale = self.scale[:, None]
        return scale * cho_solve(self.factor, scale * asked)

    def projected(
        self,
        near: Float[np.ndarray, "folds unknowns some"],
        far: Float[np.ndarray, "folds unknowns others"],
        label: Int[np.ndarray, " visits"],
    ) -> Float[np.ndarray, "folds some others"]:
        """Return what products of columns lose as what is unknown is projected out.

        They are products of columns already projected, so that an error of what is
        taken enters squared; the prior's part is shared by visits.

        Args:
            near: Products of the unknown with some columns, fold by fold.
            far: With others; may be the same.
            label: Fold of each visit.
        """
        one = self.taken(near.sum(axis=0))
        other = one if near is far else self.taken(far.sum(axis=0))
        prior = one.T @ (self.unknown.sigma[:, None] ** -2.0 * other)
        lost = np.empty((len(near), one.shape[1], other.shape[1]))
        inner = self._of_unknown(label, len(near))
        share = np.bincount(label, minlength=len(near)) / len(label)
        for f, own in enumerate(inner):
            back = far[f] - own @ other
            lost[f] = near[f].T @ other + one.T @ back - share[f] * prior
        return lost

    def _of_unknown(
        self, label: Int[np.ndarray, " visits"], folds: int
    ) -> Float[np.ndarray, "folds unknowns unknowns"]:
        """Return the unknown's own Gram matrix of each fold."""
        key = label.tobytes()
        if key not in self.inner:
            size = len(self.scale)
            total = np.zeros((folds, size, size))
            for some in stretches(len(label), label):
                means = self.some(some)
                flat = means.roots.white(means.unknown).reshape(-1, size)
                total[label[some[0]]] += flat.T @ flat
            self.inner[key] = total
        return self.inner[key]

    def less(self, residual: np.ndarray) -> "Between":
        """Return the same with other residuals."""
        return replace(self, residual=residual)
