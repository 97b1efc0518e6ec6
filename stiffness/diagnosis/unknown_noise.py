"""Noise that nothing states: of readings, of axes, of gears that arrive anyhow.

==========  ==========================================================================
Equation    y_v = ... + U_v a_v, a_v ~ N(0, 1): turns U_v of a visit that a gear makes
            by the state in which it arrives, z(s) - mean_s z(s) for each of its states
            s as likely one as the other; asked for where the log Bayes factor of what
            a set leaves, with U_v over without, is beyond `UNTOLD` and above that with
            `SMALLER` U_v
Source      moments of a discrete state, random effects of visits (Laird and Ware 1982,
            "Random-effects models for longitudinal data")
Valid       states that differ from visit to visit; a set that is found without them
Ignores     that one visit's state follows from that of the visit before
==========  ==========================================================================

How far readings miss the fitted nominal arm, and how far noise alone would.

==========  ==========================================================================
Equation    rms^2 = sum |d - mean d|^2 / readings + mean |m|^2, d what rows of a visit
            leave of a marker, m what its visits' means leave; by noise: mean tr S /
            frames (readings - visits) / readings + mean tr D^-1, S of one frame, D of
            `Whitening`
Source      definition; the two are orthogonal parts of the same readings
Valid       markers that were seen
Ignores     what the fit of the nominal takes of the noise; how axes return and the
            wrench errs
==========  ==========================================================================
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from bench.shared.errors import Warned
from stiffness.diagnosis.between_visit import mean_squares_of, residuals_of_means
from stiffness.diagnosis.detection import FEWEST_POSES, After, DetectionTest
from stiffness.diagnosis.model_fit import ModelFit, ModelTerm, SelectionProblem
from stiffness.diagnosis.nominal_fit import Prepared, axis_scatter
from stiffness.experiment.outliers import SHOWN
from stiffness.experiment.residuals import shares_of
from stiffness.experiment.sensor_noise import ODD, measured_noise_text, no_finer
from stiffness.experiment.visits import UNKNOWN
from stiffness.robot.kinematics import point_jacobian

# --- States of gears at arrival -------------------------------------------------------

UNTOLD = 10.0
"""Log Bayes factor from which gears arrive in states that nothing tells; chosen: as
`NOT_ALIKE` of names."""
SMALLER = 0.3
"""States over those of a gear that comes from either side, than which theirs have to be
likelier; chosen: what another form of the law does is a few percent of it."""


def unknown_arrivals(
    case: SelectionProblem, left: After, fit: ModelFit
) -> tuple[dict[int, Float[np.ndarray, "rows states"]], tuple[ModelTerm, ...]]:
    """Return turns by gears' states at arrival that nothing tells, and the set so.

    Args:
        case: What was looked at; poses held out are not asked.
        left: What the set leaves.
        fit: The set.

    Returns:
        Turns of each such axis, one sigma a column, in rad; the set's members without
        generic terms, those of such gears with the memory `UNKNOWN`.
    """
    found: dict[int, np.ndarray] = {}
    data, members = left.data, []
    asked = np.flatnonzero(~case.split.held_out[data.visits.posture_index])
    for member, size in zip(fit.members, fit.coefficients, strict=True):
        own = (case.situation, member.where, member.shape, size)
        shape = member.shape.copy()
        for k, turned in member.hypothesis.arrival_turns(*own).items():
            turns = data.visits.gather(turned)
            least = max(UNTOLD, data.within.log_bayes_of(k, SMALLER * turns, asked))
            if data.within.log_bayes_of(k, turns, asked) > least:
                found[k] = turned
                shape[member.hypothesis.shape_names.index("memory")] = UNKNOWN
        if not member.is_generic:
            members.append(replace(member, shape=shape))
    return found, tuple(members)


def arrives_unknown(member: ModelTerm) -> bool:
    """Return whether a member's law is that of a gear whose states nothing tells."""
    named = dict(zip(member.hypothesis.shape_names, member.shape, strict=False))
    return bool(named.get("memory") == UNKNOWN)


# --- Scatter of readings and axes -----------------------------------------------------

