"""Outliers are listed, left out, and cost nothing but themselves."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_bench import FEW, arm, recording, relative

from bench.shared.recording import Recording
from stiffness.diagnosis.diagnose import diagnose
from stiffness.experiment.outliers import (
    Outlier,
    _of_body,
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
