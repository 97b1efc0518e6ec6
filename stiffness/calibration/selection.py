"""Selection of effects on folds left out, with substitutes and backward elimination.

`spatial_folds_of` splits the poses, `selected` adds effects one at a time, `pruned`
removes those that do not improve the prediction, `common` exchanges rare effects for
common ones, and `equivalents_of` lists the effects that the data cannot distinguish
from a selected one.

Spatial folds (`spatial_folds_of`), since neighbouring poses share their errors:

==========  ==========================================================================
Equation    k-means over the places of targets in the base's frame; whole regions go to
            the hold-out, the others in turn to folds; seeds from SHA-256 of the
            readings, before anything is fitted
Source      leave-group-out validation; Lloyd 1982, "Least squares quantization in PCM"
Valid       at least as many poses as regions
Ignores     the larger distance of regions at the edge from the others
==========  ==========================================================================

Substitutes of a selected effect (`substitutes`):

==========  ==========================================================================
Equation    u = A_k x_k, an effect's signal with the other columns projected out; a
            block c comes near where |P_c u|² > 0.8 |u|², P_c onto its columns beyond
            the same ones; it is a substitute where it predicts folds left out in the
            effect's place, no worse than two standard errors or a hundredth of the
            effect's gain
Source      Hotelling 1936, "Relations between two sets of variates"; margins as
            for forward selection
Valid       effects with few coefficients
Ignores     replacement by two other effects together; tables as substitutes
==========  ==========================================================================

Backward elimination (`pruned`):

==========  ==========================================================================
Equation    loss of an effect = mean over folds left out of log residual square without
            it less log residual square with it; idle where that is not above zero
Source      backward elimination; Breiman et al. 1984, "Classification and Regression
            Trees"
Valid       folds that share no region of poses
Ignores     replacement by two other effects together
==========  ==========================================================================

Forward selection (`selected`):

==========  ==========================================================================
Equation    gain of a fold = log residual square of the set there − that of set and
            effect, both fitted on the other folds: all regions have equal weight;
            believed where the mean gain is more than two of its standard errors over
            folds; the one that gains most goes first, of those that gain alike a
            common one
Source      Breiman et al. 1984, "Classification and Regression Trees" (margins of one
            standard error; two here, for there are many candidates)
Valid       folds that share no region of poses
Ignores     variances of tables' bands are estimated from all folds together
==========  ==========================================================================
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import sem

from bench.shared.settings import SETTINGS
from stiffness.calibration.columns import SILENT, Blocks, Key
from stiffness.calibration.model import Entry, Readings
from stiffness.regression.empirical_bayes import VarianceComponents, precision_of
from stiffness.regression.normal_equations import (
    ColumnIndices,
    Eliminated,
    Normal,
    total_of,
)
from stiffness.regression.splits import k_means, seed_of_values

# --- Spatial folds --------------------------------------------------------------------

REGIONS, LEFT_OUT, FOLDS = 30, 8, 22
"""Number of regions; how many of them are kept back for the final test; number of folds
of the others, for selection. Chosen: 8 of 30 regions are about a quarter, and each of
the others is a fold of its own."""


@dataclass(frozen=True)
class SpatialFolds:
    """Split of the rows into spatial regions, folds and a hold-out.

    Attributes:
        region: Region of each row.
        held: Regions of the hold-out, which no fit uses.
        fold: Fold of each row: −1 in the hold-out, else 0 … count.
        count: Number of folds.
    """

    region: Int[np.ndarray, " rows"]
    held: tuple[int, ...]
    fold: Int[np.ndarray, " rows"]
    count: int

    @property
    def kept_back(self) -> Bool[np.ndarray, " rows"]:
        """Mask of the rows in the hold-out."""
        return self.fold < 0


def spatial_folds_of(readings: Readings, draw: int = 0) -> SpatialFolds:
    """Split the rows into regions, hold-out and folds.

    Another draw gives other regions.
    """
    ids, first, index = np.unique(
        readings.posture_id, return_index=True, return_inverse=True
    )
    rng = np.random.default_rng([seed_of_values(readings.seen), draw])
    count = min(REGIONS, max(len(ids) // 3, 6))
    place = readings.seen[first]
    label = k_means(place, count, minit="++", rng=rng)[1]
    label = np.unique(label, return_inverse=True)[1]  # k-means may leave one empty
    count = int(label.max()) + 1
    order = rng.permutation(count)
    left_out = max(1, round(LEFT_OUT / REGIONS * count))
    folds = min(FOLDS, count - left_out)
    fold_of = np.full(count, -1)
    fold_of[order[left_out:]] = np.arange(count - left_out) % folds
    held = tuple(sorted(int(r) for r in order[:left_out]))
    region = label[index]
    return SpatialFolds(region, held, fold_of[region], folds)


# --- Models on folds left out ---------------------------------------------------------

Tried = Float[np.ndarray, "folds tried"]


@dataclass(frozen=True)
class Judge:
    """Normal equations and variances from which models are fitted and cross-validated.

    Attributes:
        variances: Variances of noise and tables' bands.
        stated: Precision of the coefficients before the readings.
        design: Design effect by which each prior counts more.
    """

    blocks: Blocks
    folds: Sequence[Normal]
    variances: VarianceComponents
    stated: Float[np.ndarray, " columns"]
    design: Float[np.ndarray, " columns"]

    @cached_property
    def total(self) -> Normal:
        """Sum of the normal equations of all folds."""
        return total_of(self.folds)

    def on(self, columns: ColumnIndices) -> "CrossValidatedFit":
        """Fit a set of columns with each fold left out in turn."""
        fits = [self._leaving_out(out).joined_by(columns) for out in self.folds]
        return CrossValidatedFit(self, self.whole_on(columns), fits)

    def whole_on(self, columns: ColumnIndices) -> Eliminated:
        """Fit a set of columns to all folds."""
        return self._leaving_out(None).joined_by(columns)

    def _leaving_out(self, out: Normal | None) -> Eliminated:
        square = np.diag(self.total.gram)
        if out is not None:
            square = square - np.diag(out.gram)
        own = precision_of(
            square, self.blocks.band, self.variances, self.stated, self.design
        )
        return Eliminated.of(self.total, out, self.variances.noise, own)


@dataclass(frozen=True)
class CrossValidatedFit:
    """Fit of a set of columns, with each fold left out and on all folds."""

    judge: Judge
    whole: Eliminated
    fits: Sequence[Eliminated]

    @property
    def columns(self) -> ColumnIndices:
        """Columns of the set, in the order in which they were added."""
        return self.whole.known

    @property
    def x(self) -> Float[np.ndarray, " columns"]:
        """The solution on all folds; zeros elsewhere."""
        return self.whole.with_each([np.zeros(0, dtype=int)])[:, 0]

    @cached_property
    def residual_squares(self) -> Float[np.ndarray, " folds"]:
        """Sum of squared residuals on each fold left out, in m^2."""
        none = np.zeros(0, dtype=int)
        return residual_squares_of(
            self.judge.folds, [f.with_each([none]) for f in self.fits]
        )[:, 0]

    def with_each(self, blocks: Sequence[ColumnIndices]) -> tuple[Tried, np.ndarray]:
        """Return the residual squares with each block added, and the solutions."""
        tried = (fit.with_each(blocks) for fit in self.fits)
        return residual_squares_of(self.judge.folds, tried), self.whole.with_each(
            blocks
        )

    def joined_by(self, own: ColumnIndices) -> "CrossValidatedFit":
        """Return the fit with a block added."""
        fits = [fit.joined_by(own) for fit in self.fits]
        return CrossValidatedFit(self.judge, self.whole.joined_by(own), fits)

    def without_each(self, blocks: Sequence[ColumnIndices]) -> Tried:
        """Return the residual squares when each block alone is removed from the set."""
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
        return residual_squares_of(self.judge.folds, tried)


def residual_squares_of(folds: Sequence[Normal], solutions) -> Tried:
    """Return the sum of squared residuals of each fold's solutions on it, in m^2."""
    found = []
    for fold, x in zip(folds, solutions, strict=True):
        both = np.sum(x * (fold.gram @ x), axis=0)
        found.append(fold.square - 2.0 * fold.aim @ x + both)
    return np.array(found)


