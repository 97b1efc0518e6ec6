"""Relinearisation about the effects that were selected.

==========  ==========================================================================
Equation    y = f(c0) + (c1 - c0) df/dc + c1 (t' - t) + (c - c1) df/dc' + sizes x
            columns'; df/dc and the axes' torques t as prepared, what is dashed at the
            compliance c1, where the arm rests under what was named in the round before,
            and under the masses, the curved springs, the torques of laws beside springs
            and the wrench that were found there
Source      Gauss-Newton in springs, fixed point in loads: these turn what gives way,
            whose columns then hold the product of both; a sensor that the arm turns
            reads the same wrench, along other axes; Gauss-Newton in offsets and links'
            ends k: y - f(k0) + k0 df/dk, f of the arm as k0 says, for y
Valid       turns of an axis beyond its springs' up to some tens of mrad
Ignores     what bearings, links and the base turn the sensor; what else changes the
            pull on springs: a rope's friction
==========  ==========================================================================
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from bench.shared.recording import Recording
from stiffness.diagnosis.detection import MEASURED, MISSTATED
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    training,
)
from stiffness.diagnosis.nominal_fit import (
    Prepared,
    blocks,
    prepare,
)
from stiffness.diagnosis.sufficient_statistics import (
    SufficientStatistics,
    normal_equations_of,
)
from stiffness.effects.base import Hypothesis
from stiffness.effects.candidates import Library, library_of
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.geometry_error import GeometryError
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    JacobianBlock,
    JointRotation,
    MarkerDisplacement,
    added,
    mixture,
)
from stiffness.effects.statics import springs_of, wind_up
from stiffness.experiment.residuals import expected
from stiffness.experiment.static_state import (
    LINEAR,
    Law,
    StaticState,
    moved_to,
    rest_of,
    screw_of,
    static_state_of,
)
from stiffness.experiment.visits import held_at_mean
from stiffness.regression.normal_equations import solve
from stiffness.regression.splits import Split, seed_of, split_of
from stiffness.robot.arm import Arm
from stiffness.robot.chain import corrected_chain, link_error_of
from stiffness.robot.kinematics import point_jacobian

MOVED = 0.03
"""Share by which a compliance or a load may change under names before all columns are
laid out anew; chosen: what a load or a mass winds up goes with it, and sizes are said
to some per cent."""
ROUNDS = 2
"""How often it is asked what laws of a gear leave to each other; chosen: a third round
moves a hundredth of the first."""
TINY = 1e-9
"""A load in N or N m that is none; chosen."""
SMALL_TURN = 1e-4
"""Turn in rad by which slopes of torques are taken; chosen: as a load winds up."""


def build_problem(
    prepared: Prepared,
    hypotheses: Sequence[Hypothesis],
    softer: Float[np.ndarray, " springs"] | None = None,
    named: ModelFit | None = None,
) -> SelectionProblem:
    """Lay out everything that naming looks at.

    Args:
        prepared: The recording against its nominal model.
        hypotheses: What may be named.
        softer: By how much each fitted compliance is another than prepared, in rad/(N
            m); None: as the data say where nothing is named.
        named: What pulls at the arm beyond the model; None: nothing.
    """
    case = nominal_problem(prepared, softer, named)
    library = library_of(case.situation, case.springs, hypotheses)
    return replace(case, library=library)


def nominal_problem(
    prepared: Prepared,
    softer: Float[np.ndarray, " springs"] | None = None,
    named: ModelFit | None = None,
) -> SelectionProblem:
    """Lay out the nominal columns alone, under what `build_problem` takes."""
    recording = prepared.situation.recording
    split = split_of(recording)
    data, situation = linearised(prepared, split, softer, named)
    springs = springs_of(situation, prepared.springs)
    return SelectionProblem(
        data,
        situation,
        prepared.springs,
        Library(springs, len(springs)),
        split,
        seed_of(recording),
        MEASURED if prepared.degrees_of_freedom else MISSTATED,
        named,
    )


def linearised(
    prepared: Prepared,
    split: Split,
    softer: Float[np.ndarray, " springs"] | None = None,
    named: ModelFit | None = None,
) -> tuple[SufficientStatistics, StaticState]:
    """Return readings and static state under the springs and loads that were found.

    Args:
        prepared: The recording against its nominal model.
        split: Which poses may be looked at.
        softer: As in `build_problem`.
        named: As in `build_problem`.
    """
    springs = springs_of(prepared.situation, prepared.springs)
    if softer is None:
        evidence = normal_equations_of(prepared.data, springs, training(split))
        softer = solve(evidence.gram.sum(axis=0), evidence.score.sum(axis=0))
    data, stands = moved_under(prepared, softer, named)
    return data, stands if named is None else state_under(stands, named)


def moved_under(
    prepared: Prepared, softer: Float[np.ndarray, " springs"], named: ModelFit | None
) -> tuple[SufficientStatistics, StaticState]:
    """Return readings and state where the arm rests, before what effects make felt."""
    data, situation = prepared.data, prepared.situation
    springs = springs_of(situation, prepared.springs)
    if springs:
        moved = softened(prepared, softer)
        change = (moved - situation.compliance)[list(prepared.springs)]
        data = data.subtract(springs, change)
        situation = situation.with_compliance(moved)
    rest = rest_of(situation.arm, situation.recording, situation.compliance)
    if named is not None:
        rest += _turned(situation, named)
    stands = moved_to(situation, rest)
    wound = wind_up(situation, (stands.torque - situation.torque)[:, :, None])
    along_arcs = beyond_linear(prepared, stands)
    return data.subtract([wound, along_arcs], np.ones(2)), stands


def softened(
    prepared: Prepared, softer: Float[np.ndarray, " springs"]
) -> Float[np.ndarray, " axes"]:
    """Return compliances other than prepared, within a decade of these."""
    own, moved = list(prepared.springs), prepared.situation.compliance.copy()
    moved[own] += _within_a_decade(softer, moved[own])
    return moved


def changes(case: SelectionProblem, prepared: Prepared, fit: ModelFit) -> bool:
    """Return whether a set changes springs or loads so that columns change with them.

    Args:
        case: As laid out.
        prepared: The recording against its nominal model.
        fit: The set.
    """
    return _change_by(case, prepared, fit) >= MOVED


def _turned(situation: StaticState, fit: ModelFit) -> Float[np.ndarray, "rows axes"]:
    """Return how far axes turn under what is named, in rad.

    What already holds the turned load, as an encoder's offset does, is left out, and
    what has no name: its columns are of the situation that it was fitted in.
    """
    angle = np.zeros_like(situation.rest)
    acting = state_under(situation, fit)
    for member, size in zip(fit.members, fit.coefficients, strict=True):
        if not (member.hypothesis.turns_load or member.is_generic):
            for part in member.jacobian(acting).parts:
                if isinstance(part, JointRotation):
                    angle[:, part.axis] += part.law @ size
    return angle


def beyond_linear(prepared: Prepared, stands: StaticState) -> EffectJacobian:
    """Return what marks move by beyond what lever arms say, where axes turned.

    A mark moves on a circle: by half the square of the turn towards the axis, which
    looks like a scale of the tracker. What the tracker's frame was turned to make up
    for is turned back.

    Args:
        prepared: Before they turned.
        stands: After.
    """
    situation, frames = prepared.situation, prepared.frames
    before, after = expected(situation, frames), expected(stands, frames)
    lever, moved = _point_jacobians(situation, before), after - before
    step = (stands.rest - situation.rest)[:, None, :, None]
    linear = _by_axes(prepared, lever, situation.screw) @ step
    turned = _frame_turns(prepared, lever, moved[None])[0]
    more = moved - linear[..., 0] + (moved + before @ turned / 2.0) @ turned
    return _column_of(more)


def slopes_beyond_linear(
    prepared: Prepared, stands: StaticState
) -> tuple[EffectJacobian, ...]:
    """Return what more of each fitted spring does beyond its column as prepared.

    ==========  ======================================================================
    Equation    d/dc_k of C (t - t0), t the axes' torques where the arm rests, and of
                `beyond_linear`; dt/dc_k = K e_k t_k, K the change of torques by turns
    Source      chain rule
    Valid       K as prepared, lever arms where the arm rests
    Ignores     K C K
    ==========  ======================================================================

    Args:
        prepared: Before axes turned.
        stands: After.
    """
    situation, frames = prepared.situation, prepared.frames
    before, after = expected(situation, frames), expected(stands, frames)
    lever, change = _point_jacobians(situation, before), _torque_by_turns(situation)
    linear = _by_axes(prepared, lever, situation.screw)
    screw = screw_of(situation.arm.at(stands.rest))
    along = _by_axes(prepared, point_jacobian(after), screw)
    torque, found = stands.torque[:, None, None], []
    every = np.moveaxis(along * torque, 3, 0)[list(prepared.springs)]
    turned, *turns = _frame_turns(prepared, lever, np.stack([after - before, *every]))
    far = after - before + before @ turned / 2.0
    for k, moved, turn in zip(prepared.springs, every, turns, strict=True):
        more = ((along - linear) * torque)[..., k]
        more += far @ turn + (moved + before @ turn / 2.0) @ turned
        wound = wind_up(stands, change[:, :, k, None] * stands.torque[:, k, None, None])
        found.append(added(_column_of(more), wound))
    return tuple(found)


def _by_axes(
    prepared: Prepared,
    lever: Float[np.ndarray, "rows markers 3 6"],
    screw: Float[np.ndarray, "rows axes 6"],
) -> Float[np.ndarray, "rows markers 3 axes"]:
    """Return what a turn of each axis moves the marks by, in m per rad."""
    rows, markers = lever.shape[:2]
    moved = lever.reshape(rows, 3 * markers, 6) @ screw.swapaxes(1, 2)
    carried = prepared.situation.carried[1:, prepared.readings.body]
    return moved.reshape(rows, markers, 3, -1) * carried.T[:, None]


def _frame_turns(
    prepared: Prepared,
    lever: Float[np.ndarray, "rows markers 3 6"],
    moved: Float[np.ndarray, "many rows markers 3"],
) -> Float[np.ndarray, "many 3 3"]:
    """Return how the tracker's frame is turned to make up for what the readings leave.

    Args:
        prepared: The recording against its nominal model.
        lever: Of the marks.
        moved: What is taken from the readings, in m; of all but the first their change.

    Returns:
        What takes a point, as a row, to its displacement; 0 where the frame is known.
    """
    if prepared.situation.recording.base_from_tracker is not None:
        return np.zeros((len(moved), 3, 3))
    readings, seen = prepared.readings, prepared.readings.weight > 0
    left = -moved[:, seen]
    left[0] += readings.value[seen]
    left[0] -= 0.0 if readings.centre is None else readings.centre[seen]
    columns = lever[seen].reshape(-1, 6)
    frame = np.linalg.lstsq(columns, left.reshape(len(moved), -1).T)[0].T
    return np.cross(frame[:, None, 3:], np.eye(3))


def _torque_by_turns(
    situation: StaticState,
) -> Float[np.ndarray, "rows axes axes"]:
    """Return what turns of each axis change of all torques, in N m per rad."""

    def slopes() -> Float[np.ndarray, "rows axes axes"]:
        turned = SMALL_TURN * np.eye(len(situation.axes))
        each = (moved_to(situation, situation.rest + turn) for turn in turned)
        change = [state.torque - situation.torque for state in each]
        return np.stack(change, axis=2) / SMALL_TURN

    return situation.once_standing("torque_by_turns", slopes)


def _column_of(moved: Float[np.ndarray, "rows markers 3"]) -> EffectJacobian:
    """Return one column that moves the marks so."""
    parts = [MarkerDisplacement(m, moved[:, m, :, None]) for m in range(moved.shape[1])]
    return EffectJacobian(1, tuple(parts))


def _point_jacobians(
    situation: StaticState, place: Float[np.ndarray, "rows markers 3"]
) -> Float[np.ndarray, "rows markers 3 6"]:
    """Return what takes twists to marks' displacements, at the mean of each visit."""
    mean = held_at_mean(situation.recording.visit, place.reshape(len(place), -1))
    return point_jacobian(mean.reshape(place.shape))


