"""The postures of the paper's Table 1, checked by kinematics that share no code."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.inverse_kinematics import inverse
from bench.postures import spread
from bench.shared.errors import Unusable
from bench.shared.plan import parse_path
from bench.standard_plans import (
    KR10,
    LIMITS,
    cartesian_postures,
    joint_space_postures,
    table_one_plan,
    table_one_postures,
)

PI = np.pi
FRAMES = (
    ((0, 0, 0.208), (PI, 0, 0)),
    ((0.025, -0.0907, -0.192), (PI / 2, 0, 0)),
    ((0.56, 0, -0.0042), (0, 0, 0)),
    ((0.196, -0.025, -0.0865), (PI / 2, 0, -PI / 2)),
    ((0, 0.0505, -0.319), (0, PI / 2, PI / 2)),
    ((0.0615, 0, -0.0505), (PI / 2, 0, -PI / 2)),
)
"""Joint frames, xyz in m and rpy in rad, from KUKA's kr10_r1100_2_macro.xacro
(github.com/kroshu/kuka_robot_descriptions); each joint turns about its own z."""
FLANGE = ((0, 0, -0.0285), (PI, 0, PI))


def transform(xyz, rpy):
    """Return a 4 x 4 transform from a URDF origin."""
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
    out[:3, 3] = xyz
    return out


def flange_in_base(posture):
    """Return base_from_flange by multiplying KUKA's joint frames, in m."""
    out = np.eye(4)
    for frame, angle in zip(FRAMES, posture, strict=True):
        out = out @ transform(*frame) @ transform((0, 0, 0), (0, 0, angle))
    return out @ transform(*FLANGE)


FLANGE_MM = {
    (0, 0, 0, 0, 0, 0): (1190, 0, 425),
    (0, -90, 0, 0, 0, 0): (0, 0, 1565),
    (0, -90, 90, 0, 0, 0): (630, 0, 985),
    (0, -90, 90, 0, 90, 0): (540, 0, 895),
    (30, -90, 90, 0, 0, 0): (545.59600, -315, 985),
    (0, 0, 90, 0, 0, 0): (610, 0, -205),
    (0, -120, 30, 0, 90, 0): (-190, 0, 1399.97423),
    (20, -70, 100, 10, 60, -30): (630.25208, -243.79615, 601.40398),
}
"""Flange of the KR10 R1100-2; by hand from its lengths 400, 25, 560, 25, 515, 90 mm."""


@pytest.mark.parametrize("posture_deg", FLANGE_MM, ids=str)
def test_the_joint_frames_of_the_maker_put_the_flange_where_the_lengths_say(
    posture_deg,
):
    flange = flange_in_base(np.deg2rad(np.array(posture_deg, dtype=float)))
    np.testing.assert_allclose(
        flange[:3, 3] * 1e3, FLANGE_MM[posture_deg], rtol=0, atol=1e-4
    )


def test_the_closed_form_agrees_with_the_joint_frames_of_the_maker():
    drawn = np.random.default_rng(1).uniform(LIMITS[:, 0], LIMITS[:, 1], (50, 6))
    for posture in [*drawn, *np.deg2rad(np.array(list(FLANGE_MM), dtype=float))]:
        asked = flange_in_base(posture)
        solutions = inverse(KR10, asked)
        reached = solutions[~np.isnan(solutions).any(axis=1)]
        assert len(reached) >= 2  # the posture itself and its flipped wrist
        for other in reached:
            np.testing.assert_allclose(flange_in_base(other), asked, 0, 1e-12)


def test_the_table_has_61_and_90_postures_and_none_twice():
    assert len(joint_space_postures()) == 61
    assert len(cartesian_postures()) == 90
    table = table_one_postures()
    assert len(np.unique(table.round(9), axis=0)) == len(table) == 151


def test_each_row_of_the_table_has_its_count():
    rows = np.rint(np.rad2deg(joint_space_postures()[:-1, [0, 2]])).astype(int)
    counts = Counter((int(a1), int(a3)) for a1, a3 in rows)
    ahead = {(0, 0): 7, (0, 30): 7, (0, 60): 9, (0, 90): 7, (0, 120): 9, (0, 150): 9}
    aside = {(a1, a3): 1 for a1 in (-15, -30) for a3 in (0, 30, 60, 90, 120, 150)}
    assert counts == ahead | aside


def test_the_61st_posture_is_home():
    home = np.rad2deg(joint_space_postures()[-1])
    np.testing.assert_allclose(home, [0, -90, 90, 0, 0, 0], rtol=0, atol=1e-12)


def test_joint_space_ranges_are_those_of_the_paper():
    table = np.rad2deg(joint_space_postures())
    lowest, highest = table.min(axis=0), table.max(axis=0)
    np.testing.assert_allclose(lowest, [-30, -180, 0, 0, 0, -30], rtol=0, atol=1e-9)
    np.testing.assert_allclose(highest, [0, 0, 150, 0, 90, 30], rtol=0, atol=1e-9)


def test_only_home_has_axes_4_and_6_on_one_line():
    assert (np.rad2deg(joint_space_postures()[:-1, 4]) >= 5 - 1e-9).all()


def test_the_flange_never_points_into_the_upper_arm():
    table = np.rad2deg(joint_space_postures())
    assert (table[:, 2] + table[:, 4]).max() <= 180 + 1e-9


def test_every_posture_is_within_the_limits():
    table = table_one_postures()
    assert (table >= LIMITS[:, 0]).all() and (table <= LIMITS[:, 1]).all()


