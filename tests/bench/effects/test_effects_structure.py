import re

import numpy as np
import pytest
from lever import HEIGHT, LENGTH, lever, moments, place, respond, turn
from numpy.testing import assert_allclose

from bench.effects.base_compliance import BaseCompliance
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.link_bending import LinkBending
from bench.effects.wrist_coupling import WristCoupling
from bench.rig import RIGID, Rig
from bench.shared.errors import Unusable

STIFF = np.array([RIGID])
SMALL = 2e-4
"""Relative error of first-order hand calculations at turns of up to 1e-4 rad."""


@pytest.fixture
def arm(tmp_path):
    return lever(tmp_path)


# --- Bearings ------------------------------------------------------------------------


def test_bearing_of_480_knm_per_rad_tilts_a_milliradian_under_480_nm(arm):
    """Klimchik 2011, 13 % of the torsional compliance of 63 kN m/rad."""
    rig = Rig(arm, (BearingTilt("a1"),))
    for across in (0, 2):
        tilt = turn(respond(rig, moments(480.0, axis=across)))[0]
        assert_allclose(tilt[across], 1e-3, rtol=1e-6)
        assert_allclose(np.delete(tilt, across), 0.0, atol=1e-6)


def test_bearing_is_as_stiff_about_u_and_v_as_each_is_stated(arm):
    """For an axis along y, u is x and v is -z."""
    rig = Rig(arm, (BearingTilt("a1", 1e-6, 3e-6),))
    assert_allclose(turn(respond(rig, moments(50.0, axis=0)))[0, 0], 50e-6, rtol=SMALL)
    assert_allclose(turn(respond(rig, moments(50.0, axis=2)))[0, 2], 150e-6, rtol=SMALL)


def test_bearing_tilts_about_its_centre(arm):
    """A centre 0.2 m along the axis is 0.2 m away in y: a turn about z shifts by it."""
    rig = Rig(arm, (BearingTilt("a1", 1e-6, 1e-6, centre_m=0.2),))
    moved = np.diff(place(respond(rig, moments(0.0, 50.0, axis=2))), axis=0)[0]
    assert_allclose(moved[:2], [50e-6 * 0.2, 50e-6 * LENGTH], rtol=SMALL)


# --- Links ---------------------------------------------------------------------------


BENDING, TORSION = 6.3e5, 4.7e5


@pytest.fixture
def beam(arm):
    return Rig(arm, (LinkBending("link_1", BENDING, TORSION),), stiffness=STIFF)


@pytest.mark.parametrize("across", [1, 2])
def test_moment_at_the_end_of_a_link_bends_it_like_a_beam(beam, across):
    """Slope M L/EI, deflection M L²/2EI: Euler-Bernoulli, any handbook."""
    states = respond(beam, moments(0.0, 40.0, axis=across))
    moved = np.diff(place(states), axis=0)[0]
    rigid = 40.0 / RIGID if across == 1 else 0.0
    assert_allclose(turn(states)[1, across] - rigid, 40 * LENGTH / BENDING, rtol=1e-6)
    sideways = {1: 2, 2: 1}[across]
    expected = 40 * LENGTH**2 / (2 * BENDING) + rigid * LENGTH
    assert_allclose(abs(moved[sideways]), expected, rtol=1e-4)


def test_force_at_the_end_of_a_link_bends_it_like_a_beam(beam):
    """F L³/3EI and F L²/2EI, plus what the force's distance from the end adds."""
    states = respond(beam, [[0.0] * 6, [0.0, 0.0, 100.0, 0.0, 0.0, 0.0]])
    end, sensor = place(states)[0], place(states, "sensor_far_side")
    load = states.wrench[1]
    mount = states.rotation[1, states.bodies.index("sensor_far_side")]
    force, moment = mount @ load[:3], mount @ load[3:]
    moment = moment + np.cross(sensor[1] - end, force)  # about the end of the link
    assert_allclose(force, [0, 0, 100], atol=0.1)
    sag = 100 * LENGTH**3 / (3 * BENDING) - moment[1] * LENGTH**2 / (2 * BENDING)
    slope = -100 * LENGTH**2 / (2 * BENDING) + moment[1] * LENGTH / BENDING
    rigid = (moment[1] - 100 * LENGTH) / RIGID
    moved = np.diff(place(states), axis=0)[0]
    assert_allclose(moved[2], sag - rigid * LENGTH, rtol=1e-4)
    assert_allclose(turn(states)[1, 1], slope + rigid, rtol=1e-4)