def state_under(situation: StaticState, fit: ModelFit) -> StaticState:
    """Return the situation with all that the members of a set make each other feel.

    What one law of a gear leaves to another depends on what that leaves to it.
    """
    sized = list(zip(fit.members, fit.coefficients, strict=True))
    now = situation
    for _ in range(ROUNDS):
        now = replace(situation, gears=now.gears)
        for member, size in sized:
            now = _acting(now, member, size)
        parallel: dict[int, dict[Law, np.ndarray]] = {}
        for member, size in sized:
            own = (now, member.where, member.shape, size)
            for axis, torque in member.hypothesis.parallel_torque(*own).items():
                parallel.setdefault(axis, {})[member.name] = torque
        gears = {
            axis: replace(now.gears.get(axis, LINEAR), parallel=laws)
            for axis, laws in parallel.items()
        }
        now = replace(now, gears={**now.gears, **gears})
    giving = tuple(_giving(*one) for one in sized if one[0].hypothesis.linear)
    return replace(now, giving=giving)


def _acting(situation: StaticState, member: ModelTerm, size: np.ndarray) -> StaticState:
    return member.hypothesis.acting(situation, member.where, member.shape, size)


def _giving(
    member: ModelTerm, size: Float[np.ndarray, " columns"]
) -> Callable[[StaticState], tuple[JacobianBlock, ...]]:
    """Return what a member does in any situation."""

    def parts(situation: StaticState) -> tuple[JacobianBlock, ...]:
        return mixture(member.jacobian(situation), size[:, None]).parts

    return parts


