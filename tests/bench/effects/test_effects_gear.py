import numpy as np
import pytest
from lever import lever, moments, respond, turn
from numpy.testing import assert_allclose
from scipy.optimize import brentq

from bench.effects.asymmetric_stiffness import AsymmetricStiffness
from bench.effects.creep import Creep
from bench.effects.hardening import Hardening
from bench.effects.hardening_smooth import SmoothHardening
from bench.effects.hysteresis import Hysteresis
from bench.effects.hysteresis_many import ManyContacts
from bench.effects.joint_compliance import JointCompliance
from bench.effects.lost_motion import LostMotion
from bench.effects.lost_motion_smooth import SmoothLostMotion
from bench.rig import Rig

OWN = 5e4
"""Stiffness of the lever's axis, in N m/rad."""
K1, K2, K3, T1, T2 = 67e3, 110e3, 120e3, 29.0, 108.0
"""Harmonic Drive CHA data 1018854, size 32, ratio above 50; N m/rad and N m."""


@pytest.fixture
def arm(tmp_path):
    return lever(tmp_path)


@pytest.fixture
def size_32():
    return Hardening("a1", K3 / K1, T1, (K2 - K1) / (K3 - K1), T2 / T1)


def wind_up(arm, effect, *torque, hold=None, stiffness=OWN):
    """Return the turn of the flange after each torque on the axis, in rad."""
    rig = Rig(arm, (effect,), stiffness=np.array([stiffness]))
    return turn(respond(rig, moments(*torque), hold=hold))[:, 1]


def test_joint_compliance_adds_to_that_of_the_axis(arm):
    effect = JointCompliance("a1", 1e-5)
    assert_allclose(wind_up(arm, effect, 100.0), 100 / OWN + 100 * 1e-5, rtol=1e-9)


# --- Hardening -----------------------------------------------------------------------


@pytest.mark.parametrize(("torque", "secant"), [(20, 67e3), (60, 84e3), (100, 93e3)])
def test_hardening_has_the_secants_of_the_catalogue(arm, size_32, torque, secant):
    up, down = wind_up(arm, size_32, torque, -torque, stiffness=K1)
    assert_allclose(torque / up, secant, rtol=5e-3)  # secants of three digits
    assert_allclose(down, -up, rtol=1e-9)


def test_hardened_gear_gives_less_on_a_preload(arm, size_32):
    """60.5 N m: 0.719 mrad from zero, 0.525 mrad on 80 N m; from the same table."""
    free, preload, more = wind_up(arm, size_32, 60.5, 80.0, 140.5, stiffness=K1)
    assert_allclose([free, more - preload], [0.719e-3, 0.525e-3], atol=5e-7)


def test_hardening_has_the_slopes_of_the_equation(arm, size_32):
    angle = wind_up(arm, size_32, 10.0, 20.0, 50.0, 90.0, 120.0, 160.0, stiffness=K1)
    slope = np.array([10.0, 40.0, 40.0]) / np.diff(angle)[::2]
    assert_allclose(slope, [K1, K2, K3], rtol=1e-8)


def test_smooth_hardening_follows_the_arctangent_law(arm):
    effect = SmoothHardening("a1", K3 / K1, T1)
    torque = np.array([5.0, 20.0, 35.0, 60.0, 100.0, 200.0, -60.0])
    angle = wind_up(arm, effect, *torque, stiffness=K1)
    bend = 1.2 * T1 / K1
    law = K3 * angle - (K3 - K1) * bend * np.arctan(angle / bend)
    assert_allclose(law, torque, rtol=5e-3)  # as near as the file states
    assert_allclose(angle[3:5], [60 / 84e3, 100 / 93e3], rtol=0.07)  # the catalogue's


# --- Asymmetry and play --------------------------------------------------------------


@pytest.mark.parametrize("ratio", [1.3, 0.5])
def test_asymmetric_axis_has_the_stated_ratio_and_its_own_softer_side(arm, ratio):
    up, down = wind_up(arm, AsymmetricStiffness("a1", ratio), 40.0, -40.0)
    assert_allclose(-down / up, ratio, rtol=1e-9)
    assert_allclose(max(up, -down), 40.0 / OWN, rtol=1e-9)


@pytest.mark.parametrize("kind", [LostMotion, SmoothLostMotion])
def test_play_opens_by_its_width_when_the_torque_turns_round(arm, kind):
    """One arcminute, 2.909e-4 rad, of free turn between ±10 N m."""
    up, down = wind_up(arm, kind("a1", 2.909e-4), 10.0, -10.0)
    ends = 20.0 / (300 * OWN)  # the closed play is 300 times as stiff as the axis
    assert_allclose(up - down, 20.0 / OWN + 2.909e-4, atol=ends)


