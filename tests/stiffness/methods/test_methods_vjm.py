from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import config
from small_truth import TABLE_3, cartesian_compliance, postures, pulls, record

from bench.shared.errors import NotIdentifiable, UnknownName
from bench.shared.recording import Payload
from stiffness.experiment.deflections import every_plateau, one_per_pose
from stiffness.methods.vjm import Vjm, refuse_if_blind
from stiffness.regression.intervals import share
from stiffness.regression.least_squares import least_squares, solve
from stiffness.robot.arm import Arm

TOOL = Payload(1.0, np.array([0.0, 0.01, 0.05]))
AXES = tuple(f"a{k}" for k in range(1, 7))


@pytest.fixture(scope="module")
def arm(kr10):
    return Arm.from_mjcf(kr10)


@pytest.fixture
def without_shape_checks():
    """Checking shapes takes three quarters of a fit; other tests check them."""
    config.update("jaxtyping_disable", True)
    yield
    config.update("jaxtyping_disable", False)


def experiment(arm, poses=40, plateaus=2, noise=None, **details):
    """Poses and forces are always the same; only the noise is drawn."""
    forces = pulls(poses, plateaus, seed=1)
    return record(
        arm, postures(arm, poses, seed=0), forces, noise=noise, tool=TOOL, **details
    )


def noisy(recording, draw):
    """Add the stated noise of tracker and force sensor."""
    sigma = np.repeat([0.04, 0.002], 3)
    size = recording.tracker.repeatability
    points, wrench = recording.points, recording.wrench
    return replace(
        recording,
        points=points + size * draw.standard_normal(points.shape),
        wrench=wrench + sigma * draw.standard_normal(wrench.shape),
    )


@pytest.mark.parametrize("frame", ["sensor", "base"])
def test_springs_of_table_3_are_recovered_without_noise(arm, frame):
    fitted = Vjm(arm).fit(experiment(arm, frame=frame))
    found = [parameter.value for parameter in fitted.stiffness]
    # the fit stops at 1e-4 of sigma, itself up to a percent
    np.testing.assert_allclose(found, TABLE_3, rtol=1e-6)
    assert [parameter.name for parameter in fitted.parameters] == list(AXES)
    assert {parameter.unit for parameter in fitted.stiffness} == {"N m/rad"}


def test_springs_are_recovered_with_an_unknown_tracker_frame(arm):
    """The arm's own markers give the frame, its sag taken into account."""
    lost = replace(experiment(arm), base_from_tracker=None)
    fitted = Vjm(arm).fit(lost)
    # what is left of the frame after one round with the springs of the first, of 2e-3
    np.testing.assert_allclose(fitted.compliance * TABLE_3, 1.0, atol=2e-6)


def test_one_reading_per_pose_is_enough(arm):
    recording = experiment(arm)
    fitted = Vjm(arm, select=one_per_pose).fit(recording)
    # the fit stops at 1e-4 of sigma, itself up to two percent
    np.testing.assert_allclose(fitted.compliance * TABLE_3, 1.0, atol=2e-6)
    assert fitted.solution.groups == 40
    assert (fitted.solution.sigma > 1.2 * Vjm(arm).fit(recording).solution.sigma).all()


def test_prediction_is_the_deflection_that_was_measured(arm):
    """p(q_loaded) - p(q_unloaded), to 10 nm for wrenches turned with the fit."""
    recording = experiment(arm, frame="base")
    data = every_plateau(arm, recording)
    predicted = Vjm(arm).fit(recording).predict(data.cases)
    np.testing.assert_allclose(predicted, data.deflection, atol=1e-8)


def test_prediction_is_the_papers_equation_to_first_order(arm):
    """J K_theta^-1 J^T w of Eq. 6, whose error is the change of the lever arms."""
    recording = experiment(arm, frame="base")
    cases = every_plateau(arm, recording).cases
    level = replace(cases, point_in_flange=np.tile(cases.origin_in_flange, (80, 1)))
    predicted = Vjm(arm).fit(recording).predict(level)
    soft = cartesian_compliance(arm, cases.posture, 1 / TABLE_3, cases.origin_in_flange)
    linear = (soft @ cases.wrench_in_base[:, :, None])[:, :3, 0]
    # axes twist by a few milliradians: so much does the linear answer err
    assert 1e-4 < np.abs(predicted - linear).max() / np.abs(linear).max() < 2e-2


