from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.instruments import Encoders, ForceSensor, Markers, Slip, Tracker
from bench.instruments.force_sensor import NO_GAIN
from bench.instruments.random_streams import CAUSES, streams
from bench.instruments.tracker import (
    CORRELATION_LENGTH,
    DISTANCE,
    FEATURES,
    MIDDLE,
    DriftCourse,
    displaced,
    inverse,
    smooth_field,
    standpoint,
)
from bench.kinematic_chain import anatomy
from bench.model_file import load
from bench.shared.errors import UnknownName, Unusable

ROWS, MARKS = 400, 5
MICROMETRE = 1e-6
SILENT = Tracker(noise=0.0)


@pytest.fixture(scope="module")
def points():
    """Marks that stand still for two hours, in the base's frame."""
    place = np.random.default_rng(3).uniform(-0.5, 0.5, (MARKS, 3)) + MIDDLE
    return np.tile(place, (ROWS, 1, 1))


@pytest.fixture(scope="module")
def time():
    """Row by row, in s."""
    return np.linspace(0.0, 7200.0, ROWS)


@pytest.fixture(scope="module")
def stuck(kr10):
    """Marks on the KR10."""
    model = load(kr10)
    return Markers().stick(model, anatomy(model), streams(0))


def see(tracker, points, time, seed=1):
    normal = np.broadcast_to([1.0, 0.0, 0.0], points.shape)
    return tracker.read(points, normal, time, streams(seed))[0]


def sure(sample, sigma, wrong=1e-6):
    """Whether a sample's scatter is that of sigma, but for a chance of `wrong`."""
    count = np.size(sample)
    low, high = stats.chi2.ppf([wrong / 2, 1 - wrong / 2], count)
    return low < np.sum((np.ravel(sample) / sigma) ** 2) < high


# --- Chance --------------------------------------------------------------------------


def test_causes_draw_from_streams_of_their_own():
    first = [streams(7)[cause].standard_normal(3) for cause in CAUSES]
    again = streams(7)
    backwards = [again[cause].standard_normal(3) for cause in reversed(CAUSES)][::-1]
    np.testing.assert_array_equal(first, backwards)
    assert len(np.unique(first)) == 3 * len(CAUSES)


# --- Tracker -------------------------------------------------------------------------


def test_silent_tracker_reads_places_in_its_own_frame(points, time):
    base_from_tracker = standpoint(streams(1)["tracker_frame"])
    reading = see(SILENT, points, time)
    back = reading @ base_from_tracker[:3, :3].T + base_from_tracker[:3, 3]
    np.testing.assert_allclose(back, points, rtol=0, atol=1e-14)


@given(st.integers(0, 10_000))
def test_tracker_stands_before_the_arm_and_looks_at_it(seed):
    transform = standpoint(np.random.default_rng(seed))
    turn, place = transform[:3, :3], transform[:3, 3]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), rtol=0, atol=1e-14)
    assert np.linalg.det(turn) > 0.0
    distance = np.linalg.norm(place - MIDDLE)
    assert DISTANCE[0] <= distance <= DISTANCE[1]
    ahead = inverse(transform, MIDDLE) / distance
    assert ahead[2] > np.cos(np.deg2rad(30.0))  # five sigma of its tilt


def test_noise_has_the_stated_sigma_along_each_axis_of_the_tracker(points, time):
    sigma = np.array([10.0, 10.0, 25.0]) * MICROMETRE
    noisy = Tracker(repeatability=tuple(sigma.tolist()))
    error = see(noisy, points, time) - see(SILENT, points, time)
    for axis in range(3):
        assert sure(error[..., axis], sigma[axis])
    assert not sure(error[..., 2], sigma[0])


def test_frames_average_the_noise_and_not_the_field(points, time):
    many = Tracker(frames=16, field=15e-6)
    error = see(many, points, time) - see(Tracker(noise=0.0, field=15e-6), points, time)
    assert sure(error, 10 * MICROMETRE / 4)


def test_silencing_one_cause_leaves_the_draws_of_the_others(points, time):
    both = Tracker(field=15e-6, occlusions=0.1)
    error = see(both, points, time) - see(
        Tracker(noise=0.0, field=15e-6, occlusions=0.1), points, time
    )
    alone = see(Tracker(), points, time) - see(SILENT, points, time)
    seen = ~np.isnan(error)
    # differences of lengths near 2 m, each rounded to 4e-16 m
    np.testing.assert_allclose(error[seen], alone[seen], rtol=0, atol=2e-15)