MUCH_FINER = 0.5
"""The same below which it is the tracker's, whatever the force sensor does; chosen."""


def noise_ratio_of(
    prepared: Prepared, last: DetectionTest, named: bool, unstated: bool
) -> float:
    """Return by what noise is to grow for what fits no law; one: by nothing.

    Marks of one body measure noise: scatter beyond it is a finding, and noise only
    where names are judged. A noise that is only stated is a lower bound, one that is
    not stated is none.

    Args:
        prepared: The recording against its nominal model.
        last: Test of the residual of the set, or of everything where none was selected.
        named: Whether a set was selected.
        unstated: Whether no noise is stated.
    """
    ratio = _ratio_of_scatter(prepared, last)
    if prepared.degrees_of_freedom:
        return ratio if named and last.is_overdispersed else 1.0
    smaller = unstated and 0.0 < ratio < 1.0 / ODD
    if smaller:
        readings = prepared.readings
        return no_finer(ratio, readings.weight, readings.inverse)
    return ratio if ratio > ODD else 1.0


def _ratio_of_scatter(prepared: Prepared, last: DetectionTest) -> float:
    """Return what scatter along no law is over noise; of 6D targets, one at least.

    Points of a 6D target share its noise and scatter by less than as many marks.
    """
    shared = np.any(shares_of(prepared.situation.recording) != 1.0)
    return max(last.noise_ratio, 1.0) if shared else last.noise_ratio


def smaller_noise(prepared: Prepared, last: DetectionTest) -> float:
    """Return noise over the one it was held for, where it is smaller; one elsewhere.

    Of too few poses to judge scatter by, what laws fitted to them leave is less.
    """
    ratio, measured = _ratio_of_scatter(prepared, last), last.scatter.dispersion > 0.0
    return ratio if measured and 0.0 < ratio < 1.0 / ODD else 1.0


CLEARLY = 3.0
"""Scatter of an axis over the most that a data sheet allows from which it is a finding;
chosen."""
BESIDE_ANOTHER = 0.5
"""The same over that of the axis that scatters most; chosen: what others seem to do
beside it may be its own."""
MOST_SCATTER = 100.0
"""The most that is taken for scatter and not for a law, over the same; chosen."""


def scattering_axes(prepared: Prepared, left: After) -> Float[np.ndarray, " axes"]:
    """Return one sigma of axes that miss their angles after no law; zero for others.

    The teeth of a gear make an error of hundreds of periods in a turn, which no poses
    tell from chance.

    Args:
        prepared: The recording against its nominal model.
        left: What a set leaves of it.
    """
    none = np.zeros_like(prepared.pose_repeatability)
    if left.data.between is None:
        return none
    trend = np.ones((len(left.data.between.residual), 1))
    own = (prepared.situation, left.data.between, trend)
    found, least = axis_scatter(*own, MOST_SCATTER), axis_scatter(*own)
    beyond = np.divide(found, least, out=none.copy(), where=least > 0.0)
    clear = beyond > max(CLEARLY, BESIDE_ANOTHER * float(beyond.max()))
    return np.where(clear, np.hypot(found, prepared.pose_repeatability), none)


def reading_noise(prepared: Prepared) -> float:
    """Return one sigma of a frame's coordinates as they are judged, in m."""
    return float(np.sqrt(np.trace(np.linalg.inv(prepared.readings.inverse)) / 3.0))


def scatter_of_readings(noise_rms: float, ratio: float) -> float | None:
    """Return the rms of a reading that was taken for noise, in m; None without.

    Args:
        noise_rms: What noise as it is judged now leaves, in m.
        ratio: That noise over the one before.
    """
    return noise_rms * float(np.sqrt(1.0 - ratio**-2.0)) if ratio > 1.0 else None


