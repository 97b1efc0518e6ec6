import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from bench.shared.errors import UnknownName, Unusable
from stiffness.networks.model import (
    ACTIVATIONS,
    Cnn,
    Mlp,
    Scaling,
    Shape,
    encoding,
    plain_angles,
    sine_and_cosine,
    weights_of,
)
from stiffness.networks.pretraining import (
    Errors,
    Pretrained,
    Pretraining,
    pretrain,
    split,
)
from stiffness.networks.source_domain import SourceDomain
from stiffness.networks.training import Training
from stiffness.networks.transfer import FineTuning, coral, fine_tune, hold_back

SMALL = Pretraining(shape=Mlp(hidden=4, width=24), training=Training(60, 64, 1e-2))
POINT = np.zeros(3)


@pytest.fixture(scope="module")
def domain() -> SourceDomain:
    """Deflections that are linear in the wrench, of an arm with two axes."""
    draw = np.random.default_rng(0)
    posture = np.column_stack([draw.uniform(-1, 1, (900, 2)), np.zeros(900)])
    wrench = draw.uniform(-100, 100, (900, 6))
    soft = 1e-6 * np.stack([1 + np.sin(posture[:, 0]), np.cos(posture[:, 1])], axis=1)
    deflection = wrench[:, :3] * soft[:, [0, 1, 0]]
    return SourceDomain("test", posture, wrench, deflection, POINT, POINT)


@pytest.fixture(scope="module")
def pretrained(domain) -> Pretrained:
    return pretrain(domain, SMALL)


def measured(domain: SourceDomain, pretrained: Pretrained):
    """Take 100 rows of 25 poses whose arm is softer than the springs say."""
    few = domain.take(np.arange(100))
    seen = pretrained.network.encode(few.posture, few.wrench_in_base)
    return seen, 1.3 * few.deflection, np.arange(100) // 4


# --- What a network sees -------------------------------------------------------------


def test_sines_and_cosines_make_eighteen_inputs_of_twelve_quantities():
    """Wu et al. 2024, Eq. 5."""
    posture, wrench = np.full((1, 6), np.pi / 6), np.arange(6.0)[None]
    seen = sine_and_cosine(posture, wrench)[0]
    np.testing.assert_allclose(seen[:6], 0.5)
    np.testing.assert_allclose(seen[6:12], np.sqrt(0.75))
    np.testing.assert_array_equal(seen[12:], wrench[0])
    assert plain_angles(posture, wrench).shape == (1, 12)


def test_unknown_encoding_is_named_with_those_that_exist():
    with pytest.raises(UnknownName, match=r"sine_and_cosine"):
        encoding("sine")


