"""Final fit of the selected effects, with intervals, error tables and geometry.

`final_fit` fits the selected columns once more, with tables in full, about the
corrected geometry; a `FinalFit` turns its coefficients into parameters of the arm.

Intervals (`FinalFit.spread`):

==========  ==========================================================================
Equation    cov = C (sum over regions g g') C R / (R − 1) + D, g = A'r / s² of a region,
            C = (A'A / s² + P)⁻¹; estimate ± t(R − 1) sqrt(cov), never narrower than
            C times the design effect gives; D see below
Source      Liang, Zeger 1986 (the sandwich of clusters); Cameron, Miller 2015
            (R / (R − 1) and Student's t with R − 1)
Valid       ten regions or more
Ignores     the selection that came before, on folds left out, but for D
==========  ==========================================================================

What the numbers of the drawing that were not chosen add (`of_unchosen`):

==========  ==========================================================================
Equation    D = f B S⁻¹ B' + B d d' B', B = C A'U / s², U their columns,
            S = U'U / s² + P − U'A B / s², d = S⁻¹ U'r / s², f the design effect: the
            covariance that C has with U's coefficients fitted too, by their priors,
            and the square of what the estimates would change by
Source      Bayesian model averaging, its widest model: Hoeting et al. 1999,
            Statistical Science 14, 382
Valid       numbers that lie about the drawing as stated
Ignores     columns of which others, the frame or targets do just the same
==========  ==========================================================================

Design effects of the regions (`design_effects`), by which priors count more:

==========  ==========================================================================
Equation    tr(V⁻¹ sum over regions d d') R / (R − 1) / tr(1 − V⁻¹ C P C), d = C g of
            the drawing's coefficients, or those of an octave; V their part of C
Source      Rao, Scott 1984, "On chi-squared tests for multiway contingency tables",
            Annals of Statistics 12, 46 (the mean of generalised design effects)
Valid       ten regions or more
Ignores     that directions differ in it
==========  ==========================================================================

Repeated fit (`final_fit`):

==========  ==========================================================================
Equation    as `stiffness.regression.empirical_bayes`; repeated about the corrected
            geometry where it moved
Source      Gauss-Newton
Valid       corrections that are small beside the arm
Ignores     effects that were not selected: they stay as the model has them
==========  ==========================================================================
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_solve
from scipy.stats import t as student

from bench.shared.settings import SETTINGS, Interval
from stiffness.calibration.columns import (
    SILENT,
    STATED,
    Blocks,
    Key,
    candidates_of,
    normals_of,
)
from stiffness.calibration.model import CalibrationState, Geometry, Readings
from stiffness.calibration.rigid_fit import RigidFit
from stiffness.regression.empirical_bayes import Solved, VarianceComponents, learnt
from stiffness.regression.normal_equations import Normal

# --- Intervals ------------------------------------------------------------------------

LEVEL = SETTINGS.confidence


DesignEffects = Mapping[tuple[Key, int], float]
"""By prior: see `Blocks.priors`."""


def design_effects(
    blocks: Blocks, folds: Sequence[Normal], fit: Solved, noise: float
) -> DesignEffects:
    """Return how much more coefficients err than if readings erred by themselves.

    Readings of one region err together, so there are fewer of them than there seem, and
    a prior counts by this factor more beside them. The noise is the variance of a
    coordinate, in m^2.
    """
    priors, count = blocks.priors, len(folds)
    scores = np.array([f.aim - f.gram @ fit.x for f in folds]) / noise
    found = {}
    for prior in sorted({p for p in priors if p == STATED or p[1]}):
        own = np.array([j for j, p in enumerate(priors) if p == prior])
        inverse = fit.inverse(own)  # (columns, own)
        moved, weight = scores @ inverse, np.linalg.inv(inverse[own])
        used = len(own) - np.trace(weight @ (inverse.T * fit.precision) @ inverse)
        square = np.einsum("fi,ij,fj->", moved, weight, moved)
        ratio = square * count / max(count - 1, 1) / max(used, 1.0)
        found[prior] = max(float(ratio), 1.0)
    return found


# --- Parameters of the arm from coefficients ------------------------------------------


@dataclass(frozen=True)
class Table:
    """Transmission error of an axis as a sum of harmonics.

    Attributes:
        order: Order of each harmonic.
        cos: Amplitude of cos(order q), in rad.
        sin: Of sin(order q), in rad.
    """

    order: Float[np.ndarray, " waves"]
    cos: Float[np.ndarray, " waves"]
    sin: Float[np.ndarray, " waves"]

    def at(self, angle: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Return the error of the output angle at some angles, in rad."""
        wave = angle[:, None] * self.order
        return np.cos(wave) @ self.cos + np.sin(wave) @ self.sin