def loads_of(case: SelectionProblem, fit: ModelFit) -> frozenset[tuple[str, str]]:
    """Return the names of a set that change what the others feel."""
    here = case.situation
    return frozenset(
        member.name
        for member, size in zip(fit.members, fit.coefficients, strict=True)
        if _acting(here, member, size) is not here
    )


def acts_on_others(situation: StaticState, term: ModelTerm) -> bool:
    """Return whether a term changes what others feel, whatever its size."""
    return _felt_with(situation, term) is not situation


def changes_moments(situation: StaticState, term: ModelTerm) -> bool:
    """Return whether a term changes moments on the arm: a weight, a wrong wrench."""
    return _felt_with(situation, term).moment is not situation.moment


def changes_torques(situation: StaticState, term: ModelTerm) -> bool:
    """Return whether a term changes axes' torques: a weight, a compensator."""
    return _felt_with(situation, term).torque is not situation.torque


def _felt_with(situation: StaticState, term: ModelTerm) -> StaticState:
    """Return what others feel with a term whose coefficients are all one."""
    size = np.ones(term.jacobian(situation).columns)
    return _acting(situation, term, size)


def is_load_of_one_axis(situation: StaticState, term: ModelTerm) -> bool:
    """Return whether a term changes the torque of one axis: a compensator."""
    parts = term.jacobian(situation).parts
    return len(parts) == 1 and changes_torques(situation, term)


