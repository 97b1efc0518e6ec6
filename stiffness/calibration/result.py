"""Calibration of an arm: the whole analysis, named effects, drift that remains.

`calibrated` runs the analysis on the regions that are not kept back, `named` selects
the effects that are significant, `drift_term` tests the residual for drift of a link.

Drift of one link in the residual (`drift_term`), such as from thermal expansion:

==========  ==========================================================================
Equation    y = residual, A = geometry, frame and targets, and frame and targets times
            time, B = one site's parameters times time; share = |P_B y|² / |y|² with A
            projected out of both; p by F, times the number of sites
Source      Frisch, Waugh 1933 (what is projected out); Bonferroni
Valid       changes that are small and go one way
Ignores     correlated errors within a pose: hence a share is required too
==========  ==========================================================================

Significance of selected effects (`named`), corrected for the number tried:

==========  ==========================================================================
Equation    a parameter is significant where
            |value| > half t(1 - a / 2m) / t(1 - a / 2), half its interval's half width,
            a = 5 %, m units tried, R - 1 degrees of freedom; an effect needs a
            significant parameter and a loss of more than two standard errors; a table
            needs a harmonic that is not zero, and that it or its loss be significant
Source      Dunn 1961, "Multiple comparisons among means", JASA 56, 52
Valid       ten regions or more
Ignores     what is common to several effects: they are fitted together
==========  ==========================================================================

What neighbouring poses leave alike, which is not noise (`agreement`):

==========  ==========================================================================
Equation    pairs (i, j) of poses next to each other in posture; noise² = mean
            |r_i − r_j|² / 2; agreement = mean r_i . r_j / mean |r|²; p-value by turning
            the signs of half the poses at random
Source      von Neumann 1941, "Distribution of the ratio of the mean square successive
            difference to the variance"; sign flips: Fisher 1935
Valid       what was left out changes slowly from pose to pose
Ignores     what changes within the distance of neighbours: it counts as noise
==========  ==========================================================================
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from scipy.stats import f as fisher
from scipy.stats import norm
from scipy.stats import t as student
from threadpoolctl import threadpool_limits

from bench.shared.recording import Recording
from bench.shared.settings import Interval
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
    FinalFit,
    Table,
    Wave,
    design_effects,
    final_fit,
)
from stiffness.calibration.model import (
    CalibrationState,
    Geometry,
    Readings,
    entries_of,
    readings_of,
)
from stiffness.calibration.rigid_fit import (
    RigidFit,
    far_from,
    fitted,
    not_seen,
    rigid_outlier_distances,
)
from stiffness.calibration.selection import (
    MARGIN,
    Judge,
    Selected,
    SpatialFolds,
    selected,
    spatial_folds_of,
)
from stiffness.regression.empirical_bayes import learnt
from stiffness.regression.normal_equations import total_of
from stiffness.regression.testing import SIGNIFICANCE
from stiffness.robot.arm import Arm

# --- Residuals that grow with time ----------------------------------------------------

LEAST, ALPHA = 0.05, 1e-3
"""Minimum share of the residual that has to grow with time, and its p-value; chosen."""
FAINT = 1e-8
"""Singular value, relative to the largest, below which columns are dependent."""


@dataclass(frozen=True)
class DriftTerm:
    """An axis or a link whose parameters change with time."""

    where: str
    share: float


def drift_term(
    state: CalibrationState, residual: Float[np.ndarray, "rows coordinates"]
) -> DriftTerm | None:
    """Return the site whose drift explains most of the residual."""
    hours = state.readings.hours[:, None, None]
    every, rows = state.nuisance_jacobian(), residual.size
    entries = entries_of(state.standing.chain)
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
    """Return an orthonormal basis of the columns."""
    size = np.linalg.norm(a, axis=0)
    u, s, _ = np.linalg.svd(a / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return u[:, s > FAINT * max(s[0], 1e-300)]


# --- Residuals that neighbours have in common -----------------------------------------

FLIPS = 1999
POWER = 0.9


@dataclass(frozen=True)
class Agreement:
    """How alike residuals of neighbours are.

    Attributes:
        p_value: Of there being nothing but noise.
        share: Of the mean square that neighbours have in common.
        rms: Of the residuals, 3-D, in m.
        noise: What neighbours differ by, 3-D of one pose, in m.
        smallest: Rms of a common part that these data would have shown, in m.
    """

    p_value: float
    share: float
    rms: float
    noise: float
    smallest: float


def agreement(
    residual: Float[np.ndarray, "rows 3"], posture: Float[np.ndarray, "rows axes"]
) -> Agreement:
    """Compare residuals of poses that are each other's nearest."""
    found = KDTree(posture).query(posture, k=2)
    distance, near = (np.asarray(values) for values in found)
    a, b = np.arange(len(posture)), near[:, 1]
    closest = distance[:, 1] <= np.median(distance[:, 1])
    twice = (near[b, 1] == a) & (a > b)  # count a pair of mutual neighbours once
    a, b = a[closest & ~twice], b[closest & ~twice]
    product = np.sum(residual[a] * residual[b], axis=1)
    seen = float(product.mean())
    rng = np.random.default_rng(len(posture))
    beaten = 0
    for _ in range(FLIPS):
        sign = rng.choice([-1.0, 1.0], len(posture))
        beaten += bool(np.mean(sign[a] * sign[b] * product) >= seen)
    square = float(np.mean(np.sum(residual**2, axis=1)))
    noise2 = float(np.mean(np.sum((residual[a] - residual[b]) ** 2, axis=1)) / 2.0)
    reach = (norm.ppf(1.0 - SIGNIFICANCE) + norm.ppf(POWER)) / np.sqrt(3.0 * len(a))
    return Agreement(
        p_value=(1 + beaten) / (1 + FLIPS),
        share=seen / max(square, 1e-30),
        rms=float(np.sqrt(square)),
        noise=float(np.sqrt(noise2)),
        smallest=float(np.sqrt(noise2 * reach)),
    )


