"""Springs, coefficients and shapes are fitted with the columns that they lay out."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import prepared

from stiffness.diagnosis.joint_fit import (
    Layout,
    OperatingPoint,
    _JointFit,
    nameless_columns,
    worth_of,
)
from stiffness.diagnosis.model_evaluation import evaluate_consistently, evaluate_model
from stiffness.diagnosis.model_fit import (
    FeltByOthers,
    ModelTerm,
    SelectionProblem,
    fit_model,
    free_shapes,
)
from stiffness.diagnosis.relinearisation import (
    build_problem,
    laid_out_softer,
    nominal_problem,
    total_softening,
)
from stiffness.effects.angle_dependent_stiffness import AngleDependentStiffness
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.hardening import Hardening
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.jacobian import mixture, values
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.residual_map import GenericTerm

NONE = np.zeros(0)


def joint(ready, terms) -> tuple[_JointFit, np.ndarray]:
    """Return a set's joint fit, and where it starts."""
    case = nominal_problem(ready)
    fit = fit_model(case, terms)
    shapes = free_shapes(case.situation, fit.members)
    nameless = nameless_columns(fit, case.situation)
    found = _JointFit(ready, case.split, fit, shapes, nameless)
    return found, found.start(laid_out_softer(case, ready) + fit.springs)


def sets() -> list[tuple[ModelTerm, ...]]:
    """Sets whose laws make each other feel what they do."""
    hard = ModelTerm(Hardening(), "a2", np.array([30.0, 0.0]))
    loop = ModelTerm(Hysteresis(), "a2", np.array([20.0, 0.0]))
    wave = ModelTerm(AngleDependentStiffness(), "a2", np.array([2.0]))
    load = ModelTerm(GravityLoad(), "link_3", NONE)
    pull = ModelTerm(GravityCompensator(), "a2", NONE)
    nameless = ModelTerm(GenericTerm("generic_torque", "torque", "torque"), "a3", NONE)
    of_loads = [(hard, load), (hard, loop, pull, load), (load, nameless)]
    return [(hard, loop), (hard, wave), *of_loads]


def joined(terms) -> str:
    return "+".join(term.name[0] for term in terms)


@pytest.mark.parametrize("terms", sets(), ids=joined)
def test_slopes_hold_what_laws_change_of_each_other(terms):
    """The descent of the sum of squares is its difference quotient."""
    ready = prepared(
        "hardening@a2,stiffness_ratio=1.8,torque_nm=25",
        "hysteresis@a2,width_rad=2e-4",
        "gravity_load@link_3,mass_kg=1,com_x_m=0.1,com_y_m=0,com_z_m=0",
    )
    fit, x = joint(ready, terms)
    here = fit.linearise(x)
    assert np.isfinite(here.square)
    steps = 0.1 / np.sqrt(np.diag(here.gram))
    for j, step in enumerate(steps):
        ahead, back = x.copy(), x.copy()
        ahead[j] += step
        back[j] -= step
        change = fit.linearise(ahead).square - fit.linearise(back).square
        said = -4.0 * here.descent[j] * step
        assert change == pytest.approx(said, rel=0.05, abs=0.01 * np.sqrt(here.square))


def test_slope_of_a_soft_spring_has_the_lever_arms_of_where_the_arm_rests():
    """A generic term explains what is linear in the torque; the curvature remains."""
    ready = prepared("hysteresis@a2,width_rad=2e-4")
    nameless = ModelTerm(GenericTerm("generic_torque", "torque", "torque"), "a2", NONE)
    loop = ModelTerm(Hysteresis(), "a2", np.array([20.0, 0.0]))
    fit, x = joint(ready, (loop, nameless))
    soft = ready.springs.index(1)
    x[soft] += 4.0 * ready.situation.compliance[1]
    here = fit.linearise(x)
    step = 0.3 / np.sqrt(here.gram[soft, soft])
    ahead, back = x.copy(), x.copy()
    ahead[soft] += step
    back[soft] -= step
    change = fit.linearise(ahead).square - fit.linearise(back).square
    assert change == pytest.approx(-4.0 * here.descent[soft] * step, rel=0.05)


def test_a_gear_that_hardens_and_holds_wind_up_back_is_found_as_it_is():
    """Laid out in turn, each law is wrong by what it makes the other feel."""
    ready = prepared(
        "hardening@a2,stiffness_ratio=1.8,torque_nm=25",
        "hysteresis@a2,width_rad=1e-4",
    )
    some = (Hardening(), Hysteresis())
    case, layout = build_problem(ready, some), Layout(ready, some)
    hard = ModelTerm(some[0], "a2", np.array([40.0, 0.0]))
    loop = ModelTerm(some[1], "a2", np.array([20.0, 0.0]))
    first = fit_model(case, [hard, loop])
    point = layout.fitted_jointly(case, first)
    there = layout.at(point)
    law, coefficients = point.named.members[0], point.named.coefficients
    sizes = law.hypothesis.parameters(there.situation, "a2", law.shape, coefficients[0])
    assert sizes["torque_nm"] == pytest.approx(25.0, rel=0.1)
    assert sizes["stiffness_ratio"] == pytest.approx(1.8, rel=0.05)
    assert coefficients[1][0] == pytest.approx(1e-4, rel=0.1)


