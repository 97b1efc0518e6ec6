"""Laws of one gear act on each other, and their sizes come out right together."""

from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bench.effects.angle_dependent_stiffness import AngleDependentStiffness
from bench.effects.asymmetric_stiffness import AsymmetricStiffness
from bench.effects.creep import Creep
from bench.effects.effect import Effect
from bench.effects.hardening import Hardening
from bench.effects.hysteresis import Hysteresis
from stiffness.diagnosis.model_fit import ModelFit, ModelTerm
from stiffness.diagnosis.relinearisation import state_under
from stiffness.effects.jacobian import turn, values
from stiffness.experiment.static_state import StaticState

LOOP = (Hysteresis("a2", width_rad=1e-4), (11.0, 0.0))
WAVE = (AngleDependentStiffness("a2", 0.1, 2.0, 1.0), (2.0,))
ASYMMETRY = (AsymmetricStiffness("a2", 1.3), (0.1,))
CREEP = (Creep("a2", 0.05, 60.0), (60.0, 0.0))


def terms_of(*laws: tuple[Effect, tuple[float, ...]]) -> list[ModelTerm]:
    return [
        ModelTerm(truth.BY_NAME[effect.name], effect.where, np.array(shape))
        for effect, shape in laws
    ]


def fitted(
    state: StaticState, terms: list[ModelTerm], done: np.ndarray
) -> tuple[StaticState, ModelFit]:
    """Fit laws and the springs of their axes to a displacement, in a static state."""
    axes = sorted({state.axis(term.where) for term in terms})
    own = [term.jacobian(state) for term in terms]
    springs = [turn(k, state.torque[:, k]) for k in axes]
    design = np.concatenate([truth.moved(state, s) for s in (*own, *springs)], axis=3)
    design = design.reshape(-1, design.shape[3])
    size = np.linalg.norm(design, axis=0)
    found = np.linalg.lstsq(design / size, done.ravel())[0] / size
    ends = np.cumsum([law.columns for law in own])
    compliance = truth.situation().compliance.copy()
    compliance[axes] += found[ends[-1] :]
    parts = tuple(np.split(found[: ends[-1]], ends[:-1]))
    return state.with_compliance(compliance), ModelFit(
        tuple(terms), 0.0, np.zeros(0), parts, 0
    )


def sizes(state: StaticState, fit: ModelFit) -> dict[str, float]:
    found = {}
    for term, own in zip(fit.members, fit.coefficients, strict=True):
        law = term.hypothesis.parameters(state, term.where, term.shape, own)
        found |= {f"{term.name[0]}.{name}": value for name, value in law.items()}
    return found


@pytest.mark.parametrize(
    ("laws", "size", "true"),
    [
        ((ASYMMETRY, WAVE), "angle_dependent_stiffness.ratio", 0.1),
        ((ASYMMETRY, LOOP), "hysteresis.width_rad", 1e-4),
        ((ASYMMETRY, CREEP), "creep.ratio", 0.05),
    ],
    ids=["wave", "loop", "creep"],
)
def test_laws_that_act_through_an_asymmetric_spring_have_their_size(laws, size, true):
    """Laid out each by itself, the size is off by more than a tenth."""
    done = truth.in_base(truth.recording(*(effect for effect, _ in laws)))
    done = done - truth.in_base(truth.recording())
    state, terms = truth.situation(), terms_of(*laws)
    errors = []
    for _ in range(3):
        own, fit = fitted(state, terms, done)
        errors.append(sizes(own, fit)[size] / true - 1.0)
        state = state_under(own, fit).with_compliance(truth.situation().compliance)
    assert abs(errors[0]) > 0.1
    assert abs(errors[-1]) < 0.02


def test_a_loop_beside_a_spring_that_hardens_is_that_of_slipping_elements():
    """Elements slip by how far the gear winds up, which friction and law share."""
    hard = (Hardening("a2", 2.0, torque_nm=15.0), (15.0, 0.0))
    loop = (Hysteresis("a2", width_rad=4e-4), (25.0, 0.0))
    done = truth.in_base(truth.recording(hard[0], loop[0]))
    friction = done - truth.in_base(truth.recording(hard[0]))
    done = done - truth.in_base(truth.recording())
    state, (law, slips) = truth.situation(), terms_of(hard, loop)
    straight = truth.situation().compliance
    left = []
    for slip in (40.0, 45.0, 50.0):
        here, terms = state, [law, replace(slips, shape=np.array([slip, 0.0]))]
        own, fit = fitted(here, terms, done)
        for _ in range(5):
            here = state_under(own, fit).with_compliance(straight)
            own, fit = fitted(here, terms, done)
        size = np.concatenate([*fit.coefficients, [own.compliance[1] - straight[1]]])
        laws = [*(term.jacobian(here) for term in terms), turn(1, here.torque[:, 1])]
        every = np.concatenate([truth.moved(here, one) for one in laws], axis=3)
        left.append(np.linalg.norm(every @ size - done) / np.linalg.norm(friction))
    assert min(left) < 0.045