@given(st.integers(1, 5), st.floats(-1e3, 1e3), st.floats(1e-3, 1e3))
def test_units_come_back_as_they_were_taken(columns, mean, scale):
    draw = np.random.default_rng(columns)
    values = mean + scale * draw.standard_normal((50, columns))
    scaling = Scaling.of(values)
    unitless = scaling.unitless(values)
    np.testing.assert_allclose(unitless.mean(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(unitless.std(axis=0), 1.0, rtol=1e-9)
    np.testing.assert_allclose(scaling.in_units(unitless), values, rtol=1e-9)


def test_input_that_never_varied_in_training_changes_no_prediction(pretrained):
    """The third axis stood still, as A4 and A6 do in Table 4."""
    wrench = np.full((2, 6), 50.0)
    posture = np.array([[0.2, 0.3, 0.0], [0.2, 0.3, 1.0]])
    predicted = pretrained.network.predict(posture, wrench)
    np.testing.assert_array_equal(predicted[0], predicted[1])


def test_posture_of_another_arm_is_refused(pretrained):
    with pytest.raises(Unusable, match="7 axes make 20 inputs"):
        pretrained.network.predict(np.zeros((1, 7)), np.zeros((1, 6)))


# --- Shapes --------------------------------------------------------------------------


@pytest.mark.parametrize("activation", ACTIVATIONS)
def test_perceptron_is_the_papers_equation_1(activation):
    shape = Mlp(hidden=2, width=5, activation=activation)
    network = shape.build(4, seed=0)
    x = torch.linspace(-1, 1, 4)[None]
    phi = {"relu": torch.relu, "tanh": torch.tanh, "sigmoid": torch.sigmoid}[activation]
    h = x
    layers = [layer.double() for layer in shape.layers(network.double())]
    for k, layer in enumerate(layers):
        assert isinstance(layer, torch.nn.Linear)
        torch.nn.init.constant_(layer.bias, 0.1 * k)
        torch.nn.init.normal_(layer.weight)
        h = h.double() @ layer.weight.T + layer.bias
        h = phi(h) if k < 2 else h
    torch.testing.assert_close(network(x.double()), h)


def test_paper_network_has_four_layers_of_380():
    network = Mlp().build(18, seed=0)
    sizes = [tuple(layer.weight.shape) for layer in Mlp().layers(network)]  # pyright: ignore
    assert sizes == [(380, 18), (380, 380), (380, 380), (380, 380), (3, 380)]


def test_reference_network_has_four_convolutions_of_one_and_a_dense_layer():
    """Zhao et al. 2021: 16, 32, 64, 128 channels, then 256 neurons."""
    network = Cnn().build(18, seed=0)
    parts = [p for p in network.modules() if isinstance(p, torch.nn.Conv1d)]
    assert [(p.out_channels, p.kernel_size) for p in parts] == [
        (16, (1,)),
        (32, (1,)),
        (64, (1,)),
        (128, (1,)),
    ]
    dense = [p for p in network.modules() if isinstance(p, torch.nn.Linear)]
    assert [(p.in_features, p.out_features) for p in dense] == [(512, 256), (256, 3)]
    assert len(Cnn().layers(network)) == 6


def test_pooling_a_signal_of_length_one_returns_it():
    """All four places of the reference then hold the same value."""
    network = Cnn().build(18, seed=0).eval()
    before_dense = torch.nn.Sequential(*list(network.children())[:5])
    pooled = before_dense(torch.randn(3, 18))
    assert pooled.shape == (3, 128, 4)
    torch.testing.assert_close(pooled, pooled[:, :, :1].expand(3, 128, 4))


def test_inputs_as_places_of_a_signal_lose_their_order_within_a_quarter():
    network = Cnn(inputs_are="signal").build(18, seed=0).eval()
    x = torch.randn(1, 18)
    swapped = x[:, [1, 0, *range(2, 18)]]
    torch.testing.assert_close(network(x), network(swapped))
    assert not torch.allclose(
        Cnn().build(18, seed=0).eval()(x), Cnn().build(18, seed=0).eval()(swapped)
    )


@pytest.mark.parametrize("shape", [Mlp(2, 8), Cnn(), Cnn("signal")])
def test_weights_follow_from_the_seed_alone(shape: Shape):
    state = torch.get_rng_state()
    first, again, other = (weights_of(shape.build(18, s)) for s in (0, 0, 1))
    assert torch.equal(state, torch.get_rng_state())
    for name in first:
        np.testing.assert_array_equal(first[name], again[name])
    assert any(not np.array_equal(first[name], other[name]) for name in first)


def test_impossible_networks_are_refused_with_all_faults():
    with pytest.raises(Unusable, match="2 faults"):
        Mlp(hidden=0, width=0)
    with pytest.raises(UnknownName, match="relu"):
        Mlp(activation="relo")
    with pytest.raises(Unusable, match="dropout is 1"):
        Cnn(dropout=1.0)
    with pytest.raises(Unusable, match="four of at least 1"):
        Cnn(channels=(16, 0, 8, 8))


# --- Pre-training --------------------------------------------------------------------


def test_rate_rises_to_its_peak_and_falls_to_zero():
    settings = Training(steps=100, rate=2.0, warm_up=0.1)
    rates = [settings.rate_at(step) for step in range(101)]
    assert rates[0] == pytest.approx(0.2)
    assert max(rates) == rates[10] == rates[9] == 2.0
    assert rates[55] == pytest.approx(1.0)
    assert rates[100] == pytest.approx(0.0)


def test_seventy_percent_of_the_rows_train_and_the_others_test():
    rows, others = split(1000, seed=3)
    assert (len(rows), len(others)) == (700, 300)
    np.testing.assert_array_equal(np.sort([*rows, *others]), np.arange(1000))


def test_pretraining_learns_what_the_springs_say(domain, pretrained):
    guess = np.abs(domain.deflection).mean(axis=0)
    assert np.all(pretrained.on_test.mae < 0.4 * guess)
    assert pretrained.loss[-1] < 0.2 * pretrained.loss[0]


def test_errors_are_the_papers_equations_7_to_9():
    error = Errors.of(np.array([[1.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]), np.zeros((2, 3)))
    assert (error.mae[0], error.stde[0], error.me[0]) == (2.0, 1.0, 3.0)


@pytest.mark.parametrize("shape", [SMALL.shape, Cnn(dropout=0.5)])
def test_interrupted_pretraining_ends_with_the_same_numbers(domain, tmp_path, shape):
    settings = Pretraining(shape=shape, training=Training(14, 64, 1e-2))
    whole = pretrain(domain, settings)

    def stop(step: int, loss: float) -> None:
        if step == 11:
            raise KeyboardInterrupt

    file = tmp_path / "network.npz"
    with pytest.raises(KeyboardInterrupt):
        pretrain(domain, settings, file, stop, every=4)
    steps: list[int] = []
    resumed = pretrain(domain, settings, file, lambda step, _: steps.append(step))
    assert steps == list(range(9, 15))
    np.testing.assert_array_equal(resumed.loss, whole.loss)
    for name, weight in whole.network.weights.items():
        np.testing.assert_array_equal(resumed.network.weights[name], weight)


def test_finished_pretraining_is_read_and_not_repeated(domain, pretrained, tmp_path):
    file = tmp_path / "network.npz"
    pretrain(domain, SMALL, file)
    steps: list[int] = []
    again = pretrain(domain, SMALL, file, lambda step, _: steps.append(step))
    assert steps == []
    np.testing.assert_array_equal(again.on_test.mae, pretrained.on_test.mae)


def test_training_of_other_springs_is_not_taken_up(domain, tmp_path):
    file = tmp_path / "network.npz"
    pretrain(domain, SMALL, file)
    softer = domain.take(np.arange(900))
    softer.deflection[0] *= 1.0 + 1e-12
    steps: list[int] = []
    pretrain(softer, SMALL, file, lambda step, _: steps.append(step))
    assert len(steps) == SMALL.training.steps


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut short", b"x" * 100])
def test_damaged_training_is_refused_by_name(domain, tmp_path, content):
    file = tmp_path / "network.npz"
    file.write_bytes(content)
    with pytest.raises(Unusable, match=r"network\.npz.*\n.*delete it"):
        pretrain(domain, SMALL, file)


def test_impossible_training_is_refused_with_all_faults():
    with pytest.raises(Unusable, match="3 faults"):
        Training(steps=0, rate=-1.0, warm_up=1.0)


# --- Fine-tuning ---------------------------------------------------------------------


def test_only_unfrozen_layers_change(domain, pretrained):
    rows = measured(domain, pretrained)
    tuned = fine_tune(pretrained.network, *rows, FineTuning((2, 5), epochs=5))
    before = pretrained.network.weights
    changed = {
        name
        for name, weight in tuned.network.weights.items()
        if not np.array_equal(weight, before[name])
    }
    assert changed == {"2.weight", "2.bias", "8.weight", "8.bias"}


def test_correction_brings_the_network_nearer_to_what_was_measured(domain, pretrained):
    rows = measured(domain, pretrained)
    tuned = fine_tune(pretrained.network, *rows, FineTuning(epochs=80, rate=3e-3))
    assert tuned.training_mae[-1] < 0.5 * tuned.training_mae[0]
    assert tuned.validation_mae[-1] < 0.7 * tuned.validation_mae[0]


def test_epoch_that_is_best_on_the_poses_held_back_is_kept(domain, pretrained):
    """Wu et al. 2024, Fig. 7."""
    rows = measured(domain, pretrained)
    tuned = fine_tune(pretrained.network, *rows, FineTuning(epochs=80, rate=0.03))
    best = int(np.argmin(tuned.validation_mae))
    assert tuned.epoch == best + 1
    few = domain.take(np.flatnonzero(np.isin(rows[2], tuned.held_back)))
    predicted = tuned.network.predict(few.posture, few.wrench_in_base)
    mae = np.abs(predicted - 1.3 * few.deflection).mean()
    assert mae == pytest.approx(tuned.validation_mae[best], rel=1e-4)


def test_normal_training_keeps_the_last_epoch(domain, pretrained):
    settings = FineTuning(epochs=30, rate=0.03, keep="last", validation=0.0)
    tuned = fine_tune(pretrained.network, *measured(domain, pretrained), settings)
    assert tuned.epoch == 30
    assert len(tuned.held_back) == 0
    assert np.isnan(tuned.validation_mae).all()


def test_pull_keeps_weights_near_where_they_were(domain, pretrained):
    def far(pull: float) -> float:
        settings = FineTuning(epochs=40, pull=pull, keep="last")
        rows = measured(domain, pretrained)
        tuned = fine_tune(pretrained.network, *rows, settings)
        before = pretrained.network.weights
        return sum(
            float(np.sum((weight - before[name]) ** 2))
            for name, weight in tuned.network.weights.items()
        )

    assert far(1.0) < 0.5 * far(0.0)


@given(st.integers(2, 40), st.integers(1, 5), st.integers(0, 9))
def test_poses_are_held_back_whole(poses, rows, seed):
    pose = np.repeat(7 * np.arange(poses), rows)
    back = hold_back(pose, 0.2, seed)
    assert 1 <= len(back) < poses
    assert abs(len(back) - 0.2 * poses) <= 1
    np.testing.assert_array_equal(back, hold_back(pose[::-1], 0.2, seed))


def test_layer_that_does_not_exist_is_refused(domain, pretrained):
    with pytest.raises(Unusable, match=r"layers 1 to 5, not \[6\]"):
        settings = FineTuning(unfrozen=(1, 6))
        fine_tune(pretrained.network, *measured(domain, pretrained), settings)


def test_impossible_fine_tuning_is_refused_with_all_faults():
    with pytest.raises(Unusable, match="3 faults"):
        FineTuning(unfrozen=(), epochs=0, validation=0.0)


# --- Alignment -----------------------------------------------------------------------


def test_features_that_vary_alike_are_no_distance_apart():
    """Sun and Saenko 2016, Eq. 1, by hand: (4 - 1)^2 / (4 * 1^2)."""
    one = torch.tensor([[-1.0], [0.0], [1.0]])
    torch.testing.assert_close(coral(one, 2.0 * one), torch.tensor(9.0 / 4.0))
    assert coral(one, one + 5.0) == 0.0