def test_a_load_and_a_play_that_move_each_other_settle():
    """Laid out where each was fitted, the load is wrong by as much each other time."""
    case, members = at_a_load_and_a_play()
    fit = evaluate_model(case, members).fit
    pull = members[0].hypothesis
    torque = pull.parameters(case.situation, "a1", NONE, fit.coefficients[0])
    assert torque["torque_nm"] == pytest.approx(45.0, rel=0.05)
    assert fit.coefficients[1][0] == pytest.approx(2e-4, rel=0.02)


@pytest.mark.parametrize("terms", sets()[:3:2], ids=joined)
def test_a_set_is_evaluated_as_it_was_fitted_with_its_columns(terms):
    """A linear fit there stays there: its columns hold what laws change of others."""
    ready = prepared(
        "hardening@a2,stiffness_ratio=1.8,torque_nm=25",
        "hysteresis@a2,width_rad=2e-4",
        "gravity_load@link_3,mass_kg=1,com_x_m=0.1,com_y_m=0,com_z_m=0",
    )
    layout, case = Layout(ready, ()), nominal_problem(ready)
    point = layout.fitted_jointly(case, fit_model(case, terms))
    look = evaluate_model(layout.at(point), point.named.members)
    at = len(look.fit.springs)
    known = at + sum(map(len, look.fit.coefficients))
    gram = look.slopes.gram[1][: look.known, : look.known]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    inverse = np.linalg.pinv(gram * scale * scale[:, None], hermitian=True)
    errors = (scale * np.sqrt(np.diag(inverse)))[:known]
    assert np.all(np.abs(look.fit.springs) < errors[:at])
    for old, new in zip(point.named.coefficients, look.fit.coefficients, strict=True):
        assert np.all(np.abs(new - old) < errors[at : at + len(old)])
        at += len(old)


def at_a_load_and_a_play() -> tuple[SelectionProblem, tuple[ModelTerm, ...]]:
    """Return columns laid out under a load that closes a play, and the two."""
    some = (GravityCompensator(), LostMotion())
    ready = prepared(
        "gravity_compensator@a1,torque_nm=45,phase_rad=0.9",
        "lost_motion@a1,width_rad=2e-4",
    )
    case = build_problem(ready, some)
    load = ModelTerm(some[0], "a1", NONE)
    play = ModelTerm(some[1], "a1", np.array([8.0]))
    layout = Layout(ready, some)
    point = layout.fitted_jointly(case, fit_model(case, [load, play]))
    return layout.at(point), point.named.members


def test_a_law_that_has_gone_leaves_nothing_that_others_felt_of_it():
    case, (load, play) = at_a_load_and_a_play()
    assert case.felt is not None
    own = {name: law for name, law in case.felt.laws.items() if name == play.name}
    without = replace(case, felt=replace(case.felt, laws=own))
    found, asked = (evaluate_model(c, [play]).fit for c in (case, without))
    assert_allclose(found.coefficients[0], asked.coefficients[0], rtol=1e-12)
    assert_allclose(found.springs, asked.springs, rtol=1e-12)
    square = values(case.felt.total({load.name}).parts[0])
    assert np.sqrt(np.mean(square**2)) > 1e-6  # what would stay is no little


def test_what_laws_feel_is_left_out_where_poses_contradict_it():
    """A play that closes is linear over little: its slope is no slope further on."""
    case, members = at_a_load_and_a_play()
    assert case.felt is not None
    laws = {n: mixture(x, 9.0 * np.eye(x.columns)) for n, x in case.felt.laws.items()}
    wrong = replace(case, felt=replace(case.felt, laws=laws))
    bare = evaluate_model(replace(case, felt=None), members)
    for asked, want in ((case, evaluate_model(case, members)), (wrong, bare)):
        found = evaluate_consistently(asked, members, ()).fit
        for one, other in zip(found.coefficients, want.fit.coefficients, strict=True):
            assert_allclose(one, other, rtol=1e-12)


def test_a_point_holds_what_the_set_alone_lays_out():
    """What acted on the columns before and is not in the set acts no more."""
    some = (GravityCompensator(),)
    ready = prepared("gravity_compensator@a1,torque_nm=40,phase_rad=0.5")
    bare, layout = build_problem(ready, some), Layout(ready, some)
    acted = fit_model(bare, [ModelTerm(some[0], "a1", NONE)])
    softer, nothing = total_softening(bare, ready, acted), fit_model(bare, [])
    under = build_problem(ready, some, softer, acted)
    assert np.ptp(under.situation.torque - bare.situation.torque) > 1.0
    point = layout.fitted_jointly(under, nothing)
    found = layout.at(point).situation
    assert_allclose(found.torque, bare.situation.torque, atol=0.1)


def test_a_set_that_leaves_as_much_with_more_parameters_is_worth_less():
    ready = prepared("hysteresis@a2,width_rad=3e-4")
    case = nominal_problem(ready)
    loop = ModelTerm(Hysteresis(), "a2", np.array([20.0, 0.0]))
    one, none = fit_model(case, [loop]), fit_model(case, [])
    nothing = FeltByOthers((), {}, {}, {})
    point = OperatingPoint(np.zeros(6), one, nothing, one, 10.0)
    assert point.worth(100) == pytest.approx(-5.0 - 1.5 * np.log(100.0))
    assert worth_of(none, 10.0, 100) == pytest.approx(-5.0)