# --- Named effects --------------------------------------------------------------------


def named(
    chosen: Selected,
    estimates: Mapping[Key, Mapping[str, Interval]],
    waves: Mapping[str, Wave],
    regions: int,
) -> Iterator[Key]:
    """Yield the believed effects that are significant, the most important first."""
    tried = max(len({(s.key, s.parameters) for s in chosen.steps}), 1)
    tail = (1.0 - LEVEL) / 2
    wider = float(student.isf(tail / tried, regions - 1))
    wider /= float(student.isf(tail, regions - 1))
    for key, (loss, error) in sorted(chosen.budget.items(), key=lambda one: -one[1][0]):
        if loss <= MARGIN * error:
            continue
        if key[0] == "transmission_error":
            wave = waves.get(key[1])
            sure = loss > norm.isf(2.0 * tail / tried) * error
            if (
                wave is not None
                and wave.clear
                and (sure or wave.size > wider * wave.half)
            ):
                yield key
        elif any(_clear(e, wider) for e in estimates.get(key, {}).values()):
            yield key


def _clear(found: Interval, wider: float) -> bool:
    return bool(abs(found.estimate) > wider * (found.high - found.low) / 2.0)


# --- Lag or friction ------------------------------------------------------------------

TOLD = 0.5
"""Share of a lag that commanded angles have to show for it to be the report's; chosen:
most of it."""


def held_by_friction(
    estimates: Mapping[Key, Mapping[str, Interval]],
    told: Float[np.ndarray, " axes"],
) -> dict[Key, Key]:
    """Return the lags that are called hysteresis, with the new key.

    An axis that stops short of what it reports is wound up by its gear's friction, or
    its report leads: at rest the two look alike, and every gear has friction. Commanded
    angles that the report leads as well decide for the report. One that goes on beyond
    its report lags, or friction holds it after it swung back: `is_told` decides. What
    goes with an axis' share of the move is the report's: friction does not know how
    fast the axis arrived. How far each report lags behind its command is in rad, NaN
    where not recorded.
    """
    found = {}
    for effect, where in estimates:
        if effect == "reading_lag" and set(estimates[effect, where]) == {"lag_rad"}:
            lag = estimates[effect, where]["lag_rad"].estimate
            if lag < 0.0 and not is_told(lag, told[int(where[1:]) - 1]):
                found[effect, where] = ("hysteresis", where)
    return found


def is_told(lag: float, told: float) -> bool:
    """Return whether commanded angles show a lag: it is the report's, nothing else's.

    Without them the sides from which poses were reached tell only that an axis rests
    elsewhere after either move, of which friction is another cause. Both lags are in
    rad; the report's behind its command is NaN where not recorded.
    """
    return bool(told * np.sign(lag) > TOLD * abs(lag))


def mean_lag(sizes: Mapping[str, Interval], readings: Readings, axis: int) -> float:
    """Return the mean lag of an axis along its last moves, in rad.

    The axis counts from 0.
    """
    side, share = readings.moves.side[:, axis], readings.moves.share[:, axis]
    parts = {"lag_rad": np.abs(side), "share_lag_rad": side * share}
    return float(sum(sizes[n].estimate * np.mean(parts[n]) for n in sizes))


def _width(lag: Interval) -> Interval:
    return Interval(-2.0 * lag.estimate, -2.0 * lag.high, -2.0 * lag.low)


