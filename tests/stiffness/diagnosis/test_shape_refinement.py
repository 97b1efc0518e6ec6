"""A shape is moved to where it explains most, wherever the coarse grid's points lie."""

import numpy as np
import pytest
from small_bench import prepared

from stiffness.diagnosis.model_fit import ModelTerm, fit_model, fit_shapes, tried
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.effects.creep import Creep


def test_a_creep_s_time_is_where_it_explains_most():
    """The best time lies below a point of the grid, the parabola's top above it."""
    case = build_problem(prepared("creep@a3,ratio=0.1,time_s=23"), (Creep(),))
    grid = Creep().shapes(case.situation, "a3")
    coarse = min(grid, key=lambda shape: abs(np.log(shape[0] / 30.0)) + shape[1])

    def gain(time: float) -> float:
        law = ModelTerm(Creep(), "a3", np.array([time, coarse[1]]))
        fit = fit_model(case, (law,))
        return fit.gain

    law = ModelTerm(Creep(), "a3", coarse)
    (best,) = fit_shapes(case, (law,))
    most = max(gain(time) for time in np.geomspace(10.0, 60.0, 40))
    assert gain(best.shape[0]) > most - 0.1


@pytest.mark.parametrize("factor", [False, True])
def test_fine_values_lie_between_the_neighbours_of_the_nearest(factor):
    grid = np.array([5.0, 30.0, 180.0])
    values = tried(32.5, grid, factor, 7)
    values = np.exp(values) if factor else values
    assert len(values) == 7
    assert np.all(np.diff(values) > 0.0)
    assert 5.0 < values[0] < 30.0 < values[-1] < 180.0
    assert np.all(tried(178.0, grid, False, 3) > 30.0)