def noise_text(
    prepared: Prepared,
    last: DetectionTest,
    scatter: float | None,
    ratio: float,
    unstated: bool,
) -> str:
    """Return what is said of a noise that scatter shows; empty: it is as it was held.

    Args:
        prepared: The recording with the noise that names were judged against.
        last: The last test under it.
        scatter: As `scatter_of_readings` has it.
        ratio: That noise over the one before.
        unstated: Whether no noise is stated.
    """
    sigma, now = 1e3 * reading_noise(prepared), smaller_noise(prepared, last)
    if scatter is not None:
        return (
            f"{1e3 * scatter:.3g} mm rms of a reading fit no law and were taken for "
            f"noise, now {sigma:.3g} mm a coordinate, {ratio:.2f} times what it was "
            "held for; names are judged against that."
        )
    if ratio < 1.0:
        return f"the tracker's noise is not stated; readings scatter by {sigma:.3g} mm."
    if unstated or prepared.degrees_of_freedom or now == 1.0:
        return ""
    sure = now < MUCH_FINER or prepared.situation.recording.wrench is None
    stated = "noise" if sure else "noise of tracker or force sensor"
    return (
        f"the stated {stated} cannot be true: readings scatter {now:.2f} times as "
        f"much, {now * sigma:.3g} mm; names are judged against the stated one."
    )


FEW = "few_poses"
"""Code of the remark that there are too few poses to test small effects."""


def data_warnings(prepared: Prepared) -> tuple[Warned, ...]:
    """Return what is remarkable but no mistake."""
    said = list(prepared.warnings)
    poses = int(prepared.situation.posture_index.max()) + 1
    if poses < FEWEST_POSES:
        text = (
            f"{poses} pose{'s' * (poses > 1)}: only what is far beyond noise can show; "
            f"bring {FEWEST_POSES} at least, forty to be told of small effects."
        )
        said.append(Warned(FEW, "rig", text))
    tracker = prepared.situation.recording.tracker
    if tracker is not None and tracker.is_stated and is_odd(prepared):
        readings = prepared.readings
        text = measured_noise_text(
            prepared.noise,
            float(np.sqrt(np.mean(tracker.repeatability**2))),
            prepared.degrees_of_freedom,
            no_finer(0.0, readings.weight, readings.inverse) > 0.99,
        )
        said.append(Warned("noise_statement", "tracker", text))
    for k, gear in sorted(prepared.situation.gears.items()):
        if gear.unknown is not None:
            most = 1e6 * np.sqrt(np.sum(gear.unknown**2, axis=1).max())
            unit = "µm" if prepared.situation.arm.slides[k] else "µrad"
            text = (
                f"the gear of a{k + 1} arrives at each visit in a state that the "
                f"recording does not tell: what such states do, {most:.2g} {unit} at "
                "most (one sigma), counts as noise."
            )
            said.append(Warned("unknown_arrival", f"a{k + 1}", text))
    wander = prepared.situation.wander
    if np.any(wander > 0.0):
        markers = prepared.situation.recording.markers
        which = [m.name for m, one in zip(markers, wander, strict=True) if one > 0.0]
        many = f"{len(which)} of {len(markers)} marks wander"
        names = ", ".join(which[:SHOWN]) + (", …" if len(which) > SHOWN else "")
        text = (
            f"{many} on their bodies over hours along no law, by up to "
            f"{1e6 * np.sqrt(wander.max()):.2g} µm a coordinate (one sigma): {names}. "
            "That counts as noise, and no slip is asked for of them."
        )
        said.append(Warned("wandering_marks", "tracker", text))
    if prepared.downweighted:
        count = len(prepared.downweighted)
        text = f"{count} readings lie beyond the noise and counted less."
        said.append(Warned("downweighted", "tracker", text))
    for k in prepared.blind:
        text = f"the stiffness of a{k + 1} cannot be seen and was left at the model's."
        said.append(Warned("not_identifiable", f"a{k + 1}", text))
    return tuple(said)


def is_odd(prepared: Prepared) -> bool:
    """Return whether noise is clearly another than the one it was held for."""
    return not 1.0 / ODD <= prepared.noise <= ODD


# --- Rms of the nominal fit -----------------------------------------------------------


@dataclass(frozen=True)
class RmsSummary:
    """3-D rms of a reading.

    Attributes:
        rms: What the fitted nominal arm leaves, in m.
        noise: What the tracker's errors alone would leave, in m.
        within: `rms` of differences within visits, each marker's mean taken off, in m.
        noise_within: `noise` of these, in m.
    """

    rms: float
    noise: float
    within: float
    noise_within: float