def mean_log_gain(
    before: Float[np.ndarray, " folds"], after: Float[np.ndarray, " folds"]
) -> tuple[float, float]:
    """Return the mean gain of the logarithm of the residual, and its standard error."""
    each = np.log(before / after)
    return float(each.mean()), float(sem(each))


# --- Confounded effects ---------------------------------------------------------------

MARGIN, SLIGHT = SETTINGS.standard_errors, 0.01
"""Standard errors of a loss, and share of the effect's gain, that count as none;
chosen: laws are no truer than a tenth of their size, squared."""
NEAR = 0.8
"""Minimum share of an effect's square that a substitute must explain; chosen: cosine
0.9."""
FEW = 12
"""Maximum number of columns of a candidate substitute; chosen: twice a link's
parameters."""
RARE = ("bearing_tilt", "tracker_scale")
"""Effects selected only where no common one explains the data: seats and trackers are
stiffer and more accurate than gears and geometry by an order of magnitude."""

LENGTHS: Key = ("geometry_error", "lengths")
"""Common scaling of all link lengths, which a tracker's scale error mimics."""

Unit = tuple[Key, ColumnIndices]


def is_rare(unit: Unit) -> bool:
    """Return whether an effect is rarer than those that mimic it."""
    return unit[0][0] in RARE


