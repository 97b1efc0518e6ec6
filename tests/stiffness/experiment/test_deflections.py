from dataclasses import replace

import numpy as np
import pytest
from small_truth import BASE_FROM_TRACKER, PLACES, postures, pulls, record

from bench.shared.errors import Unusable
from bench.shared.recording import UNLOADED, UNLOADING, Marker
from stiffness.experiment.deflections import (
    LoadCases,
    end_effector_markers,
    every_plateau,
    loaded_and_unloaded,
    one_per_pose,
)
from stiffness.robot.arm import Arm

POSES, PLATEAUS = 8, 3


@pytest.fixture(scope="module")
def arm(kr10):
    return Arm.from_mjcf(kr10)


@pytest.fixture(scope="module")
def recording(arm):
    return record(arm, postures(arm, POSES, seed=0), pulls(POSES, PLATEAUS, seed=1))


def test_deflection_is_how_far_the_mean_of_the_markers_moved_in_the_base(
    arm, recording
):
    data = every_plateau(arm, recording)
    turn = BASE_FROM_TRACKER[:3, :3]
    mean = recording.points.mean(axis=1).reshape(POSES, PLATEAUS + 1, 3) @ turn.T
    expected = (mean[:, 1:] - mean[:, :1]).reshape(-1, 3)
    np.testing.assert_allclose(data.deflection, expected, atol=1e-15)
    np.testing.assert_allclose(
        data.cases.point_in_flange, np.tile(PLACES.mean(axis=0), (len(expected), 1))
    )


def test_one_row_per_loaded_plateau(arm, recording):
    data = every_plateau(arm, recording)
    np.testing.assert_array_equal(
        data.posture_id, np.repeat(np.arange(POSES), PLATEAUS)
    )
    assert UNLOADED not in recording.stage[data.row]


def test_wrench_is_the_difference_of_the_two_readings(arm, recording):
    """A bias of the sensor and the weight of the empty hook are in both."""
    bias = np.array([3.0, -2.0, 1.0, 0.1, 0.2, 0.3])
    biased = replace(recording, wrench=recording.wrench + bias)
    np.testing.assert_allclose(
        every_plateau(arm, biased).cases.wrench_in_base,
        every_plateau(arm, recording).cases.wrench_in_base,
        atol=1e-12,
    )


def test_one_per_pose_takes_the_first_reading_under_the_heaviest_weight(arm, recording):
    mass = np.tile([0.0, 2.0, 5.0, 5.0], POSES)
    weighed = replace(recording, load_mass=mass)
    data = one_per_pose(arm, weighed)
    np.testing.assert_array_equal(data.row, np.arange(POSES) * (PLATEAUS + 1) + 2)
    heaviest = one_per_pose(arm, recording).cases.wrench_in_base[:, :3]
    force = np.linalg.norm(recording.wrench[:, :3], axis=1).reshape(POSES, -1)
    np.testing.assert_allclose(
        np.linalg.norm(heaviest, axis=1), force.max(axis=1), rtol=0.01
    )


def test_rows_without_a_weight_on_the_hook_are_not_loaded(recording):
    stage = recording.stage.copy()
    stage[PLATEAUS :: PLATEAUS + 1] = UNLOADING
    mass = np.tile([0.0, 2.0, 5.0, 0.0], POSES)
    loaded, unloaded = loaded_and_unloaded(
        replace(recording, stage=stage, load_mass=mass)
    )
    np.testing.assert_array_equal(loaded % (PLATEAUS + 1), np.tile([1, 2], POSES))
    np.testing.assert_array_equal(unloaded, loaded - loaded % (PLATEAUS + 1))


def test_unloaded_reading_may_come_after_the_loaded_ones(recording):
    backwards = recording.take(np.arange(len(recording.time))[::-1])
    loaded, unloaded = loaded_and_unloaded(backwards)
    np.testing.assert_array_equal(backwards.visit[loaded], backwards.visit[unloaded])
    assert set(backwards.stage[unloaded]) == {UNLOADED}