def test_occluded_readings_are_the_stated_fraction_and_whole_marks(points, time):
    hidden = np.isnan(see(Tracker(occlusions=0.05), points, time))
    assert np.all(hidden.all(axis=2) == hidden.any(axis=2))
    low, high = stats.binom.ppf([5e-7, 1 - 5e-7], ROWS * MARKS, 0.05)
    assert low < hidden[..., 0].sum() < high


def test_mark_that_looks_away_is_not_seen(points, time):
    tracker = Tracker(widest_view=np.deg2rad(80.0).item())
    away = standpoint(streams(1)["tracker_frame"])[:3, 3] - points
    reading, _ = tracker.read(points, away / 2.0, time, streams(1))
    assert not np.isnan(reading).any()
    reading, _ = tracker.read(points, -away / 2.0, time, streams(1))
    assert np.isnan(reading).all()


def test_scaled_tracker_reads_all_lengths_longer(points, time):
    scaled = see(Tracker(noise=0.0, scale=1e-3), points, time)
    np.testing.assert_allclose(scaled, 1.001 * see(SILENT, points, time), rtol=1e-13)


def test_drift_moves_the_readings_along_the_trackers_axes(points, time):
    drifting = Tracker(
        noise=0.0, drift=(DriftCourse((1e-5, 0.0, -2e-5, 0.0, 0.0, 0.0)),)
    )
    error = see(drifting, points, time) - see(SILENT, points, time)
    hours = time[:, None, None] / 3600.0
    np.testing.assert_allclose(
        error,
        np.broadcast_to(hours * [1e-5, 0.0, -2e-5], error.shape),
        rtol=1e-5,
        atol=1e-14,
    )


def test_base_drift_moves_the_arm_along_the_bases_axes(points, time):
    drifting = Tracker(
        noise=0.0, base_drift=(DriftCourse((0.0, 1e-5, 0.0, 0.0, 0.0, 1e-4)),)
    )
    wandered = points + (time / 3600.0)[:, None, None] * [0.0, 1e-5, 0.0]
    turned = np.cross([0.0, 0.0, 1e-4], points) * (time / 3600.0)[:, None, None]
    expected = see(SILENT, wandered + turned, time)
    # what is left of the turn is of second order: (2e-4)² / 2 times 1 m
    np.testing.assert_allclose(see(drifting, points, time), expected, atol=3e-8)


def test_a_drift_that_warms_up_comes_to_rest_after_its_time_constant(points, time):
    warming = DriftCourse((3.6e-2, 0.0, 0.0, 0.0, 0.0, 0.0), time_constant=50.0)
    moved = displaced(points, (warming,), np.linspace(0.0, 1e3, ROWS))
    shift = (moved - points)[:, 0, 0]
    assert np.isclose(shift[-1], 50.0 * 3.6e-2 / 3600.0)
    assert np.all(np.diff(shift) >= -1e-15)
    start = displaced(points, (warming,), np.full(ROWS, 0.1))
    steady = displaced(points, (DriftCourse(warming.rate),), np.full(ROWS, 0.1))
    np.testing.assert_allclose(start - points, steady - points, rtol=2e-3, atol=1e-15)


def test_drifts_of_one_body_add_up(points, time):
    courses = [
        DriftCourse((s, 0.0, 0.0, 0.0, 0.0, 0.0), t)
        for s, t in ((1.0, 1e9), (2.0, 9.0))
    ]
    apart = [displaced(points, (course,), time) - points for course in courses]
    both = displaced(points, tuple(courses), time) - points
    np.testing.assert_allclose(both, apart[0] + apart[1], atol=1e-12)


def test_points_that_wander_keep_their_distances(points, time):
    drifting = DriftCourse((1e-3, 0.0, 2e-3, 0.1, -0.2, 0.3), time_constant=4e3)
    now = displaced(points, (drifting,), time)
    apart = np.linalg.norm(now[:, 1:] - now[:, :-1], axis=2)
    np.testing.assert_allclose(apart, np.tile(apart[0], (ROWS, 1)), rtol=1e-13)


