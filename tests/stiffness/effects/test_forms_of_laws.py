"""A law comes back under its name, whatever form it has and whatever it leaves."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import FEW, MECHANICS, arm, moved_by, prepared, recording

from bench.shared.recording import Recording
from scenarios.pipelines.patching import patch_of_diagnosis
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.gate import gate_terms, pose_statistics
from stiffness.diagnosis.model_evaluation import (
    ModelEvaluation,
    _covariance_of_forms,
    _covariance_of_the_unknown,
    evaluate_model,
    shift_by_forms,
)
from stiffness.diagnosis.model_fit import ModelTerm, fit_shapes
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.result import Name
from stiffness.effects.angle_dependent_stiffness import AngleDependentStiffness
from stiffness.effects.askew_base import AskewBase
from stiffness.effects.askew_tilt import AskewTilt
from stiffness.effects.asymmetric_stiffness import AsymmetricStiffness
from stiffness.effects.base_compliance import BaseCompliance
from stiffness.effects.base_tilt import BaseTilt
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.creep import Creep
from stiffness.effects.drift import HOUR, Drift, wander, warmed
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.hardening import Hardening
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.jacobian import EffectJacobian, hstack, rotate, turn, values
from stiffness.effects.link_bending import LinkBending
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.marker_slip import MarkerSlip
from stiffness.effects.mass_scale import MassScale
from stiffness.effects.stretched_spring import StretchedSpring
from stiffness.effects.transmission_error import TransmissionError
from stiffness.effects.wrench_gain import WrenchGain
from stiffness.effects.wrench_misalignment import WrenchMisalignment
from stiffness.regression.splits import Split

GEAR = (Hardening(), LostMotion(), Hysteresis(), Creep())


def with_turn(axis: int, angle: np.ndarray) -> Recording:
    """Let an axis turn beyond what the arm does, by an angle in each row."""
    return moved_by(turn(axis, angle), np.ones(1))


def with_law(axis: int, law: Callable[[np.ndarray], np.ndarray]) -> Recording:
    """Add a turn of an axis, a law of its torque along each visit, (visits, steps)."""
    situation = prepared().situation
    path = situation.torque[situation.steps, axis]
    return with_turn(axis, situation.from_steps(law(path)))


def test_gear_that_errs_with_two_harmonics_of_its_turn_is_named_as_one():
    """Two and five periods a turn; one law alone would leave the other at its place."""
    q = recording().posture[:, 1]
    error = 2e-4 * np.sin(2.0 * q + 0.4) + 1.5e-4 * np.sin(5.0 * q - 1.0)
    found = diagnose(with_turn(1, error), arm(), (*FEW, TransmissionError()))
    assert found.verdict == "explained"
    (named,) = found.named
    assert (named.name.effect, named.name.where) == ("transmission_error", "a2")


def test_spring_that_varies_with_the_cube_of_a_sine_is_named():
    """Two and six periods a turn, for 4 sin³ x = 3 sin x - sin 3x."""
    q, torque = recording().posture[:, 1], prepared().situation.torque[:, 1]
    wound = 6e-6 * torque * np.sin(2.0 * q) ** 3
    found = diagnose(with_turn(1, wound), arm(), (*FEW, AngleDependentStiffness()))
    assert found.verdict == "explained"
    (named,) = found.named
    assert (named.name.effect, named.name.where) == ("angle_dependent_stiffness", "a2")


def dahl(torque: np.ndarray) -> np.ndarray:
    """Return the lag of a Dahl contact at rest at each visit's first reading."""
    state, lag = np.zeros(len(torque)), [np.zeros(len(torque))]
    for step in range(1, torque.shape[1]):
        change = torque[:, step] - torque[:, step - 1]
        side = np.sign(change)
        state = side + (state - side) * np.exp(-np.abs(change) / 15.0)
        lag.append(state)
    return -1e-4 * np.stack(lag, axis=1)


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (dahl, "hysteresis"),
        (lambda torque: 3e-4 * np.tanh(torque / 35.0), "hardening"),
        (lambda torque: 1e-4 * np.tanh(torque / 1.0), "lost_motion"),
    ],
    ids=["Dahl's contact", "a hyperbolic tangent", "a smooth dead zone"],
)
def test_law_of_another_form_comes_back_under_the_same_name(law, name):
    found = diagnose(with_law(1, law), arm(), GEAR)
    assert [(e.name.effect, e.name.where) for e in found.named] == [(name, "a2")]
    assert found.verdict == "explained"