def test_rigid_postures_would_bias_a_compliance_by_several_sigma(arm):
    """Why Jacobians are taken at rest: the paper's one-step fit errs."""
    exact = experiment(arm, poses=151, plateaus=8)
    recording = replace(exact, frames=np.full(len(exact.time), 10))
    data = every_plateau(arm, recording)
    cases = data.cases
    jacobian = arm.jacobian(cases.posture, "flange", cases.point_in_flange)[:, :3]
    torque = arm.load_torque(
        cases.posture, cases.wrench_in_base, "flange", cases.origin_in_flange
    )
    whiten = data.noise.whitener()
    rigid, covariance = solve(
        whiten(jacobian * torque[:, None]), whiten(data.deflection[..., None])[..., 0]
    )
    sigma = np.sqrt(np.diag(covariance))
    away = np.abs(rigid - 1 / TABLE_3) / sigma
    at_rest = Vjm(arm).fit(recording)
    assert away.max() > 4.0
    assert np.abs((at_rest.compliance - 1 / TABLE_3) / sigma).max() < 0.01


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_intervals_cover_the_truth_as_often_as_they_say(arm):
    """95 % intervals over 1,000 recordings: between 93 and 97 %, every axis.

    A share of 1,000 at 95 % has a standard error of 0.7 %.
    """
    exact = experiment(arm, poses=40, plateaus=1)
    truth = 1 / TABLE_3
    draw = np.random.default_rng(5)
    trials = 1000
    stated, clustered = np.zeros(6), np.zeros(6)
    for _ in range(trials):
        fitted = Vjm(arm).fit(noisy(exact, draw))
        away = np.abs(fitted.compliance - truth)
        stated += away < 1.959964 * fitted.solution.sigma
        ends = np.array([(p.low, p.high) for p in fitted.parameters])
        clustered += (ends[:, 0] < truth) & (truth < ends[:, 1])
    for counts in (stated, clustered):
        assert 0.93 < counts.min() / trials
        assert counts.max() / trials < 0.97
        # all axes together leave no doubt about the level
        assert share(int(counts.sum()), 6 * trials).estimate == pytest.approx(
            0.95, abs=0.01
        )


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_rows_of_a_visit_share_their_unloaded_reading_and_sigma_knows(arm):
    """Scatter over recordings equals the stated sigma, with eight rows per visit."""
    exact = experiment(arm, poses=25, plateaus=8)
    draw = np.random.default_rng(6)
    fits = [Vjm(arm).fit(noisy(exact, draw)) for _ in range(60)]
    z = np.array([(f.compliance - 1 / TABLE_3) / f.solution.sigma for f in fits])
    # 360 values: standard error of their spread 4 %, three of them
    assert np.std(z) == pytest.approx(1.0, abs=0.12)


def test_stated_noise_alone_is_too_sure_where_the_model_is_wrong(arm):
    """An arm that is softer at some angles has no six springs; clusters know."""
    exact = experiment(arm, poses=60, plateaus=4)
    wobble = 1.0 + 0.3 * np.sin(3.0 * exact.posture[:, 1])
    assert exact.points is not None
    start = exact.points[exact.stage == "unloaded"].repeat(5, axis=0)
    points = start + (exact.points - start) * wobble[:, None, None]
    fitted = Vjm(arm).fit(
        noisy(replace(exact, points=points), np.random.default_rng(7))
    )
    assert (fitted.solution.sigma_clustered > 2 * fitted.solution.sigma).all()


ON_AXIS = np.array([0.0, 0.0, 0.06])
"""A hook on the last axis, in the flange's frame, in m."""


def test_force_through_the_last_axis_leaves_it_unknown_and_is_refused(arm):
    exact = experiment(arm, hook=ON_AXIS)
    with pytest.raises(NotIdentifiable, match=r"'a6'.*beside its axis") as error:
        Vjm(arm).fit(exact)
    assert all(f"'{axis}'" not in str(error.value) for axis in AXES[:5])


@pytest.mark.parametrize("seed", range(5))
def test_noise_does_not_make_an_unknown_axis_known(arm, seed):
    """A trial without this check gave 1e18 N m/rad."""
    exact = experiment(arm, hook=ON_AXIS)
    with pytest.raises(NotIdentifiable, match="'a6'"):
        Vjm(arm).fit(noisy(exact, np.random.default_rng(seed)))


def test_markers_round_the_last_axis_do_not_show_it_either(arm):
    """Their mean lies on the axis and does not move with it."""
    ring = np.array([[40, 0, 5], [-20, 34.641016, 5], [-20, -34.641016, 5]]) * 1e-3
    with pytest.raises(NotIdentifiable, match="'a6'"):
        Vjm(arm).fit(noisy(experiment(arm, places=ring), np.random.default_rng(8)))


