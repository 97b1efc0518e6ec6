"""A shape is moved to where it explains most, wherever the coarse grid's points lie."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import prepared

from stiffness.diagnosis.model_fit import HeldTerms, ModelTerm, fit_model, fit_shapes
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.search import tried
from stiffness.effects.creep import Creep
from stiffness.effects.lost_motion import LostMotion


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


def test_a_law_beside_terms_that_stay_is_fitted_as_if_all_were_laid_out_anew():
    """Of creep and a play, the creep's time moves while the play stays as it is."""
    case = build_problem(prepared("creep@a3,ratio=0.1,time_s=23"), (Creep(),))
    play = ModelTerm(LostMotion(), "a2", LostMotion().shapes(case.situation, "a2")[1])
    law = ModelTerm(Creep(), "a3", Creep().shapes(case.situation, "a3")[2])
    found = HeldTerms.of(case, [play]).fitted_with(law)
    stayed, moved = found.members
    assert stayed is play and moved.name == law.name
    assert moved.shape[0] != law.shape[0]
    same = fit_model(case, found.members)
    assert_allclose(found.gain, same.gain, rtol=1e-9)
    every = zip(found.coefficients, same.coefficients, strict=True)
    assert all(np.allclose(a, b, rtol=1e-7, atol=0.0) for a, b in every)
    for time in (0.5, 2.0):
        other = replace(moved, shape=moved.shape * np.array([time, 1.0]))
        assert fit_model(case, (play, other)).gain < found.gain
