"""Between-visit model: means of visits constrain geometry, sensors and gravity.

Errors that many readings share make them dependent; a square root undoes it.

==========  ==========================================================================
Equation    (D^-1 + F F')^-1 = R'R = D - H'H, R = (1 + A A')^-1/2 D^1/2, A = D^1/2 F;
            with A = u s v': H = (s^2 / (1 + s^2))^1/2 u' D^1/2
Source      spectral calculus: A A' has the left singular vectors of A
Valid       D positive semidefinite (0 = not seen)
Ignores     nothing
==========  ==========================================================================

What is unknown of tracker and markers moves readings in a few ways.

==========  ==========================================================================
Equation    columns: [1, -p x] for the tracker, R_b for a marker's place, smooth
            functions of p for the tracker's field, the same for x, y and z
Source      as `nuisance_parameters`
Valid       as `nuisance_parameters`
Ignores     as `nuisance_parameters`
==========  ==========================================================================

The mean of a visit's readings pulls at markers; a column feels what it moves.

==========  ==========================================================================
Equation    product of columns with mean displacements x and y of all markers:
            x'R'R y = x'Dy - (Hx)'(Hy), R, D and H of `Whitening`
Source      as `Whitening`
Valid       as `BetweenVisitModel`
Ignores     as `BetweenVisitModel`
==========  ==========================================================================

Between visits, marker positions constrain geometry, sensors and gravity.

==========  ==========================================================================
Equation    mean_m = R_b(q) place_m + frame + field(p_m) + J_m arrival + noise;
            X~ = X - N G, G = (N'N + P)^-1 N'X for unknown places, frame and field N
            with prior information P; rows of a visit are whitened by (1 + A A')^-1/2,
            A what a visit's arrival of the axes and error of the force induce
Source      Bayesian linear model with nuisance marginalised
Valid       absolute readings; visits err independently but for the field
Ignores     ageing of the field over the day
==========  ==========================================================================
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_factor, cho_solve

from stiffness.effects.design_matrix import (
    DesignMatrix,
    SiteMean,
    contract,
    site_means_of,
)
from stiffness.experiment.visits import Kept, stretches
from stiffness.robot.kinematics import point_jacobian

# --- Whitening of errors that readings share ------------------------------------------


@dataclass(frozen=True, eq=False)
class Whitening:
    """Square roots R of inverse covariances of markers' means, visit by visit.

    Attributes:
        half: D^1/2 of each marker.
        error: u, what shared errors induce, whitened.
        size: s^2 of each.
    """

    half: Float[np.ndarray, "visits markers 3 3"]
    error: Float[np.ndarray, "visits n errors"]
    size: Float[np.ndarray, "visits errors"]

    @classmethod
    def of(
        cls,
        precision: Float[np.ndarray, "visits markers 3 3"],
        induced: Float[np.ndarray, "visits n errors"],
    ) -> "Whitening":
        """Take the roots.

        Args:
            precision: D, inverse covariance of each marker's mean.
            induced: F, what shared errors induce, one sigma each.
        """
        value, vector = np.linalg.eigh(precision)
        scaled = vector * np.sqrt(np.maximum(value, 0.0))[..., None, :]
        half = scaled @ vector.swapaxes(-1, -2)
        count = min(induced.shape[1:])
        error, size = (
            np.empty((*induced.shape[:2], count)),
            np.empty((len(half), count)),
        )
        for some in stretches(len(half)):
            white = _blockwise(half[some], induced[some])
            error[some], s, _ = np.linalg.svd(white, full_matrices=False)
            size[some] = s**2
        return cls(half, error, size)

    def some(self, visits: Int[np.ndarray, " some"]) -> "Whitening":
        """Return those of some visits."""
        return Whitening(self.half[visits], self.error[visits], self.size[visits])

    def white(
        self, displacement: Float[np.ndarray, "visits n columns"]
    ) -> Float[np.ndarray, "visits n columns"]:
        """Return R x."""
        return self._shrunk(_blockwise(self.half, displacement))

    def back(
        self, white: Float[np.ndarray, "visits n columns"]
    ) -> Float[np.ndarray, "visits n columns"]:
        """Return R' x."""
        return _blockwise(self.half, self._shrunk(white))

    def error_factor(self) -> Float[np.ndarray, "visits errors n"]:
        """Return H: what shared errors take of information is H'H."""
        along = _blockwise(self.half, self.error).swapaxes(1, 2)
        return np.sqrt(self.size / (1.0 + self.size))[..., None] * along

    def _shrunk(self, whole: np.ndarray) -> np.ndarray:
        less = 1.0 / np.sqrt(1.0 + self.size) - 1.0
        along = less[..., None] * (self.error.swapaxes(1, 2) @ whole)
        return whole + self.error @ along