def alone(state: StaticState, *laws: tuple[str, str, list[float], list[float]]):
    """Return a static state under laws of one gear: effect, place, shape and size."""
    terms = tuple(ModelTerm(truth.BY_NAME[e], w, np.array(s)) for e, w, s, _ in laws)
    size = tuple(np.array(c) for _, _, _, c in laws)
    return state_under(state, ModelFit(terms, 0.0, np.zeros(0), size, 0))


def column(state: StaticState, effect: str, where: str, shape: list[float]):
    return values(
        truth.BY_NAME[effect].jacobian(state, where, np.array(shape)).parts[0]
    )


def test_a_wave_of_stiffness_and_a_coupling_act_on_what_friction_leaves():
    """Its torque is f = (w/2) z / C; on all, where they are not named beside it."""
    state, width, shape = truth.situation(), 2e-4, [8.0, 0.0]
    for axis, where in ((1, "a2"), (3, "a4")):
        loop = ("hysteresis", where, shape, [width])
        wave = ("angle_dependent_stiffness", where, [2.0], [0.0, 0.0])
        coupling = ("wrist_coupling", "a6", [4.0], [0.0])
        named = alone(state, loop, wave, coupling)
        friction = -width * column(state, "hysteresis", where, shape)[:, 0]
        friction /= state.compliance[axis]
        left = state.torque[:, axis] - friction
        assert np.abs(friction).max() > 0.02 * np.abs(state.torque[:, axis]).max()
        assert_allclose(named.spring_torque(axis), left, atol=1e-12)
        own = named.spring_torque(axis, ("hysteresis", where))
        assert_array_equal(own, state.torque[:, axis])
        phase = 2.0 * state.recording.posture[:, axis]
        for here, torque in (
            (named, left),
            (alone(state, loop), state.torque[:, axis]),
        ):
            law = column(here, "angle_dependent_stiffness", where, [2.0])
            assert_allclose(law[:, 0], torque * np.cos(phase), atol=1e-9)
    assert_allclose(column(named, "wrist_coupling", "a6", [4.0])[:, 0], left)


def test_friction_feels_what_a_wave_and_a_coupling_leave():
    """The wave carries -u (w - mean of w)/C, the coupling -c u / C."""
    state, shape = truth.situation(), [2.0, 0.0]
    a, b = -0.1 * state.compliance[5], 0.05 * state.compliance[5]
    wave = ("angle_dependent_stiffness", "a6", [1.0], [a, b])
    loop = ("hysteresis", "a6", shape, [0.0])
    named = alone(state, wave, loop)
    angle, felt = state.recording.posture[:, 5], state.torque[:, 5]
    softer = a * np.cos(angle) + b * np.sin(angle)
    mean = float(np.average(softer, weights=felt**2))
    law = truth.BY_NAME[wave[0]]
    found = law.mean_softening(state, "a6", np.ones(1), np.array([a, b]))
    assert found == {5: pytest.approx(mean)}
    left = felt * (1.0 + (softer - mean) / state.compliance[5])
    assert_allclose(named.spring_torque(5), left, atol=1e-9)
    torque = state.torque.copy()
    torque[:, 5] = left
    want = column(replace(state, torque=torque), "hysteresis", "a6", shape)
    assert_allclose(column(named, "hysteresis", "a6", shape), want, atol=1e-9)
    named = alone(state, ("wrist_coupling", "a6", [4.0], [5e-6]), loop)
    more = 5e-6 * state.torque[:, 3] / state.compliance[5]
    assert_allclose(named.spring_torque(5), state.torque[:, 5] + more, atol=1e-9)


@pytest.mark.parametrize("half", [-0.1, 0.1])
def test_asymmetry_winds_other_laws_up_by_the_slope_of_its_side(half):
    """By 1 on the softer side, by (C - |a|)/(C + |a|) on the other."""
    state = truth.situation()
    mean = state.compliance[1]
    named = alone(state, ("asymmetric_stiffness", "a2", [0.1], [half * mean]))
    assert named.unloaded_compliance(1) == pytest.approx(1.1 * mean)
    assert named.unloaded_compliance(1, "asymmetric_stiffness") == mean
    torque = state.torque[:, 1]
    clear = np.abs(torque) > 0.05 * np.abs(torque).max()
    stiffer = clear & (np.sign(torque) != np.sign(half))
    softer = clear & ~stiffer
    assert stiffer.any()
    assert softer.any()
    slope = named.softness_of(1)
    assert_allclose(slope[softer], 1.0, atol=1e-3)
    assert_allclose(slope[stiffer], 0.9 / 1.1, atol=1e-3)
    wound = named.wound(1, torque)
    assert_allclose(wound[softer], torque[softer], rtol=2e-2)
    assert_allclose(wound[stiffer], torque[stiffer] * 0.9 / 1.1, rtol=2e-2)
    some = np.flatnonzero(stiffer)[:5]
    part = named.some(some)
    assert_array_equal(part.softness_of(1), slope[some])
    assert_array_equal(part.spring_torque(1), named.spring_torque(1)[some])