@pytest.mark.parametrize("rounding", [0.016, 0.1, 0.3])
def test_asymmetry_that_turns_over_gradually_costs_no_name_of_the_arm(rounding):
    """Whatever the width over which a spring's slope changes from side to side."""
    others = {"hysteresis@a3": "width_rad=1e-4", "bearing_tilt@a4": "", "creep@a2": ""}
    effects = [f"{name},{size}".strip(",") for name, size in others.items()]
    situation = prepared(*effects).situation
    torque, compliance = situation.torque[:, 1], situation.compliance[1]
    width = rounding * np.abs(torque).max()
    even = 0.2 * compliance * torque * np.tanh(torque / width)
    seen = moved_by(turn(1, even), np.ones(1), *effects)
    library = (*GEAR, BearingTilt(), AsymmetricStiffness())
    found = diagnose(seen, arm(), library)
    named = {f"{e.name.effect}@{e.name.where}" for e in found.named}
    assert named == {"asymmetric_stiffness@a2", *others}


@pytest.mark.parametrize(("middle", "second"), [(0.6, 3.1), (0.81, 3.72), (1.0, 3.5)])
def test_interval_of_a_hardening_holds_for_all_gears_of_the_table(middle, second):
    """Torques end below T2: whether K2 is K3 is a matter of the gear."""
    gear = f"stiffness_ratio=1.7,torque_nm=60,middle_share={middle}"
    seen = recording(f"hardening@a2,{gear},second_torque={second}", poses=20)
    (found,) = diagnose(seen, arm(), (Hardening(),)).named
    ratio = found.parameters["stiffness_ratio"]
    assert 1.0 < ratio.low < 1.7 < ratio.high


def test_mass_of_some_kilograms_is_sized_with_the_springs_that_it_leaves():
    found = diagnose(
        recording("gravity_load@link_3,mass_kg=6,com_x_m=0.2"),
        arm(),
        (*FEW, GravityLoad()),
    )
    [one] = found.named
    assert (one.name.effect, one.name.where) == ("gravity_load", "link_3")
    mass = one.parameters["mass_kg"]
    half = 0.5 * (mass.high - mass.low)
    assert abs(mass.estimate - 6.0) < 2.0 * half < 0.6


def test_masses_wrong_by_one_factor_are_one_name():
    """Though some added masses, link by link, would do the same."""
    library = (*FEW, GravityLoad(), MassScale())
    found = diagnose(recording("mass_scale@arm,ratio=1.3"), arm(), library)
    [one] = found.named
    assert (one.name.effect, one.name.where) == ("mass_scale", "arm")
    ratio = one.parameters["ratio"]
    assert ratio.low - 0.02 < 1.3 < ratio.high + 0.02
    assert ratio.high - ratio.low < 0.1


def test_base_whose_springs_stand_askew_is_a_base_that_gives_way():
    """Soft about one level direction between x and y, hard about the other."""
    moment = prepared().situation.moment[:, 0]
    soft = np.array([0.6, 0.8, 0.0])
    rotation = 6e-7 * soft * (moment @ soft)[:, None]
    tip = rotate(0, rotation[:, :, None], np.zeros_like(moment))
    names = (*FEW, BaseTilt(), BaseCompliance())
    found = diagnose(moved_by(EffectJacobian(1, (tip,)), np.ones(1)), arm(), names)
    assert [e.name.effect for e in found.named] == ["base_compliance"]
    assert found.verdict == "explained"