def test_torque_along_a_link_twists_it(beam):
    """T L/GJ."""
    twist = turn(respond(beam, moments(40.0, axis=0)))[0, 0]
    assert_allclose(twist, 40 * LENGTH / TORSION, rtol=1e-6)


def test_link_without_length_is_refused(tmp_path):
    arm = lever(tmp_path, second_axis="1 0 0")
    with pytest.raises(Unusable, match="no length between its axes"):
        _ = Rig(arm, (LinkBending("link_2"),)).model


# --- The foot ------------------------------------------------------------------------


def test_pedestal_of_a_million_nm_per_rad_moves_a_point_at_1_m_by_a_tenth(arm):
    """100 N at 1 m height on 1e6 N m/rad: 0.1 mm; here 100 N m and 0.3 m."""
    rig = Rig(arm, (BaseCompliance("base", ry_rad_per_nm=1e-6),), stiffness=STIFF)
    states = respond(rig, moments(0.0, 100.0))
    moved = np.diff(place(states), axis=0)[0]
    assert_allclose(turn(states, "base")[1, 1], 1e-4, rtol=1e-6)
    assert_allclose(moved[[0, 2]], [1e-4 * HEIGHT, -1e-4 * LENGTH], rtol=2e-3)


@pytest.mark.parametrize("along", [0, 1, 2])
def test_foot_gives_way_along_and_about_each_direction_by_its_compliance(arm, along):
    turns, shifts = (1e-7, 2e-7, 3e-7), (1e-8, 2e-8, 3e-8)
    rig = Rig(arm, (BaseCompliance("base", *turns, *shifts),))
    turned = turn(respond(rig, moments(50.0, axis=along)), "base")[0, along]
    assert_allclose(turned, 50 * turns[along], rtol=SMALL)
    force = np.zeros((2, 6))
    force[1, along] = 50.0
    moved = np.diff(place(respond(rig, force), "base"), axis=0)[0, along]
    assert_allclose(moved, 50 * shifts[along], rtol=SMALL)


def test_arm_without_a_base_gives_way_about_the_world_all_the_same(arm, tmp_path):
    effect = BaseCompliance("base", ry_rad_per_nm=1e-6, z_m_per_n=1e-7)
    stood = respond(Rig(arm, (effect,)), moments(0.0, 60.0))
    text = arm.read_text().replace('<body name="base">', "").replace("</body>", "", 1)
    text = re.sub(r'<inertial mass="10".*?/>', "", text)
    bare = tmp_path / "bare.xml"
    bare.write_text(text)
    moved = respond(Rig(bare, (effect,)), moments(0.0, 60.0))
    assert_allclose(place(moved), place(stood), atol=1e-13)
    assert_allclose(moved.axis_angle, stood.axis_angle, atol=1e-13)


# --- The wrist -----------------------------------------------------------------------


@pytest.mark.parametrize("coupling", [5e-6, -8e-6])
def test_torque_on_one_wrist_axis_turns_the_other_by_the_coupling(tmp_path, coupling):
    """C₁₂ = c and Cᵢᵢ = (1 - r)/Kᵢ with r = |c| √(K₁ K₂)."""
    arm = lever(tmp_path, second_axis="1 0 0")
    effect = WristCoupling("a2", with_axis="a1", compliance_rad_per_nm=coupling)
    rig = Rig(arm, (effect,))
    about_1 = respond(rig, moments(0.1), posture=(0.0, 0.0)).axis_angle[0]
    about_2 = respond(rig, moments(0.1, axis=0), posture=(0.0, 0.0)).axis_angle[0]
    K = np.array([5e4, 2e4])
    share = abs(coupling) * np.sqrt(K.prod())
    own = (1 - share) / K
    expected = 0.1 * np.array([[own[0], coupling], [coupling, own[1]]])
    assert_allclose([about_1, about_2], expected, rtol=1e-5)


def test_coupled_wrist_is_slack_wherever_the_controller_puts_it(tmp_path):
    arm = lever(tmp_path, second_axis="1 0 0")
    rig = Rig(arm, (WristCoupling("a2", with_axis="a1"),))
    states = respond(rig, moments(0.0), posture=(0.7, -0.4))
    assert_allclose(states.axis_angle[0], [0.7, -0.4], atol=1e-14)


def test_coupling_that_no_spring_can_make_is_refused(tmp_path):
    arm = lever(tmp_path, second_axis="1 0 0")
    effect = WristCoupling("a2", with_axis="a1", compliance_rad_per_nm=2e-5)
    with pytest.raises(Unusable, match=r"at most 1.42e-05"):
        _ = Rig(arm, (effect,)).model