def _renamed(chosen: Selected, friction: Mapping[Key, Key]) -> Selected:
    """Return a selection in which some lags are called hysteresis."""

    def called(key: Key) -> Key:
        return friction.get(key, key)

    equivalents = {
        called(key): (key, *others) if key in friction else others
        for key, others in chosen.equivalents.items()
    }
    return replace(
        chosen,
        steps=tuple(
            replace(
                step,
                key=called(step.key),
                parameters=("width_rad",),
                values=tuple(-2.0 * v for v in step.values),
            )
            if step.key in friction and step.parameters == ("lag_rad",)
            else step
            for step in chosen.steps
        ),
        budget={called(key): loss for key, loss in chosen.budget.items()},
        equivalents=equivalents,
    )


# --- Calibration ----------------------------------------------------------------------

CHOOSING = 129
"""Order below which tables end during selection; afterwards they are fitted in full."""

WAVES = 5
"""Number of each table's largest harmonics that get an interval."""


@dataclass(frozen=True)
class Calibrated:
    """Result of a calibration; nothing was fitted to the regions kept back.

    Attributes:
        before: Nominal arm: tracker frame, target positions and springs fitted.
        springs: Stiffness of springs that the model has, in N m/rad, by axis: as
            fitted with the nominal geometry, without ends, and with the corrected one.
        estimates: Parameters with intervals, by effect and site; tables excepted.
        error_tables: Transmission errors, by axis.
        harmonics: Largest significant harmonic of each table, by axis.
        named: Effects that are believed and whose parameters differ significantly
            from zero, the most important first.
        nominal: Residual of the nominal arm, on all rows, in m; of 6D targets the
            orientation's follows, see `CalibrationState.residual`.
        residual: Residual after calibration, likewise.
        used: Effective number of coefficients per fitted coordinate.
        at_first: Spatial correlation of the residual before calibration.
        turns_at_first: Spatial correlation of the orientations' residual before it, in
            rad; None without 6D targets.
    """

    readings: Readings
    spatial_folds: SpatialFolds
    before: Geometry
    corrected_geometry: Geometry
    springs: tuple[dict[str, Interval], dict[str, Interval]]
    estimates: dict[Key, dict[str, Interval]]
    error_tables: dict[str, Table]
    harmonics: dict[str, Wave]
    selected: Selected
    named: tuple[Key, ...]
    nominal: Float[np.ndarray, "rows coordinates"]
    residual: Float[np.ndarray, "rows coordinates"]
    used: float
    at_first: Agreement
    at_last: Agreement
    turns_at_first: Agreement | None
    turns_at_last: Agreement | None

    @property
    def held(self) -> Bool[np.ndarray, " rows"]:
        """Mask of the rows kept back for the final test."""
        return self.spatial_folds.kept_back


SWEEPS = 3
"""Fits that look for outliers; chosen: each leaves out what the last found."""


def outlier_distances(readings: Readings) -> Float[np.ndarray, " rows"]:
    """Return how far outliers are from the freely fitted arm, in m; 0: none is.

    All effects at all sites are fitted, before anything is selected and any region
    kept back: what is far off beside them was not badly predicted. Each of at most
    `SWEEPS` fits leaves out what the one before found, first what is far from the rigid
    arm, and judges all readings anew.
    """
    size = rigid_outlier_distances(readings)
    sprung = _sprung(readings.arm)
    for _ in range(SWEEPS):
        keep = size == 0.0
        rigid = fitted(readings.take(keep), redraw=True)
        state = CalibrationState.of(readings, rigid.geometry)
        blocks = Blocks.of(rigid, state, candidates_of(state, CHOOSING), sprung)
        every = set(zip(blocks.owner, blocks.parameter, strict=True))
        free = final_fit(readings, keep, rigid, every, sprung, CHOOSING, {})
        size = far_from(readings, free.residual)
        if np.array_equal(size > 0.0, ~keep):
            break
    return size


