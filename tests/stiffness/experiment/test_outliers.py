"""Outliers are listed, left out, and cost nothing but themselves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_bench import FEW, arm, recording, relative

from bench.shared.recording import Recording
from scenarios.pipelines.patching import patch_of_diagnosis
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.base_compliance import BaseCompliance
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.experiment.outliers import (
    EVERY,
    Outlier,
    _of_body,
    odd_poses,
    outliers_at,
    outliers_of,
    spread_of_bodies,
    without_outliers,
)

SHARE = 1e-3
MM = 1e-3


def with_wild(made: Recording, seed: int) -> tuple[Recording, list[Outlier]]:
    """Put one reading in a thousand off by 1 to 300 mm, and say which."""
    random = np.random.default_rng(seed)
    assert made.points is not None
    points = made.points.copy()
    seen = np.argwhere(np.isfinite(points).all(axis=2))
    wild = []
    for row, m in random.permutation(seen)[: max(1, round(SHARE * len(seen)))]:
        size = MM * 300.0 ** random.uniform()
        way = random.normal(size=3)
        points[row, m] += size * way / np.linalg.norm(way)
        pose = int(made.posture_id[row])
        wild.append(Outlier(int(row), pose, made.markers[m].name, size))
    return replace(made, points=points), sorted(wild, key=lambda o: (o.row, o.marker))


def only(made: Recording, count: int) -> Recording:
    """Keep the last marks alone."""
    assert made.points is not None
    points, markers = made.points[:, -count:], made.markers[-count:]
    return replace(made, points=points, markers=markers)


def _body_of(made: Recording, marker: str) -> list[int]:
    body = {m.name: m.body for m in made.markers}
    return [k for k, m in enumerate(made.markers) if m.body == body[marker]]


def listed(found) -> list[tuple[int, str]]:
    return sorted((o.row, o.marker) for o in found)


@pytest.mark.parametrize("seed", range(5))
def test_every_wild_reading_is_listed_with_its_size_and_no_other(seed):
    seen, wild = with_wild(recording(), seed)
    found = outliers_of(seen)
    assert listed(found) == listed(wild)
    sizes = {(o.row, o.marker): o.size for o in found}
    assert seen.points is not None
    for o in wild:  # of three marks alone the distances show a part of it
        size = sizes[o.row, o.marker]
        whole = np.isfinite(seen.points[o.row, _body_of(seen, o.marker)]).all()
        assert 0.3 * o.size < size < o.size + 0.1 * MM
        assert not whole or size > o.size - 0.1 * MM


def test_nothing_is_wild_in_a_sound_recording():
    assert outliers_of(recording()) == ()
    assert outliers_of(recording("bearing_tilt@a3")) == ()


def test_bodies_that_turn_under_load_are_no_outliers_of_relative_readings():
    made = relative(recording("hysteresis@a2,width_rad=4e-4", poses=20))
    assert outliers_of(made) == ()
    assert spread_of_bodies(made) is None
    assert diagnose(made, arm(), FEW).outliers == ()


@pytest.mark.parametrize("size", [0.3, 300.0])
def test_wild_reading_is_listed_in_relative_readings_too(size):
    made = relative(recording(poses=20))
    assert made.points is not None
    points = made.points.copy()
    row = int(np.flatnonzero(np.diff(made.visit) == 0)[40]) + 1
    points[row, 9] += np.array([1.0, -0.7, 1.3]) * size * MM
    found = diagnose(replace(made, points=points), arm(), FEW)
    assert listed(found.outliers) == [(row, made.markers[9].name)]


def test_of_three_marks_the_one_that_is_wild_is_listed():
    made = only(recording(), 3)
    assert made.points is not None
    points = made.points.copy()
    along = points[7, 1] - points[7, 0] + points[7, 1] - points[7, 2]
    points[7, 1] += 5 * MM * along / np.linalg.norm(along)
    found = outliers_of(replace(made, points=points))
    assert listed(found) == [(7, made.markers[1].name)]


def test_of_four_marks_the_two_that_are_wild_are_listed():
    made = only(recording(), 4)
    assert made.points is not None
    points = made.points.copy()
    row = int(np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))[9])
    points[row, 1] += [3 * MM, 1 * MM, -2 * MM]
    points[row, 3] += [-25 * MM, 10 * MM, 7 * MM]
    found = outliers_of(replace(made, points=points))
    assert listed(found) == [(row, made.markers[m].name) for m in (1, 3)]


def test_of_two_marks_that_are_seen_the_wild_one_is_told_by_the_fitted_arm():
    made = only(recording(poses=20), 4)
    assert made.points is not None
    points = made.points.copy()
    row = int(np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))[9])
    points[row, 2] += [3 * MM, 1 * MM, -2 * MM]
    points[row, :2] = np.nan
    found = diagnose(replace(made, points=points), arm(), FEW)
    assert listed(found.outliers) == [(row, made.markers[2].name)]


def test_mark_that_stays_where_it_slipped_to_is_no_outlier():
    made = recording()
    assert made.points is not None
    points = made.points.copy()
    points[len(points) // 2 :, 9] += 2 * MM
    assert outliers_of(replace(made, points=points)) == ()


@pytest.mark.parametrize("count", [1, 4])
def test_wild_readings_cost_nothing_but_themselves(count):
    made = only(recording("hysteresis@a2,width_rad=4e-4", poses=20), count)
    seen, wild = with_wild(made, 3)
    plain, found = diagnose(made, arm(), FEW), diagnose(seen, arm(), FEW)
    assert listed(found.outliers) == listed(wild)
    assert plain.outliers == ()
    assert [n.name for n in found.named] == [n.name for n in plain.named]
    (told,) = [w for w in found.warnings if w.code == "outliers"]
    assert f"{wild[0].marker} in pose {wild[0].pose}" in told.text
    if plain.named:
        width, before = (d.named[0].parameters["width_rad"] for d in (found, plain))
        assert before.low < width.estimate < before.high


def test_left_out_reading_is_as_one_that_was_not_seen():
    made = recording()
    name = made.markers[2].name
    left = without_outliers(made, [Outlier(5, int(made.posture_id[5]), name, MM)])
    assert left.points is not None and made.points is not None
    assert np.isnan(left.points[5, 2]).all()
    assert np.isnan(left.points).sum() == np.isnan(made.points).sum() + 3
    assert without_outliers(made, ()) is made


def test_noise_of_a_mark_that_others_place_badly_is_no_outlier():
    """Three marks nearly on a line: the body may seem to turn about it."""
    random, rows = np.random.default_rng(1), 20_000
    place = 0.1 * np.array([[0, 0, 0], [1, 0.02, 0], [2, 0, 0], [1, 1.5, 0]])
    turn = Rotation.from_rotvec(random.normal(size=(rows, 3)))
    points = np.stack([turn.apply(at) for at in place], axis=1)
    points += 1e-5 * random.normal(size=points.shape)
    points[7, 3] += 20 * MM
    found = np.zeros((rows, 4))
    _of_body(points, [0, 1, 2, 3], found)
    assert np.argwhere(found).tolist() == [[7, 3]]


TRUE = {
    "hysteresis@a2": "width_rad=2e-4",
    "bearing_tilt@a4": "u_rad_per_nm=8e-6,v_rad_per_nm=8e-6",
    "base_compliance@base": "rx_rad_per_nm=4e-7,ry_rad_per_nm=4e-7",
}


def bumped(made: Recording, poses: np.ndarray) -> Recording:
    """Let the tracker be pushed by a quarter of a millimetre within these poses."""
    assert made.points is not None
    points = made.points.copy()
    for pose in poses:
        rows = np.flatnonzero(made.posture_id == pose)
        points[rows[len(rows) // 2 :]] += np.array([1.5e-4, -2e-4, 1e-4])
    return replace(made, points=points)


def exchanged(made: Recording, poses: np.ndarray) -> Recording:
    """Write down the readings of two loads one for the other in these poses."""
    assert made.points is not None and made.wrench is not None
    points, size = made.points.copy(), np.linalg.norm(made.wrench[:, :3], axis=1)
    for pose in poses:
        rows = np.flatnonzero(made.posture_id == pose)
        order = rows[np.argsort(size[rows])]
        points[order[[0, -1]]] = points[order[[-1, 0]]]
    return replace(made, points=points)


@pytest.mark.parametrize("fault", [bumped, exchanged])
def test_poses_that_were_read_wrongly_cost_nothing_but_themselves(fault):
    """Three of sixty; they held every name, as no law does what they do."""
    made = recording(*(f"{name},{size}" for name, size in TRUE.items()), poses=60)
    odd = np.unique(made.posture_id)[[7, 20, 41]]
    found = diagnose(fault(made, odd), arm(), (*FEW, BearingTilt(), BaseCompliance()))
    assert {f"{e.name.effect}@{e.name.where}" for e in found.named} == {*TRUE}
    assert found.verdict == "partly_explained" and not found.unexplained_places
    assert {o.pose for o in found.outliers} == {*odd.tolist()}
    assert not {*odd.tolist()} & {*found.held_out}
    (said,) = (w for w in found.warnings if w.code == "odd_poses")
    assert all(str(pose) in said.text for pose in odd)
    less = without_outliers(made, found.outliers)
    others = made.take(np.flatnonzero(~np.isin(made.posture_id, odd)))
    patches = [patch_of_diagnosis(found, some, arm()) for some in (less, others)]
    assert patches[0].fitted == patches[1].fitted  # where they were does not count


@pytest.mark.parametrize(
    ("size", "odd"),
    [
        ({3: 100.0, 9: 60.0}, {3, 9}),
        ({3: 100.0, 9: 28.0}, {3}),  # not three times what most have
        ({3: 35.0}, set()),  # all others together are as far off
        (dict.fromkeys(range(5), 100.0), set()),  # a group of their own
        ({}, set()),
    ],
)
def test_poses_are_odd_where_few_have_most_of_what_is_left(size, odd):
    left, readings = np.full(40, 10.0), np.full(40, 25.0)
    left[[*size]] = [*size.values()]
    assert {*np.flatnonzero(odd_poses(left**2, readings)).tolist()} == odd
    few = odd_poses(left[:15] ** 2, readings[:15])
    assert not few.any()  # they tell no quantile


def test_pose_that_is_visited_again_and_again_is_not_odd():
    """Forty times, to see the drift: it has as much in each visit as any other."""
    square, readings = np.full(40, 60.0), np.full(40, 25.0)
    square[7], readings[7] = 40 * 60.0, 40 * 25
    assert not odd_poses(square, readings).any()
    square[7] *= 16.0
    assert odd_poses(square, readings).tolist() == [k == 7 for k in range(40)]


def test_readings_of_a_pose_are_left_out_in_all_of_its_rows():
    made = recording()
    assert made.points is not None
    pose = int(made.posture_id[-1])
    unseen = np.full(made.points.shape, 1e-4)
    unseen[0] = np.nan
    assert not outliers_at(
        made, [int(made.posture_id[0])], np.full_like(unseen, np.nan)
    )
    found = outliers_at(made, [pose], unseen)
    less = without_outliers(made, found).points
    assert less is not None
    gone = made.posture_id == pose
    assert np.isnan(less[gone]).all()
    np.testing.assert_array_equal(less[~gone], made.points[~gone])
    assert {o.marker for o in found} == {EVERY}
    np.testing.assert_allclose([o.size for o in found], np.sqrt(3.0) * 1e-4)