def _blockwise(half: np.ndarray, displacement: np.ndarray) -> np.ndarray:
    visits, markers = half.shape[:2]
    shaped = half @ displacement.reshape(visits, markers, 3, -1)
    return shaped.reshape(visits, 3 * markers, -1)


# --- Nuisance columns -----------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class NuisanceJacobian:
    """Columns in m per unit, frame first, then places, then field.

    Attributes:
        frame: Levers of all markers; no last axis where the frame is known.
        turn: Turns of the markers' bodies.
        field: Smooth functions at the markers; none where no field is stated.
        rest: Variance of the field that these leave, in m^2.
        sigma: Prior sigma of each column.
    """

    frame: Float[np.ndarray, "visits markers 3 twist"]
    turn: Float[np.ndarray, "visits markers 3 3"]
    field: Float[np.ndarray, "visits markers waves"]
    rest: Float[np.ndarray, "visits markers"]
    sigma: Float[np.ndarray, " columns"]

    def of(
        self, visits: Int[np.ndarray, " some"]
    ) -> Float[np.ndarray, "some n columns"]:
        """Return the columns of some visits."""
        frame, turn, field = self.frame[visits], self.turn[visits], self.field[visits]
        some, markers, _, first = frame.shape
        waves = field.shape[2]
        total = np.zeros((some, markers, 3, len(self.sigma)))
        total[..., :first] = frame
        for m in range(markers):
            at = first + 3 * m
            total[:, m, :, at : at + 3] = turn[:, m]
        at = first + 3 * markers
        for i in range(3):
            total[:, :, i, at + i * waves : at + (i + 1) * waves] = field
        return total.reshape(some, 3 * markers, -1)


