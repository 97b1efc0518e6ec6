from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_truth import BASE_FROM_TRACKER, TABLE_3, postures, pulls, record

from bench.shared.errors import Unusable
from bench.shared.recording import Marker, Payload
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium
from stiffness.robot.tracker_frame import kabsch, tracker_frame
from stiffness.robot.wrench import sensor_in_flange, wrench_in_base


@pytest.fixture(scope="module")
def arm(kr10):
    return Arm.from_mjcf(kr10)


@pytest.fixture(scope="module")
def recording(arm):
    """Thirty poses of an arm that does not give way, without noise."""
    posture, forces = postures(arm, 30, seed=0), pulls(30, 2, seed=1)
    return record(arm, posture, forces, compliance=np.zeros(6))


def with_base_markers(recording):
    """Add three markers on the base to a recording."""
    places = np.array([[0.1, 0.1, 0.0], [0.1, -0.1, 0.0], [-0.1, 0.0, 0.05]])
    turn, shift = BASE_FROM_TRACKER[:3, :3], BASE_FROM_TRACKER[:3, 3]
    seen = np.tile((places - shift) @ turn, (len(recording.time), 1, 1))
    extra = tuple(Marker(f"foot{k}", "base", place) for k, place in enumerate(places))
    return replace(
        recording,
        markers=recording.markers + extra,
        points=np.concatenate([recording.points, seen], axis=1),
    )


def test_kabsch_finds_the_rotation_and_shift_that_made_the_points():
    draw = np.random.default_rng(0)
    points = draw.standard_normal((5, 3))
    turn = Rotation.from_rotvec([0.3, -2.0, 0.7]).as_matrix()
    found = kabsch(points, points @ turn.T + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found[:3, :3], turn, atol=1e-14)
    np.testing.assert_allclose(found[:3, 3], [1.0, 2.0, 3.0], atol=1e-14)


def test_kabsch_is_no_worse_than_any_small_turn_away_from_it():
    """R, t = argmin sum |R p + t - q|^2."""
    draw = np.random.default_rng(1)
    source, target = draw.standard_normal((2, 8, 3))

    def cost(transform):
        left = source @ transform[:3, :3].T + transform[:3, 3] - target
        return np.sum(left**2)

    best = kabsch(source, target)
    for _ in range(20):
        other = best.copy()
        turn = Rotation.from_rotvec(1e-3 * draw.standard_normal(3)).as_matrix()
        other[:3, :3] = turn @ best[:3, :3]
        other[:3, 3] += 1e-3 * draw.standard_normal(3)
        assert cost(best) < cost(other)


def test_points_on_a_line_fix_no_frame():
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    with pytest.raises(Unusable, match="one line"):
        kabsch(line, line)


def test_stated_frame_is_taken_as_it_is(arm, recording):
    frame = tracker_frame(arm, recording)
    assert frame.source == "manifest"
    np.testing.assert_array_equal(frame.base_from_tracker, BASE_FROM_TRACKER)


def test_markers_on_the_base_give_the_frame_however_the_arm_bends(arm):
    posture, forces = postures(arm, 10, seed=2), pulls(10, 1, seed=3)
    soft = replace(record(arm, posture, forces), base_from_tracker=None)
    frame = tracker_frame(arm, with_base_markers(soft))
    assert frame.source == "base markers"
    np.testing.assert_allclose(frame.base_from_tracker, BASE_FROM_TRACKER, atol=1e-12)


def test_markers_of_a_rigid_arm_give_the_frame(arm, recording):
    frame = tracker_frame(arm, replace(recording, base_from_tracker=None))
    assert frame.source == "arm markers"
    np.testing.assert_allclose(frame.base_from_tracker, BASE_FROM_TRACKER, atol=1e-12)


def test_sag_of_a_soft_arm_is_in_its_frame_once_the_springs_are_known(arm):
    posture, forces = postures(arm, 20, seed=4), pulls(20, 1, seed=5)
    soft = replace(record(arm, posture, forces), base_from_tracker=None)
    rigid, sagging = tracker_frame(arm, soft), tracker_frame(arm, soft, 1 / TABLE_3)
    # the arm's own weight bends it by a millimetre
    assert np.abs(rigid.base_from_tracker - BASE_FROM_TRACKER).max() > 1e-4
    np.testing.assert_allclose(sagging.base_from_tracker, BASE_FROM_TRACKER, atol=1e-10)


