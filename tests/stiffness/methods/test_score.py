import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from bench.shared.errors import BenchError, Unusable
from bench.shared.settings import Interval
from stiffness.methods.score import METRICS, mae, me, scores, stde_absolute, stde_signed
from stiffness.regression.intervals import bootstrap, quotient_interval, share

ERROR = np.array([0.1, -0.3, 0.2, -0.1, 0.6])
ONCE = np.ones(5)
ERRORS = st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=12)


def test_scores_are_the_papers_equations_evaluated_by_hand():
    """Eqs 7 to 9 of Wu et al. 2024; e = 0.1, 0.3, 0.2, 0.1, 0.6."""
    assert mae(ERROR, ONCE) == pytest.approx(1.3 / 5)
    assert stde_absolute(ERROR, ONCE) == pytest.approx(np.sqrt(0.51 / 5 - 0.26**2))
    assert stde_signed(ERROR, ONCE) == pytest.approx(np.sqrt(0.51 / 5 - 0.1**2))
    assert me(ERROR, ONCE) == pytest.approx(0.6)


@given(errors=ERRORS, counts=st.lists(st.integers(0, 3), min_size=12, max_size=12))
@pytest.mark.parametrize("metric", METRICS)
def test_row_that_counts_twice_is_a_row_written_twice(metric, errors, counts):
    error, weight = np.array(errors), np.array(counts[: len(errors)])
    weight[0] += 1
    repeated = np.repeat(error, weight)
    statistic = METRICS[metric]
    # the root of a rounded difference of squares
    assert statistic(error, weight.astype(float)) == pytest.approx(
        statistic(repeated, np.ones(len(repeated))), abs=1e-6
    )


@given(errors=ERRORS)
def test_absolute_deviation_is_never_above_the_signed_one_about_zero(errors):
    """Mean e^2 = MAE^2 + STDE^2 holds for absolute errors."""
    error, once = np.array(errors), np.ones(len(errors))
    square = mae(error, once) ** 2 + stde_absolute(error, once) ** 2
    assert square == pytest.approx(np.mean(error**2), abs=1e-9)
    assert me(error, once) >= mae(error, once) - 1e-12


def test_scores_speak_millimetres_of_errors_in_metres():
    draw = np.random.default_rng(0)
    measured = 1e-3 * draw.standard_normal((40, 3))
    predicted = measured + np.array([1e-4, 0.0, -2e-4])
    found = scores(predicted, measured, np.arange(40), resamples=100)
    by_name = {(s.direction, s.metric): s for s in found}
    assert by_name["x", "MAE"].value_mm == pytest.approx(0.1)
    assert by_name["y", "ME"].value_mm == 0.0
    assert by_name["z", "MAE"].value_mm == pytest.approx(0.2)
    assert {s.n for s in found} == {40}
    assert len(found) == 3 * len(METRICS)


def test_same_seed_gives_the_same_intervals_to_the_last_bit():
    draw = np.random.default_rng(1)
    error, pose = draw.standard_normal((60, 3)), np.repeat(np.arange(20), 3)
    again = [scores(error, 0 * error, pose, seed=7, resamples=200) for _ in range(2)]
    assert again[0] == again[1]
    assert again[0] != scores(error, 0 * error, pose, seed=8, resamples=200)


def test_errors_that_are_no_numbers_are_refused():
    bad = np.full((3, 3), np.nan)
    with pytest.raises(Unusable, match="no numbers"):
        scores(bad, bad, np.arange(3))
    with pytest.raises(Unusable, match="no rows"):
        scores(bad[:0], bad[:0], np.arange(0))


def test_interval_over_poses_covers_the_truth_as_often_as_it_says():
    """MAE of poses with a common error each: rows of a pose hang together."""
    draw = np.random.default_rng(2)
    truth = np.sqrt(2 / np.pi) * np.hypot(1.0, 0.5)
    covered = 0
    for trial in range(400):
        common = np.repeat(draw.standard_normal(60), 4)
        error = common + 0.5 * draw.standard_normal(240)
        pose = np.repeat(np.arange(60), 4)
        interval = bootstrap(error, pose, mae, seed=trial, resamples=500)
        covered += int(interval.low <= truth <= interval.high)
    # 95 % less what 60 poses cost; four standard errors of a share of 400
    assert share(covered, 400).estimate == pytest.approx(0.945, abs=0.045)


def test_interval_over_rows_would_be_too_short():
    """Why poses are drawn and not rows."""
    draw = np.random.default_rng(3)
    error = np.repeat(draw.standard_normal(60), 4)
    poses = bootstrap(error, np.repeat(np.arange(60), 4), mae)
    rows = bootstrap(error, np.arange(240), mae)
    # four copies of a row halve the apparent spread
    assert (poses.high - poses.low) / (rows.high - rows.low) == pytest.approx(
        2, rel=0.1
    )


def test_bca_ends_of_a_mean_agree_with_another_implementation():
    draw = np.random.default_rng(4)
    values = draw.exponential(size=50)
    ours = bootstrap(values, np.arange(50), mae, seed=0, resamples=20000)
    other = stats.bootstrap(
        (values,), np.mean, n_resamples=20000, method="BCa", rng=draw
    ).confidence_interval
    # 20,000 resamples leave about 1 % of the width
    width = other.high - other.low
    assert ours.low == pytest.approx(other.low, abs=0.03 * width)
    assert ours.high == pytest.approx(other.high, abs=0.03 * width)


def test_percentages_have_clopper_and_pearsons_published_ends():
    """None of ten: 1 - 0.025^(1/10); all the tails of the binomial for the others."""
    none = share(0, 10)
    assert (none.low, none.high) == (0.0, pytest.approx(1 - 0.025**0.1))
    some = share(950, 1000)
    assert stats.binom.sf(949, 1000, some.low) == pytest.approx(0.025)
    assert stats.binom.cdf(950, 1000, some.high) == pytest.approx(0.025)


def test_interval_without_poses_to_draw_is_refused():
    with pytest.raises(BenchError, match="two poses"):
        bootstrap(np.ones(4), np.zeros(4, dtype=int), mae)
    with pytest.raises(BenchError, match="5 of 4"):
        share(5, 4)


def test_sigma_of_an_interval_is_that_of_a_normal_distribution():
    half = 1.959964
    found = Interval(3.0, 3.0 - 0.2 * half, 3.0 + 0.2 * half)
    assert found.sigma == pytest.approx(0.2, rel=1e-6)


def test_ends_of_a_quotient_are_fiellers_and_none_where_nothing_may_divide():
    """At each end the error of x - r m is as large as x - r m itself."""
    x, m, q = 0.03, 4.6, 1.98
    covariance = np.array([[4e-4, 1e-3], [1e-3, 4.4]])
    found = quotient_interval(x, m, covariance, q)
    for r in (found.low, found.high):
        way = np.array([1.0, -r])
        assert (x - r * m) ** 2 == pytest.approx(q**2 * way @ covariance @ way)
    assert found.low < x / m < found.high
    wide = quotient_interval(x, 2.0, covariance, q)
    assert np.isinf(wide.low) and np.isinf(wide.high)


@given(st.floats(1.0, 9.0), st.floats(-3.0, 3.0), st.floats(1e-3, 0.1))
def test_a_quotient_by_what_is_known_errs_as_its_numerator_does(m, x, sigma):
    found = quotient_interval(x, m, np.diag([sigma**2, 0.0]), 2.0)
    half = 2.0 * sigma / m
    assert (found.low, found.high) == pytest.approx((x / m - half, x / m + half))
