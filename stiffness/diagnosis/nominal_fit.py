"""Nominal fit: joint compliance, tracker frame, marker positions and their priors.

Where the tracker stands and the markers sit is unknown, and is no finding.

==========  ==========================================================================
Equation    columns: [1, -p x] for the tracker, R_b for a marker's place, smooth
            functions for the tracker's field; prior sigmas as below
Source      the rules of what counts as nominal: given places within 1 mm, an unstated
            frame, a stated volumetric error
Valid       absolute readings
Ignores     a stated frame that is wrong: that is a finding
==========  ==========================================================================

Every reading counts once: within its visit for the load, in its mean for the rest.

Within visits and between them are orthogonal parts of the same readings. Where a
marker was not seen, its mean is completed by the motion of its body.

Some visits are enough to learn nearly where everything is and how it bends.

A recording is made ready once: the nominal is fitted, the noise is checked.

Nuisances are the tracker's frame where it is not stated, the markers' places, and
the stiffness of every axis that has a spring in the model; of all axes, where the model
states none and the load was measured. Everything else competes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from bench.shared.errors import Unusable, Warned
from bench.shared.recording import Recording
from stiffness.diagnosis.between_visit import BetweenVisitModel, NuisanceJacobian
from stiffness.diagnosis.noise_model import (
    checked,
    induced_rotations,
    max_pose_repeatability,
    pose_repeatability_of,
    rest_of,
    rigid_motion,
    smooth_basis,
    trend_of,
    wander_of,
    whole_visit_errors,
    with_noise_between_poses,
)
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    normal_equations_of,
)
from stiffness.diagnosis.within_visit import WithinVisitModel
from stiffness.effects.base import axes_of
from stiffness.effects.design_matrix import DesignMatrix, design_matrix_of
from stiffness.effects.jacobian import EffectJacobian, turn
from stiffness.experiment.residuals import (
    Residuals,
    bodies_of,
    expected,
    rigid_groups,
    seen_in_base,
    weight_of,
)
from stiffness.experiment.sensor_noise import no_finer
from stiffness.experiment.static_state import StaticState, static_state_of
from stiffness.experiment.visits import Visits, mean_of, visits_of
from stiffness.robot.arm import Arm
from stiffness.robot.kinematics import point_jacobian
from stiffness.robot.tracker_frame import (
    MARKER_POSITION_SIGMA,
    TrackerFit,
    initial_tracker_frame,
)

# --- Nuisance parameters --------------------------------------------------------------

FREE = 1.0
"""One sigma of what is not known at all, in m or rad."""


def nuisance_parameters(
    situation: StaticState,
    visits: Visits,
    point: Float[np.ndarray, "visits markers 3"],
    field: bool,
) -> NuisanceJacobian:
    """Return columns of what is unknown, and their prior sigmas.

    Args:
        situation: Where the arm stood.
        visits: How rows lie side by side.
        point: Where the markers are.
        field: Whether the tracker's smooth error is among them, where it is stated.
    """
    recording = situation.recording
    count, markers = point.shape[:2]
    frame = np.zeros((count, markers, 3, 0))
    if recording.base_from_tracker is None:
        frame = point_jacobian(point)
    places = [
        np.full(3, FREE if marker.position is None else MARKER_POSITION_SIGMA)
        for marker in recording.markers
    ]
    first = visits.row[:, 0]
    axes = {m.body: axes_of(situation, m.body)[first] for m in recording.markers}
    turn = np.stack([axes[m.body] for m in recording.markers], axis=1)
    tracker = recording.tracker
    waves, rest = np.zeros((count, markers, 0)), np.zeros((count, markers))
    if field and tracker is not None and tracker.volumetric:
        waves = smooth_basis(point.reshape(-1, 3), tracker.volumetric)
        waves = waves.reshape(count, markers, -1)
        rest = rest_of(waves, tracker.volumetric)
    sigma = [np.full(frame.shape[3], FREE), *places, np.ones(3 * waves.shape[2])]
    return NuisanceJacobian(frame, turn, waves, rest, np.concatenate(sigma))


def frames_after(
    frames: TrackerFit,
    between: BetweenVisitModel,
    columns: DesignMatrix,
    step: Float[np.ndarray, " columns"],
    known: bool,
) -> TrackerFit:
    """Move frame and places to where they are estimated.

    Args:
        frames: As they were when `between` was made.
        between: What the means say of them.
        columns: What else was fitted.
        step: How much of it.
        known: Whether the tracker's frame is stated.
    """
    moved = between.nuisance_estimate
    if columns.count:
        moved = moved - between.nuisance_coefficients(columns) @ step
    markers = len(frames.marker_positions)
    first = 0 if known else 6
    twist = np.zeros(6) if known else moved[:6]
    place = moved[first : first + 3 * markers].reshape(markers, 3)
    return frames.displaced(twist, place)


# --- Reduction to sufficient statistics -----------------------------------------------

DECADES = 10.0
"""Fitted compliances may be this many times the model's (one sigma of their prior):
stiffness is nominal over at least a decade either way."""


def blocks(
    situation: StaticState,
    visits: Visits,
    readings: Residuals,
    pose_repeatability: Float[np.ndarray, " axes"] | None,
    field: bool = True,
) -> tuple[SufficientStatistics, Float[np.ndarray, " axes"]]:
    """Compress readings to what they say within visits and between them.

    Args:
        situation: Where the arm stood.
        visits: How rows lie side by side.
        readings: The residuals.
        pose_repeatability: One sigma of the axes' arrival, in rad; None: estimated.
        field: Whether the tracker's smooth error is to be reckoned with.

    Returns:
        Both blocks, and the arrival.
    """
    weight = visits.gather(readings.weight) * visits.counts[..., None]
    values = np.nan_to_num(visits.gather(readings.value))
    expected = readings.point - readings.value  # lever arms end where the model says
    point = mean_of(visits.gather(expected), weight)
    screw = visits.gather(situation.screw)
    errors = induced_rotations(situation, visits)
    within = WithinVisitModel.of(
        values,
        weight,
        readings.inverse,
        point,
        readings.body,
        (situation.carried, screw, errors),
    )
    count, longest, _ = weight.shape
    axes = screw.shape[2]
    if situation.recording.displacement == "relative":
        return SufficientStatistics(visits, within, None), np.zeros(axes)
    fitted, _, _ = rigid_motion(values, weight, readings.inverse, point, readings.body)
    complete = np.where((weight > 0)[..., None], values, fitted)
    seen = weight.max(axis=2)
    share = seen / np.maximum(seen.sum(axis=1, keepdims=True), 1e-12)
    mean = np.einsum("vr,vrmi->vmi", share, complete)
    carried = situation.carried[:, readings.body]
    turned = BetweenVisitModel.turned(point_jacobian(point), screw, carried)
    shared = errors.reshape(count, axes, longest, -1).mean(axis=2)
    shared = shared[..., : whole_visit_errors(situation)]
    precision = weight.sum(axis=1)[..., None, None] * readings.inverse
    nuisance = nuisance_parameters(situation, visits, point, field)
    more = nuisance.rest + situation.wander
    if np.any(more > 0.0):
        precision = _with_noise(precision, more)
    place = (point, share, carried, screw)
    if pose_repeatability is None:
        silent = BetweenVisitModel.of(mean, precision, turned @ shared, nuisance, place)
        first = visits.row[:, 0]
        state = (situation.rest, situation.torque, situation.recording.time)
        trend = trend_of(*(values[first] for values in state))
        pose_repeatability = axis_scatter(situation, silent, trend)
    induced = np.concatenate([turned * pose_repeatability, turned @ shared], axis=2)
    between = BetweenVisitModel.of(mean, precision, induced, nuisance, place)
    return SufficientStatistics(visits, within, between), pose_repeatability


def axis_scatter(
    situation: StaticState,
    means: BetweenVisitModel,
    trend: Float[np.ndarray, "visits terms"],
    factor: float = 1.0,
) -> Float[np.ndarray, " axes"]:
    """Return one sigma of the axes' arrival, at most a factor of the largest."""
    turned = BetweenVisitModel.turned(means.lever, means.screw, means.carries)
    lever = means.whitening.white(turned)
    largest = factor * max_pose_repeatability(situation)
    return pose_repeatability_of(means.residual[..., 0], lever, trend, largest)