def test_tracker_is_silent_about_its_frame_unless_it_states_one(points, time):
    normal = np.zeros_like(points)
    assert Tracker().read(points, normal, time, streams(1))[1] is None
    honest = Tracker(frame_error=(0.0,) * 6).read(points, normal, time, streams(1))[1]
    np.testing.assert_array_equal(honest, standpoint(streams(1)["tracker_frame"]))
    error = (1e-3, 0.0, 0.0, 0.0, 0.0, 0.01)
    stated = Tracker(frame_error=error).read(points, normal, time, streams(1))[1]
    assert stated is not None
    assert honest is not None
    turn = np.array([[np.cos(0.01), -np.sin(0.01)], [np.sin(0.01), np.cos(0.01)]])
    wrong = stated @ np.linalg.inv(honest)
    np.testing.assert_allclose(wrong[:2, :2], turn, atol=1e-12)
    np.testing.assert_allclose(wrong[:3, 3], error[:3], atol=1e-12)


def test_tracker_names_every_size_that_cannot_be():
    with pytest.raises(Unusable, match=r"noise is -1.*\n.*occlusions is 1.0.*below 1"):
        Tracker(noise=-1.0, occlusions=1.0)


# --- Smooth field --------------------------------------------------------------------


@given(st.integers(0, 10_000))
def test_field_is_bounded_and_smooth(seed):
    field = smooth_field(15e-6, np.random.default_rng(seed))
    place = np.random.default_rng(seed + 1).uniform(-2.0, 2.0, (200, 3))
    value = field.at(place)
    assert np.abs(value).max() <= 15e-6 * np.sqrt(2 * FEATURES)
    # a slope of sd/L per coordinate, 6 sigma, over 3 mm of deflection: 0.54 µm
    step = np.abs(field.at(place + np.array([0.003, 0.0, 0.0])) - value).max()
    assert 0.0 < step < 6 * 15e-6 / CORRELATION_LENGTH * 0.003


def test_field_has_the_stated_size_and_correlation():
    """Over many fields: variance sd², exp(-1/2) of it at the correlation length."""
    place = np.array([[0.0, 0.0, 0.0], [CORRELATION_LENGTH, 0.0, 0.0]])
    drawn = np.array(
        [smooth_field(2.0, np.random.default_rng(s)).at(place) for s in range(1000)]
    )
    here, there = drawn[:, 0].ravel(), drawn[:, 1].ravel()
    # 3000 values: one sigma of a variance is sqrt(2 / 3000) = 2.6 %, bounds at 4
    assert np.mean(here**2) == pytest.approx(4.0, rel=0.11)
    assert np.mean(here * there) == pytest.approx(4.0 * np.exp(-0.5), abs=0.4)


def test_field_is_the_same_wherever_one_comes_back(points, time):
    reading = see(Tracker(noise=0.0, field=15e-6), points, time)
    np.testing.assert_array_equal(reading, np.tile(reading[0], (ROWS, 1, 1)))


# --- Force sensor --------------------------------------------------------------------


@pytest.fixture(scope="module")
def wrench():
    """Ten rows of one load in each of 60 visits."""
    once = np.random.default_rng(5).uniform(-50.0, 50.0, (60, 6))
    return np.repeat(once, 10, axis=0)


VISIT = np.repeat(np.arange(60), 10)


def feel(sensor, wrench, seed=1):
    return sensor.read(wrench, VISIT, streams(seed))


def test_silent_sensor_reads_the_load_itself(wrench):
    np.testing.assert_array_equal(feel(ForceSensor(noise=0.0), wrench), wrench)


def test_sensor_noise_has_the_stated_sigma(wrench):
    error = feel(ForceSensor(), wrench) - wrench
    assert sure(error[:, :3], 0.04)
    assert sure(error[:, 3:], 0.002)


