"""What a tracker does wrong is placed at the tracker."""

from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation
from small_bench import FEW, arm, prepared, recording

from bench.shared.recording import Recording
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.jacobian import values
from stiffness.effects.residual_map import (
    COLUMNS,
    along_circles,
    errors_of_tracker,
    upright,
)
from stiffness.experiment.static_state import StaticState
from stiffness.robot.tracker_frame import TrackerFit

STEP = 1e-6
AWAY = np.random.default_rng(0).uniform(-3.0, 3.0, (20, 3))


def polar(away: np.ndarray) -> np.ndarray:
    """Return azimuth, elevation and range as rows."""
    x, y, z = np.moveaxis(away, -1, 0)
    level = np.hypot(x, y)
    return np.stack([np.arctan2(y, x), np.arctan2(z, level), np.hypot(level, z)])


def seen(polar: np.ndarray) -> np.ndarray:
    a, e, r = polar
    level = r * np.cos(e)
    return np.stack([level * np.cos(a), level * np.sin(a), r * np.sin(e)], axis=-1)


A, E, R = polar(AWAY)
LEVEL = R * np.cos(E)
ERRORS = [
    *((0, error / LEVEL) for error in (1.0, R)),
    *((0, f(n * A)) for n in (1, 2) for f in (np.cos, np.sin)),
    (1, 1.0 / R),
    *((1, f(2 * A)) for f in (np.cos, np.sin)),
    *((1, f(n * E)) for n in (1, 2) for f in (np.cos, np.sin)),
    *((2, R**n) for n in (0, 1, 2)),
]
"""What errs, 0 azimuth, 1 elevation, 2 range, and by how much per unit."""


@pytest.mark.parametrize("column", range(len(ERRORS)))
def test_columns_are_what_errors_of_circles_and_beam_do(column):
    coordinate, error = ERRORS[column]
    off = np.zeros((3, len(AWAY)))
    off[coordinate] = STEP * error
    moved = (seen(polar(AWAY) + off) - seen(polar(AWAY) - off)) / (2 * STEP)
    assert_allclose(along_circles(AWAY)[:, :, column], moved, atol=1e-6)


def test_beam_that_sags_falls_with_the_square_of_its_way():
    assert along_circles(AWAY).shape[2] == COLUMNS == len(ERRORS) + 1
    fall = along_circles(AWAY)[:, :, -1]
    assert_allclose(fall, np.outer(np.sum(AWAY**2, axis=1), [0.0, 0.0, 1.0]))


@pytest.mark.parametrize("up", [[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [0.3, -0.4, 0.5]])
def test_upright_axes_are_a_right_handed_frame(up):
    axes = upright(np.array(up))
    assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert_allclose(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2], atol=1e-12)
    assert_allclose(axes[:, 2], up / np.linalg.norm(up))


def from_tracker_at(stand: list[float], turn: np.ndarray) -> StaticState:
    here = truth.situation()
    places = np.zeros((len(here.recording.markers), 3))
    return replace(here, frames=TrackerFit(turn, np.array(stand), places))


def test_circles_are_level_however_the_readings_axes_are_turned():
    stand, turn = [2.0, -1.0, 0.7], Rotation.from_rotvec([0.4, 1.2, -0.3]).as_matrix()
    one = errors_of_tracker(from_tracker_at(stand, np.eye(3)))
    other = errors_of_tracker(from_tracker_at(stand, turn))
    for a, b in zip(one.parts, other.parts, strict=True):
        assert_allclose(values(a), values(b))


def test_readings_that_were_turned_to_the_base_know_no_circles():
    assert errors_of_tracker(from_tracker_at([0.0, 0.1, 0.9], np.eye(3))).columns == 0
    relative = replace(truth.recording(), displacement="relative")
    far = from_tracker_at([2.0, 0.0, 0.0], np.eye(3))
    assert errors_of_tracker(replace(far, recording=relative)).columns == 0


def with_bad_circle(made: Recording) -> Recording:
    """Let the tracker's level circle err by 50 microradians twice a turn."""
    assert made.points is not None
    frame = prepared().frames.transform
    turn, stand = frame[:3, :3], frame[:3, 3]
    a, e, r = polar(made.points @ turn.T)
    wrong = seen(np.stack([a + 5e-5 * np.sin(2 * a + 0.3), e, r]))
    assert np.hypot(stand[0], stand[1]) > 1.0
    return replace(made, points=wrong @ turn)


def test_circle_that_errs_gets_no_name_but_its_place():
    found = diagnose(with_bad_circle(recording()), arm(), FEW)
    assert found.verdict == "unexplained"
    assert found.unexplained is not None
    assert found.unexplained.where == "tracker"