def _with_noise(
    precision: Float[np.ndarray, "visits markers 3 3"],
    variance: Float[np.ndarray, "visits markers"],
) -> Float[np.ndarray, "visits markers 3 3"]:
    """Return inverse covariances with more noise of each marker; 0 = not seen stays."""
    return np.linalg.solve(np.eye(3) + variance[..., None, None] * precision, precision)


def spring_columns(situation: StaticState, springs: np.ndarray) -> list[EffectJacobian]:
    """Return what more compliance of each axis does."""
    return [turn(int(k), situation.torque[:, k]) for k in springs]


def spring_step(
    situation: StaticState,
    data: SufficientStatistics,
    springs: np.ndarray,
) -> tuple[Float[np.ndarray, " springs"], Float[np.ndarray, " springs"]]:
    """Return the best change of each compliance and its standard deviation.

    Args:
        situation: Where the arm stood.
        data: Both blocks.
        springs: The axes, each with a spring in the model.
    """
    model = 1.0 / situation.arm.stiffness[springs]
    return _step(situation, data, springs, model, model)


def _step(
    situation: StaticState,
    data: SufficientStatistics,
    springs: np.ndarray,
    mean: Float[np.ndarray, " springs"],
    unit: Float[np.ndarray, " springs"],
) -> tuple[Float[np.ndarray, " springs"], Float[np.ndarray, " springs"]]:
    """Return `spring_step` under a prior about `mean`, of `DECADES` units."""
    fold = np.zeros(data.visits.poses(), dtype=int)
    found = normal_equations_of(data, spring_columns(situation, springs), fold)
    gram, score = found.gram[0], found.score.sum(axis=0)
    prior = (DECADES * unit) ** -2.0
    inner = (gram + np.diag(prior)) * unit * unit[:, None]
    ask = unit * (score + prior * (mean - situation.compliance[springs]))
    step = unit * np.linalg.solve(inner, ask)
    return step, unit * np.sqrt(np.diag(np.linalg.inv(inner)))


