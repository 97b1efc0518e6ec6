"""A sum of squares is minimised within bounds, by steps that gain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.optimize import brentq, lsq_linear

from stiffness.regression.normal_equations import Bounds, Linearised, minimise

FREE = Bounds(np.full(2, -np.inf), np.full(2, np.inf), np.full(2, np.inf))


def linearised(residual, jacobian):
    """Return the normal equations of residuals that are to vanish."""

    def at(x: np.ndarray) -> Linearised:
        left, slope = residual(x), jacobian(x)
        return Linearised(float(left @ left), -slope.T @ left, slope.T @ slope)

    return at


def valley(x: np.ndarray) -> np.ndarray:
    """Rosenbrock's function as residuals."""
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def slope_of_valley(x: np.ndarray) -> np.ndarray:
    return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


FINE = linearised(lambda x: 1e3 * valley(x), lambda x: 1e3 * slope_of_valley(x))
"""So that what one more step must gain is little."""


def test_a_curved_valley_is_followed_to_its_end():
    found = minimise(FINE, np.array([-1.2, 1.0]), FREE, 100)
    assert_allclose(found.parameters, 1.0, atol=1e-2)
    assert found.square < 1.0


def test_a_parameter_at_its_bound_does_not_hold_the_others_back():
    """A step that is only clipped leaves the valley, and gains nothing."""
    bounds = Bounds(np.array([-2.0, -2.0]), np.array([0.5, 2.0]), np.full(2, np.inf))
    found = minimise(FINE, np.array([-1.2, 1.0]), bounds, 100)
    assert_allclose(found.parameters, [0.5, 0.25], atol=1e-3)


@given(st.integers(0, 10**6))
def test_a_linear_problem_within_bounds_is_solved_as_scipy_does(seed):
    rng = np.random.default_rng(seed)
    matrix, aim = rng.normal(size=(8, 3)), 1e3 * rng.normal(size=8)
    low, high = -np.abs(rng.normal(size=3)), np.abs(rng.normal(size=3))
    at = linearised(lambda x: matrix @ x - aim, lambda _: matrix)
    bounds = Bounds(low, high, np.full(3, np.inf))
    found = minimise(at, np.zeros(3), bounds, 50)
    best = lsq_linear(matrix, aim, (low, high), method="bvls")
    assert found.square == pytest.approx(2.0 * best.cost, rel=1e-6)


def test_no_step_is_longer_than_it_may_be():
    seen = list[np.ndarray]()

    def at(x: np.ndarray) -> Linearised:
        seen.append(x)
        return linearised(lambda y: 100.0 * (y - 9.0), lambda _: 100.0 * np.eye(1))(x)

    ends = Bounds(np.array([-np.inf]), np.array([np.inf]), np.array([2.0]))
    found = minimise(at, np.zeros(1), ends, 20)
    assert np.abs(np.diff([x[0] for x in seen])).max() <= 2.0 + 1e-9
    assert_allclose(found.parameters, 9.0, atol=0.1)


def test_what_is_impossible_is_not_stepped_into():
    """As where springs would be too soft for the load."""

    def at(x: np.ndarray) -> Linearised:
        if x[0] > 1.0:
            return Linearised(np.inf, np.zeros(1), np.zeros((1, 1)))
        return linearised(lambda y: 100.0 * (y - 1.5), lambda _: 100.0 * np.eye(1))(x)

    ends = Bounds(np.array([-np.inf]), np.array([np.inf]), np.array([np.inf]))
    found = minimise(at, np.zeros(1), ends, 60)
    assert 0.5 < found.parameters[0] <= 1.0
    assert np.isfinite(found.square)


def test_a_parameter_that_does_nothing_stays():
    slope = np.array([[100.0, 0.0], [0.0, 0.0]])
    at = linearised(lambda x: slope @ x - np.array([300.0, 0.0]), lambda _: slope)
    found = minimise(at, np.array([0.0, 7.0]), FREE, 20)
    assert_allclose(found.parameters, [3.0, 7.0], rtol=1e-3)


def test_columns_that_are_fitted_anew_are_eliminated():
    """The problem of some parameters is that of all, the others at their best."""
    rng = np.random.default_rng(4)
    design, aim = rng.normal(size=(30, 5)), rng.normal(size=30)
    kept = np.array([1, 3])
    found = Linearised.of_some(design.T @ design, design.T @ aim, kept)
    rest = np.delete(design, kept, axis=1)
    step = np.array([0.3, -0.2])

    def square(change: np.ndarray) -> float:
        left = aim - design[:, kept] @ change
        fitted = rest @ np.linalg.lstsq(rest, left)[0]
        return float(np.sum((left - fitted) ** 2) - np.sum(aim**2))

    assert found.square == pytest.approx(square(np.zeros(2)))
    said = found.square - 2.0 * found.descent @ step + step @ found.gram @ step
    assert said == pytest.approx(square(step))


def test_a_prior_draws_the_last_parameters_back():
    rng = np.random.default_rng(5)
    design, aim = rng.normal(size=(30, 2)), rng.normal(size=30)
    bare = Linearised(float(aim @ aim), design.T @ aim, design.T @ design)
    drawn = bare.with_prior(np.array([1e6]), np.array([0.5]), bare.square)
    step = np.linalg.solve(drawn.gram, drawn.descent)
    assert step[1] == pytest.approx(-0.5, abs=1e-3)
    assert drawn.square == pytest.approx(bare.square + 0.25e6)


def test_steps_that_fail_one_after_the_other_are_damped_ever_more():
    """Beyond a cliff near the start, where the slope says to go: eight by fives."""
    asked = list[float]()

    def at(x):
        asked.append(float(x[0]))
        square = 1e6 if x[0] > 0.01 else 1e4 * float((x[0] - 1.0) ** 2)
        return Linearised(square, 1e4 * (1.0 - x), 1e4 * np.eye(1))

    far = np.full(1, np.inf)
    found = minimise(at, np.zeros(1), Bounds(-far, far, far), 7)
    assert 0.0 < found.parameters[0] <= 0.01
    assert asked[1:6] == sorted(asked[1:6], reverse=True)


def test_a_step_to_the_other_side_of_a_valley_is_no_end():
    """It gains next to nothing where it should have gained all: the next is shorter."""
    far = np.full(1, np.inf)
    free = Bounds(-far, far, far)
    at = linearised(lambda x: 1e3 * np.arctan(x), lambda x: np.diag(1e3 / (1.0 + x**2)))

    def gained(start: float) -> float:
        asked = list[Linearised]()
        minimise(lambda x: asked.append(at(x)) or asked[-1], np.array([start]), free, 1)
        return asked[0].square - asked[1].square

    start = brentq(lambda x: gained(x) - 0.25, 1.0, 1.5)
    found = minimise(at, np.array([start]), free, 20)
    assert abs(found.parameters[0]) < 1e-3