@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("bearing_tilt@a2", {"u": 2e-6, "v": 1.5e-6, "uv": 1.2e-6}),
        ("base_compliance@base", {"rx": 6e-7, "ry": 4e-7, "rxy": -4e-7}),
    ],
)
def test_tilt_that_is_softest_between_two_axes_has_one_name_and_all_sizes(name, sizes):
    """And the patch has its direction."""
    true = {f"{part}_rad_per_nm": size for part, size in sizes.items()}
    seen = recording(",".join([name, *(f"{k}={v}" for k, v in true.items())]))
    tilts = (BearingTilt(), AskewTilt(), BaseTilt(), BaseCompliance(), AskewBase())
    found = diagnose(seen, arm(), (*GEAR, LinkBending(), *tilts))
    [one] = found.named
    assert f"{one.name.effect}@{one.name.where}" == name
    assert found.verdict == "explained"
    for parameter, size in true.items():
        held = one.parameters[parameter]
        half = 0.5 * (held.high - held.low)
        assert abs(held.estimate - size) < 2.0 * half < 0.3 * abs(size)
    [entry] = patch_of_diagnosis(found, seen, arm()).effects
    assert entry.parameters == {n: p.estimate for n, p in one.parameters.items()}


@pytest.mark.parametrize(
    ("where", "ratio", "knee"), [("a2", 0.3, 60.0), ("a4", 0.0, 4.0)]
)
def test_bearing_that_grows_stiffer_has_one_name_and_all_sizes(where, ratio, knee):
    """And the patch holds them; linear tilts left it to hardening gears nearby."""
    true = {"u_rad_per_nm": 8e-6, "v_rad_per_nm": 6e-6}
    true |= {"compliance_ratio": ratio, "moment_nm": knee}
    made = recording(
        ",".join([f"bearing_tilt@{where}", *(f"{k}={v}" for k, v in true.items())])
    )
    found = diagnose(made, arm(), MECHANICS)
    [one] = found.named
    assert one.name == Name("bearing_tilt", where)
    assert found.verdict == "explained"
    for parameter, size in true.items():
        held = one.parameters[parameter]
        about = 0.05 if parameter == "compliance_ratio" else 0.1 * size
        assert abs(held.estimate - size) < about
    [entry] = patch_of_diagnosis(found, made, arm()).effects
    assert entry.parameters == {n: p.estimate for n, p in one.parameters.items()}


@pytest.mark.parametrize(("axis", "share"), [("a2", 0.04), ("a3", 0.05), ("a4", 0.06)])
def test_gear_whose_knee_lies_low_is_no_play(axis, share):
    """Gravity winds it up by twenty times T1; r and m of a gear of size 32."""
    here, k = prepared().situation, prepared().situation.axis(axis)
    torque = here.torque[:, k]
    knee = share * float(np.abs(torque).max())
    first, second = (np.clip(torque, -x, x) for x in (knee, 3.72 * knee))
    turned = 0.8 * here.compliance[k] * (0.81 * first + 0.19 * second)
    laws = (*GEAR, Hysteresis(), BearingTilt())
    found = diagnose(moved_by(turn(k, turned), np.ones(1)), arm(), laws)
    [one] = found.named
    assert one.name == Name("hardening", axis)
    assert found.verdict == "explained"
    assert one.parameters["torque_nm"].estimate == pytest.approx(knee, rel=0.2)


@pytest.mark.parametrize("ratio", [0.3, 3.0])
def test_link_that_bends_more_one_way_has_one_name_and_all_sizes(ratio):
    """And the patch holds them; an equal section left the rest to a bearing nearby."""
    true = {"bending_nm2": 2e5, "torsion_nm2": 2e5, "bending_ratio": ratio}
    sizes = ",".join(f"{k}={v}" for k, v in true.items())
    made = recording(f"link_bending@link_2,{sizes}")
    found = diagnose(made, arm(), MECHANICS)
    [one] = found.named
    assert one.name == Name("link_bending", "link_2")
    assert found.verdict == "explained"
    for parameter, size in true.items():
        held = one.parameters[parameter]
        assert held.low - 0.05 * size < size < held.high + 0.05 * size
        assert held.high - held.low < 0.4 * size
    [entry] = patch_of_diagnosis(found, made, arm()).effects
    assert entry.parameters == {n: p.estimate for n, p in one.parameters.items()}