# --- Fit to some visits ---------------------------------------------------------------

ROUNDS = 3
"""How often springs and frames are fitted at the equilibrium that they imply; chosen:
each gains a factor of a hundred."""
FEW = 30
"""Visits that these rounds look at; chosen for time, the last step takes them all."""
LEAST, GREATEST = 0.02, 50.0
"""Bounds of a compliance over the model's; chosen: well over a decade either way."""
BLIND = 1.0
"""A compliance whose sigma is above this share of the model's own is left nominal."""


@dataclass(frozen=True)
class FirstFit:
    """A good start.

    Attributes:
        frames: Tracker and markers.
        compliance: Of each axis, in rad/(N m).
    """

    frames: TrackerFit
    compliance: Float[np.ndarray, " axes"]


def first_fit(recording: Recording, arm: Arm) -> FirstFit:
    """Fit frames and springs to some visits, at the equilibrium that they imply.

    Args:
        recording: With markers and a tracker.
        arm: The nominal arm, with the recording's names.
    """
    some = _some(recording)
    compliance = model_compliance(arm)
    springs = np.flatnonzero(compliance > 0)
    model = compliance[springs]
    frames = initial_tracker_frame(arm, some, compliance)
    names, _ = bodies_of(arm, some)
    for _ in range(ROUNDS):
        situation = static_state_of(arm, some, compliance, names)
        visits = visits_of(situation.visit, situation.posture_index)
        readings = residuals_of(situation, frames)
        data, _ = blocks(situation, visits, readings, np.zeros(len(compliance)), False)
        step = np.zeros(0)
        if len(springs):
            step, sigma = spring_step(situation, data, springs)
            new = np.clip(compliance[springs] + step, LEAST * model, GREATEST * model)
            new = np.where(sigma > BLIND * model, model, new)
            step = new - compliance[springs]
            compliance = compliance.copy()
            compliance[springs] = new
        if data.between is not None:
            columns = design_matrix_of(spring_columns(situation, springs), visits.row)
            known = some.base_from_tracker is not None
            frames = frames_after(frames, data.between, columns, step, known)
    return FirstFit(frames, compliance)


