import hypothesis_truth as truth
import numpy as np
import pytest

from stiffness.effects.creep import followed
from stiffness.effects.hysteresis import SPREAD, rounded, spread_stop
from stiffness.experiment.visits import BEFORE, MEMORIES, memories


def whole_path(situation, axis):
    """Return an axis' torque over the experiment with its ways, and which are rows."""
    path, read = [0.0], [-1]
    for visit, rows in enumerate(situation.steps):
        path += list(situation.way_torque[visit, :, axis])
        read += [-1] * situation.way_torque.shape[1]
        path += list(situation.torque[rows, axis])
        read += list(rows)
    return np.array(path), np.array(read)


@pytest.mark.parametrize("slip", [1.0, 20.0, 1e4])
def test_carried_stops_are_those_over_the_whole_experiment(slip):
    """Also where they never slip, and so forget nothing."""
    situation = truth.situation()
    path, read = whole_path(situation, 1)
    bound = slip * np.array(SPREAD)
    state, states = np.zeros(len(bound)), [0.0]
    for change in np.diff(path):
        state = np.clip(state + change, -bound, bound)
        states.append(state.sum() / bound.sum())
    expected = np.empty(situation.rows)
    expected[read[read >= 0]] = np.array(states)[read >= 0]
    found = spread_stop(situation, 1, slip, BEFORE)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_carried_rounded_stop_is_one_over_the_whole_experiment():
    situation, slip = truth.situation(), 15.0
    path, read = whole_path(situation, 2)
    state, states = 0.0, [0.0]
    for change in np.diff(path):
        end = np.sign(change)
        state = end + (state - end) * np.exp(-abs(change) / slip)
        states.append(state)
    expected = np.empty(situation.rows)
    expected[read[read >= 0]] = np.array(states)[read >= 0]
    found = rounded(situation, 2, slip, BEFORE)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_creep_much_faster_than_a_move_remembers_nothing_of_the_visit_before():
    """Then the way leaves the torque at its end, which is gravity's at the arrival."""
    situation = truth.situation()
    fast = [followed(situation, 1, 0.02, memory) for memory in MEMORIES]
    np.testing.assert_allclose(fast[2], fast[1], atol=1e-6)


def test_what_was_before_is_known_only_where_every_visit_is_there():
    assert memories(np.array([0, 0, 1, 1, 2])) == MEMORIES
    assert BEFORE not in memories(np.array([3, 3, 3]))
    assert BEFORE not in memories(np.array([0, 0, 2, 2]))  # a draw of poses