def calibrated(
    readings: Readings,
    spatial_folds: SpatialFolds,
    said: Callable[[str], object] = lambda _: None,
    highest: int = ORDERS[-1],
) -> Calibrated:
    """Calibrate an arm on the regions that are not kept back.

    `said` receives a line on each effect that is believed; tables of transmission error
    end below the order `highest`. A table without a name is left out, and the rest is
    fitted anew, until all have one.
    """
    keep = ~spatial_folds.kept_back
    fit_on = readings.take(keep)
    sprung = _sprung(readings.arm)
    plain = fitted(fit_on, redraw=False)
    before = final_fit(readings, keep, plain, set(), sprung, highest, {})
    rigid = fitted(fit_on, redraw=True)
    state = CalibrationState.of(readings, rigid.geometry)
    some = candidates_of(state, min(CHOOSING, highest))
    blocks = Blocks.of(rigid, state, some, sprung)
    folds = normals_of(blocks, state, spatial_folds.fold, spatial_folds.count)
    stated = 1.0 / blocks.size**2
    fit, sizes = learnt(total_of(folds), blocks.band, stated)
    design = design_effects(blocks, folds, fit, sizes.noise)
    more = blocks.by_prior(design)
    _, sizes = learnt(total_of(folds), blocks.band, stated, more)
    chosen = selected(Judge(blocks, folds, sizes, stated, more), said)
    chosen = replace(chosen, not_seen=not_seen(fit_on, rigid))
    said("drawing tables in full")
    wanted = {(blocks.owner[j], blocks.parameter[j]) for j in chosen.columns}
    del folds
    if not any(blocks.entry[j] >= 0 and blocks.owner[j] != SILENT
               for j in chosen.columns):  # fmt: skip
        rigid = RigidFit(before.corrected_geometry, rigid.kept)
    while True:
        after = final_fit(readings, keep, rigid, wanted, sprung, highest, design)
        result = _result(readings, spatial_folds, before, after, chosen)
        tables = {("transmission_error", axis) for axis in result.error_tables}
        if tables <= {*result.named}:
            return result
        wanted = {one for one in wanted if one[0] not in tables - {*result.named}}


def _result(
    readings: Readings,
    spatial_folds: SpatialFolds,
    before: FinalFit,
    after: FinalFit,
    chosen: Selected,
) -> Calibrated:
    """Return parameters with their intervals, names, and residuals."""
    keep = ~spatial_folds.kept_back
    numbers, waves = np.flatnonzero(after.order == 0), after.largest_waves(WAVES)
    asked = [numbers, *(w.ravel() for w in waves.values())]
    region = np.where(keep, spatial_folds.region, -1)
    half = after.spread(region, np.concatenate(asked))
    ends = np.cumsum([len(a) for a in asked])
    by_wave = zip(waves.items(), np.split(half, ends)[1:], strict=False)
    widths = dict(zip(numbers.tolist(), half.tolist(), strict=False))
    estimates = after.estimates(widths)
    clearest = {axis: after.wave(own, h.reshape(-1, 2)) for (axis, own), h in by_wave}
    count = len(np.unique(spatial_folds.region[keep]))
    friction = held_by_friction(estimates, readings.told_lag)
    estimates = {friction.get(k, k): v for k, v in estimates.items()}
    for key in friction.values():
        estimates[key] = {"width_rad": _width(estimates[key]["lag_rad"])}
    chosen = _renamed(chosen, friction)
    return Calibrated(
        readings=readings,
        spatial_folds=spatial_folds,
        before=before.corrected_geometry,
        corrected_geometry=after.corrected_geometry,
        springs=(
            before.springs(readings.arm.stiffness, {}),
            after.springs(readings.arm.stiffness, widths),
        ),
        estimates=estimates,
        error_tables=after.error_tables(),
        harmonics=clearest,
        selected=chosen,
        named=tuple(named(chosen, estimates, clearest, count)),
        nominal=before.residual,
        residual=after.residual,
        used=after.used,
        at_first=agreement(before.residual[:, :3], readings.posture),
        at_last=agreement(after.residual[~keep, :3], readings.posture[~keep]),
        turns_at_first=_turn_agreement(readings, before.residual),
        turns_at_last=_turn_agreement(readings.take(~keep), after.residual[~keep]),
    )


def _turn_agreement(
    readings: Readings, residual: Float[np.ndarray, "rows coordinates"]
) -> Agreement | None:
    turned = readings.turned(residual)
    if turned is None:
        return None
    seen = np.isfinite(turned[:, 0])
    return agreement(turned[seen], readings.posture[seen]) if seen.any() else None


@threadpool_limits.wrap(limits=1, user_api="blas")
def calibrate(
    recording: Recording,
    arm: Arm,
    draw: int = 0,
    said: Callable[[str], object] = lambda _: None,
) -> Calibrated:
    """Calibrate an arm on absolute positions without a load.

    Args:
        recording: Only its unloaded rows are used.
        arm: The nominal arm.
        draw: Which regions are held out; see `spatial_folds_of`.
        said: Callback that receives a line on each effect that is believed.

    Raises:
        Unusable: Where the recording does not allow a calibration.
    """
    readings = readings_of(recording, arm.for_recording(recording))
    return calibrated(readings, spatial_folds_of(readings, draw), said)


def _sprung(arm: Arm) -> set[Key]:
    """Return the springs of the model; their stiffness is a nuisance parameter."""
    springs = enumerate(arm.stiffness)
    return {("joint_compliance", f"a{k + 1}") for k, s in springs if s > 0.0}