@pytest.mark.parametrize("beyond", [0.0, 0.15])
def test_flange_and_hook_stay_above_the_floor_and_clear_of_the_base(beyond):
    """Of a column 0.2 m in radius and 0.55 m high: foot and turning shoulder."""
    for posture in table_one_postures():
        flange = flange_in_base(posture)
        x, y, z = flange[:3, 3] + beyond * flange[:3, 2]
        assert z > 0.1
        assert z > 0.55 or np.hypot(x, y) > 0.2


def test_cartesian_postures_put_the_flange_on_the_grid_pointing_down():
    """To 1 um, by the joint frames of the maker."""
    wanted_mm = [
        (x, y, z)
        for x in (300, 400, 500, 600, 700, 800)
        for y in (-300, -150, 0, 150, 300)
        for z in (300, 550, 800)
    ]
    flanges = np.array([flange_in_base(posture) for posture in cartesian_postures()])
    np.testing.assert_allclose(
        flanges[:, :3, 3], np.array(wanted_mm) / 1e3, rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(
        flanges[:, :3, 2], np.tile([0, 0, -1], (90, 1)), rtol=0, atol=1e-9
    )


def test_cartesian_postures_keep_axes_4_and_6_at_zero_and_axis_5_in_range():
    table = np.rad2deg(cartesian_postures())
    np.testing.assert_allclose(table[:, [3, 5]], 0.0, rtol=0, atol=1e-9)
    assert table[:, 4].min() == pytest.approx(0.796, abs=1e-3)
    assert table[:, 4].max() == pytest.approx(90.183, abs=1e-3)
    assert (table[:, 2] > 0).all()  # elbow up


def test_the_whole_plan_visits_the_whole_table_in_its_order():
    whole = table_one_plan()
    np.testing.assert_array_equal(whole.posture, table_one_postures())
    np.testing.assert_array_equal(whole.posture_id, np.arange(151))


@pytest.mark.parametrize("poses", [1, 2, 12, 75, 150])
def test_fewer_poses_are_evenly_spaced_and_keep_their_id(poses):
    some = table_one_plan(poses)
    np.testing.assert_array_equal(some.posture, table_one_postures()[some.posture_id])
    assert some.visits == poses == len(set(some.posture_id.tolist()))
    steps = np.diff(some.posture_id)
    assert poses == 1 or steps.max() - steps.min() <= 1


def test_revisits_come_last_and_repeat_posture_and_pulley():
    twice = table_one_plan(20, parse_path("0,10,0"), revisits=5)
    assert twice.visits == 25
    for visit in range(20, 25):
        first = int(np.flatnonzero(twice.posture_id == twice.posture_id[visit])[0])
        assert first < 20 and twice.pulley[first] == twice.pulley[visit]


@pytest.mark.parametrize("pulleys", [1, 3, 6, 8])
def test_pulley_places_come_equally_often_and_follow_no_coordinate(pulleys):
    whole = table_one_plan(pulleys=pulleys)
    counts = np.bincount(whole.pulley, minlength=pulleys)
    assert counts.max() - counts.min() <= 2
    flange = np.array([flange_in_base(q)[:3, 3] for q in whole.posture])
    for place in range(pulleys if pulleys > 1 else 0):
        for column in np.hstack([flange, whole.posture[:, [0, 1, 2, 4]]]).T:
            # 0.2: the 95 % bound of a correlation by chance over 151 is 0.16
            assert abs(np.corrcoef(whole.pulley == place, column)[0, 1]) < 0.2


@pytest.mark.parametrize("poses", [0, 152])
def test_a_count_the_table_does_not_have_is_refused_with_advice(poses):
    with pytest.raises(Unusable, match=r"151.*bench\.postures"):
        table_one_plan(poses)


def test_spread_postures_keep_to_the_central_part_and_to_what_is_feasible():
    found = spread(LIMITS, 200, seed=3, feasible=lambda q: q[:, 1] < 0, central=0.5)
    middle, half = LIMITS.mean(axis=1), np.diff(LIMITS, axis=1)[:, 0] / 2
    assert found.shape == (200, 6)
    assert (np.abs(found - middle) <= 0.5 * half + 1e-12).all()
    assert (found[:, 1] < 0).all()


def test_spread_postures_fill_each_axis_evenly():
    found = spread(LIMITS, 500, seed=0, central=1.0)
    share = (found - LIMITS[:, 0]) / np.diff(LIMITS, axis=1)[:, 0]
    for axis in share.T:
        counts, _ = np.histogram(axis, bins=10, range=(0, 1))
        assert np.abs(counts - 50).max() <= 10  # by chance it would be about 20


def test_the_same_seed_spreads_the_same_postures_and_fewer_come_first():
    more = spread(LIMITS, 40, seed=5, feasible=lambda q: q[:, 2] > 0)
    fewer = spread(LIMITS, 7, seed=5, feasible=lambda q: q[:, 2] > 0)
    np.testing.assert_array_equal(more[:7], fewer)
    assert not np.array_equal(more, spread(LIMITS, 40, seed=6))


def test_an_impossible_spread_is_refused_with_advice():
    with pytest.raises(Unusable, match=r"only 0 were feasible.*widen"):
        spread(LIMITS, 2, seed=0, feasible=lambda q: np.zeros(len(q), dtype=bool))
    with pytest.raises(Unusable, match="a2") as refused:
        spread(np.array([[-1.0, 1.0], [-np.inf, np.inf]]), 0, seed=0, central=2.0)
    assert len(refused.value.faults) == 3