def others_of(trial: CrossValidatedFit) -> list[Unit]:
    """Return the small blocks that a fit does not hold, the commoner ones first."""
    blocks = trial.judge.blocks
    known = set(trial.columns.tolist())
    units = [(key, part) for key in blocks.keys for part in blocks.parts(key)]
    lengths = lengths_of(blocks)
    if len(lengths):
        units.append((LENGTHS, lengths))
    few = [(k, c) for k, c in units if len(c) <= FEW or k == LENGTHS]
    free = [(k, c) for k, c in few if not known & set(c.tolist())]
    return sorted(free, key=is_rare)


def lengths_of(blocks: Blocks) -> ColumnIndices:
    """Return the columns that scale the lengths of links."""
    return np.array(
        [
            j
            for j, (key, name) in enumerate(
                zip(blocks.owner, blocks.parameter, strict=True)
            )
            if key[0] == "geometry_error" and name.endswith("_m") and key != SILENT
        ],
        dtype=int,
    )


def substitutes(
    trial: CrossValidatedFit, own: ColumnIndices, units: Sequence[Unit]
) -> list[Unit]:
    """Return the units that predict as well as some columns of a fit."""
    judge = trial.judge
    rest = np.setdiff1d(trial.columns, own)
    whole, x = judge.whole_on(rest), trial.x[own]
    size = float(x @ whole.inner(own, own) @ x)
    near = []
    for unit in units:
        cross = whole.inner(unit[1], own) @ x
        inside = cross @ np.linalg.solve(whole.inner(unit[1], unit[1]), cross)
        if inside > NEAR * size:
            near.append(unit)
    if not near:
        return []
    less = judge.on(rest)
    gain = mean_log_gain(less.residual_squares, trial.residual_squares)[0]
    every, solutions = less.with_each([c for _, c in near])
    return [
        (key, columns)
        for (key, columns), left, x in zip(near, every.T, solutions.T, strict=True)
        if judge.blocks.holds(columns, x[columns]) and _as_good(trial, left, gain)
    ]


def _as_good(trial: CrossValidatedFit, left: np.ndarray, gain: float) -> bool:
    loss, error = mean_log_gain(left, trial.residual_squares)
    return loss <= max(MARGIN * error, SLIGHT * gain)


# --- Backward elimination -------------------------------------------------------------


def pruned(trial: CrossValidatedFit) -> CrossValidatedFit:
    """Remove effects out of bounds, then those that do not improve the prediction."""
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


def _is_constant(key: Key, inside: dict[Key, ColumnIndices]) -> bool:
    """Return whether an offset is the constant term of a table of harmonics.

    Without it harmonics of low order would model the constant and extrapolate badly.
    """
    return key[0] == "encoder_offset" and ("transmission_error", key[1]) in inside


def inside_of(trial: CrossValidatedFit) -> dict[Key, ColumnIndices]:
    """Return the columns of each effect that a fit holds."""
    blocks, known = trial.judge.blocks, np.sort(trial.columns)
    own = {k: np.intersect1d(blocks.columns_of([k]), known) for k in blocks.keys}
    return {key: columns for key, columns in own.items() if len(columns)}


def budget_of(trial: CrossValidatedFit) -> dict[Key, tuple[float, float]]:
    """Return the loss from removing each effect alone, with its standard error."""
    inside = inside_of(trial)
    left = trial.without_each(list(inside.values()))
    return {
        key: mean_log_gain(one, trial.residual_squares)
        for key, one in zip(inside, left.T, strict=True)
    }


def common(trial: CrossValidatedFit) -> CrossValidatedFit:
    """Replace each rare effect by a common one where that predicts as well."""
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


def equivalents_of(trial: CrossValidatedFit, budget: dict[Key, tuple[float, float]]):
    """Return the effects that would predict as well as each selected one."""
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