@dataclass(frozen=True)
class Wave:
    """One harmonic of a table, with half the width of the interval of its amplitude.

    Attributes:
        order: Periods per turn of the axis.
        size: Amplitude, in rad.
        phase: Phase in size sin(order q + phase), in rad.
        half: Half the width of the interval of `size`, in rad.
    """

    order: int
    size: float
    phase: float
    half: float

    @property
    def clear(self) -> bool:
        """Whether the interval excludes zero."""
        return bool(self.size > self.half)


# --- Final fit ------------------------------------------------------------------------

MOVED = 2e-4
"""Change of the geometry in rad or m from which columns are computed anew; chosen: its
square times an arm's length is less than a tenth of a tracker's noise."""
ROUNDS = 3


@dataclass(frozen=True)
class FinalFit:
    """Fit of a set of columns, with the state in which they were computed.

    Attributes:
        state: State of the arm in which they were computed.
        known: Indices of the fitted columns.
        variances: Variances of noise and bands.
        residual: Residual on all rows, in m; see `CalibrationState.residual`.
        used: Effective number of coefficients per fitted coordinate.
        of_unchosen: What each coefficient's variance is larger by, since numbers of the
            drawing that were not fitted may be off as well.
    """

    blocks: Blocks
    state: CalibrationState
    known: Int[np.ndarray, " known"]
    fit: Solved
    variances: VarianceComponents
    residual: Float[np.ndarray, "rows coordinates"]
    used: float
    design: DesignEffects
    of_unchosen: Float[np.ndarray, " known"]

    @property
    def order(self) -> Int[np.ndarray, " known"]:
        """Order of each fitted column of a table; 0 elsewhere."""
        return self.blocks.order[self.known]

    @cached_property
    def corrected_geometry(self) -> Geometry:
        """The geometry corrected by its own fitted parameters only."""
        blocks, rigid = self.blocks, self.state.geometry
        step = np.zeros(rigid.parameter_count)
        step[: len(rigid.values)] = -rigid.values
        for j, value in zip(self.known, self.fit.x, strict=True):
            if blocks.entry[j] >= 0:
                step[blocks.entry[j]] = value - blocks.start[j]
        return rigid.stepped(step)

    def spread(
        self, region: Int[np.ndarray, " rows"], wanted: Int[np.ndarray, " some"]
    ) -> Float[np.ndarray, " some"]:
        """Return half the width of the confidence intervals of some coefficients.

        Rows of a region below zero were not fitted; `wanted` are indices within the
        fitted coefficients.
        """
        inverse = self.fit.inverse(wanted)  # (known, some)
        regions = np.unique(region[region >= 0])
        total = np.zeros((len(wanted), len(wanted)))
        for r in regions:
            a, y = self.blocks.problem(self.state, np.flatnonzero(region == r))
            a = a[:, self.known]
            score = inverse.T @ (a.T @ (y - a @ self.fit.x) / self.variances.noise)
            total += np.outer(score, score)
        count = len(regions)
        variance = np.diag(total) * count / (count - 1)
        design = self.blocks.by_prior(self.design)[self.known[wanted]]
        least = inverse[wanted, np.arange(len(wanted))] * design
        variance = np.maximum(variance, least) + self.of_unchosen[wanted]
        return student.ppf(0.5 + LEVEL / 2, count - 1) * np.sqrt(variance)

    def estimates(self, half: dict[int, float]) -> dict[Key, dict[str, Interval]]:
        """Return parameters with intervals, of half a width by number in `known`."""
        found: dict[Key, dict[str, Interval]] = {}
        for i, width in half.items():
            j, value = self.known[i], float(self.fit.x[i])
            if self.blocks.owner[j] != SILENT:
                own = found.setdefault(self.blocks.owner[j], {})
                interval = Interval(value, value - width, value + width)
                own[self.blocks.parameter[j]] = interval
        return found

    def _pairs(self) -> dict[str, Int[np.ndarray, "waves 2"]]:
        """Return the coefficients of each table, by axis: a cosine, and its sine."""
        where = np.array([self.blocks.owner[j][1] for j in self.known])
        waves = self.order > 0
        return {
            str(axis): np.flatnonzero(waves & (where == axis)).reshape(-1, 2)
            for axis in dict.fromkeys(where[waves])
        }

    def error_tables(self) -> dict[str, Table]:
        """Return the tables of transmission error among the coefficients, by axis."""
        x, order = self.fit.x, self.order.astype(float)
        return {
            axis: Table(order[own[:, 0]], x[own[:, 0]], x[own[:, 1]])
            for axis, own in self._pairs().items()
        }

    def largest_waves(self, count: int) -> dict[str, Int[np.ndarray, "waves 2"]]:
        """Return, by axis, the coefficient pairs of each table's largest harmonics."""
        found = {}
        for axis, own in self._pairs().items():
            size = np.sum(self.fit.x[own] ** 2, axis=1)
            found[axis] = own[np.argsort(-size, kind="stable")[:count]]
        return found

    def wave(
        self, waves: Int[np.ndarray, "waves 2"], half: Float[np.ndarray, "waves 2"]
    ) -> Wave:
        """Return the largest significant harmonic of some, or else the largest."""
        size, width = np.hypot(*self.fit.x[waves].T), half.max(axis=1)
        clear = np.flatnonzero(size > width)
        at = int(clear[0]) if len(clear) else 0
        c, s = self.fit.x[waves[at]]
        order, phase = int(self.order[waves[at, 0]]), float(np.arctan2(c, s))
        return Wave(order, float(size[at]), phase, float(width[at]))

    def springs(
        self, nominal: Float[np.ndarray, " axes"], half: Mapping[int, float]
    ) -> dict[str, Interval]:
        """Return the fitted stiffness of each spring of the model, in N m/rad.

        Changes within a decade count as nominal; unidentifiable springs keep their
        value. Intervals are those of compliances, of half a width by number in `known`.
        """
        found = {}
        for i, j in enumerate(self.known.tolist()):
            if self.blocks.owner[j] == SILENT and self.blocks.entry[j] < 0:
                where, value = _axis_of(self.blocks, j), float(self.fit.x[i])
                usual = 1.0 / nominal[int(where[1:]) - 1]
                give = float(np.clip(value, usual / 10.0, 10.0 * usual))
                wide = half.get(i, np.inf)
                stiffest = 1.0 / (give - wide) if wide < give else np.inf
                found[where] = Interval(1.0 / give, 1.0 / (give + wide), stiffest)
        return found


