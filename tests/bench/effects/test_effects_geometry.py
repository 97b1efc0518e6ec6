import numpy as np
import pytest
from lever import LENGTH, lever, moments, place, respond, turn
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from bench.effects.angle_dependent_stiffness import AngleDependentStiffness
from bench.effects.deflection_compensation import DeflectionCompensation
from bench.effects.encoder_offset import EncoderOffset
from bench.effects.geometry_error import GeometryError
from bench.effects.reading_lag import ReadingLag
from bench.effects.transmission_error import TransmissionError
from bench.rig import Rig
from bench.shared.recording import LastMoves


@pytest.fixture
def arm(tmp_path):
    return lever(tmp_path)


def at_rest(arm, effect, posture=(0.0,)):
    return respond(Rig(arm, (effect,)), moments(0.0), posture)


# --- In the drive --------------------------------------------------------------------


def test_axis_stands_beside_the_reported_angle_by_the_encoder_offset(arm):
    angle = at_rest(arm, EncoderOffset("a1", 7e-4), (0.4,)).axis_angle
    assert_allclose(angle, 0.4 + 7e-4, rtol=1e-14)


def test_axis_rests_beyond_the_reported_angle_along_its_last_move(arm):
    """Up, up, down, nowhere, up; before the first move nothing is known."""
    reported = np.array([0.1, 0.4, 0.6, 0.2, 0.2, 0.3])
    rig = Rig(arm, (ReadingLag("a1", 5e-4),))
    posture = np.zeros((6, len(rig.anatomy.axes)))
    posture[:, 0] = reported
    beyond = rig.command(posture).reference[:, 0] - reported
    assert_allclose(beyond, 5e-4 * np.array([0, 1, 1, -1, -1, 1]), atol=1e-15)
    ways = LastMoves(np.ones_like(posture[3:]), np.zeros_like(posture[3:]))
    said = rig.command(posture[3:], ways).reference[:, 0]
    assert_allclose(said - reported[3:], 5e-4, rtol=1e-9)


def test_lag_by_share_follows_the_axis_speed_in_a_synchronised_move(arm):
    """Alone, a third of another's way, back at full speed, at rest beside others."""
    posture = np.array([[0.1, 0.0], [0.4, 0.0], [0.5, 0.3], [0.2, 0.3], [0.2, 0.9]])
    rig = Rig(arm, (ReadingLag("a1", 0.0, 5e-4),))
    still = np.zeros((5, len(rig.anatomy.axes)))
    still[:, : posture.shape[1]] = posture[:, : still.shape[1]]
    moves = LastMoves.of(posture).of_axes(np.arange(2), 2)
    assert_allclose(moves.share[:, 0], [0, 1, 1 / 3, -1, 0], atol=1e-12)
    first = LastMoves(moves.side[:, :1], moves.share[:, :1])
    beyond = rig.command(still, first).reference[:, 0] - posture[:, 0]
    assert_allclose(beyond, 5e-4 * moves.share[:, 0], atol=1e-15)


@pytest.mark.parametrize("reported", [-1.0, 0.3, 2.0])
def test_controller_turns_an_axis_back_by_what_its_weights_wind_up(tmp_path, reported):
    """Link and tool about a horizontal axis, by the model's spring."""
    arm, mass = lever(tmp_path, mass=2.0), 2.0
    rig = Rig(arm, (DeflectionCompensation("a1", 0.7),), stiffness=np.array([8e4]))
    tool, beyond = rig.mounted.payload, rig.command(np.array([[reported]])).reference
    first = mass * LENGTH * np.cos(reported)
    x, _, z = tool.com
    first += tool.mass * ((LENGTH + x) * np.cos(reported) + z * np.sin(reported))
    assert tool.mass > 0.0
    assert_allclose(beyond - reported, -0.7 * 9.81 * first / 5e4, rtol=1e-9)
    text = arm.read_text().replace(
        "<option", '<option><flag gravity="disable"/></option><option', 1
    )
    arm.write_text(text)
    rig = Rig(arm, rig.effects, stiffness=rig.stiffness)
    assert_allclose(rig.command(np.array([[reported]])).reference, beyond, rtol=1e-12)


@pytest.mark.parametrize("reported", [-1.0, 0.3, 2.0])
def test_transmission_errs_by_a_sine_of_the_reported_angle(arm, reported):
    """One arcminute from peak to peak, Harmonic Drive CHA data 1018854."""
    effect = TransmissionError("a1", 2.909e-4 / 2, order=3.0, phase_rad=0.5)
    angle = at_rest(arm, effect, (reported,)).axis_angle[0, 0]
    error = 1.4545e-4 * np.sin(3.0 * reported + 0.5)
    assert_allclose(angle - reported, error, rtol=1e-9)


@pytest.mark.parametrize("kind", [EncoderOffset, TransmissionError])
def test_error_of_the_drive_is_the_same_under_load(arm, kind):
    rig, nominal = Rig(arm, (kind("a1"),)), Rig(arm)
    torque = moments(0.0, 60.0)
    wound = [
        np.diff(respond(r, torque, (0.3,)).axis_angle[:, 0]) for r in (rig, nominal)
    ]
    assert_allclose(*wound, rtol=1e-9)


@pytest.mark.parametrize("reported", [-1.0, 0.3, 2.0])
def test_stiffness_varies_with_a_cosine_of_the_reported_angle(arm, reported):
    effect = AngleDependentStiffness("a1", 0.1, order=2.0, phase_rad=0.5)
    states = respond(Rig(arm, (effect,)), moments(60.0), (reported,))
    stiffness = 60.0 / (states.axis_angle[0, 0] - reported)
    assert_allclose(stiffness, 5e4 * (1 + 0.1 * np.cos(2 * reported + 0.5)), rtol=1e-9)


# --- In the links --------------------------------------------------------------------


def test_longer_and_twisted_link_moves_the_flange_as_drawn(arm):
    """It holds in the link's frame: p' = p + (x, y, z) and R' = exp([r]×) R."""
    shift, twist = np.array([3e-4, -2e-4, 1e-4]), np.array([1e-3, 2e-3, -5e-4])
    states = at_rest(arm, GeometryError("link_1", *shift, *twist), (0.6,))
    nominal = respond(Rig(arm), moments(0.0), (0.6,))
    turned = Rotation.from_rotvec([0, 0.6, 0])
    moved = place(states)[0] - place(nominal)[0]
    assert_allclose(moved, turned.apply(shift), atol=1e-15)
    expected = turned * Rotation.from_rotvec(twist)
    assert_allclose(turn(states)[0], expected.as_rotvec(), atol=1e-14)


def test_error_of_a_link_moves_the_next_axis_and_all_beyond(tmp_path):
    """A twist of r about x turns the axis along z to (0, -sin r, cos r)."""
    arm = lever(tmp_path, second_axis="0 0 1")
    effect = GeometryError("link_1", x_m=0.0, ry_rad=0.0, rx_rad=0.01)
    states = respond(Rig(arm, (effect,)), moments(0.0), (0.0, 0.8))
    expected = Rotation.from_rotvec([0.01, 0, 0]) * Rotation.from_rotvec([0, 0, 0.8])
    assert_allclose(turn(states)[0], expected.as_rotvec(), atol=1e-14)
    assert_allclose(place(states)[0, 0], LENGTH, atol=1e-15)