def test_revisited_pose_is_compared_with_its_own_visit(arm, recording):
    pose = recording.posture_id % (POSES // 2)
    data = every_plateau(arm, replace(recording, posture_id=pose))
    assert len(np.unique(data.posture_id)) == POSES // 2
    assert len(np.unique(data.visit)) == POSES


@pytest.mark.parametrize("row", [0, 1])
def test_marker_missing_in_either_reading_leaves_both_means(arm, recording, row):
    """Otherwise the mean would jump by the marker's distance, not by its motion."""
    points = recording.points.copy()
    points[row, 2] = np.nan
    data = every_plateau(arm, replace(recording, points=points))
    kept = [0, 1, 3]
    turn = BASE_FROM_TRACKER[:3, :3]
    moved = (recording.points[1, kept] - recording.points[0, kept]).mean(axis=0)
    np.testing.assert_allclose(data.deflection[0], turn @ moved, atol=1e-15)
    np.testing.assert_allclose(data.cases.point_in_flange[0], PLACES[kept].mean(axis=0))


def test_row_that_saw_no_marker_is_left_out(arm, recording):
    points = recording.points.copy()
    points[1] = np.nan
    data = every_plateau(arm, replace(recording, points=points))
    assert len(data.row) == POSES * PLATEAUS - 1
    assert 1 not in data.row


def scatter(recording, arm, draws=4000):
    """Covariance of the first visit's deflections over many noisy readings."""
    one = recording.take(recording.visit == 0)
    noise = np.random.default_rng(2)
    rows = PLATEAUS + 1
    sigma = recording.tracker.repeatability
    many = sigma * noise.standard_normal((draws, rows, len(recording.markers), 3))
    many /= 1.0 if one.frames is None else np.sqrt(one.frames)[:, None, None]
    seen = np.isfinite(one.points[..., 0])
    weight = seen[1:] & seen[:1]
    weight = weight / weight.sum(axis=1, keepdims=True)
    moved = np.einsum("rm,drmi->dri", weight, many[:, 1:] - many[:, :1])
    turned = moved @ BASE_FROM_TRACKER[:3, :3].T
    return np.cov(turned.reshape(draws, -1).T)


def test_noise_is_what_many_noisy_readings_scatter_by(arm, recording):
    """(delta_ij own_i + shared_i . shared_j) T, a marker missing, frames uneven."""
    points = recording.points.copy()
    points[2, 1] = np.nan
    frames = np.tile([4, 1, 2, 9], POSES)
    tracker = replace(recording.tracker, repeatability=np.array([1e-5, 2e-5, 4e-5]))
    uneven = replace(recording, points=points, frames=frames, tracker=tracker)
    noise = every_plateau(arm, uneven).noise
    stated = noise._covariance(np.arange(PLATEAUS)[None], None)[0]
    seen = scatter(uneven, arm)
    # 4,000 draws: relative standard error of a variance 2.2 %, five of them
    spread = np.sqrt(np.outer(np.diag(stated), np.diag(stated)))
    np.testing.assert_allclose(seen / spread, stated / spread, atol=0.11)
    np.testing.assert_allclose(
        noise.sigma()[:PLATEAUS].ravel(), np.sqrt(np.diag(stated)), rtol=1e-12
    )


def test_markers_of_one_target_do_not_average_each_others_noise(arm, recording):
    together = tuple(replace(m, target="t1") for m in recording.markers)
    one = every_plateau(arm, replace(recording, markers=together))
    four = every_plateau(arm, recording)
    np.testing.assert_allclose(one.sigma, 2.0 * four.sigma, rtol=1e-12)


def test_whitened_errors_are_independent_with_sigma_one(arm, recording):
    noise = every_plateau(arm, recording).noise
    per_wrench = np.random.default_rng(3).standard_normal((POSES * PLATEAUS, 3, 6))
    per_wrench *= 1e-5
    rows = np.arange(PLATEAUS)[None]
    covariance = noise._covariance(rows, per_wrench)[0]
    whiten = noise.whitener(per_wrench)
    unit = np.zeros((POSES * PLATEAUS, 3, 3 * PLATEAUS))
    unit[:PLATEAUS] = np.eye(3 * PLATEAUS).reshape(PLATEAUS, 3, -1)
    transform = whiten(unit)[:PLATEAUS].reshape(3 * PLATEAUS, -1)
    np.testing.assert_allclose(
        transform @ covariance @ transform.T, np.eye(3 * PLATEAUS), atol=1e-9
    )


def test_places_that_are_not_stated_are_found_from_the_readings(arm):
    """Of a rigid arm exactly; the recording's frame must be known."""
    posture, forces = postures(arm, 5, seed=4), pulls(5, 1, seed=5)
    rigid = record(arm, posture, forces, compliance=np.zeros(6))
    unknown = tuple(replace(m, position=None) for m in rigid.markers)
    data = every_plateau(arm, replace(rigid, markers=unknown))
    np.testing.assert_allclose(
        data.cases.point_in_flange[0], PLACES.mean(axis=0), atol=1e-12
    )


def test_flange_comes_before_tool_and_tool_before_the_last_link(arm, recording):
    bodies = ("link_6", "tool", "flange", "link_2")
    for kept, expected in ((4, [2]), (2, [1]), (1, [0])):
        markers = tuple(Marker(b, b, np.zeros(3)) for b in bodies[:kept])
        some = replace(
            recording, markers=markers, points=recording.points[:, : len(markers)]
        )
        assert end_effector_markers(arm, some).tolist() == expected


def test_all_reasons_against_a_recording_are_given_at_once(arm, recording):
    posture = recording.posture.copy()
    posture[3, 4] = np.nan
    bad = replace(
        recording,
        posture=posture,
        wrench=None,
        tracker=None,
        rows="stream",
        markers=(),
        points=None,
    )
    with pytest.raises(Unusable) as error:
        every_plateau(arm, bad)
    words = ("axis a5", "row 3", "stream", "fx_n", "[sensors.tracker]", "flange")
    assert [word for word in words if word not in str(error.value)] == []


def test_recording_without_any_pair_is_refused(arm, recording):
    idle = recording.take(recording.stage == UNLOADED)
    with pytest.raises(Unusable, match="no visit has both"):
        every_plateau(arm, idle)


def test_load_cases_that_disagree_are_refused_with_all_faults():
    """Also where nobody checks the annotations, as these tests do."""
    unchecked = object.__new__(LoadCases)
    unchecked.__dict__.update(
        posture=np.full((2, 6), np.nan),
        wrench_in_base=np.zeros((3, 6)),
        point_in_flange=np.zeros((1, 3)),
    )
    with pytest.raises(Unusable) as error:
        unchecked.__post_init__()
    words = ("wrench_in_base is (3, 6)", "point_in_flange is (1, 3)", "posture, row 0")
    assert [word for word in words if word not in str(error.value)] == []