def test_play_is_half_taken_up_by_half_the_closing_torque(arm):
    angle = wind_up(arm, LostMotion("a1", 2e-4, closing_nm=0.4), 0.2)
    assert_allclose(angle, 0.2 / OWN + 0.5e-4, rtol=1e-9)


def test_smooth_play_follows_the_hyperbolic_tangent(arm):
    torque = np.array([0.5, 1.0, 1.5, 2.5, 4.0, -1.5])
    angle = wind_up(arm, SmoothLostMotion("a1", 2e-4, closing_nm=1.5), *torque)
    law = torque / OWN + 1e-4 * np.tanh(torque / 1.5)
    assert_allclose(angle, law, atol=1e-6)  # twelve pieces stay within 1 % of it


# --- Hysteresis ----------------------------------------------------------------------


def maxwell_slip(torque, own, each, limit):
    """Return the path of a spring with slipping springs beside it, solved by hand."""
    friction, angle, path = np.zeros(len(limit)), 0.0, []
    for load in torque:

        def held(turned, was=friction, start=angle):
            return np.clip(was + each * (turned - start), -limit, limit)

        solved = brentq(
            lambda x, load=load, held=held: own * x + held(x).sum() - load,
            -1.0,
            1.0,
            xtol=1e-16,
        )
        friction, angle = held(solved), solved
        path.append(angle)
    return np.array(path)


UP_AND_DOWN = (
    20.0,
    60.0,
    100.0,
    60.0,
    20.0,
    0.0,
    40.0,
    -50.0,
    -100.0,
    -30.0,
    0.0,
    80.0,
)


def test_hysteresis_is_the_maxwell_slip_model(arm):
    width, share = 3e-4, np.array([1, 2, 3, 4]) / 10
    each = 0.6 * OWN / 4
    angle = wind_up(arm, Hysteresis("a1", width), *UP_AND_DOWN)
    expected = maxwell_slip(UP_AND_DOWN, OWN, each, share * width * OWN / 2)
    assert_allclose(angle, expected, atol=1e-12)


@pytest.mark.parametrize("kind", [Hysteresis, ManyContacts])
def test_loop_is_as_wide_at_zero_torque_as_stated(arm, kind):
    """One arcminute, the limit of Harmonic Drive's CHA data 1018854."""
    angle = wind_up(arm, kind("a1", 2.909e-4), 200.0, 0.0, -200.0, 0.0)
    assert_allclose(angle[1] - angle[3], 2.909e-4, atol=1e-10)  # 5 µN m of friction


def test_many_contacts_load_as_dahl_says_and_turn_as_masing_says(arm):
    width, stiffening = 3e-4, 1.0
    full, reach = width * OWN / 2, width / 2 / stiffening
    torque = np.array([5.0, 10.0, 20.0, 40.0, 30.0, 20.0, 0.0, -20.0])
    angle = wind_up(arm, ManyContacts("a1", width), *torque)
    friction = torque - OWN * angle
    dahl = full * (1 - np.exp(-angle[:4] / reach))
    assert_allclose(friction[:4], dahl, atol=0.01 * full)  # as the file states
    back = angle[3] - angle[4:]
    masing = friction[3] - 2 * full * (1 - np.exp(-back / 2 / reach))
    assert_allclose(friction[4:], masing, atol=0.02 * full)  # the same, doubled


# --- Creep ---------------------------------------------------------------------------


def test_creep_has_gained_63_2_percent_after_one_time_constant(arm):
    effect = Creep("a1", ratio=0.05, time_s=30.0)
    angle = wind_up(arm, effect, 0.0, 50.0, hold=[100.0, 30.0])
    gained = (angle[1] * OWN / 50 - 1) / 0.05
    assert_allclose(gained, 0.632, atol=5e-4)
    assert_allclose(gained, 1 - np.exp(-1), rtol=1e-6)


def test_creep_goes_on_under_a_load_that_stands_and_comes_back_without(arm):
    effect = Creep("a1", ratio=0.05, time_s=30.0)
    angle = wind_up(arm, effect, 50.0, 50.0, 0.0, hold=[10.0, 20.0, 30.0])
    gained = angle / (50 / OWN) - [1, 1, 0]
    share = 1 - np.exp(-np.array([1 / 3, 1.0]))
    expected = 0.05 * np.append(share, share[1] * np.exp(-1))
    assert_allclose(gained, expected, rtol=1e-6)
