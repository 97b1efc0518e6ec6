"""Selection of effects on folds left out, with substitutes and backward elimination.

Sets of effects are judged on folds of regions that they were not fitted to.

What these data cannot tell from a name is said with it.

==========  ==========================================================================
Equation    u = A_k x_k, what a name does beyond the other known columns; another block
            c comes near where |P_c u|² > 0.8 |u|², P_c onto its columns beyond the same
            ones; it does as well where folds left out are predicted, with it in the
            name's stead, no worse than two standard errors or a hundredth of what the
            name gains
Source      Hotelling 1936, "Relations between two sets of variates"; margins as
            `selection`
Valid       names of few coefficients
Ignores     what only two others together could replace; tables as substitutes
==========  ==========================================================================

What folds left out are better without goes, and rare effects that others replace.

==========  ==========================================================================
Equation    loss of a name = mean over folds left out of log of what is left without it
            less log of what is left with it; idle where that is not above zero
Source      backward elimination; Breiman et al. 1984, "Classification and Regression
            Trees"
Valid       folds that share no region of poses
Ignores     names that only two others together would replace
==========  ==========================================================================

An effect is believed when regions of poses that it was not fitted to confirm it.

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
from functools import cached_property

import numpy as np
from jaxtyping import Float

from stiffness.calibration.columns import SILENT, Blocks, Key
from stiffness.regression.elimination import ColumnIndices, Eliminated
from stiffness.regression.empirical_bayes import VarianceComponents, precision_of
from stiffness.regression.normal_equations import Normal, total_of
from stiffness.regression.testing import mean_log_gain

# --- Models on folds left out ---------------------------------------------------------

Tried = Float[np.ndarray, "folds tried"]


@dataclass(frozen=True)
class Judge:
    """Everything needed to fit a set on all folds but one and to look at that one.

    Attributes:
        blocks: The columns.
        folds: Normal equations of each fold.
        variances: Of noise and tables' bands.
    """

    blocks: Blocks
    folds: Sequence[Normal]
    variances: VarianceComponents

    @cached_property
    def total(self) -> Normal:
        """All folds together."""
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
        own = precision_of(square, self.blocks.band, self.variances)
        return Eliminated.of(self.total, out, self.variances.noise, own)


@dataclass(frozen=True)
class CrossValidatedFit:
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
    def columns(self) -> ColumnIndices:
        """The set, in the order in which it grew."""
        return self.whole.known

    @property
    def x(self) -> Float[np.ndarray, " columns"]:
        """The solution on all folds; zeros elsewhere."""
        return self.whole.with_each([np.zeros(0, dtype=int)])[:, 0]

    @cached_property
    def residual_squares(self) -> Float[np.ndarray, " folds"]:
        """The sum of squares on each fold left out, in m^2."""
        none = np.zeros(0, dtype=int)
        return residual_squares_of(
            self.judge.folds, [f.with_each([none]) for f in self.fits]
        )[:, 0]

    def with_each(self, blocks: Sequence[ColumnIndices]) -> tuple[Tried, np.ndarray]:
        """Return what is left with each block added, and the solutions on all."""
        tried = (fit.with_each(blocks) for fit in self.fits)
        return residual_squares_of(self.judge.folds, tried), self.whole.with_each(
            blocks
        )

    def joined_by(self, own: ColumnIndices) -> "CrossValidatedFit":
        """Believe a block."""
        fits = [fit.joined_by(own) for fit in self.fits]
        return CrossValidatedFit(self.judge, self.whole.joined_by(own), fits)

    def without_each(self, blocks: Sequence[ColumnIndices]) -> Tried:
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
        return residual_squares_of(self.judge.folds, tried)


def residual_squares_of(folds: Sequence[Normal], solutions) -> Tried:
    """Return the sum of squares that each fold's solutions leave on it, in m^2."""
    found = []
    for fold, x in zip(folds, solutions, strict=True):
        both = np.sum(x * (fold.gram @ x), axis=0)
        found.append(fold.square - 2.0 * fold.aim @ x + both)
    return np.array(found)


# --- Confounded effects ---------------------------------------------------------------

MARGIN, SLIGHT = 2.0, 0.01
"""Standard errors of a loss, and share of what the name gains, that count as none;
chosen: laws are no truer than a tenth of their size, squared."""
NEAR = 0.8
"""Share of a name's square that another must do at least; chosen: cosine 0.9."""
FEW = 12
"""Columns of a block that is looked at; chosen: twice a link's numbers."""
RARE = ("bearing_tilt", "tracker_scale")
"""What explains only where nothing common does: seats and trackers are stiffer and more
true than gears and drawings by an order of magnitude."""

LENGTHS: Key = ("geometry_error", "lengths")
"""All links longer or shorter together: what a tracker's scale looks like."""

Unit = tuple[Key, ColumnIndices]


def is_rare(unit: Unit) -> bool:
    """Return whether an effect is rarer than those that look like it."""
    return unit[0][0] in RARE


def others_of(trial: CrossValidatedFit) -> list[Unit]:
    """Return the small blocks that a trial does not hold, the commoner ones first."""
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
    """Return the columns that make links longer or shorter."""
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
    """Return the units that would do as well as some columns of a trial.

    Args:
        trial: What is believed.
        own: Columns in it.
        units: Blocks that are not in it.
    """
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
    """Take out what became impossible, then what folds are better without."""
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
    """Return whether an offset is the constant about which a table's waves go.

    Without it slow waves would make one, and run away where no pose was fitted.
    """
    return key[0] == "encoder_offset" and ("transmission_error", key[1]) in inside


def inside_of(trial: CrossValidatedFit) -> dict[Key, ColumnIndices]:
    """Return the columns of each effect that a trial holds."""
    blocks, known = trial.judge.blocks, np.sort(trial.columns)
    own = {k: np.intersect1d(blocks.columns_of([k]), known) for k in blocks.keys}
    return {key: columns for key, columns in own.items() if len(columns)}


def budget_of(trial: CrossValidatedFit) -> dict[Key, tuple[float, float]]:
    """Return what each effect's going alone would lose, with its standard error."""
    inside = inside_of(trial)
    left = trial.without_each(list(inside.values()))
    return {
        key: mean_log_gain(one, trial.residual_squares)
        for key, one in zip(inside, left.T, strict=True)
    }


def common(trial: CrossValidatedFit) -> CrossValidatedFit:
    """Put a common effect in the place of each rare one that it can replace."""
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
    """Return what would do as well as each name, by name."""
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
        equivalents: Of each effect believed, those that would do as well in its stead.
    """

    columns: ColumnIndices
    steps: tuple[Step, ...]
    budget: dict[Key, tuple[float, float]]
    equivalents: dict[Key, tuple[Key, ...]]


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
    return Selected(trial.columns, tuple(steps), budget, equivalents_of(trial, budget))


def _units(blocks: Blocks) -> list[tuple[Key, ColumnIndices]]:
    """Return what enters together: the drawing, each table, each bounded number."""
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
    """Try units, each by itself."""
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
        yield Step(key, names, rms, gain, error, verdict)
