import numpy as np
import pytest
from scipy import stats

from stiffness.regression.testing import joint_statistic


def test_sizes_known_only_together_are_not_zero_at_once():
    """Each lies within one standard error of zero, their difference twenty away."""
    covariance = np.array([[1.0, 0.999], [0.999, 1.0]])
    apart = np.array([0.45, -0.45])
    assert joint_statistic(apart, covariance) == pytest.approx(0.9**2 / 0.002 / 2)
    assert joint_statistic(apart, np.eye(2)) == pytest.approx(0.45**2)
    units = np.array([1e-9, 1e6])
    scaled = joint_statistic(apart * units, covariance * units * units[:, None])
    assert scaled == pytest.approx(joint_statistic(apart, covariance))


def test_of_a_single_size_it_is_the_square_in_standard_errors_and_of_none_zero():
    assert joint_statistic(np.array([3e-6]), np.array([[1e-12]])) == pytest.approx(9.0)
    assert joint_statistic(np.zeros(0), np.zeros((0, 0))) == 0.0


def test_noise_alone_passes_the_joint_limit_as_often_as_is_stated():
    draw = np.random.default_rng(3)
    poses, sizes, trials = 40, 4, 2000
    values = draw.standard_normal((trials, poses, sizes))
    mixed = values @ draw.standard_normal((sizes, sizes))
    over = [
        joint_statistic(v.mean(axis=0), np.cov(v.T) / poses)
        > stats.f.ppf(0.95, sizes, poses - 1)
        for v in mixed
    ]
    small_sample = (poses - 1) / (poses - sizes)  # what the docstring leaves out
    exact = stats.f.sf(
        stats.f.ppf(0.95, sizes, poses - 1) / small_sample, sizes, poses - sizes
    )
    assert np.mean(over) == pytest.approx(exact, abs=0.02)