def _some(recording: Recording) -> Recording:
    ids = np.unique(recording.visit)
    chosen = ids[:: max(1, len(ids) // FEW)]
    return recording.take(np.isin(recording.visit, chosen))


def model_compliance(arm: Arm) -> Float[np.ndarray, " axes"]:
    """Return the compliance of the model's own springs, 0 where rigid."""
    stiff = arm.stiffness
    return np.where(stiff > 0, 1.0 / np.where(stiff > 0, stiff, 1.0), 0.0)


def residuals_of(situation: StaticState, frames: TrackerFit) -> Residuals:
    """Return readings less where they should be, with the stated noise.

    Relative readings are counted from where a visit's first row should be.
    """
    recording = situation.recording
    assert recording.tracker is not None
    point, should = seen_in_base(recording, frames), expected(situation, frames)
    if recording.displacement == "relative":
        first = situation.steps[situation.visit, 0]
        point = point - frames.shift + should[first]
    inverse = (frames.turn / recording.tracker.repeatability**2) @ frames.turn.T
    _, body = bodies_of(situation.arm, recording)
    return Residuals(
        value=point - should,
        point=point,
        weight=weight_of(recording),
        inverse=inverse,
        body=body,
    )


# --- Springs that the model does not state --------------------------------------------

SOFTEST = 1e-3
"""Unit of a compliance of which nothing is stated, in rad/(N m) or m/N; its prior's
sigma is ten times as much. Chosen: a small arm's wrist has 1e-3."""
CLEAR = 3.0
"""Sigmas from which a compliance of which nothing is stated is told from none."""


def states_no_springs(recording: Recording, arm: Arm) -> bool:
    """Return whether all compliances are nominal because the model has none.

    So it is under a measured load. Where the model states the stiffness of some axes,
    a zero is the claim that the others are rigid.
    """
    return recording.wrench is not None and not np.any(arm.stiffness > 0)


def with_load_springs(recording: Recording, arm: Arm) -> Arm:
    """Return a rigid arm with the springs that its measured deflections show.

    They are fitted as one block, from a rigid start, to what rows of a visit differ
    by; an axis that this does not show is fitted to the means of visits too.

    Args:
        recording: With markers, a tracker and a measured wrench.
        arm: The nominal arm, with the recording's names, without any spring.

    Returns:
        The arm. Its springs are starts and scales: what other effects make look below
        zero has the same size, and what is not told from none that of its error. An
        axis stays rigid where that error is larger than all compliances that are told.
    """
    some, rigid = _some(recording), np.zeros(len(arm.axes))
    frames = initial_tracker_frame(arm, some, rigid)
    names, _ = bodies_of(arm, some)
    situation = static_state_of(arm, some, rigid, names)
    visits = visits_of(situation.visit, situation.posture_index)
    readings = residuals_of(situation, frames)
    data, _ = blocks(situation, visits, readings, rigid, False)
    axes, unit = np.arange(len(rigid)), np.full(len(rigid), SOFTEST)
    compliance = rigid.copy()
    for asked in (data, replace(data, between=None)):
        step, sigma = _step(situation, asked, axes, rigid, unit)
        size = np.abs(step)
        told = np.where(size > CLEAR * sigma, size, 0.0)
        most = [told[arm.slides == kind].max() for kind in arm.slides]
        seen = sigma < BLIND * np.array(most)
        compliance[seen] = np.maximum(size, CLEAR * sigma)[seen]
    none = np.zeros_like(compliance)
    stiffness = np.divide(1.0, compliance, out=none, where=compliance > 0)
    return replace(arm, stiffness=stiffness)


def springs_warning(springs: Sequence[int], axes: int) -> Warned:
    """Say which compliances a diagnosis fits as nominal though the model states none.

    Args:
        springs: The axes that are fitted, from 0.
        axes: How many the arm has.
    """
    text = "the model states no joint stiffness; "
    if not len(springs):
        text += "the load shows no compliance of an axis, and all stay rigid."
    else:
        whose = "all" if len(springs) == axes else f"{len(springs)} of {axes}"
        names = ", ".join(f"a{k + 1}" for k in springs)
        text += f"a diagnosis fits compliances of {whose} axes as nominal: {names}."
    return Warned("springs_fitted", "arm", text)


# --- Prepare --------------------------------------------------------------------------


@dataclass(frozen=True)
class Prepared:
    """A recording against its nominal model, ready for hypotheses.

    Attributes:
        situation: Where the arm stood under the fitted springs.
        data: What differences within visits and means of visits say.
        frames: Tracker and markers as fitted.
        readings: Residuals and their weights.
        springs: The axes whose compliance is fitted, from 0.
        blind: Axes with a spring that the data cannot see, left at the model's; and
            where it states none and others are fitted, the axes left rigid.
        sigma: Standard deviation of each fitted compliance, in rad/(N m).
        noise: Measured noise of a reading over the stated one; 1 where not measurable.
        degrees_of_freedom: How many contrasts that ratio rests on.
        downweighted: Readings (row, marker) that count less, and their size in sigma.
        pose_repeatability: One sigma of the axes' arrival, in rad.
        modelled: The compliance that the model states, in rad/(N m); 0 = rigid.
        warnings: What a reader should know of the fit.
    """

    situation: StaticState
    data: SufficientStatistics
    frames: TrackerFit
    readings: Residuals
    springs: tuple[int, ...]
    blind: tuple[int, ...]
    sigma: Float[np.ndarray, " springs"]
    noise: float
    degrees_of_freedom: int
    downweighted: tuple[tuple[int, int, float], ...]
    pose_repeatability: Float[np.ndarray, " axes"]
    modelled: Float[np.ndarray, " axes"]
    warnings: tuple[Warned, ...] = ()


def prepare(recording: Recording, arm: Arm) -> Prepared:
    """Fit what is nominal and say what the noise is.

    Args:
        recording: With markers.
        arm: The nominal arm, with the recording's names.

    Raises:
        Unusable: Where there is nothing to compare, with all reasons.
    """
    faults = []
    if recording.points is None or not np.isfinite(recording.points).any():
        faults.append("it has no marker that is seen; displacements are needed.")
    if recording.tracker is None:
        faults.append("the tracker's noise is unknown: give [sensors.tracker].")
    if faults:
        raise Unusable(f"Recording {recording.name!r}", faults)
    if not states_no_springs(recording, arm):
        return _prepared(recording, arm)
    found = _prepared(recording, soft := with_load_springs(recording, arm))
    if found.blind:  # what its model does not state is not left at a first guess
        seen = np.isin(np.arange(len(arm.axes)), found.springs)
        found = _prepared(recording, replace(soft, stiffness=soft.stiffness * seen))
    blind = sorted({*range(len(arm.axes))} - {*found.springs}) if found.springs else ()
    return replace(
        found,
        blind=tuple(blind),
        modelled=model_compliance(arm),
        warnings=(springs_warning(found.springs, len(arm.axes)),),
    )


def _prepared(recording: Recording, arm: Arm) -> Prepared:
    start = first_fit(recording, arm)
    names, body = bodies_of(arm, recording)
    situation = static_state_of(arm, recording, start.compliance, names)
    frames = start.frames
    situation = replace(situation, frames=frames)
    visits = visits_of(situation.visit, situation.posture_index)
    readings = residuals_of(situation, frames)
    groups = rigid_groups(recording, body)
    seen = (readings.value, readings.point, readings.weight, readings.inverse)
    check = checked(visits, *seen, groups)
    check = with_noise_between_poses(
        check, situation, readings, frames.marker_positions, groups
    )
    noise = no_finer(check.noise, check.weight, readings.inverse)
    readings = replace(
        readings, weight=check.weight, inverse=readings.inverse / noise**2
    )
    wander = wander_of(situation, visits, readings, frames.marker_positions, groups)
    frames = replace(frames, wander=tuple(wander.tolist()))
    situation = replace(situation, frames=frames)
    data, arrival = blocks(situation, visits, readings, None)
    springs = np.flatnonzero(arm.stiffness > 0)
    _, sigma = spring_step(situation, data, springs)
    blind = sigma > BLIND / arm.stiffness[springs]
    return Prepared(
        situation=situation,
        data=data,
        frames=frames,
        readings=readings,
        springs=tuple(int(k) for k in springs[~blind]),
        blind=tuple(int(k) for k in springs[blind]),
        sigma=sigma[~blind],
        noise=noise,
        degrees_of_freedom=check.degrees_of_freedom,
        downweighted=check.downweighted,
        pose_repeatability=arrival,
        modelled=model_compliance(arm),
    )


def with_noise(
    prepared: Prepared,
    ratio: float,
    pose_repeatability: Float[np.ndarray, " axes"] | None = None,
) -> Prepared:
    """Return a recording with another noise of its readings, or of its axes.

    Args:
        prepared: The recording against its nominal model.
        ratio: The new noise over the present one.
        pose_repeatability: One sigma of the axes' arrival, in rad; None: estimated.
    """
    inverse = prepared.readings.inverse / ratio**2
    readings = replace(prepared.readings, inverse=inverse)
    visits = prepared.data.visits
    data, arrival = blocks(prepared.situation, visits, readings, pose_repeatability)
    return replace(
        prepared,
        data=data,
        readings=readings,
        sigma=prepared.sigma * ratio,
        noise=prepared.noise * ratio,
        pose_repeatability=arrival,
    )
