"""Calibration of an arm: the whole analysis, named effects, drift that remains.

What is left may grow with time in one link alone, as a link does that warms up.

==========  ==========================================================================
Equation    y = residual, A = drawing, frame and places, and frame and places times
            time, B = one place's numbers times time; share = |P_B y|² / |y|² with A
            projected out of both; p by F, times the number of places
Source      Frisch, Waugh 1933 (what is projected out); Bonferroni
Valid       changes that are small and go one way
Ignores     that readings of one pose err together: hence a share is asked for too
==========  ==========================================================================

What was believed gets a name where it is clearly there, however many were tried.

==========  ==========================================================================
Equation    a number is clear where |value| > half t(1 - a / 2m) / t(1 - a / 2), half
            its interval's half width, a = 5 %, m units tried, R - 1 freedoms; a name
            needs a clear number and a loss of more than two standard errors; a table
            needs a wave that is not zero, and that it or its loss be clear
Source      Dunn 1961, "Multiple comparisons among means", JASA 56, 52
Valid       ten regions or more
Ignores     what of it is common to several names: they are fitted together
==========  ==========================================================================

A calibrated arm: what was believed, how sure, and what stays unexplained.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student

from stiffness.calibration.columns import (
    ORDERS,
    SILENT,
    Blocks,
    Key,
    candidates_of,
    normals_of,
)
from stiffness.calibration.final_fit import (
    LEVEL,
    Table,
    Wave,
    estimates_of,
    final_fit,
    largest_waves,
    spread,
    springs_of,
    tables_of,
    wave_of,
)
from stiffness.calibration.model import (
    CalibrationState,
    Geometry,
    Readings,
    SpatialFolds,
    entries_of,
)
from stiffness.calibration.rigid_fit import RigidFit, fitted
from stiffness.calibration.selection import MARGIN, Judge, Selected, selected
from stiffness.regression.empirical_bayes import learnt
from stiffness.regression.intervals import Estimate
from stiffness.regression.normal_equations import total_of
from stiffness.regression.testing import Agreement, agreement
from stiffness.robot.arm import Arm

# --- Residuals that grow with time ----------------------------------------------------

LEAST, ALPHA = 0.05, 1e-3
"""Share of what is left that has to grow, and its p-value; chosen."""
FAINT = 1e-8
"""Singular value, of the largest, below which columns are the same."""


@dataclass(frozen=True)
class DriftTerm:
    """A place whose numbers change with time.

    Attributes:
        where: An axis or a link.
        share: Of what is left.
    """

    where: str
    share: float


def drift_term(
    stance: CalibrationState, residual: Float[np.ndarray, "rows 3"]
) -> DriftTerm | None:
    """Return the place that explains most of what is left by changing with time."""
    hours = stance.readings.hours[:, None, None]
    every, rows = stance.nuisance_jacobian(), residual.size
    entries = entries_of(stance.standing.chain)
    known = [every, every[:, :, len(entries) :] * hours]
    base = _basis(np.concatenate(known, axis=2).reshape(rows, -1))
    left = residual.ravel() - base @ (base.T @ residual.ravel())
    total, places = float(left @ left), {e.where for e in entries}
    best: DriftTerm | None = None
    for where in sorted(places):
        own = [j for j, e in enumerate(entries) if e.where == where]
        a = (every[:, :, own] * hours).reshape(rows, -1)
        size = float(np.linalg.norm(a))
        a = a - base @ (base.T @ a)
        if np.linalg.norm(a) <= 1e-6 * size:  # no time went by, or it is the frame's
            continue
        basis = _basis(a)
        count, square = basis.shape[1], float(np.sum((basis.T @ left) ** 2))
        rest = rows - base.shape[1] - count
        if rest < 1 or square <= (best.share if best else LEAST) * total:
            continue
        ratio = square / count / ((total - square) / rest)
        if fisher.sf(ratio, count, rest) * len(places) < ALPHA:
            best = DriftTerm(where, square / total)
    return best


def _basis(a: Float[np.ndarray, "n columns"]) -> np.ndarray:
    """Return orthonormal columns that span the same."""
    size = np.linalg.norm(a, axis=0)
    u, s, _ = np.linalg.svd(a / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return u[:, s > FAINT * max(s[0], 1e-300)]


# --- Named effects --------------------------------------------------------------------


def named(
    chosen: Selected,
    estimates: Mapping[Key, Mapping[str, Estimate]],
    waves: Mapping[str, Wave],
    regions: int,
) -> Iterator[Key]:
    """Yield what was believed and is clearly there, the one that matters most first.

    Args:
        chosen: What was believed, and what was tried.
        estimates: Numbers with their intervals.
        waves: Of each table the largest wave that is clearly there.
        regions: How many regions were fitted.
    """
    tried = max(len({(s.key, s.parameters) for s in chosen.steps}), 1)
    tail = (1.0 - LEVEL) / 2
    wider = float(student.isf(tail / tried, regions - 1))
    wider /= float(student.isf(tail, regions - 1))
    for key, (loss, error) in sorted(chosen.budget.items(), key=lambda one: -one[1][0]):
        if loss <= MARGIN * error:
            continue
        if key[0] == "transmission_error":
            wave = waves[key[1]]
            sure = loss > norm.isf(2.0 * tail / tried) * error
            if wave.clear and (sure or wave.size > wider * wave.half):
                yield key
        elif any(_clear(e, wider) for e in estimates.get(key, {}).values()):
            yield key


def _clear(found: Estimate, wider: float) -> bool:
    return bool(abs(found.value) > wider * (found.high - found.low) / 2.0)


# --- Calibration ----------------------------------------------------------------------

CHOOSING = 129
"""Order below which tables end while effects are chosen; then they are drawn whole."""

WAVES = 5
"""Of each table the waves that get an interval, the largest ones."""


@dataclass(frozen=True)
class Calibrated:
    """What calibration found; nothing was fitted to the regions kept back.

    Attributes:
        readings: All that was seen.
        spatial_folds: Which of it was kept back.
        before: Arm as drawn: frame, places and springs fitted.
        corrected_geometry: The drawing as corrected.
        springs: Stiffness of springs that the model has, in N m/rad, by axis: as
            fitted to the arm as drawn, and to the corrected one.
        estimates: Of every number but tables', with intervals, by effect and place.
        error_tables: Of uneven gears, by axis.
        harmonics: Of each table the largest wave that is clearly there, by axis.
        selected: How effects were chosen.
        named: Effects that are believed and whose numbers are clearly not zero, the
            one that matters most first.
        nominal: Residual of the arm as drawn, on all rows, in m.
        residual: What calibration leaves, on all rows, in m.
        used: Coefficients settled for each coordinate that was fitted.
        at_first: Whether neighbours agree before.
        at_last: Whether they do after.
    """

    readings: Readings
    spatial_folds: SpatialFolds
    before: Geometry
    corrected_geometry: Geometry
    springs: tuple[dict[str, float], ...]
    estimates: dict[Key, dict[str, Estimate]]
    error_tables: dict[str, Table]
    harmonics: dict[str, Wave]
    selected: Selected
    named: tuple[Key, ...]
    nominal: Float[np.ndarray, "rows 3"]
    residual: Float[np.ndarray, "rows 3"]
    used: float
    at_first: Agreement
    at_last: Agreement

    @property
    def held(self) -> Bool[np.ndarray, " rows"]:
        """Rows that decide."""
        return self.spatial_folds.kept_back


def calibrated(
    readings: Readings,
    spatial_folds: SpatialFolds,
    said: Callable[[str], None] = lambda _: None,
    highest: int = ORDERS[-1],
) -> Calibrated:
    """Calibrate an arm on the regions that are not kept back.

    Args:
        readings: What was seen.
        spatial_folds: Which of it is kept back.
        said: Is told what was believed.
        highest: Order below which tables of uneven gears end.

    Returns:
        What was believed, with the arm as corrected.
    """
    keep = ~spatial_folds.kept_back
    fit_on = readings.take(keep)
    sprung = _sprung(readings.arm)
    plain = fitted(fit_on, redraw=False)
    before = final_fit(readings, keep, plain, set(), sprung, highest)
    rigid = fitted(fit_on, redraw=True)
    stance = CalibrationState.of(readings, rigid.geometry)
    some = candidates_of(stance, min(CHOOSING, highest))
    blocks = Blocks.of(rigid, stance, some, sprung)
    folds = normals_of(blocks, stance, spatial_folds.fold, spatial_folds.count)
    _, sizes = learnt(total_of(folds), blocks.band)
    chosen = selected(Judge(blocks, folds, sizes), said)
    said("drawing tables in full")
    wanted = {(blocks.owner[j], blocks.parameter[j]) for j in chosen.columns}
    del folds
    if not any(blocks.entry[j] >= 0 and blocks.owner[j] != SILENT
               for j in chosen.columns):  # fmt: skip
        rigid = RigidFit(before.corrected_geometry, rigid.kept)
    after = final_fit(readings, keep, rigid, wanted, sprung, highest)
    full, known, x = after.blocks, after.known, after.fit.x
    numbers = np.flatnonzero(full.order[known] == 0)
    waves = largest_waves(full, known, x, WAVES)
    asked = [numbers, *(w.ravel() for w in waves.values())]
    region = np.where(keep, spatial_folds.region, -1)
    half = spread(
        full, after.stance, region, known, after.fit, after.variances,
        np.concatenate(asked),
    )  # fmt: skip
    ends = np.cumsum([len(a) for a in asked])
    by_wave = zip(waves.items(), np.split(half, ends)[1:], strict=False)
    widths = dict(zip(numbers.tolist(), half.tolist(), strict=False))
    estimates = estimates_of(full, known, x, widths)
    clearest = {
        axis: wave_of(full, known, x, own, h.reshape(-1, 2))
        for (axis, own), h in by_wave
    }
    count = len(np.unique(spatial_folds.region[keep]))
    return Calibrated(
        readings=readings,
        spatial_folds=spatial_folds,
        before=before.corrected_geometry,
        corrected_geometry=after.corrected_geometry,
        springs=tuple(springs_of(f, readings.arm.stiffness) for f in (before, after)),
        estimates=estimates,
        error_tables=tables_of(full, known, x),
        harmonics=clearest,
        selected=chosen,
        named=tuple(named(chosen, estimates, clearest, count)),
        nominal=before.residual,
        residual=after.residual,
        used=after.used,
        at_first=agreement(before.residual, readings.posture),
        at_last=agreement(after.residual[~keep], readings.posture[~keep]),
    )


def _sprung(arm: Arm) -> set[Key]:
    """Return the springs that the model has: how stiff they are is no finding."""
    springs = enumerate(arm.stiffness)
    return {("joint_compliance", f"a{k + 1}") for k, s in springs if s > 0.0}