def _change_by(case: SelectionProblem, prepared: Prepared, fit: ModelFit) -> float:
    """Return the largest share by which a set changes springs, slopes or loads."""
    own = list(case.springs)
    softer, before = _mean_softening(case, fit), case.situation.compliance
    compliance = before.copy()
    compliance[own] += _within_a_decade(softer, before[own])
    now = state_under(prepared.situation.with_compliance(compliance), fit)
    then = case.situation
    loads = [(now.moment, then.moment), (now.torque[..., None], then.torque[..., None])]
    shares = [0.0, *np.abs(softer / before[own])]
    for new, old in loads:
        change, size = (np.sqrt(np.mean(x**2, axis=(0, 2))) for x in (new - old, old))
        shares.extend(change / np.maximum(size, TINY))
    if now.gears or then.gears:
        every = range(len(now.axes))
        new, old = (np.stack([x.softness_of(k) for k in every]) for x in (now, then))
        shares.append(float(np.sqrt(np.max(np.mean((new - old) ** 2, axis=1)))))
    for axis in _shared_axes(case.situation, fit):
        new, old = (x.spring_torque(axis) for x in (now, then))
        size = float(np.sqrt(np.mean(then.torque[:, axis] ** 2)))
        shares.append(float(np.sqrt(np.mean((new - old) ** 2))) / max(size, TINY))
    return float(max(shares))


def _shared_axes(situation: StaticState, fit: ModelFit) -> list[int]:
    """Return the axes that two members of a set or more turn."""
    turned = Counter(
        axis
        for member in fit.members
        for axis in {
            part.axis
            for part in member.jacobian(situation).parts
            if isinstance(part, JointRotation)
        }
    )
    return sorted(axis for axis, count in turned.items() if count > 1)


def total_softening(
    case: SelectionProblem, prepared: Prepared, fit: ModelFit
) -> Float[np.ndarray, " springs"]:
    """Return by how much compliances are other than prepared, on average over rows."""
    return laid_out_softer(case, prepared) + _mean_softening(case, fit)


def laid_out_softer(
    case: SelectionProblem, prepared: Prepared
) -> Float[np.ndarray, " springs"]:
    """Return by how much compliances are laid out other than prepared."""
    moved = case.situation.compliance - prepared.situation.compliance
    return moved[list(prepared.springs)]


def _mean_softening(
    case: SelectionProblem, fit: ModelFit
) -> Float[np.ndarray, " springs"]:
    """Return by how much compliances are other than laid out, on average over rows.

    Waves over a small range of angles may hold most of a spring.
    """
    return fit.springs + softening_of(case.situation, case.springs, fit)