@pytest.mark.parametrize("axis", [3, 4])
def test_bearing_whose_rollers_carry_the_whole_moment_takes_no_other_name(axis):
    """A play in any direction across the axis, taken up smoothly."""
    here, place = prepared().situation, axis + 1
    across = here.seat[:, place, :, :2]
    about = np.einsum("rij,ri->rj", across, here.moment[:, place])
    whole = np.linalg.norm(about, axis=1, keepdims=True)
    tilt = 2e-4 * about / np.maximum(whole, 1e-9) * np.tanh(whole / 3.0)
    turned = np.einsum("rij,rj->ri", across, tilt)[:, :, None]
    law = EffectJacobian(1, (rotate(place, turned, here.origin[:, place]),))
    found = diagnose(moved_by(law, np.ones(1)), arm(), MECHANICS)
    assert [e.name for e in found.named] == [Name("bearing_tilt", f"a{axis + 1}")]


@pytest.mark.parametrize(("height", "aside"), [(-0.3, 0.0), (0.1, 0.05)])
def test_foot_that_turns_about_a_point_off_its_plate_has_its_size(height, aside):
    """Nothing else is named, though a bearing above it could tilt as well."""
    situation, point = prepared().situation, np.array([aside, -aside, height])
    moment = situation.moment[:, 0] - np.cross(point, situation.force[:, 0])
    rotation = (moment * np.array([6e-7, 5e-7, 2e-7]))[:, :, None]
    tip = rotate(0, rotation, np.broadcast_to(point, moment.shape))
    made = moved_by(EffectJacobian(1, (tip,)), np.ones(1))
    found = diagnose(made, arm(), (*FEW, BaseTilt(), BaseCompliance()))
    [one] = found.named
    assert one.name.effect == "base_compliance"
    for name, true in (("rx_rad_per_nm", 6e-7), ("ry_rad_per_nm", 5e-7)):
        assert one.parameters[name].low < true < one.parameters[name].high
    [entry] = patch_of_diagnosis(found, made, arm()).effects
    assert entry.settings["centre_m"] == pytest.approx(height, abs=0.1)


def test_wrench_about_another_point_is_a_sensor_beside_its_place():
    beside = "wrench_misalignment@wrench_sensor,x_m=0.03,z_m=-0.01"
    names = (*FEW, WrenchGain(), WrenchMisalignment())
    found = diagnose(recording(beside), arm(), names)
    [one] = found.named
    assert (one.name.effect, found.verdict) == ("wrench_misalignment", "explained")
    true = {"x_m": 0.03, "y_m": 0.0, "z_m": -0.01}
    assert one.parameters.keys() == true.keys()
    for name, size in one.parameters.items():
        assert size.low < true[name] < size.high
        assert size.high - size.low < 0.01


# --- Sizes of other forms -------------------------------------------------------------


@pytest.mark.parametrize(
    ("law", "shape"),
    [
        (LostMotion(), [1e-3]),  # closed at every torque
        (Hysteresis(), [1e-3, 0.0]),  # slipped at every reading
        (Hardening(), [1e5, 0.0]),  # below its knee at every torque
        (Creep(), [1e-3, 0.0]),  # at rest at every reading
    ],
    ids=lambda case: getattr(case, "effect", ""),
)
def test_form_of_a_law_adds_its_size_to_the_laws_coefficient(law, shape):
    """Where all forms are alike, a unit of one is that much of the law itself."""
    situation, shape = prepared().situation, np.array(shape)
    (own,) = law.jacobian(situation, "a2", shape).parts
    (forms,) = law.variants(situation, "a2", shape).parts
    want = law.size_of_variants * values(own)
    near = np.abs(values(forms) - want) < 0.05 * np.abs(want).max()
    assert near.mean(axis=0).min() > 0.6  # the first of a visit tell forms apart


@pytest.fixture(scope="module")
def gear() -> tuple[ModelEvaluation, Split]:
    """A gear that hardens and plays, as twenty poses have it."""
    hardens = "hardening@a2,stiffness_ratio=1.7,torque_nm=60"
    ready = prepared(hardens, "lost_motion@a2,width_rad=3e-4")
    laws = (Hardening(), LostMotion())
    case = build_problem(ready, laws)
    shapes = [law.shapes(case.situation, "a2")[2] for law in laws]
    terms = [ModelTerm(law, "a2", s) for law, s in zip(laws, shapes, strict=True)]
    own = fit_shapes(case, terms)
    look = evaluate_model(case, own)
    return look, case.split


