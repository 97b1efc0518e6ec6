"""What a force sensor reads without a load is its noise, and moves no axis."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from small_bench import FEW, MODEL, arm

from bench.experiment import record
from bench.instruments import Instruments
from bench.instruments.force_sensor import ForceSensor
from bench.rig import Rig
from bench.shared.recording import UNLOADED, Recording
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.lost_motion import LostMotion
from stiffness.experiment.sensor_noise import tared
from stiffness.regression.testing import SIGNIFICANCE

COARSE = ForceSensor(accuracy_force=4.0, accuracy_torque=0.2)


@cache
def coarse() -> Recording:
    """Nothing is there but a sensor that errs by 4 N, a twenty-fifth of the load."""
    return record(
        Rig(MODEL), table_one_plan(poses=60), Instruments(force_sensor=COARSE), seed=4
    )


@pytest.fixture
def case() -> tuple[Recording, np.ndarray, np.ndarray]:
    """A recording with its wrench along the base's axes, and the sensor's axes."""
    turns = np.linalg.qr(
        np.random.default_rng(1).normal(size=(len(coarse().time), 3, 3))
    )
    axes = turns[0]
    made = coarse()
    assert made.wrench is not None
    return made, turned(axes, made.wrench), axes


def turned(axes: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    parts = [np.einsum("rij,rj->ri", axes, w) for w in np.split(wrench, 2, axis=1)]
    return np.concatenate(parts, axis=1)


def test_rows_without_a_load_read_their_mean_and_the_others_what_they_read(case):
    made, wrench, axes = case
    found = turned(axes.swapaxes(1, 2), tared(made, wrench, axes))
    rest = made.stage == UNLOADED
    mean = made.wrench[rest].mean(axis=0)
    np.testing.assert_allclose(found[rest], np.tile(mean, (rest.sum(), 1)), atol=0.2)
    np.testing.assert_allclose(found[~rest], made.wrench[~rest], atol=1e-9)


def test_a_bias_of_the_sensor_stays(case):
    made, wrench, axes = case
    bias = np.array([1.5, -8.0, 3.0, 0.2, 0.0, -0.1])
    more = turned(axes, np.tile(bias, (len(wrench), 1)))
    apart = tared(made, wrench + more, axes) - tared(made, wrench, axes)
    np.testing.assert_allclose(apart, more, atol=1e-9)


def test_what_hangs_on_an_unloaded_sensor_is_a_load(case):
    made, wrench, axes = case
    hook = wrench - np.array([0.0, 0.0, 30.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal(tared(made, hook, axes), hook)


def test_readings_of_a_sensor_whose_noise_is_not_stated_stay(case):
    made, wrench, axes = case
    assert made.wrench_sensor is not None
    silent = replace(made.wrench_sensor, accuracy_force=0.0)
    np.testing.assert_array_equal(
        tared(replace(made, wrench_sensor=silent), wrench, axes), wrench
    )


@pytest.mark.parametrize("seed", [1, 4, 7])
def test_a_coarse_sensor_feigns_nothing(seed):
    """An axis that turns by no torque where noise is read looks as if it had play.

    Of these recordings of nothing each alarms where that noise is kept.
    """
    made = record(
        Rig(MODEL), table_one_plan(poses=60), Instruments(force_sensor=COARSE), seed
    )
    found = diagnose(made, arm(), (*FEW, LostMotion()))
    assert found.detection.p_value >= SIGNIFICANCE
