import numpy as np
import pytest
from lever import lever, moments, respond
from numpy.testing import assert_allclose

from bench.cell import Cell
from bench.effects.gravity_compensator import GravityCompensator
from bench.effects.gravity_load import GravityLoad
from bench.effects.joint_compliance import JointCompliance
from bench.effects.pulley_friction import PulleyFriction
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import Plan, parse_path

OWN = 5e4
"""Stiffness of the lever's axis, in N m/rad."""
G = 9.81


@pytest.fixture
def arm(tmp_path):
    return lever(tmp_path, mass=2.0)


def axis_torque(arm, *effects, posture=0.0):
    """Return what the axis' spring carries without a load, in N m."""
    states = respond(Rig(arm, effects), moments(0.0), (posture,))
    return OWN * (states.axis_angle[0, 0] - posture)


# --- Weight --------------------------------------------------------------------------


def test_added_mass_loads_the_axis_by_its_lever(arm):
    """1.5 kg at 0.2 m on a level lever: 1.5 × 9.81 × 0.2 = 2.943 N m about y."""
    before = axis_torque(arm)
    after = axis_torque(arm, GravityLoad("link_1", 1.5, com_x_m=0.2))
    assert_allclose(after - before, 2.943, rtol=1e-4)


def test_mass_is_taken_away_too(arm):
    before = axis_torque(arm)
    after = axis_torque(arm, GravityLoad("link_1", -0.5, com_x_m=0.3))
    assert_allclose(after - before, -0.5 * G * 0.3, rtol=1e-4)


def test_mass_added_and_taken_away_elsewhere_moves_the_centre(arm):
    there = GravityLoad("link_1", 1.0, com_x_m=0.4)
    gone = GravityLoad("link_1", -1.0, com_x_m=0.1)
    moved = axis_torque(arm, there, gone) - axis_torque(arm)
    assert_allclose(moved, 1.0 * G * 0.3, rtol=1e-4)


def test_taking_away_more_than_there_is_is_refused(arm):
    with pytest.raises(Unusable, match="2 kg and -3 kg leave no mass"):
        _ = Rig(arm, (GravityLoad("link_1", -3.0),)).model


# --- Compensator ---------------------------------------------------------------------


@pytest.mark.parametrize("torque", [40.0, -25.0])
@pytest.mark.parametrize("posture", [-1.5, 0.0, 0.7, 2.5])
def test_compensator_pushes_with_the_sine_of_the_axis_angle(tmp_path, torque, posture):
    """torque_nm sin(q - phase_rad) at the angle where the axis comes to rest."""
    effect = GravityCompensator("a1", torque, phase_rad=0.4)
    rig = Rig(lever(tmp_path), (effect,))
    q = respond(rig, moments(0.0), (posture,)).axis_angle[0, 0]
    assert_allclose(OWN * (q - posture), torque * np.sin(q - 0.4), atol=1e-9)


@pytest.mark.parametrize("torque", [40.0, -25.0])
@pytest.mark.parametrize("length", [0.5, -2.0])
@pytest.mark.parametrize("posture", [-1.5, 0.7, 2.5])
def test_compensator_with_free_length_pulls_by_how_far_it_is_stretched(
    tmp_path, torque, length, posture
):
    """torque_nm sin x (1 - f (1 - r)/w), also where it pulls at no length."""
    form = {"free_length_ratio": length, "arm_ratio": 0.4}
    effect = GravityCompensator("a1", torque, phase_rad=0.4, **form)
    rig = Rig(lever(tmp_path), (effect,))
    q = respond(rig, moments(0.0), (posture,)).axis_angle[0, 0]
    w = np.sqrt(1.0 + 0.4**2 + np.sign(torque) * 2.0 * 0.4 * np.cos(q - 0.4))
    expected = torque * np.sin(q - 0.4) * (1.0 - 0.6 * length / w)
    assert_allclose(OWN * (q - posture), expected, atol=1e-8)


def test_compensator_winds_up_all_that_is_in_series_in_its_gear(tmp_path):
    """It bridges the gear: (1/K + c) τ is the wind-up, however soft the gear."""
    soft = JointCompliance("a1", 3.0 / OWN)
    rig = Rig(lever(tmp_path), (GravityCompensator("a1", 40.0), soft))
    q = respond(rig, moments(0.0), (0.7,)).axis_angle[0, 0]
    assert_allclose(OWN / 4.0 * (q - 0.7), 40.0 * np.sin(q), atol=1e-9)


def test_compensator_of_the_right_size_carries_the_arm_in_every_posture(arm):
    """Weight gives A cos q + B sin q; a spring of √(A² + B²) gives minus that."""
    level, upright = axis_torque(arm), axis_torque(arm, posture=np.pi / 2)
    largest = np.hypot(level, upright)
    effect = GravityCompensator("a1", largest, phase_rad=np.arctan2(level, -upright))
    left = [axis_torque(arm, effect, posture=q) for q in (-2.0, 0.0, 0.5, 1.5)]
    assert_allclose(left, 0.0, atol=1e-3 * largest)  # A, B: of an arm that sags


# --- Rope ----------------------------------------------------------------------------


def test_pulley_keeps_two_percent_and_gives_them_back_on_the_way_down(arm):
    """2 % per sheave of steel rope (Verope): 98.1 N pull with 96.138, then 100.062."""
    path = parse_path("0,5,10,5,0")
    plan = Plan("rope", np.array([[0.2]]), np.array([0]), np.array([0]), path)
    cell = Cell(pulley=np.array([[0.6, 0.2, 1.0]]))
    pull = [
        np.linalg.norm(
            Rig(arm, effects, cell=cell).carry_out(plan).wrench[:, :3], axis=1
        )
        for effects in ((PulleyFriction("rig", 0.02),), ())
    ]
    assert_allclose(pull[1], G * np.array([0, 5, 10, 5, 0]), atol=1e-6)
    assert_allclose(pull[0], [0, 48.069, 96.138, 50.031, 0], atol=1e-6)