def test_blank_readings_are_left_out_of_the_frame(arm, recording):
    points = recording.points.copy()
    points[::3, 1] = np.nan
    blank = replace(recording, base_from_tracker=None, points=points)
    frame = tracker_frame(arm, blank)
    np.testing.assert_allclose(frame.base_from_tracker, BASE_FROM_TRACKER, atol=1e-12)


def test_frame_that_nothing_fixes_is_refused_with_advice(arm, recording):
    nowhere = tuple(replace(marker, position=None) for marker in recording.markers)
    unknown = replace(recording, base_from_tracker=None, markers=nowhere)
    with pytest.raises(Unusable, match="three markers on the base"):
        tracker_frame(arm, unknown)
    relative = replace(recording, base_from_tracker=None, displacement="relative")
    with pytest.raises(Unusable, match=r"\[frames.tracker\]"):
        tracker_frame(arm, relative)


@pytest.mark.parametrize("frame", ["sensor", "base"])
def test_wrench_in_base_is_the_force_that_pulled(arm, frame):
    posture, forces = postures(arm, 6, seed=6), pulls(6, 1, seed=7)
    seen = record(arm, posture, forces, compliance=np.zeros(6), frame=frame)
    wrench = wrench_in_base(seen, arm.at(seen.posture))
    pulled = np.concatenate([np.zeros((6, 1, 3)), forces], axis=1).reshape(-1, 3)
    np.testing.assert_allclose(wrench[:, :3], pulled, atol=1e-12)


def test_mounting_of_the_sensor_turns_its_readings(arm, recording):
    """w_base = R_base_body R_body_sensor w_sensor: a sensor turned by 90 degrees."""
    sensor = replace(
        recording.wrench_sensor, quaternion_wxyz=np.sqrt([0.5, 0.0, 0.0, 0.5])
    )
    turned = recording.wrench[:, [1, 0, 2, 4, 3, 5]] * [1, -1, 1, 1, -1, 1]
    other = replace(recording, wrench=turned, wrench_sensor=sensor)
    standing = arm.at(recording.posture)
    np.testing.assert_allclose(
        wrench_in_base(other, standing), wrench_in_base(recording, standing), atol=1e-12
    )


def test_weight_of_the_tool_is_taken_off_where_the_sensor_feels_it(arm, recording):
    tool = Payload(1.5, np.array([0.01, 0.02, 0.07]))
    standing = arm.at(recording.posture)
    sensor = replace(recording.wrench_sensor, includes_tool_weight=True)
    weight = np.array([0.0, 0.0, -9.81 * tool.mass])
    lever = standing.point("flange", tool.com)
    lever = lever - standing.point("flange", sensor.position)
    turn = standing.turn("flange")
    felt = [np.tile(weight, (len(lever), 1)), np.cross(lever, weight)]
    felt = np.concatenate(
        [np.einsum("cji,cj->ci", turn, part) for part in felt], axis=1
    )
    heavy = replace(
        recording, wrench=recording.wrench + felt, wrench_sensor=sensor, tool=tool
    )
    np.testing.assert_allclose(
        wrench_in_base(heavy, standing), wrench_in_base(recording, standing), atol=1e-12
    )


def test_sensor_origin_is_carried_to_the_flange_from_the_last_link(arm, recording):
    sensor = replace(recording.wrench_sensor, body="link_6", position=np.zeros(3))
    moved = sensor_in_flange(arm, replace(recording, wrench_sensor=sensor))
    # the flange lies 28.5 mm along -z of link 6; its own z points outward
    np.testing.assert_allclose(moved, [0.0, 0.0, -0.0285], atol=1e-15)


def test_sensor_before_the_last_axis_is_refused(arm, recording):
    sensor = replace(recording.wrench_sensor, body="link_3")
    with pytest.raises(Unusable, match="'link_3', which does not move with the flange"):
        sensor_in_flange(arm, replace(recording, wrench_sensor=sensor))


def test_recording_without_a_wrench_is_refused_with_what_to_give(arm, recording):
    with pytest.raises(Unusable, match="fx_n"):
        wrench_in_base(replace(recording, wrench=None), arm.at(recording.posture))


def test_unloaded_arm_of_the_simulator_rests_under_its_weight(arm):
    """The simulator of these tests is not rigid by mistake."""
    posture = postures(arm, 3, seed=9)
    assert np.abs(equilibrium(arm, posture, 1 / TABLE_3) - posture).max() > 1e-4