def test_other_forms_that_explain_nothing_do_not_move_a_fit(gear):
    """Readings that are what was fitted leave them no variance beyond noise."""
    look, split = gear
    gram, known = look.slopes.gram[1], np.arange(look.known)
    fitted = np.concatenate([look.fit.springs, *look.fit.coefficients])
    fitted = np.pad(fitted, (0, len(gram) - len(fitted)))
    score = np.zeros_like(look.slopes.score)
    score[np.argmin(split.held_out)] = gram @ fitted
    exact = replace(look, slopes=replace(look.slopes, score=score))
    moved = shift_by_forms(exact, split) - fitted[known]
    told = known[np.diag(gram)[known] > 0.0]  # a form has nothing in between
    sigma = np.sqrt(np.diag(np.linalg.inv(gram[np.ix_(told, told)])))
    assert np.abs(moved[told] / sigma).max() < 0.01


def test_other_forms_widen_a_size_though_readings_show_none_of_them(gear):
    """A law that is another by a twentieth of it may have another size by as much."""
    look, _ = gear
    at = len(look.fit.springs) + sum(map(len, look.fit.coefficients[:-1]))
    width = float(look.fit.coefficients[-1][0])
    more = float(_covariance_of_forms(look)[at, at]) ** 0.5
    assert 0.002 * abs(width) < more < 0.1 * abs(width)


@pytest.mark.parametrize("more", [_covariance_of_forms, _covariance_of_the_unknown])
def test_forms_and_constants_of_a_law_without_a_size_widen_nothing(gear, more):
    look, _ = gear
    none = tuple(0.0 * c for c in look.fit.coefficients)
    nothing = replace(look, fit=replace(look.fit, coefficients=none))
    gram = look.slopes.gram[1][: look.known, : look.known]
    told = np.flatnonzero(np.diag(gram) > 0.0)
    own = np.linalg.inv(gram[np.ix_(told, told)])
    assert_allclose(np.diag(more(nothing))[told] / np.diag(own), 0.0, atol=1e-6)


def test_gear_that_errs_in_several_orders_has_one_name_and_all_waves_in_the_patch():
    """A Fourier series is one law: what one wave leaves is no offset and no spring."""
    sizes = {2.0: (1e-4, 0.0), 4.0: (4e-5, 0.0), 6.0: (2e-5, 1.0)}
    errors = tuple(
        f"transmission_error@a3,amplitude_rad={a},order={n},phase_rad={phase}"
        for n, (a, phase) in sizes.items()
    )
    made = recording("hysteresis@a2", *errors, poses=60)
    laws = (*FEW, TransmissionError(), GravityCompensator(), MassScale())
    found = diagnose(made, arm(), laws)
    assert {(e.name.effect, e.name.where) for e in found.named} == {
        ("hysteresis", "a2"),
        ("transmission_error", "a3"),
    }
    amplitude = found["transmission_error", "a3"].parameters["amplitude_rad"]
    assert amplitude.low <= sizes[2.0][0] <= amplitude.high
    patch = patch_of_diagnosis(found, made, arm())
    waves = [e for e in patch.effects if e.effect == "transmission_error"]
    assert len(waves) > 1
    angle = made.posture[:, 2]
    names = ("amplitude_rad", "order", "phase_rad")
    table = np.array([[e.parameters[name] for name in names] for e in waves], float)
    seen = [a * np.sin(n * angle + phase) for a, n, phase in table]
    true = [a * np.sin(n * angle + phase) for n, (a, phase) in sizes.items()]
    left = np.sum(seen, axis=0) - np.sum(true, axis=0)  # but for a_3's zero
    assert np.std(left) < 0.2 * np.std(np.sum(true, axis=0))


