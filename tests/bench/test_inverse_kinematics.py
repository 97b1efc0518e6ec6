"""Closed-form inverse kinematics undoes forward kinematics, for any arm of its kind."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bench.inverse_kinematics import OrthoParallelArm, inverse
from bench.shared.errors import Unusable
from bench.standard_plans import KR10

length = st.floats(0.02, 1.0)
offset = st.floats(-0.3, 0.3)
zero = st.floats(-np.pi, np.pi)
arms = st.fixed_dictionaries(
    {name: offset for name in ("a1", "a2")}
    | {name: length for name in ("c1", "c2", "c3", "c4")}
    | {"b": st.floats(-0.1, 0.1)}
    | {"offset": st.tuples(*[zero] * 6)}
    | {"sign": st.tuples(*[st.sampled_from((-1, 1))] * 6)}
)
postures = st.lists(st.floats(-3.1, 3.1), min_size=6, max_size=6).map(np.array)


def forward(arm, posture):
    """Return base_from_flange, 4 x 4 transforms in m, of postures in rad."""
    angles = posture.reshape(-1, 6) * np.array(arm.sign) - np.array(arm.offset)
    upper_arm = Rotation.from_euler("ZY", angles[:, :2])
    forearm = upper_arm * Rotation.from_euler("Y", angles[:, 2:3])
    flange = forearm * Rotation.from_euler("ZYZ", angles[:, 3:])
    transform = np.tile(np.eye(4), (len(angles), 1, 1))
    transform[:, :3, :3] = flange.as_matrix()
    transform[:, :3, 3] = (
        Rotation.from_euler("Z", angles[:, :1]).apply([arm.a1, arm.b, arm.c1])
        + upper_arm.apply([0.0, 0.0, arm.c2])
        + forearm.apply([arm.a2, 0.0, arm.c3])
        + flange.apply([0.0, 0.0, arm.c4])
    )
    return transform.reshape(*posture.shape[:-1], 4, 4)


def angle_between(one, other):
    """Return the difference of angles, in rad, whole turns aside."""
    return np.abs(np.angle(np.exp(1j * (one - other))))


@given(arms, postures)
@settings(max_examples=150, deadline=None)
def test_every_solution_puts_the_flange_where_it_was_asked_to_be(lengths, posture):
    arm = OrthoParallelArm(**lengths)
    asked = forward(arm, posture)
    solutions = inverse(arm, asked)
    reached = forward(arm, solutions[~np.isnan(solutions).any(axis=1)])
    assert len(reached) >= 2  # the posture itself and its flipped wrist
    np.testing.assert_allclose(reached, np.tile(asked, (len(reached), 1, 1)), 0, 1e-12)


@given(arms, postures)
@settings(max_examples=150, deadline=None)
def test_the_posture_that_made_a_transform_is_among_its_solutions(lengths, posture):
    """Away from singular postures, where an angle is free or a root is flat."""
    arm = OrthoParallelArm(**lengths)
    t = posture * np.array(arm.sign) - np.array(arm.offset)
    bend = t[2] + np.arctan2(arm.a2, arm.c3)
    reach = arm.a1 + arm.c2 * np.sin(t[1])
    reach += arm.a2 * np.cos(t[1] + t[2]) + arm.c3 * np.sin(t[1] + t[2])
    singular = min(abs(np.sin(t[4])), abs(np.sin(bend)), abs(reach))
    solutions = inverse(arm, forward(arm, posture))
    off = angle_between(solutions, posture).max(axis=1)
    if singular > 1e-3:  # rounding of 1e-15 grows by its inverse, twice over
        assert np.nanmin(off) < 1e-8


@pytest.mark.parametrize("singular", [(0, 0, 0.3), (0, 0.7, 0), (0.4, 0, 0)])
def test_a_singular_posture_is_still_reached(singular):
    """Stretched elbow, aligned wrist, both: a solution remains, and it is exact."""
    t2, bend, t5 = singular
    psi = np.arctan2(KR10.a2, KR10.c3)
    t = np.array([0.2, t2, bend - psi, 0.5, t5, -0.4])
    asked = forward(KR10, (t + KR10.offset) * KR10.sign)
    reached = forward(KR10, inverse(KR10, asked)[0])
    np.testing.assert_allclose(reached, asked, rtol=0, atol=1e-12)


def test_where_axes_4_and_6_are_one_axis_the_fourth_stays_at_zero():
    asked = forward(KR10, np.deg2rad([10.0, -80.0, 100.0, 30.0, 0.0, 20.0]))
    np.testing.assert_allclose(
        np.rad2deg(inverse(KR10, asked)[0]), [10, -80, 100, 0, 0, 50], rtol=0, atol=1e-9
    )


def test_a_point_out_of_reach_has_no_solution():
    asked = forward(KR10, np.zeros(6))
    asked[0, 3] += 0.02  # the KR10 is stretched 0.6 mm short of its full reach here
    assert np.isnan(inverse(KR10, asked)).all()


def test_solutions_come_in_the_order_that_is_promised():
    posture = np.deg2rad([20.0, -70.0, 100.0, 10.0, 60.0, -30.0])
    solutions = inverse(KR10, forward(KR10, posture))
    t = solutions * np.array(KR10.sign) - np.array(KR10.offset)
    bend = np.angle(np.exp(1j * (t[:, 2] + np.arctan2(KR10.a2, KR10.c3))))
    ahead = angle_between(t[:, 0], np.deg2rad(-20.0)) < 1e-9
    assert ahead.tolist() == [True] * 4 + [False] * 4
    assert (bend[[0, 1]] > 0).all() and (bend[[2, 3]] < 0).all()
    assert (t[::2, 4] >= 0).all() and (t[1::2, 4] <= 0).all()


def test_the_distance_of_the_wrist_obeys_the_law_of_the_header():
    k, psi = np.hypot(KR10.a2, KR10.c3), np.arctan2(KR10.a2, KR10.c3)
    for t3 in np.linspace(-3, 3, 7):
        t = np.array([0.0, 0.3, t3, 0.0, 0.0, 0.0])
        flange = forward(KR10, (t + KR10.offset) * KR10.sign)
        wrist = flange[:3, 3] - KR10.c4 * flange[:3, 2]
        r2 = np.sum((wrist - [KR10.a1, KR10.b, KR10.c1]) ** 2)
        law = ((KR10.c2 + k) ** 2 - r2) / (r2 - (KR10.c2 - k) ** 2)
        assert np.tan((t3 + psi) / 2) ** 2 == pytest.approx(law, rel=1e-9)


def test_batches_of_any_shape_give_what_single_transforms_give():
    posture = np.random.default_rng(0).uniform(-2, 2, (3, 2, 6))
    many = inverse(KR10, forward(KR10, posture))
    assert many.shape == (3, 2, 8, 6)
    one = inverse(KR10, forward(KR10, posture[2, 1]))
    np.testing.assert_allclose(many[2, 1], one, rtol=0, atol=1e-12)


def test_faulty_parameters_are_refused_all_at_once():
    with pytest.raises(Unusable) as refused:
        OrthoParallelArm(
            np.nan, 0.0, 0.0, 0.4, 0.0, 0.5, 0.1, offset=(0.0,), sign=(1, 1, 1, 1, 1, 2)
        )
    assert len(refused.value.faults) == 4
    for words in ("a1 is nan", "c2", "offset", "sign"):
        assert words in str(refused.value)