# --- Means of visits ------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Means:
    """What means of some visits could say of columns.

    Attributes:
        whitening: Of their inverse covariances.
        lever: What takes a twist to a marker's displacement.
        carries: Whether a place carries a marker.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it.
        nuisance: Displacement of the markers per unit of each unknown.
    """

    whitening: Whitening
    lever: Float[np.ndarray, "visits markers 3 6"]
    carries: Bool[np.ndarray, "places markers"]
    share: Float[np.ndarray, "visits rows"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    nuisance: Float[np.ndarray, "visits n unknowns"]

    def displacement(
        self, columns: DesignMatrix
    ) -> Float[np.ndarray, "visits n columns"]:
        """Return mean displacements of all markers by columns; for few."""
        visits, markers = self.lever.shape[:2]
        total = np.zeros((visits, markers, 3, len(columns.column)))
        for site in site_means_of(columns, self.share, self.screw):
            if site.marker >= 0:
                total[:, site.marker, :, site.slots] = site.mean
            else:
                on = np.flatnonzero(self.carries[site.site])
                moved = self.lever[:, on] @ site.mean[:, None]
                total[:, on, :, site.slots] = moved
        return columns.joined(total.reshape(visits, 3 * markers, -1))

    def products(
        self,
        sites: list[SiteMean],
        slots: int,
        weighted: Float[np.ndarray, "visits n pulls"],
    ) -> Float[np.ndarray, "pulls slots"]:
        """Return the products of pulls at markers with slots, added up."""
        total = np.zeros((weighted.shape[2], slots))
        places: dict[int, np.ndarray] = {}
        for site in sites:
            at = self._at(site, weighted, places)
            total[:, site.slots] = contract(at, site.mean)
        return total

    def of_nuisance(
        self, sites: list[SiteMean], slots: int
    ) -> Float[np.ndarray, "unknowns slots"]:
        """Return the products of the unknown with slots, added up."""
        total = np.zeros((self.nuisance.shape[2], slots))
        for site in sites:
            at = self._at(site, self._nuisance_weighted, self._nuisance_at)
            total[:, site.slots] = contract(at, site.mean)
        return total

    def of_each(
        self,
        sites: list[SiteMean],
        slots: int,
        weighted: Float[np.ndarray, "visits n pulls"],
    ) -> Float[np.ndarray, "visits pulls slots"]:
        """Return the products of pulls at markers with slots, visit by visit."""
        total = np.zeros((len(weighted), weighted.shape[2], slots))
        places: dict[int, np.ndarray] = {}
        for site in sites:
            at = self._at(site, weighted, places)
            total[:, :, site.slots] = at.swapaxes(1, 2) @ site.mean
        return total

    def error_products(
        self, sites: list[SiteMean], slots: int
    ) -> Float[np.ndarray, "errors slots"]:
        """Return H x of all slots, visits one after the other."""
        seen = self._error_factor
        total = np.empty((*seen.shape[:2], slots))
        for site in sites:
            if site.marker >= 0:
                at = seen[..., 3 * site.marker : 3 * site.marker + 3]
            else:
                if site.site not in self._error_factor_at:
                    self._error_factor_at[site.site] = seen @ self._onto(site.site)
                at = self._error_factor_at[site.site]
            total[..., site.slots] = at @ site.mean
        return total.reshape(seen.shape[0] * seen.shape[1], slots)

    def add_gram(
        self, sites: list[SiteMean], total: Float[np.ndarray, "slots slots"]
    ) -> None:
        """Add the products of all slots, summed over visits, H left out."""
        self._of_places([s for s in sites if s.site >= 0], total)
        self._of_markers(sites, total)

    def _of_places(self, sites: list[SiteMean], gram: np.ndarray) -> None:
        """Add the products of motions of bodies with each other, H left out."""
        sums = self._inner
        for j, far in enumerate(sites):
            pulled: dict[bytes, np.ndarray] = {}
            for near in sites[: j + 1]:
                both = self.carries[near.site] & self.carries[far.site]
                key = both.tobytes()
                if key not in sums:
                    lever = self.lever[:, both].swapaxes(2, 3)
                    sums[key] = (lever @ self._weighted_lever[:, both]).sum(axis=1)
                if key not in pulled:
                    pulled[key] = sums[key] @ far.mean
                block = contract(near.mean, pulled[key])
                gram[near.slots, far.slots] += block
                if near is not far:
                    gram[far.slots, near.slots] += block.T

    def _of_markers(self, sites: list[SiteMean], gram: np.ndarray) -> None:
        """Add the products of shifts with motions and with each other, H left out."""
        heavy, precision = self._weighted_lever, self._precision
        shifts = [s for s in sites if s.marker >= 0]
        if not shifts:
            return
        start, end = shifts[0].slots.start, shifts[-1].slots.stop
        count = end - start
        twists = np.empty((len(heavy), 6, count))
        marker = np.empty(count, dtype=int)
        for shift in shifts:
            m, mean = shift.marker, shift.mean
            own = slice(shift.slots.start - start, shift.slots.stop - start)
            marker[own] = m
            twists[..., own] = heavy[:, m].swapaxes(1, 2) @ mean
            gram[shift.slots, shift.slots] += contract(mean, precision[:, m] @ mean)
        for site in sites:
            if site.site < 0:
                continue
            on = self.carries[site.site][marker]
            block = np.where(on, contract(site.mean, twists), 0.0)
            gram[site.slots, start:end] += block
            gram[start:end, site.slots] += block.T

    def _at(
        self, site: SiteMean, weighted: np.ndarray, places: dict[int, np.ndarray]
    ) -> np.ndarray:
        """Return what pulls at markers make at a site: (visits, k, pulls)."""
        if site.marker >= 0:
            return weighted[:, 3 * site.marker : 3 * site.marker + 3]
        if site.site not in places:
            places[site.site] = self._onto(site.site).swapaxes(1, 2) @ weighted
        return places[site.site]

    def _onto(self, site: int) -> np.ndarray:
        """Return what takes a place's twist to displacements: (visits, n, 6)."""
        if site not in self._point_jacobians:
            visits, markers = self.lever.shape[:2]
            apart = self.lever.reshape(visits, 3 * markers, 6)
            self._point_jacobians[site] = (
                apart * np.repeat(self.carries[site], 3)[:, None]
            )
        return self._point_jacobians[site]

    @cached_property
    def _nuisance_weighted(self) -> np.ndarray:
        return self.whitening.back(self.whitening.white(self.nuisance))

    @cached_property
    def _nuisance_at(self) -> dict[int, np.ndarray]:
        return {}

    @cached_property
    def _point_jacobians(self) -> dict[int, np.ndarray]:
        return {}

    @cached_property
    def _error_factor_at(self) -> dict[int, np.ndarray]:
        return {}

    @cached_property
    def _weighted_lever(self) -> np.ndarray:
        """Levers times what noise alone makes of a marker's precision."""
        return self._precision @ self.lever

    @cached_property
    def _error_factor(self) -> np.ndarray:
        return self.whitening.error_factor()

    @cached_property
    def _precision(self) -> np.ndarray:
        return self.whitening.half @ self.whitening.half

    @cached_property
    def _inner(self) -> dict[bytes, np.ndarray]:
        """What markers seen by the noise alone make of twists, by who carries them."""
        return {}


# --- Between --------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BetweenVisitModel:
    """Per-visit means of markers, whitened, with what is unknown projected out.

    Attributes:
        whitening: Square roots of inverse covariances of the means.
        lever: What takes a twist to a marker's displacement.
        carries: Whether a place carries a marker.
        share: Weight of each row in each visit's mean.
        screw: Twist of what an axis carries per radian along it, in each row.
        nuisance: Columns of places, frame and field.
        scale: Of these columns over those in m, rad and sigma.
        factor: Cholesky factor of their information, prior included, scaled.
        residual: Whitened mean residuals with the unknown taken out.
        nuisance_estimate: What the unknown was estimated to be.
        inner: The unknown's own Gram matrix by folds, for every division asked for.
        kept: What is laid out for the visits asked for last.
    """

    whitening: Whitening
    lever: Float[np.ndarray, "visits markers 3 6"]
    carries: Bool[np.ndarray, "places markers"]
    share: Float[np.ndarray, "visits rows"]
    screw: Float[np.ndarray, "visits rows axes 6"]
    nuisance: NuisanceJacobian
    scale: Float[np.ndarray, " unknowns"]
    factor: tuple[np.ndarray, bool]
    residual: Float[np.ndarray, "visits n 1"]
    nuisance_estimate: Float[np.ndarray, " unknowns"]
    inner: dict[bytes, np.ndarray] = field(default_factory=dict)
    kept: Kept[Means] = field(default_factory=Kept[Means])

    @classmethod
    def of(
        cls,
        mean: Float[np.ndarray, "visits markers 3"],
        precision: Float[np.ndarray, "visits markers 3 3"],
        induced: Float[np.ndarray, "visits n errors"],
        unknown: NuisanceJacobian,
        place: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray],
    ) -> "BetweenVisitModel":
        """Whiten and project.

        Args:
            mean: Mean residual of each visit, along the base's axes, in m.
            precision: Inverse covariance of it by the tracker's noise; 0 = not seen.
            induced: What errors of a visit induce, one sigma each, in m.
            unknown: Columns of what is unknown, in m, and their prior sigmas.
            place: `point` of markers, `share` of rows, whether places carry markers,
                `screw`.
        """
        visits, markers = mean.shape[:2]
        roots = Whitening.of(precision, induced)
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
        lever = point_jacobian(point)
        return cls(
            roots, lever, carried, share, screw, unknown, scale, factor, left, moved
        )

    @staticmethod
    def turned(
        lever: Float[np.ndarray, "visits markers 3 6"],
        screw: Float[np.ndarray, "visits rows axes 6"],
        carries: Bool[np.ndarray, "places markers"],
    ) -> Float[np.ndarray, "visits n axes"]:
        """Return the displacement of markers per radian that an axis misses by.

        Its arguments are called as the fields.
        """
        apart = lever.reshape(len(lever), -1, 6)
        moved = apart @ screw.mean(axis=1).swapaxes(1, 2)
        return moved * np.repeat(carries[1:].T, 3, axis=0)

    def nuisance_coefficients(
        self, columns: DesignMatrix
    ) -> Float[np.ndarray, "unknowns columns"]:
        """Return what each unknown would take of one unit of each column.

        Args:
            columns: In all visits.
        """
        everyone = np.arange(len(self.residual))
        means = self.some(everyone)
        asked = means.of_nuisance(
            site_means_of(columns, means.share, means.screw), len(columns.column)
        )
        return self.nuisance_removed(columns.joined(asked))

    def some(self, visits: Int[np.ndarray, " some"]) -> Means:
        """Return what means of some visits could say."""
        return self.kept.of(visits, self._means)

    def _means(self, visits: Int[np.ndarray, " some"]) -> Means:
        return Means(
            self.whitening.some(visits),
            self.lever[visits],
            self.carries,
            self.share[visits],
            self.screw[visits],
            self.nuisance.of(visits),
        )

    def nuisance_removed(
        self, asked: Float[np.ndarray, "unknowns columns"]
    ) -> Float[np.ndarray, "unknowns columns"]:
        """Return what the unknown takes of columns from their products with it."""
        scale = self.scale[:, None]
        return scale * cho_solve(self.factor, scale * asked)

    def project_out(
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
        one = self.nuisance_removed(near.sum(axis=0))
        other = one if near is far else self.nuisance_removed(far.sum(axis=0))
        prior = self.nuisance.sigma[:, None] ** -2.0 * other
        lost = np.empty((len(near), one.shape[1], other.shape[1]))
        inner = self._nuisance_gram(label, len(near))
        share = np.bincount(label, minlength=len(near)) / len(label)
        for f, own in enumerate(inner):
            back = far[f] - own @ other - share[f] * prior
            np.matmul(near[f].T, other, out=lost[f])
            lost[f] += one.T @ back
        return lost

    def _nuisance_gram(
        self, label: Int[np.ndarray, " visits"], folds: int
    ) -> Float[np.ndarray, "folds unknowns unknowns"]:
        """Return the unknown's own Gram matrix of each fold."""
        key = label.tobytes()
        if key not in self.inner:
            size = len(self.scale)
            total = np.zeros((folds, size, size))
            for some in stretches(len(label), label):
                means = self.some(some)
                flat = means.whitening.white(means.nuisance).reshape(-1, size)
                total[label[some[0]]] += flat.T @ flat
            self.inner[key] = total
        return self.inner[key]

    def with_residual(self, residual: np.ndarray) -> "BetweenVisitModel":
        """Return the same with other residuals."""
        return replace(self, residual=residual)


def mean_squares_of(
    between: BetweenVisitModel, share: Float[np.ndarray, " markers"]
) -> tuple[float, float]:
    """Return mean squares of what means of visits leave, and by noise."""
    left, seen = residuals_of_means(between)
    rms = np.mean(np.sum(left[seen] ** 2, axis=1))
    undone = np.linalg.pinv(between.whitening.half, hermitian=True)
    own = share * np.sum(undone**2, axis=(2, 3))
    return float(rms), float(np.mean(own[seen]))


def residuals_of_means(
    between: BetweenVisitModel,
) -> tuple[Float[np.ndarray, "visits markers 3"], Bool[np.ndarray, "visits markers"]]:
    """Return what means of visits leave, in m, and which markers were seen."""
    roots = between.whitening
    seen: Bool[np.ndarray, "visits markers"] = np.any(roots.half != 0.0, axis=(2, 3))
    undone = np.linalg.pinv(roots.half, hermitian=True)
    longer = np.sqrt(1.0 + roots.size) - 1.0
    along = longer[..., None] * (roots.error.swapaxes(1, 2) @ between.residual)
    white = (between.residual + roots.error @ along).reshape(*seen.shape, 3, 1)
    return (undone @ white)[..., 0], seen