@dataclass(frozen=True)
class HeldOut:
    """3-D rms of a reading over the poses held out, of the fitted nominal arm.

    Attributes:
        within: Of differences within visits, each marker's mean taken off, in m.
        whole: With what means of visits leave; NaN where they are not compared.
    """

    within: float
    whole: float


def held_out_misfit(prepared: Prepared, case: SelectionProblem) -> HeldOut:
    """Return how far the fitted nominal arm misses the poses held out; NaN without.

    Args:
        prepared: The recording against its nominal model.
        case: The same with springs as the readings have them.
    """
    rows = case.split.held_out[prepared.data.visits.posture_index]
    apart, seen = _apart(prepared, case)
    if not (count := int(seen[rows].sum())):
        return HeldOut(np.nan, np.nan)
    square, whole = float(np.sum(apart[rows] ** 2)) / count, np.nan
    between = case.data.between
    if between is not None:
        left, shown = residuals_of_means(between)
        if shown[rows].any():
            means = np.sum(left[rows][shown[rows]] ** 2, axis=1)
            whole = float(np.sqrt(square + np.mean(means)))
    return HeldOut(float(np.sqrt(square)), whole)


def rms_summary(prepared: Prepared, case: SelectionProblem) -> RmsSummary:
    """Return how far readings miss the arm with its springs as they were fitted.

    Args:
        prepared: The recording against its nominal model.
        case: The same with springs as the readings have them.
    """
    within, noise_within = rms, noise = _within(prepared, case)
    if case.data.between is not None:
        share = shares_of(prepared.situation.recording)
        more, by_noise = mean_squares_of(case.data.between, share)
        rms, noise = rms + more, noise + by_noise
    squares = (rms, noise, within, noise_within)
    return RmsSummary(*(float(np.sqrt(square)) for square in squares))


def _within(prepared: Prepared, case: SelectionProblem) -> tuple[float, float]:
    """Return mean squares of differences within visits, and by noise; 0 without."""
    apart, seen = _apart(prepared, case)
    count, freedom = int(seen.sum()), int(np.maximum(seen.sum(axis=1) - 1, 0).sum())
    if not freedom:
        return 0.0, 0.0
    one = np.trace(np.linalg.inv(prepared.readings.inverse))
    share = np.broadcast_to(shares_of(prepared.situation.recording), seen.shape)
    by_noise = one * np.mean(share[seen] / _reading_weights(prepared)[seen])
    return float(np.sum(apart**2)) / count, float(by_noise) * freedom / count


def _apart(
    prepared: Prepared, case: SelectionProblem
) -> tuple[
    Float[np.ndarray, "visits longest markers 3"],
    Bool[np.ndarray, "visits longest markers"],
]:
    """Return residuals less their mean over each visit, and which were seen."""
    left = np.nan_to_num(prepared.readings.value) - _softer(prepared, case)
    seen = _reading_weights(prepared) > 0
    values = np.where(seen[..., None], prepared.data.visits.gather(left), 0.0)
    mean = values.sum(axis=1) / np.maximum(seen.sum(axis=1), 1)[..., None]
    return np.where(seen[..., None], values - mean[:, None], 0.0), seen


def _reading_weights(prepared: Prepared) -> Float[np.ndarray, "visits longest markers"]:
    visits = prepared.data.visits
    return visits.gather(prepared.readings.weight) * visits.counts[..., None]


def _softer(
    prepared: Prepared, case: SelectionProblem
) -> Float[np.ndarray, "rows markers 3"]:
    """Return how markers move as springs are not those that were prepared."""
    situation = prepared.situation
    change = case.situation.compliance - situation.compliance
    twist = situation.screw * (situation.torque * change)[..., None]
    carried = situation.carried[1:, prepared.readings.body].astype(float)
    expected = np.nan_to_num(prepared.readings.point - prepared.readings.value)
    of_marker = np.einsum("rki,km->rmi", twist, carried)
    return np.einsum("rmij,rmj->rmi", point_jacobian(expected), of_marker)