def test_one_pose_is_refused_by_every_axis_it_cannot_tell_apart(arm):
    lone = experiment(arm, poses=1, plateaus=1)
    with pytest.raises(NotIdentifiable) as error:
        Vjm(arm).fit(lone)
    assert sum(f"'{axis}'" in str(error.value) for axis in AXES) >= 4


def test_unknown_axis_may_be_held_when_asked_for(arm):
    exact = experiment(arm, hook=ON_AXIS)
    fitted = Vjm(arm, held=("a6",)).fit(exact)
    assert [parameter.name for parameter in fitted.parameters] == list(AXES[:5])
    np.testing.assert_allclose(fitted.compliance * TABLE_3, 1.0, atol=1e-6)


def test_axis_to_hold_must_exist(arm):
    with pytest.raises(UnknownName, match="Did you mean 'a6'"):
        Vjm(arm, held=("a66",))


def test_wrench_with_the_wrong_sign_is_refused_with_the_sign_rule(arm):
    backwards = experiment(arm, frame="base")
    assert backwards.wrench is not None
    backwards = replace(backwards, wrench=-backwards.wrench)
    with pytest.raises(NotIdentifiable, match="world exerts on the robot"):
        Vjm(arm).fit(backwards)


def test_lone_negative_axis_is_not_put_down_to_the_wrenchs_sign(arm):
    """The sign of the wrench turns all compliances over, never one."""
    value, sigma = 1.0 / TABLE_3, 0.01 / TABLE_3
    value[3] *= -0.1
    with pytest.raises(NotIdentifiable, match=r"'a4'.*others are positive") as error:
        refuse_if_blind(arm, list(range(6)), value, sigma, 1.0 / arm.stiffness)
    assert "Check the wrench" not in str(error.value)


def test_negative_axis_whose_interval_holds_positive_values_is_called_uncertain(arm):
    value, sigma = 1.0 / TABLE_3, 0.01 / TABLE_3
    value[5], sigma[5] = -0.5 * value[5], value[5]
    with pytest.raises(NotIdentifiable, match="'a6' is too uncertain") as error:
        refuse_if_blind(arm, list(range(6)), value, sigma, 1.0 / arm.stiffness)
    assert "negative" not in str(error.value)


def test_readings_relative_to_the_first_are_as_good(arm):
    exact = experiment(arm)
    assert exact.points is not None
    start = exact.points[exact.stage == "unloaded"].repeat(3, axis=0)
    relative = replace(exact, points=exact.points - start, displacement="relative")
    np.testing.assert_allclose(
        Vjm(arm).fit(relative).compliance, Vjm(arm).fit(exact).compliance, rtol=1e-9
    )


def test_normal_equations_are_solved_and_their_covariance_is_the_inverse():
    """(A^T A) x = A^T y; information of a column = 1 / (A^T A)^-1_kk."""
    draw = np.random.default_rng(9)
    design, target = draw.standard_normal((10, 3, 4)), draw.standard_normal((10, 3))
    value, covariance = solve(design, target)
    a = design.reshape(30, 4)
    np.testing.assert_allclose(a.T @ a @ value, a.T @ target.ravel(), atol=1e-12)
    others = np.delete(a, 1, axis=1)
    alone = a[:, 1] - others @ np.linalg.lstsq(others, a[:, 1])[0]
    assert covariance[1, 1] == pytest.approx(1 / (alone @ alone))


def test_column_that_others_mimic_or_that_is_empty_is_unseen():
    draw = np.random.default_rng(10)
    design = draw.standard_normal((10, 3, 5))
    design[..., 2] = design[..., 0] - 2 * design[..., 1]
    design[..., 4] = 0.0
    value, covariance = solve(design, draw.standard_normal((10, 3)))
    assert np.isinf(np.diag(covariance)).tolist() == [True, True, True, False, True]
    assert value[[0, 1, 2, 4]].tolist() == [0.0] * 4


def test_clustered_covariance_is_the_jackknife_over_groups():
    """(G-1)/G sum of squared changes when a group is left out, solved anew each."""
    draw = np.random.default_rng(11)
    design, target = draw.standard_normal((12, 3, 2)), draw.standard_normal((12, 3))
    group = np.array([3, 1, 1, 2, 2, 2, 5, 5, 3, 1, 5, 5])
    found = least_squares(design, target, group)
    changes = [
        found.value - solve(design[group != g], target[group != g])[0]
        for g in np.unique(group)
    ]
    expected = 3 / 4 * sum(np.outer(change, change) for change in changes)
    np.testing.assert_allclose(found.clustered, expected, atol=1e-14)