# --- Selection ------------------------------------------------------------------------

ALIKE = 0.99
"""Share of the best gain from which on another effect counts as equal; chosen: laws are
no truer than a tenth of their size, squared."""
DRAWING: Key = ("geometry_error", "all links")
"""All corrections of the geometry, which are tried together."""
BELIEVED, NO_GAIN, IMPOSSIBLE = "believed", "no gain", "out of bounds"


@dataclass(frozen=True)
class Step:
    """One candidate effect that was tested in the selection.

    Attributes:
        key: Effect and site.
        rms: Residual on folds left out, 3-D per reading, in m; with it if believed.
        gain: Decrease of the logarithm of the mean square on a fold left out.
        verdict: `believed`, `no gain` or `out of bounds`.
        values: The coefficients, fitted beside what was believed before.
    """

    key: Key
    parameters: tuple[str, ...]
    rms: float
    gain: float
    error: float
    verdict: str
    values: tuple[float, ...] = ()


@dataclass(frozen=True)
class Selected:
    """Result of the selection.

    Attributes:
        columns: All fitted columns, nuisance parameters included.
        steps: Effects that were believed, in order; then those that were refused.
        budget: For each effect believed, the increase of the logarithm of the mean
            square on folds left out when it alone is removed, and its standard error.
        equivalents: For each effect believed, those that predict as well in its place.
        not_seen: Numbers of the drawing that the readings do not show.
    """

    columns: ColumnIndices
    steps: tuple[Step, ...]
    budget: dict[Key, tuple[float, float]]
    equivalents: dict[Key, tuple[Key, ...]]
    not_seen: tuple[Entry, ...] = ()


def selected(judge: Judge, said: Callable[[str], object] = lambda _: None) -> Selected:
    """Select effects forward, then remove those that do not improve the prediction."""
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
            f"{best.key[0]}@{best.key[1]}: {1e6 * best.rms:.1f} µm on regions left out"
        )
        trial = trial.joined_by(unit[1])
        rest = [u for u in rest if u is not unit]
    trial = common(pruned(_with_winding(trial, rest)))
    budget = budget_of(trial)
    return Selected(trial.columns, tuple(steps), budget, equivalents_of(trial, budget))


def _with_winding(
    trial: CrossValidatedFit, rest: Sequence[tuple[Key, ColumnIndices]]
) -> CrossValidatedFit:
    """Add the compliance of axes with a table, where it predicts better at all.

    Gravity winds an axis up as a wave of its angle does: without a compliance harmonics
    of low order would model that, and extrapolate badly.
    """
    for key, own in rest:
        tabled = ("transmission_error", key[1]) in inside_of(trial)
        if key[0] == "joint_compliance" and tabled:
            (step,) = _tried(trial, [(key, own)])
            if step.verdict != IMPOSSIBLE and step.gain > 0.0:
                trial = trial.joined_by(own)
    return trial


def _units(blocks: Blocks) -> list[tuple[Key, ColumnIndices]]:
    """Return the units of selection: geometry, tables, single bounded parameters."""
    claims = np.array([owner != SILENT for owner in blocks.owner])
    drawing = np.flatnonzero((blocks.entry >= 0) & claims)
    units: list[tuple[Key, ColumnIndices]] = (
        [(DRAWING, drawing)] if len(drawing) else []
    )
    for key in blocks.keys:
        if key[0] not in ("encoder_offset", "geometry_error"):
            units += [(key, own) for own in blocks.parts(key)]
    return units


def _tried(
    trial: CrossValidatedFit, units: Sequence[tuple[Key, ColumnIndices]]
) -> Iterator[Step]:
    """Evaluate units, each added by itself."""
    blocks = trial.judge.blocks
    every, solutions = trial.with_each([own for _, own in units])
    for (key, own), left, x in zip(units, every.T, solutions.T, strict=True):
        gain, error = mean_log_gain(trial.residual_squares, left)
        verdict = BELIEVED if gain > max(MARGIN * error, 0.0) else NO_GAIN
        if not blocks.holds(own, x[own]):
            verdict = IMPOSSIBLE
        square = (left if verdict == BELIEVED else trial.residual_squares).sum()
        rms = float(np.sqrt(max(square, 0.0) / trial.judge.total.count * 3.0))
        names = tuple(blocks.parameter[j] for j in own)
        sizes = tuple(float(v) for v in x[own])
        yield Step(key, names, rms, gain, error, verdict, sizes)
