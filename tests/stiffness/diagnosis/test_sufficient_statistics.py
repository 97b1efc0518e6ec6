"""What readings say about columns, and what is fitted before anything is named."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import SOFTER, arm, prepared, recording

from stiffness.diagnosis.between_visit import Whitening
from stiffness.diagnosis.noise_model import pose_repeatability_of
from stiffness.diagnosis.sufficient_statistics import (
    Augmented,
    cross_gram,
    normal_equations_of,
    per_pose_scores,
)
from stiffness.effects import HYPOTHESES
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.candidates import library_of
from stiffness.effects.design_matrix import Deferred, KeptColumns, design_matrix_of
from stiffness.effects.jacobian import (
    BodyTwist,
    JointRotation,
    rotate,
    translate,
    turn,
    values,
)
from stiffness.effects.marker_slip import MarkerSlip
from stiffness.experiment.visits import Kept, visits_of
from stiffness.regression import testing
from stiffness.regression.normal_equations import (
    minimum_norm_fit,
    projection_coefficients,
)
from stiffness.regression.splits import split_of
from stiffness.regression.testing import sign_flip_test
from stiffness.robot.kinematics import point_jacobian


def test_silent_fit_recovers_stiffness_within_its_sigma():
    """Six springs, 4 sigma: a false alarm once in 2600 recordings."""
    ready = prepared()
    truth = 1.0 / (arm().stiffness * SOFTER)
    found = ready.situation.compliance[list(ready.springs)]
    assert ready.springs == (0, 1, 2, 3, 4, 5)
    # the first rounds look at some visits only, so up to twice the sigma of all
    assert np.all(np.abs(found - truth) < 8.0 * ready.sigma)


def test_measured_noise_is_the_stated_one():
    """12,000 contrasts measure a standard deviation to 0.7 %; four of these."""
    ready = prepared()
    assert ready.degrees_of_freedom > 10_000
    assert abs(ready.noise - 1.0) < 0.03


def test_whitened_square_within_visits_is_its_freedom():
    within = prepared().data.within
    square, freedom = within.square.sum(), within.degrees_of_freedom.sum()
    assert abs(square - freedom) < 5.0 * np.sqrt(2.0 * freedom)


def test_torque_is_the_moment_along_the_axis():
    """Two ways to the same torque: places' moments, and the Jacobian's transpose."""
    at = prepared().situation
    gravity = arm().gravity_torque(at.rest, at.recording.tool)
    np.testing.assert_allclose(at.torque, gravity + at.load_torque, atol=1e-9)


def test_rest_is_an_equilibrium():
    """Within 50 nm at a metre: the wrench turns with the flange, in two rounds."""
    at = prepared().situation
    wound = at.rest - at.recording.posture
    np.testing.assert_allclose(wound, at.torque * at.compliance, atol=5e-8)


def test_rotation_about_a_point_leaves_the_point():
    random = np.random.default_rng(0)
    centre, vector = random.normal(size=(2, 5, 3))
    twist = rotate(0, vector[:, :, None], centre).twist[:, :, 0]
    moved = np.einsum("nij,nj->ni", point_jacobian(centre), twist)
    np.testing.assert_allclose(moved, 0.0, atol=1e-14)


def test_levers_take_twists_to_displacements():
    random = np.random.default_rng(0)
    point, shift, spin = random.normal(size=(3, 5, 3))
    moved = np.einsum("nij,nj->ni", point_jacobian(point), np.hstack([shift, spin]))
    np.testing.assert_allclose(moved, shift + np.cross(spin, point), atol=1e-14)


def test_a_turn_and_the_same_motion_are_the_same_column():
    ready = prepared()
    at, k = ready.situation, 2
    law = at.torque[:, k]
    twist = at.screw[:, k] * law[:, None]
    motion = BodyTwist(k + 1, twist[:, :, None])
    other = replace(turn(k, law), parts=(motion,))
    fold = np.zeros(40, dtype=int)
    both = normal_equations_of(ready.data, [turn(k, law), other], fold)
    np.testing.assert_allclose(both.gram[0], both.gram[0][0, 0], rtol=1e-3)
    np.testing.assert_allclose(
        both.score[:, 0], both.score[:, 1], atol=1e-3 * np.abs(both.score).max()
    )


def test_a_model_without_springs_has_no_columns_and_no_fault():
    data, fold = prepared().data, np.zeros(40, dtype=int)
    assert normal_equations_of(data, [], fold).gram.shape == (1, 0, 0)
    assert per_pose_scores(data, [], fold).score.shape == (40, 0)


def test_gram_of_folds_adds_up_to_the_gram_of_poses():
    """Turns, a motion and a shift; exact within visits, between but for the prior."""
    ready = prepared()
    at = ready.situation
    tilt = BearingTilt().jacobian(at, "a3", np.zeros(1))
    slip = MarkerSlip().jacobian(at, "marker:link2_b", at.recording.time[99:100])
    laws = [turn(1, at.torque[:, 1]), turn(4, at.torque[:, 4] ** 2)]
    fold = np.arange(40) % 4
    for data, signatures, near in (
        (replace(ready.data, between=None), [*laws, tilt], 1e-9),
        (ready.data, [*laws, tilt, slip], 1e-2),
    ):
        of_folds = normal_equations_of(data, signatures, fold)
        of_poses = per_pose_scores(data, signatures, fold)
        whole = of_folds.gram.sum(axis=0)
        size = np.sqrt(np.diag(whole))
        own = of_poses.own.sum(axis=0) / size / size[:, None]
        np.testing.assert_allclose(own, whole / size / size[:, None], atol=near)
        np.testing.assert_allclose(of_poses.gram, of_folds.gram, rtol=1e-9)
        score = of_folds.score / size
        np.testing.assert_allclose(of_poses.score / size, score, atol=1e-6)


def test_few_columns_meet_many_as_if_all_stood_together():
    """One evidence of all columns has what `cross_gram` says of two parts of them."""
    ready = prepared()
    at = ready.situation
    few = [turn(1, at.torque[:, 1]), BearingTilt().jacobian(at, "a4", np.zeros(1))]
    slip = MarkerSlip().jacobian(at, "marker:link4_a", at.recording.time[99:100])
    many = [slip, BearingTilt().jacobian(at, "a2", np.zeros(1)), few[0]]
    fold = np.arange(40) % 3
    whole = normal_equations_of(ready.data, [*few, *many], fold)
    gram, score = cross_gram(ready.data, few, [KeptColumns(many)], fold)
    size = np.sqrt(np.diag(whole.gram.sum(axis=0)))
    unit = size[:3, None] * size
    np.testing.assert_allclose(gram / unit, whole.gram[:, :3] / unit, atol=1e-9)
    np.testing.assert_allclose(score / size, whole.score / size, atol=1e-6)


def test_terms_that_come_one_lot_after_another_stand_as_if_all_came_at_once():
    """Whatever was asked before, in any order, and where one is asked for twice."""
    ready = prepared()
    at = ready.situation
    tilt = BearingTilt()
    slip = MarkerSlip().jacobian(at, "marker:link4_a", at.recording.time[99:100])
    terms = [turn(1, at.torque[:, 1]), tilt.jacobian(at, "a4", np.zeros(1)), slip]
    many = [tilt.jacobian(at, "a2", np.zeros(1)), turn(2, at.torque[:, 2])]
    fold = np.arange(40) % 2
    given = normal_equations_of(ready.data, many, fold)
    library = Augmented(ready.data, KeptColumns(many), given)
    for some in ([2], [1, 2], [1, 0, 1], []):
        laid = [terms[k] for k in some]
        found, own = library.by(some, laid.__getitem__)
        whole = normal_equations_of(ready.data, [*laid, *many], fold)
        size = np.sqrt(np.diag(whole.gram.sum(axis=0)))
        unit = size[:, None] * size
        np.testing.assert_allclose(
            found.gram[0] / unit, whole.gram[1] / unit, atol=1e-9
        )
        np.testing.assert_allclose(found.score / size, whole.score / size, atol=1e-6)
        assert [len(columns) for columns in own] == [law.columns for law in laid]
        assert np.array_equal(np.concatenate([[], *own]), np.arange(sum(map(len, own))))


@pytest.mark.parametrize("hypothesis", HYPOTHESES, ids=lambda h: type(h).__name__)
def test_information_of_means_is_what_their_columns_hold_and_what_priors_add(
    hypothesis,
):
    """X'X - X'N G of the same columns by two ways, for shifts of many markers too."""
    ready = prepared()
    between = ready.data.between
    assert between is not None
    blind = replace(ready.data.within, kept=Kept(), **{
        name: np.zeros_like(getattr(ready.data.within, name))
        for name in ("weight", "kernel", "rotation_information", "weighted_residual")
    })  # fmt: skip
    everyone = np.arange(len(between.residual))
    means = between.some(everyone)
    unknown = means.whitening.white(between.nuisance.of(everyone))
    for where in hypothesis.places(ready.situation)[:1]:
        shape = hypothesis.shapes(ready.situation, where)[0]
        own = hypothesis.jacobian(ready.situation, where, shape)
        columns = design_matrix_of([own], ready.data.visits.row)
        taken = between.nuisance_coefficients(columns)
        design = means.whitening.white(means.displacement(columns)) - unknown @ taken
        held = np.sum(design**2, axis=(0, 1))
        held += np.sum((taken / between.nuisance.sigma[:, None]) ** 2, axis=0)
        data = replace(ready.data, within=blind)
        found = normal_equations_of(data, [own], np.zeros(40, dtype=int))
        scale = found.raw
        of_one = np.diag(found.gram[0])
        assert_allclose(of_one / scale, held / scale, rtol=1e-7, atol=1e-9)
        asked = np.sum(design * between.residual, axis=(0, 1))
        score = found.score.sum(axis=0)
        assert_allclose(score, asked, rtol=1e-6, atol=1e-6 * scale.max())


def test_taking_a_column_out_lowers_its_score_by_its_gram():
    ready = prepared()
    signature = turn(1, ready.situation.torque[:, 1])
    fold = np.zeros(40, dtype=int)
    before = normal_equations_of(ready.data, [signature], fold)
    less = ready.data.subtract([signature], np.array([1e-7]))
    after = normal_equations_of(less, [signature], fold)
    change = before.score.sum() - after.score.sum()
    assert change == pytest.approx(1e-7 * before.gram[0][0, 0], rel=1e-2)


def test_known_columns_may_be_multiples_of_each_other():
    random = np.random.default_rng(3)
    x = random.normal(size=(50, 3))
    x = np.column_stack([x[:, 0], 2.0 * x[:, 0], x[:, 1:]])
    gram = x.T @ x
    left = x - x[:, :2] @ projection_coefficients(gram, np.array([0, 1]))
    np.testing.assert_allclose(x[:, 0] @ left, 0.0, atol=1e-8)
    fit = minimum_norm_fit(gram, gram @ np.array([1.0, 0.0, 2.0, 3.0]))
    np.testing.assert_allclose(x @ fit, x @ [1.0, 0.0, 2.0, 3.0], atol=1e-7)


def test_sign_flips_alarm_as_often_as_they_say_whatever_the_noise():
    """100 recordings of nothing, poses of very unequal noise: 5 % at p < 0.05."""
    random = np.random.default_rng(7)
    alarms = 0
    for seed in range(100):
        scale = np.exp(random.normal(size=(60, 1)))
        white = [scale * random.normal(size=(60, n)) / 8.0 for n in (1, 1, 3)]
        alarms += sign_flip_test(white, seed).p_value < 0.05
    assert alarms <= 12  # binomial(100, 0.05): more in 1 of 700


def test_a_fifth_of_the_poses_is_kept_back_and_always_the_same():
    one, other = split_of(recording()), split_of(recording())
    np.testing.assert_array_equal(one.fold, other.fold)
    assert one.held_out.sum() >= 8
    for cluster in np.unique(one.cluster):
        assert len(np.unique(one.fold[one.cluster == cluster])) == 1


def test_visits_keep_every_row_once():
    visit = np.array([0, 0, 0, 1, 1, 2] + [3] * 95)
    visits = visits_of(visit, visit)
    rows = np.sort(visits.row[visits.counts])
    np.testing.assert_array_equal(rows, np.arange(len(visit)))


def test_a_part_of_another_width_is_refused():
    with pytest.raises(Exception, match="columns"):
        replace(turn(0, np.ones(3)), columns=2)
    assert isinstance(turn(0, np.ones(3)).parts[0], JointRotation)
    assert translate(0, np.ones((3, 3, 1))).twist.shape == (3, 6, 1)


def test_the_square_root_of_an_inverse_covariance_is_one():
    """The equation of `roots`, evaluated."""
    random = np.random.default_rng(5)
    precision = np.stack([np.diag([1.0, 4.0, 9.0]), np.diag([2.0, 3.0, 5.0])])
    feigned = random.normal(size=(6, 2))
    roots = Whitening.of(precision[None], feigned[None])
    root = roots.white(np.eye(6)[None])[0]
    spread = np.diag(1.0 / np.array([1.0, 4.0, 9.0, 2.0, 3.0, 5.0]))
    covariance = spread + feigned @ feigned.T
    np.testing.assert_allclose(root.T @ root @ covariance, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(roots.back(np.eye(6)[None])[0], root.T, atol=1e-12)
    plain, shared = np.linalg.inv(spread), roots.error_factor()[0]
    np.testing.assert_allclose(plain - shared.T @ shared, root.T @ root, atol=1e-12)


def test_signatures_that_are_worked_out_later_know_no_row_but_their_own():
    """What `library_of` defers, in rows out of order, is what it is in all rows."""
    at = prepared().situation
    rows = np.random.default_rng(2).permutation(at.rows)[:50]
    library = library_of(at, prepared().springs, HYPOTHESES)
    later = [s for s in library.jacobians if isinstance(s, Deferred)]
    assert {type(s.hypothesis) for s in later} >= {BearingTilt, MarkerSlip}
    for one in later:
        whole, some = one.of(at), one.of(at.some(rows))
        for part, own in zip(whole.parts, some.parts, strict=True):
            np.testing.assert_array_equal(values(part)[rows], values(own))


def test_random_signs_are_the_same_however_many_are_drawn_at_once(monkeypatch):
    white = [np.random.default_rng(1).normal(size=(30, n)) for n in (1, 2)]
    once = sign_flip_test(white, 5)
    monkeypatch.setattr(testing, "AT_ONCE", 4999)
    np.testing.assert_array_equal(once.together, sign_flip_test(white, 5).together)


def test_last_digits_of_a_trend_do_not_decide_how_well_axes_return():
    random = np.random.default_rng(3)
    lever = 1e5 * random.normal(size=(60, 6, 2))
    arrival = 3e-5 * random.normal(size=(60, 2))
    white = np.einsum("vna,va->vn", lever, arrival) + random.normal(size=(60, 6))
    trend = random.uniform(-1.0, 1.0, size=(60, 5))
    largest = np.full(2, 1e-3)
    found = pose_repeatability_of(white, lever, trend, largest)
    twin = trend[:, :1] + 1e-8 * random.normal(size=(60, 1))
    again = pose_repeatability_of(white, lever, np.hstack([trend, twin]), largest)
    assert_allclose(again, found, rtol=1e-6)
    assert_allclose(found, 3e-5, rtol=0.4)
