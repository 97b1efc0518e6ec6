from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import check_grad
from small_truth import BASE_FROM_TRACKER, permuted, postures, pulls, record

from stiffness.experiment.deflections import every_plateau
from stiffness.methods.gp_residual import (
    GpResidual,
    most_likely,
    negative_log_likelihood,
)
from stiffness.methods.method import Method
from stiffness.methods.transferred_networks import (
    Direct,
    DtCnn,
    FtMlp,
    TransferredFit,
    relative_deflection,
    wrench_about,
)
from stiffness.methods.vjm import Vjm
from stiffness.networks.model import Cnn, Mlp
from stiffness.networks.pretraining import Pretraining
from stiffness.networks.source_domain import SourcePlan, spanning_plan
from stiffness.networks.training import Training
from stiffness.networks.transfer import Alignment, FineTuning
from stiffness.robot.arm import Arm

TRAINING = Training(steps=30, batch=64, rate=1e-2)
SHAPE = Mlp(hidden=4, width=24)


@pytest.fixture(scope="module")
def arm(kr10) -> Arm:
    return Arm.from_mjcf(kr10)


@pytest.fixture(scope="module")
def recording(arm):
    """Twenty poses, two plateaus each, of an arm with six springs and noise."""
    noise = np.random.default_rng(0)
    return record(arm, postures(arm, 20, 1), pulls(20, 2, 2), noise=noise)


@pytest.fixture(scope="module")
def plan(arm) -> SourcePlan:
    return spanning_plan(postures(arm, 100, 3))


def methods(arm: Arm, plan: SourcePlan) -> dict[str, Method]:
    tuning = FineTuning(epochs=10)
    mlp = Pretraining(SHAPE, training=TRAINING)
    cnn = Pretraining(Cnn(), training=replace(TRAINING, steps=5))
    aligning = Alignment(training=Training(steps=5, batch=64))
    return {
        "ft_mlp": FtMlp(arm, plan, mlp, tuning),
        "dt_cnn": DtCnn(arm, plan, cnn),
        "dt_cnn aligned": DtCnn(arm, plan, cnn, aligning),
        "dt_cnn frozen": DtCnn(arm, plan, cnn, replace(tuning, unfrozen=(5, 6))),
        "gp_residual": GpResidual(arm, evaluations=5),
    }


NAMES = ("ft_mlp", "dt_cnn", "dt_cnn aligned", "dt_cnn frozen", "gp_residual")


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_gives_the_same_numbers_to_the_last_digit(name, arm, plan, recording):
    method = methods(arm, plan)[name]
    cases = every_plateau(arm, recording).cases
    first, again = (method.fit(recording).predict(cases) for _ in range(2))
    assert first.shape == (40, 3)
    assert np.isfinite(first).all()
    np.testing.assert_array_equal(first, again)


def test_network_corrected_by_a_softer_arm_comes_nearer_to_it_than_before(
    arm, plan, recording
):
    """The recording's arm is six springs: the network has those to learn from."""
    settings = Pretraining(SHAPE, training=replace(TRAINING, steps=200))
    fitted = FtMlp(arm, plan, settings, FineTuning(epochs=50)).fit(recording)
    data = every_plateau(arm, recording)
    before = fitted.pretrained.network.predict(
        data.cases.posture,
        wrench_about(arm, data.cases, fitted.network.origin_in_flange),
    )
    errors = [
        np.abs(answer - data.deflection).mean()
        for answer in (before, fitted.predict(data.cases), 0.0)
    ]
    assert errors[1] < errors[0] < 0.6 * errors[2]


def test_pretrained_network_is_taken_as_it_is(arm, plan, recording):
    method = methods(arm, plan)["ft_mlp"]
    assert isinstance(method, FtMlp)
    pretrained = method.fit(recording).pretrained
    told: set[str] = set()

    def tell(phase: str, _step: int, _loss: float) -> None:
        told.add(phase)

    again = replace(method, pretrained=pretrained, tell=tell).fit(recording)
    assert again.pretrained is pretrained
    assert told == {"fine-tuning"}


def test_direct_transfer_looks_at_no_deflection_but_through_the_springs(
    arm, plan, recording
):
    fitted = methods(arm, plan)["dt_cnn"].fit(recording)
    assert isinstance(fitted, TransferredFit)
    assert DtCnn(arm).transfer == Direct()
    for name, weight in fitted.pretrained.network.weights.items():
        np.testing.assert_array_equal(fitted.network.weights[name], weight)


def test_order_of_the_visits_changes_the_process_by_rounding_alone(arm, recording):
    cases = every_plateau(arm, recording).cases
    method = GpResidual(arm, evaluations=3)
    order = np.random.default_rng(5).permutation(20)
    one, other = (
        method.fit(r).predict(cases) for r in (recording, permuted(recording, order))
    )
    np.testing.assert_allclose(one, other, atol=1e-9)