def test_reading_follows_the_equation(wrench):
    gain = np.array(NO_GAIN)
    gain[0, 0], gain[3, 2] = 0.01, 0.002
    turn = 0.1
    sensor = ForceSensor(
        noise=0.0,
        bias=(1.0, 0.0, 0.0, 0.0, 0.0, 0.2),
        gain=tuple(map(tuple, gain.tolist())),
        mounting=(0.0, 0.0, turn),
    )
    c, s = np.cos(turn), np.sin(turn)
    back = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])  # exp(mounting)ᵀ
    felt = wrench @ np.kron(np.eye(2), back).T
    expected = felt + np.array([1.0, 0, 0, 0, 0, 0.2])
    expected[:, 0] += 0.01 * felt[:, 0]
    expected[:, 3] += 0.002 * felt[:, 2]
    np.testing.assert_allclose(feel(sensor, wrench), expected, atol=1e-12)


def test_sensor_beside_its_place_feels_the_pull_about_its_own_origin(wrench):
    """M' = M - d x F, d from where it should be to where it is."""
    offset = (0.01, -0.02, 0.035)
    felt = feel(ForceSensor(noise=0.0, offset=offset), wrench)
    np.testing.assert_array_equal(felt[:, :3], wrench[:, :3])
    levered = wrench[:, 3:] - np.cross(offset, wrench[:, :3])
    np.testing.assert_allclose(felt[:, 3:], levered, atol=1e-12)


def test_error_of_the_force_is_shared_by_a_visit_and_has_its_size(wrench):
    sensor = ForceSensor(noise=0.0, turn=0.005, size=0.01)
    reading = feel(sensor, wrench).reshape(60, 10, 6)
    np.testing.assert_array_equal(reading, np.tile(reading[:, :1], (1, 10, 1)))
    before, after = wrench[::10, :3], reading[:, 0, :3]
    size = np.linalg.norm(after, axis=1) / np.linalg.norm(before, axis=1)
    assert sure(size - 1.0, 0.01)
    unit = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in (before, after)]
    angle = np.linalg.norm(np.cross(*unit), axis=1)
    # two of the three turns move the direction: angle² is chi-square with 2 degrees
    low, high = stats.chi2.ppf([5e-7, 1 - 5e-7], 120)
    assert low < np.sum((angle / 0.005) ** 2) < high


def test_silencing_the_sensor_leaves_the_error_of_the_visit(wrench):
    noisy = feel(ForceSensor(turn=0.005), wrench)
    silent = feel(ForceSensor(noise=0.0, turn=0.005), wrench)
    alone = feel(ForceSensor(), wrench) - wrench
    np.testing.assert_allclose(noisy - silent, alone, atol=1e-13)


def test_readings_come_in_steps_of_the_resolution(wrench):
    reading = feel(ForceSensor(resolution=(0.04, 0.002)), wrench)
    for part, step in ((reading[:, :3], 0.04), (reading[:, 3:], 0.002)):
        np.testing.assert_allclose(part / step, np.rint(part / step), atol=1e-9)
    fine = feel(ForceSensor(), wrench)
    assert np.abs(reading - fine)[:, :3].max() <= 0.02 + 1e-12


def test_force_sensor_names_every_size_that_cannot_be():
    with pytest.raises(Unusable, match=r"turn is -0.1.*\n.*bias is .*6 numbers"):
        ForceSensor(turn=-0.1, bias=(1.0,))


# --- Encoders ------------------------------------------------------------------------


def test_motors_arrive_with_the_stated_scatter_once_per_visit():
    arrival = Encoders(arrival=7e-6).arrive(300, 6, streams(2))
    assert arrival.shape == (300, 6)
    assert sure(arrival, 7e-6)
    np.testing.assert_array_equal(Encoders().arrive(300, 6, streams(2)), 0.0 * arrival)


def test_encoders_after_the_gears_read_the_true_angle_with_noise():
    angle = np.random.default_rng(0).uniform(-2, 2, (300, 6))
    assert Encoders().read(angle, (False,) * 6, streams(2)) is None
    reading = Encoders(link_side=True).read(angle, (False,) * 6, streams(2))
    assert reading is not None
    assert sure(reading - angle, np.deg2rad(0.0005))


def test_encoders_name_every_size_that_cannot_be():
    with pytest.raises(Unusable, match=r"2 faults:(.|\n)*arrival(.|\n)*noise"):
        Encoders(arrival=-1.0, noise=float("nan"))


# --- Markers -------------------------------------------------------------------------