def final_fit(
    readings: Readings,
    keep: Bool[np.ndarray, " rows"],
    rigid: RigidFit,
    wanted: set[tuple[Key, str]],
    sprung: set[Key],
    highest: int,
    design: DesignEffects,
) -> FinalFit:
    """Fit the nuisance parameters and the selected effects to the rows that are kept.

    Tables of transmission error end below the order `highest`.
    """
    found = _about(readings, keep, rigid, wanted, sprung, highest, design)
    for _ in range(ROUNDS - 1):
        before, now = found.state.geometry, found.corrected_geometry
        moved = np.abs(now.values - before.values).max(initial=0.0)
        turned = np.abs(now.base_from_tracker - before.base_from_tracker).max()
        if max(moved, turned) < MOVED:
            break
        fit = RigidFit(now, rigid.kept)
        found = _about(readings, keep, fit, wanted, sprung, highest, design)
    return found


def _about(readings, keep, rigid, wanted, sprung, highest, design) -> FinalFit:
    state = CalibrationState.of(readings, rigid.geometry)
    keys = {owner for owner, _ in wanted}
    every = [
        c
        for c in candidates_of(state, highest)
        if c.key in keys or c.key in sprung
        if c.orders or (c.key, c.parameters[0]) in wanted or c.key in sprung
    ]
    full = Blocks.of(rigid, state, every, sprung)
    names = zip(full.owner, full.parameter, strict=True)
    known = np.array(
        [
            j
            for j, (owner, name) in enumerate(names)
            if full.order[j] or owner == SILENT or (owner, name) in wanted
        ]
    )
    one = np.where(keep, 0, -1)
    every_column = normals_of(full, state, one, 1)[0]
    normal = every_column.only(known)
    stated, more = 1.0 / full.size[known] ** 2, full.by_prior(design)[known]
    fit, sizes = learnt(normal, full.band[known], stated, more)
    wider = _of_unchosen(full, every_column, known, fit, sizes.noise, design)
    left = np.empty_like(state.residual)
    for start in range(0, len(left), 500):
        rows = np.arange(start, min(start + 500, len(left)))
        a, y = full.problem(state, rows)
        left[rows] = (y - a[:, known] @ fit.x).reshape(len(rows), -1)
    used = float(np.sum(1.0 - fit.precision * fit.spread())) / normal.count
    return FinalFit(full, state, known, fit, sizes, left, used, design, wider)


def _of_unchosen(
    full: Blocks,
    normal: Normal,
    known: Int[np.ndarray, " known"],
    fit: Solved,
    noise: float,
    design: DesignEffects,
) -> Float[np.ndarray, " known"]:
    """Return D's diagonal; see the module."""
    rest = np.setdiff1d(np.flatnonzero(np.isfinite(full.size)), known)
    if not len(rest):
        return np.zeros(len(known))
    factor = design.get(STATED, 1.0)
    cross = normal.gram[np.ix_(known, rest)] / noise
    moved = cho_solve(fit.factor, cross)  # B
    inner = normal.gram[np.ix_(rest, rest)] / noise - cross.T @ moved
    inner[np.diag_indices(len(rest))] += factor / full.size[rest] ** 2
    score = normal.aim[rest] / noise - cross.T @ fit.x
    inverse = np.linalg.inv(inner)
    step = moved @ (inverse @ score)
    return factor * np.einsum("ij,jk,ik->i", moved, inverse, moved) + step**2


def _axis_of(blocks: Blocks, column: int) -> str:
    at = int(np.sum(blocks.entry >= 0))
    for candidate in blocks.candidates:
        at += len(candidate.parameters)
        if column < at:
            return candidate.where
    raise AssertionError("a column of no block")