def test_spring_with_free_length_is_a_compensator_and_no_wave_of_its_gear():
    """A crank's torque is far from a sine; an encoder's offset takes its mean."""
    size = {"torque_nm": 120.0, "phase_rad": -2.4}
    size |= {"free_length_ratio": 0.7, "arm_ratio": 0.3}
    stated = ",".join(f"{name}={value}" for name, value in size.items())
    spring = f"gravity_compensator@a2,{stated}"
    made = recording(spring, "encoder_offset@a2,offset_rad=1e-3", poses=60)
    laws = (*FEW, TransmissionError(), GravityCompensator(), StretchedSpring())
    found = diagnose(made, arm(), laws)
    assert {(e.name.effect, e.name.where) for e in found.named} == {
        ("gravity_compensator", "a2"),
        ("encoder_offset", "a2"),
    }
    told = found["gravity_compensator", "a2"].parameters
    assert told.keys() == size.keys()
    assert all(told[name].low <= true <= told[name].high for name, true in size.items())
    patch = patch_of_diagnosis(found, made, arm())
    (pull,) = (e for e in patch.effects if e.effect == "gravity_compensator")
    assert pull.parameters.keys() == size.keys()


def test_room_that_settles_ever_more_slowly_is_one_drift_with_its_course_in_the_patch():
    """A stretched exponential: parts of a tracker warm up one after another."""
    seen = prepared().situation
    course = 1.0 - np.exp(-((seen.recording.time / 4e3) ** 0.6))
    moved = wander(seen, "base", course)
    size = np.array([1e-4, -5e-5, 3e-5, 5e-5, 2e-5, -3e-5])
    made = moved_by(moved, size)
    found = diagnose(made, arm(), (*FEW, Drift(), MarkerSlip()))
    assert found.verdict == "explained"
    assert [e.name.effect for e in found.named] == ["drift"]
    parts = [e.parameters for e in patch_of_diagnosis(found, made, arm()).effects]
    assert len(parts) > 1
    table = np.array([[one["x_m_per_h"], one["time_s"]] for one in parts], float)
    along = sum(speed / HOUR * warmed(seen, t) for speed, t in table)
    left = along - 1e-4 * course
    assert np.std(left) < 0.1 * np.std(1e-4 * course)


def test_spring_that_varies_in_two_orders_has_one_name_and_both_waves_in_the_patch():
    sizes = {2.0: (0.1, 0.0), 5.0: (0.06, 1.0)}
    waves = tuple(
        f"angle_dependent_stiffness@a2,ratio={r},order={n},phase_rad={phase}"
        for n, (r, phase) in sizes.items()
    )
    made = recording("hysteresis@a3", *waves, poses=60)
    found = diagnose(made, arm(), (*FEW, AngleDependentStiffness(), MassScale()))
    assert {(e.name.effect, e.name.where) for e in found.named} == {
        ("hysteresis", "a3"),
        ("angle_dependent_stiffness", "a2"),
    }
    patch = patch_of_diagnosis(found, made, arm())
    told = [e.parameters for e in patch.effects if e.where == "a2"]
    names = ("ratio", "order", "phase_rad")
    table = np.array([[one[name] for name in names] for one in told], float)
    angle = made.posture[:, 1]
    seen = np.sum([r * np.cos(n * angle + phase) for r, n, phase in table], axis=0)
    true = [r * np.cos(n * angle + phase) for n, (r, phase) in sizes.items()]
    assert len(table) > 1
    assert np.std(seen - np.sum(true, axis=0)) < 0.2 * np.std(np.sum(true, axis=0))


@pytest.mark.parametrize(
    "weak",
    [
        ModelTerm(BearingTilt(), "a5", np.zeros(1)),
        ModelTerm(LinkBending(), "link_4", np.zeros(1)),
    ],
)
def test_what_a_strong_tilt_s_other_form_does_has_no_name_beside_it(weak):
    """A bearing that tilts askew of the moment is one bearing, and no other bends."""
    tilt = ModelTerm(BearingTilt(), "a4", np.zeros(1))
    here, at = prepared().situation, ("a4", np.zeros(1))
    law = [tilt.hypothesis.jacobian(here, *at), tilt.hypothesis.variants(here, *at)]
    askew = moved_by(hstack(law), np.array([1.6e-5, 1.2e-5, 4e-6]))
    case = build_problem(prepare(askew, arm()), FEW)
    gated, slight = gate_terms(pose_statistics(case, (tilt, weak)))
    assert gated.names == (tilt.name,)
    assert [(d.candidate, d.gate) for d in slight] == [(weak.name, "other_forms")]
