"""Six channels of a force sensor say no more than the pulls on it, but for noise."""

from dataclasses import replace

import numpy as np
import pytest
from small_bench import FEW, MODEL, arm
from test_tare import turned

from bench.experiment import record
from bench.instruments import Instruments
from bench.instruments.force_sensor import ForceSensor
from bench.rig import Rig
from bench.shared.recording import WrenchSpec
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.model_fit import fit_of
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.sufficient_statistics import normal_equations_of
from stiffness.effects.wrench_gain import WrenchGain
from stiffness.experiment.sensor_noise import clear_channels

ROWS = 400
SPEC = WrenchSpec(accuracy_force=0.5, accuracy_torque=0.02)
NOISE = np.repeat([SPEC.accuracy_force, SPEC.accuracy_torque], 3)


@pytest.fixture
def pulls() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forces at one point of the sensor as they are and as read; the sensor's axes."""
    draw = np.random.default_rng(5)
    force = draw.normal(0.0, 40.0, (ROWS, 3))
    wrench = np.concatenate([force, np.cross([0.05, 0.02, 0.08], force)], axis=1)
    axes = np.linalg.qr(draw.normal(size=(ROWS, 3, 3)))[0]
    read = wrench + NOISE * draw.normal(size=wrench.shape)
    return turned(axes, wrench), turned(axes, read), axes


def test_of_pulls_at_one_point_half_of_the_noise_is_taken(pulls):
    true, read, axes = pulls
    found = clear_channels(SPEC, read, axes)
    own = turned(axes.swapaxes(1, 2), found) / NOISE
    assert np.linalg.matrix_rank(own, tol=1e-6 * np.linalg.norm(own)) == 3
    left = np.sum((turned(axes.swapaxes(1, 2), found - true) / NOISE) ** 2)
    assert left == pytest.approx(3 * ROWS, rel=0.15)  # of 6 a row


def test_six_channels_that_all_speak_are_left_as_they_are(pulls):
    _, read, axes = pulls
    free = np.random.default_rng(6).normal(0.0, 40.0 * NOISE, (ROWS, 6))
    every = read + turned(axes, free)
    np.testing.assert_allclose(clear_channels(SPEC, every, axes), every, atol=1e-9)


def test_a_sensor_of_unknown_noise_and_few_rows_are_left_as_they_are(pulls):
    _, read, axes = pulls
    silent = replace(SPEC, accuracy_torque=0.0)
    np.testing.assert_array_equal(clear_channels(silent, read, axes), read)
    few = clear_channels(SPEC, read[:5], axes[:5])
    np.testing.assert_array_equal(few, read[:5])


def test_noise_of_a_sensor_is_no_crosstalk():
    """Gains and crosstalk explain by chance no more than they are many."""
    sensor = ForceSensor(accuracy_force=0.5, accuracy_torque=0.025, noise=1.0)
    made = record(
        Rig(MODEL), table_one_plan(poses=60), Instruments(force_sensor=sensor), seed=8
    )
    case = build_problem(prepare(made, arm()), FEW)
    law, at = WrenchGain(), ("wrench_sensor", np.zeros(0))
    own = [law.jacobian(case.situation, *at), law.variants(case.situation, *at)]
    said = normal_equations_of(
        case.data, [*case.nominal, *own], case.normal_equations.fold
    )
    score = said.score[~case.split.held_out].sum(axis=0)
    gain = fit_of((), own, said.gram[1], score).gain
    assert gain < 36 + 4 * np.sqrt(2 * 36)