def test_kr10_carries_28_marks_four_on_each_body(stuck):
    names = [mark.marker.name for mark in stuck]
    assert len(names) == len(set(names)) == 28
    assert names[:5] == ["base_a", "base_b", "base_c", "base_d", "link1_a"]
    bodies = [mark.marker.body for mark in stuck]
    assert [bodies.count(f"link_{k}") for k in range(1, 7)] == [4, 4, 4, 4, 4, 0]
    assert bodies.count("base") == bodies.count("flange") == 4


@pytest.mark.parametrize("arm", ["kr10_r1100_2/kr10_r1100_2.xml", "ur10/ur10.xml"])
def test_marks_of_a_body_fix_its_pose_and_can_be_told_apart_by_distances(arm, root):
    model = load(root / "mjcf" / arm)
    stuck = Markers().stick(model, anatomy(model), streams(0))
    for first in range(0, len(stuck), 4):
        places = np.array([mark.position for mark in stuck[first : first + 4]])
        spread = np.linalg.svd(places - places.mean(axis=0), compute_uv=False)
        assert spread[2] > 0.04  # far from one plane, in m
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        assert apart[np.triu_indices(4, 1)].min() > 0.07
        for order in list(permutations(range(4)))[1:]:
            # no turn of the body brings them onto each other, not even nearly
            assert np.abs(apart[np.ix_(order, order)] - apart).max() > 0.008
        names = {mark.marker.body for mark in stuck[first : first + 4]}
        assert len(names) == 1


def test_marks_stand_on_a_kr10_above_the_floor(stuck):
    base = np.array([m.position for m in stuck if m.marker.body == "base"])
    assert base[:, 2].min() > 0.0
    flange = np.array([m.position for m in stuck if m.marker.body == "flange"])
    radius = np.linalg.norm(flange[:, :2], axis=1)
    assert radius.min() > 0.041  # beside the force sensor
    assert radius.max() < 0.15


def test_normals_of_marks_look_outwards(stuck):
    for mark in stuck:
        assert np.linalg.norm(mark.normal) == pytest.approx(1.0, abs=1e-12)
        centre = np.mean(
            [m.position for m in stuck if m.marker.body == mark.marker.body], axis=0
        )
        assert (mark.position - centre) @ mark.normal > 0.0


def test_marks_are_stuck_beside_their_nominal_places_by_the_placement(kr10, stuck):
    model = load(kr10)
    beside = Markers(placement=5e-4).stick(model, anatomy(model), streams(0))
    error = np.array([mark.position - mark.marker.position for mark in beside])
    assert sure(error, 5e-4)
    for exact, mark in zip(stuck, beside, strict=True):
        np.testing.assert_array_equal(exact.position, exact.marker.position)
        np.testing.assert_array_equal(exact.marker.position, mark.marker.position)


def test_marks_of_the_flange_are_the_same_with_and_without_the_others(kr10):
    model = load(kr10)
    everywhere = Markers(placement=5e-4).stick(model, anatomy(model), streams(0))
    alone = Markers("flange", placement=5e-4).stick(model, anatomy(model), streams(0))
    assert len(alone) == 4
    for one, other in zip(everywhere[-4:], alone, strict=True):
        np.testing.assert_array_equal(one.position, other.position)


def test_places_can_be_left_out_of_the_manifest(kr10):
    model = load(kr10)
    stuck = Markers(stated=False).stick(model, anatomy(model), streams(0))
    assert all(mark.marker.position is None for mark in stuck)


def test_slips_of_a_mark_add_from_their_time_on():
    slips = (
        Slip("link2_a", 10.0, (1.0, 0.0, 0.0)),
        Slip("link2_a", 20.0, (0.0, 2.0, 0.0)),
        Slip("link2_b", 0.0, (5.0, 5.0, 5.0)),
    )
    moved_by = Markers(slips=slips).slipped("link2_a", np.array([9.9, 10.0, 20.0]))
    np.testing.assert_array_equal(moved_by, [[0, 0, 0], [1, 0, 0], [1, 2, 0]])


def test_slip_of_a_mark_that_does_not_exist_is_refused(kr10):
    model = load(kr10)
    markers = Markers(slips=(Slip("link2_e", 1.0, (0.0, 0.0, 0.0)),))
    with pytest.raises(UnknownName, match=r"link2_e.*Did you mean 'link2_"):
        markers.stick(model, anatomy(model), streams(0))