def test_process_finds_what_springs_leave_over(arm):
    """The base tilts: every deflection carries a share no axis' spring explains."""
    softness = 4e-6
    tilting = _tilted(arm, record(arm, postures(arm, 60, 1), pulls(60, 2, 2)), softness)
    unseen = _tilted(arm, record(arm, postures(arm, 60, 7), pulls(60, 2, 8)), softness)
    data = every_plateau(arm, unseen)
    off = [
        np.abs(m.fit(tilting).predict(data.cases) - data.deflection).mean()
        for m in (Vjm(arm), GpResidual(arm, evaluations=30))
    ]
    assert off[1] < 0.7 * off[0]


def _tilted(arm: Arm, recording, softness: float):
    """Add what a soft foot, turning about the base's y, does to every marker."""
    data = every_plateau(arm, recording)
    place = arm.point_in_base(data.cases.posture, "flange", np.zeros(3))
    force = data.cases.wrench_in_base[:, :3]
    turn = softness * np.cross(place, force) * [0.0, 1.0, 0.0]
    moved = np.cross(turn, place) @ BASE_FROM_TRACKER[:3, :3]
    points = np.array(recording.points)
    points[data.row] += moved[:, None, :]
    return replace(recording, points=points)


# --- One point of the flange for another ---------------------------------------------


def test_springs_carry_the_answer_to_another_point_of_the_flange(arm, recording):
    """Between two points of one body the springs' own difference is exact for them."""
    springs = Vjm(arm).fit(recording)
    cases = every_plateau(arm, recording).cases
    at = np.array([0.1, 0.0, 0.2])
    elsewhere = replace(cases, point_in_flange=np.tile(at, (len(cases), 1)))
    common = cases.point_in_flange[0]
    here = replace(cases, point_in_flange=np.tile(common, (len(cases), 1)))
    np.testing.assert_allclose(
        springs.predict(here) + relative_deflection(springs, elsewhere, common),
        springs.predict(elsewhere),
        atol=1e-15,
    )
    np.testing.assert_array_equal(relative_deflection(springs, here, common), 0.0)


def test_wrench_about_another_point_twists_the_axes_alike(arm, recording):
    """Virtual work: torques on the axes do not depend on where a wrench is stated."""
    cases = every_plateau(arm, recording).cases
    other = np.array([0.1, -0.2, 0.3])
    moved = wrench_about(arm, cases, other)
    there = arm.load_torque(cases.posture, moved, "flange", other)
    here = arm.load_torque(
        cases.posture, cases.wrench_in_base, "flange", cases.origin_in_flange
    )
    np.testing.assert_allclose(there, here, atol=1e-12)


# --- The process ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def wave():
    draw = np.random.default_rng(0)
    inputs = draw.uniform(-2, 2, (80, 2))
    values = np.sin(2 * inputs[:, 0]) + 0.1 * draw.standard_normal(80)
    return inputs, values, np.arange(80) // 2


def test_slope_of_the_likelihood_is_that_of_its_values(wave):
    """Rasmussen and Williams 2006, Eq. 5.9, against differences."""
    inputs, values, group = wave
    same = (group[:, None] == group).astype(float)
    theta = np.log([0.7, 2.0, 1.1, 0.2, 0.3])
    error = check_grad(
        lambda t: negative_log_likelihood(t, inputs, values, same)[0],
        lambda t: negative_log_likelihood(t, inputs, values, same)[1],
        theta,
    )
    assert error < 1e-6


def test_likelihood_is_that_of_a_normal_law(wave):
    """Rasmussen and Williams 2006, Eq. 2.30, spelt out."""
    inputs, values, group = wave
    same = (group[:, None] == group).astype(float)
    l1, l2, s, p, n = 0.7, 2.0, 1.1, 0.2, 0.3
    apart = (inputs[:, None] - inputs) / [l1, l2]
    covariance = s**2 * np.exp(-0.5 * np.sum(apart**2, axis=2))
    covariance += p**2 * same + n**2 * np.eye(80)
    _, log_det = np.linalg.slogdet(covariance)
    expected = values @ np.linalg.solve(covariance, values) + log_det
    expected = (expected + 80 * np.log(2 * np.pi)) / 2 / 80
    theta = np.log([l1, l2, s, p, n])
    value, _ = negative_log_likelihood(theta, inputs, values, same)
    assert value == pytest.approx(expected, rel=1e-9)


def test_process_finds_the_input_that_matters_and_the_noise(wave):
    inputs, values, _ = wave
    process = most_likely(*wave, evaluations=60)
    assert process.length[1] > 5 * process.length[0]
    assert np.std(values - process.mean(inputs)) == pytest.approx(0.1, rel=0.3)
    x = np.column_stack([np.linspace(-1.5, 1.5, 50), np.zeros(50)])
    np.testing.assert_allclose(process.mean(x), np.sin(2 * x[:, 0]), atol=0.15)


def test_unit_of_the_values_changes_nothing_but_the_unit(wave):
    inputs, values, group = wave
    m, mm = (most_likely(inputs, v, group, 20) for v in (values, 1e3 * values))
    np.testing.assert_allclose(1e3 * m.mean(inputs), mm.mean(inputs), rtol=1e-6)
    np.testing.assert_allclose(1e3 * mm.weight, m.weight, rtol=1e-6)
    assert mm.amplitude == pytest.approx(1e3 * m.amplitude, rel=1e-6)