def softening_of(
    situation: StaticState, springs: Sequence[int], fit: ModelFit
) -> Float[np.ndarray, " springs"]:
    """Return by how much members soften fitted springs on average over rows."""
    softer = dict.fromkeys(springs, 0.0)
    for member, size in zip(fit.members, fit.coefficients, strict=True):
        own = (situation, member.where, member.shape, size)
        for axis, more in member.hypothesis.mean_softening(*own).items():
            softer[axis] = softer.get(axis, 0.0) + more
    return np.array([softer[axis] for axis in springs])


def _within_a_decade(
    change: Float[np.ndarray, " springs"], before: Float[np.ndarray, " springs"]
) -> Float[np.ndarray, " springs"]:
    return np.clip(change, -0.9 * before, 9.0 * before)


# --- Kinematics -----------------------------------------------------------------------

KINEMATIC = (EncoderOffset(), GeometryError())


def curvature(
    recording: Recording, arm: Arm, prepared: Prepared, fit: ModelFit
) -> float:
    """Return what kinematic errors do beyond their columns, in sigmas.

    Args:
        recording: With markers.
        arm: As drawn, with the recording's names.
        prepared: The recording about any kinematics.
        fit: A set in their columns.

    Returns:
        By how much all readings together show it.
    """
    here, frames, readings = prepared.situation, prepared.frames, prepared.readings
    there, turned = _corrected(recording, arm, fit)
    stands = static_state_of(turned, there, here.compliance, here.bodies)
    more = expected(stands, frames) - expected(here, frames)
    more -= _linear_displacement(prepared, fit)
    more += 0.0 if readings.centre is None else readings.centre
    every = np.zeros(prepared.data.visits.poses(), dtype=int)
    found = normal_equations_of(prepared.data, [_column_of(more)], every)
    return float(np.sqrt(max(found.gram.sum(), 0.0)))


def prepared_about(recording: Recording, arm: Arm, fit: ModelFit) -> Prepared:
    """Make a recording ready about the kinematics of a set, whose sizes stay whole.

    Readings are held against the arm that the set says, and what the set's columns do
    there is added to them: so laws do all that they do, without its second order.

    Args:
        recording: With markers.
        arm: As drawn, with the recording's names.
        fit: The set.
    """
    found = prepare(*_corrected(recording, arm, fit))
    centre, readings = _linear_displacement(found, fit), found.readings
    value, point = readings.value + centre, readings.point + centre
    readings = replace(readings, value=value, point=point, centre=centre)
    own = (found.situation, found.data.visits, readings, found.pose_repeatability)
    return replace(found, readings=readings, data=blocks(*own)[0])


def _corrected(recording: Recording, arm: Arm, fit: ModelFit) -> tuple[Recording, Arm]:
    """Return a recording and its arm with the kinematic errors of a set put right."""
    sizes = dict(zip((m.name for m in fit.members), fit.coefficients, strict=True))
    axes = [f"a{k + 1}" for k in range(len(arm.axes))]
    offsets = [sizes.get(("encoder_offset", axis), np.zeros(1)) for axis in axes]
    links = [sizes.get(("geometry_error", x), np.zeros(6)) for x in arm.chain.links]
    links = [link_error_of(own) for own in links]
    there = replace(recording, posture=recording.posture + np.concatenate(offsets))
    return there, replace(arm, chain=corrected_chain(arm.chain, np.array(links)))


def _linear_displacement(
    prepared: Prepared, fit: ModelFit
) -> Float[np.ndarray, "rows markers 3"]:
    """Return what the columns of a set's kinematic errors move the marks by."""
    here, readings = prepared.situation, prepared.readings
    lever = _point_jacobians(here, expected(here, prepared.frames))
    twist = np.zeros((*lever.shape[:2], 6))
    for member, size in zip(fit.members, fit.coefficients, strict=True):
        if member.hypothesis not in KINEMATIC:
            continue
        for part in mixture(member.jacobian(here), size[:, None]).parts:
            if isinstance(part, JointRotation):
                moved, site = here.screw[:, part.axis] * part.law, part.axis + 1
            else:
                assert isinstance(part, BodyTwist)
                moved, site = part.twist[..., 0], part.site
            twist += here.carried[site, readings.body][:, None] * moved[:, None]
    return np.einsum("rmij,rmj->rmi", lever, twist)
