"""What a tracker does wrong is placed at the tracker."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import FEW, arm, recording

from bench.recording import Recording
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.tracker_map import COLUMNS, along_circles

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
ERRORS = [
    *((0, f(n * A)) for n in (1, 2) for f in (np.cos, np.sin)),
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


def with_bad_circle(made: Recording) -> Recording:
    """Let the tracker's horizontal circle err by 50 microradians twice a turn."""
    assert made.points is not None
    a, e, r = polar(made.points)
    wrong = np.stack([a + 5e-5 * np.sin(2 * a + 0.3), e, r])
    return replace(made, points=seen(wrong))


def test_circle_that_errs_gets_no_name_but_its_place():
    found = diagnose(with_bad_circle(recording()), arm(), FEW)
    assert found.verdict == "unexplained"
    assert found.unexplained is not None
    assert found.unexplained.where == "tracker"
