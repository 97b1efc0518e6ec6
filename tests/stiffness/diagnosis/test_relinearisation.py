"""What is named changes what all else feels, and is laid out so."""

from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_bench import FEW, arm, nameless, prepared, recording, select_model

from bench.effects.hardening import Hardening as HardeningGear
from bench.effects.wrench_bias import WrenchBias
from bench.effects.wrench_gain import WrenchGain
from bench.effects.wrench_misalignment import WrenchMisalignment
from bench.experiment import observed, record
from bench.instruments import Instruments, Markers, Tracker
from bench.rig import Rig
from bench.shared.plan import parse_path
from bench.shared.recording import Payload
from bench.standard_plans import tour
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.joint_fit import Layout
from stiffness.diagnosis.model_fit import ModelFit, ModelTerm, fit_model
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import (
    beyond_linear,
    build_problem,
    curvature,
    linearised,
    prepared_about,
    total_softening,
)
from stiffness.diagnosis.sufficient_statistics import (
    normal_equations_of,
)
from stiffness.effects.angle_dependent_stiffness import AngleDependentStiffness
from stiffness.effects.base import Hypothesis
from stiffness.effects.base_compliance import BaseCompliance
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.geometry_error import GeometryError
from stiffness.effects.gravity_load import GravityLoad, seen
from stiffness.effects.hardening import Hardening
from stiffness.effects.jacobian import (
    EffectJacobian,
    JointRotation,
    MarkerDisplacement,
    mixture,
)
from stiffness.effects.statics import given_way
from stiffness.effects.wrench_misalignment import WrenchMisalignment as TurnedOrBeside
from stiffness.effects.wrist_coupling import WristCoupling
from stiffness.experiment.residuals import expected
from stiffness.experiment.static_state import StaticState, moved_to
from stiffness.robot.arm import Arm
from stiffness.robot.chain import link_axes
from stiffness.robot.wrench import turned as wrench_along

NONE = np.zeros(0)
MASS, CENTRE = 3.0, np.array([0.02, -0.03, 0.05])


def carrying(mass: float) -> StaticState:
    tool = Payload(mass, CENTRE)
    return truth.situation_in(replace(truth.recording(), tool=tool, wrench=None))


@pytest.mark.parametrize("felt", ["force", "moment", "torque"])
def test_mass_that_was_named_is_felt_as_one_that_was_known(felt):
    """But for where the arm comes to rest under it, a thousandth of a radian."""
    nothing, known = carrying(0.0), carrying(MASS)
    size = np.array([MASS, *(MASS * CENTRE)])
    named = truth.BY_NAME["gravity_load"].acting(nothing, "tool", NONE, size)
    want = getattr(known, felt) - getattr(nothing, felt)
    found = getattr(named, felt) - getattr(nothing, felt)
    assert np.abs(want).max() > 1.0
    assert_allclose(found, want, atol=2e-3 * np.abs(want).max())


def test_mass_on_a_link_is_felt_by_what_carries_the_link_alone():
    """The weight at the base, whatever carries it; nothing at the axes beyond."""
    nothing = truth.situation()
    size = np.array([MASS, 0.0, 0.0, 0.0])
    hypothesis = truth.BY_NAME["gravity_load"]
    shown = seen(nothing, "link_3")
    named = hypothesis.acting(nothing, "link_3", NONE, size[shown])
    more = named.force - nothing.force
    assert_allclose(more[:, :4], np.broadcast_to([0.0, 0.0, -9.81 * MASS], (90, 4, 3)))
    assert_array_equal(more[:, 4:], 0.0)
    axes = named.frame[:, 1:, :, 2]
    own = np.einsum("rai,rai->ra", axes, named.moment[:, 1:] - nothing.moment[:, 1:])
    assert_allclose(named.torque - nothing.torque, own, atol=1e-9)


def turned(by: EffectJacobian) -> np.ndarray:
    """Return the first law by which an axis turns, row by row."""
    (part,) = by.parts
    assert isinstance(part, JointRotation)
    return part.law[:, 0]


@pytest.mark.parametrize("form", [0.0, 1.0], ids=["pieces", "smooth"])
def test_hardening_that_was_named_narrows_the_loop_by_the_slope_of_its_law(form):
    """A loop of friction turns an axis by the slope of its spring where it stands."""
    situation, law = truth.showing("hardening"), truth.BY_NAME["hardening"]
    knee, extra = np.array([4.0, form]), np.array([0.5 * situation.compliance[1]])
    named = law.acting(situation, "a2", knee, extra)
    assert_array_equal(named.torque, situation.torque)
    step = 1e-4
    softer = situation.torque + step

    def wound(torque: np.ndarray) -> np.ndarray:
        moved = law.jacobian(replace(situation, torque=torque), "a2", knee)
        return situation.compliance[1] * torque[:, 1] + extra * turned(moved)

    slope = (wound(softer) - wound(situation.torque)) / step
    want = slope / (1.5 * situation.compliance[1])
    assert_allclose(named.softness_of(1), want, rtol=1e-3)
    assert_array_equal(named.softness_of(0), 1.0)
    as_wound = situation.torque.copy()
    as_wound[:, 1] = wound(situation.torque) / (1.5 * situation.compliance[1])
    assert_allclose(named.wound(1, situation.torque[:, 1]), as_wound[:, 1], rtol=1e-9)
    linear, shape = replace(situation, torque=as_wound), np.array([3.0, 0.0])
    loop = truth.BY_NAME["hysteresis"]
    before, after = (turned(loop.jacobian(s, "a2", shape)) for s in (linear, named))
    assert_allclose(after, before * want, rtol=1e-3, atol=1e-12)


def test_an_added_load_gives_way_by_the_slope_of_springs_where_they_stand():
    """Of a coupling of two gears that harden; from no torque on it would be 1."""
    situation, law = truth.situation(), truth.BY_NAME["hardening"]
    for k, axis in ((3, "a4"), (5, "a6")):
        extra = np.array([0.8 * situation.compliance[k]])
        situation = law.acting(situation, axis, np.array([2.0, 0.0]), extra)

    def coupled(here: StaticState) -> tuple:
        return WristCoupling().jacobian(here, "a6", np.array([4.0])).parts

    def more(here: StaticState) -> StaticState:
        return replace(here, torque=here.torque + step * (np.arange(6) == 3))

    step = 1e-4
    moved = given_way(replace(situation, giving=(coupled,)), [more])
    far = moved.parts[0]
    assert isinstance(far, JointRotation)
    slopes = situation.softness_of(5) * situation.softness_of(3)
    assert slopes.min() < 0.5
    assert_allclose(far.law[:, 0], step * slopes, rtol=1e-3, atol=1e-9)


def test_ratios_beside_hardening_are_of_the_spring_at_no_torque():
    """Creep and waves of a gear's stiffness are shares of its first slope, K1."""
    situation, law = truth.showing("hardening"), truth.BY_NAME["hardening"]
    stiff = situation.compliance[1]
    named = law.acting(situation, "a2", np.array([4.0, 0.0]), np.array([0.5 * stiff]))
    assert named.unloaded_compliance(1) == pytest.approx(1.5 * stiff)
    assert named.unloaded_compliance(0) == situation.compliance[0]
    creep = truth.BY_NAME["creep"]
    size, shape = np.array([0.03 * 1.5 * stiff]), np.array([20.0, 0.0])
    assert creep.parameters(named, "a2", shape, size)["ratio"] == pytest.approx(0.03)


PULLING = {
    *("gravity_load", "mass_scale", "gravity_compensator"),
    *("wrench_bias", "wrench_gain", "wrench_misalignment"),
}
STIFFENING = {"hardening", "asymmetric_stiffness"}


@pytest.mark.parametrize("effect", sorted(set(truth.BY_NAME) - PULLING - STIFFENING))
def test_other_effects_change_what_no_other_feels(effect):
    situation, hypothesis = truth.showing(effect), truth.BY_NAME[effect]
    where = hypothesis.places(situation)[0]
    shape = truth.middle(situation, hypothesis, where)
    size = np.ones(hypothesis.jacobian(situation, where, shape).columns)
    assert hypothesis.acting(situation, where, shape, size) is situation


BIASED = WrenchBias("wrench_sensor", 5.0, -3.0, 4.0, 0.2, 0.3, -0.4)
SCALED = WrenchGain("wrench_sensor", 0.1, -0.05, 0.08, 0.03, 0.02, 0.01)
TURNED = WrenchMisalignment("wrench_sensor", 2e-3, -4e-3, 3e-3)
BESIDE = WrenchMisalignment("wrench_sensor", 0.0, 0.0, 0.0, 0.02, -0.03, 0.05)


@pytest.mark.parametrize(
    ("fault", "shape", "about"),
    [
        (BIASED, NONE, 0.02),
        (SCALED, NONE, 0.02),
        (TURNED, np.zeros(1), 0.02),
        (BESIDE, np.ones(1), 0.1),
    ],
    ids=["bias", "gain", "turn", "shift"],
)
@pytest.mark.parametrize("felt", ["moment", "torque", "load_torque"])
def test_wrench_that_was_read_wrongly_pulls_as_the_right_one(fault, shape, about, felt):
    """But for where the sensor is thought to be turned to: a shift turns the wrist."""
    right = truth.situation()
    wrong = truth.situation_in(truth.recording(fault))
    size = np.array([*fault.parameters().values()])
    if fault is SCALED:
        size = size / (1.0 + size)
    if isinstance(fault, WrenchMisalignment):
        size = size[3:] if shape[0] else size[:3]
    hypothesis = truth.BY_NAME[fault.name]
    mended = hypothesis.acting(wrong, "wrench_sensor", shape, size)
    off, left = (getattr(s, felt) - getattr(right, felt) for s in (wrong, mended))
    assert np.abs(left).max() < about * np.abs(off).max()


def test_mass_pulls_at_a_base_that_was_named_where_no_spring_shows_it():
    """Its centre's height turns no axis and tilts the base: no name for the rest."""
    seen = recording(
        "base_compliance@base,rx_rad_per_nm=1.5e-6,ry_rad_per_nm=2.2e-6",
        "gravity_load@link_3,mass_kg=6,com_x_m=0.15,com_z_m=-0.25",
        poses=24,
    )
    found = diagnose(seen, arm(), (GravityLoad(), BaseCompliance(), GeometryError()))
    assert {n.name.effect for n in found.named} == {"base_compliance", "gravity_load"}
    assert found.verdict == "explained"


def test_sensor_far_beside_its_place_is_sized_with_the_springs_it_feigned():
    seen = recording("wrench_misalignment@wrench_sensor,x_m=0.06,y_m=-0.02")
    [one] = diagnose(seen, arm(), (Hardening(), TurnedOrBeside())).named
    shift = one.parameters["x_m"]
    assert shift.low < 0.06 < shift.high < 0.063


def test_mass_and_what_gives_way_under_it_are_both_named():
    """What the one tilts of the other is in neither's own columns: 1 of 8 kg."""
    seen = recording(
        "bearing_tilt@a1,u_rad_per_nm=4e-6,v_rad_per_nm=2e-6",
        "gravity_load@link_3,mass_kg=8.0",
        poses=20,
    )
    found = diagnose(seen, arm(), (Hardening(), BearingTilt(), GravityLoad()))
    names = {(n.name.effect, n.name.where) for n in found.named}
    assert found.verdict == "explained"
    assert names == {("bearing_tilt", "a1"), ("gravity_load", "link_3")}
    mass = next(n for n in found.named if n.name.where == "link_3")
    size = mass.parameters["mass_kg"]
    assert size.low < 8.0 < size.high
    assert size.high - size.low < 1.0


def test_a_sensor_is_turned_as_the_named_effects_hold_it(kr10):
    """A soft axis that hardens: linear springs hold it 11 mrad off, and its sensor."""
    rig = Rig(kr10)
    soft = rig.nominal.jnt_stiffness * [0.3, 0.05, 0.1, 0.1, 0.1, 0.1]
    true = HardeningGear("a2", stiffness_ratio=3.0, torque_nm=29.0)
    rig = replace(rig, effects=(true,), stiffness=soft)
    plan = tour(rig, 16, parse_path("0,10,0"), 0, 0)
    states = rig.carry_out(plan, np.zeros_like(plan.posture))
    seen = observed(rig, plan, states, Instruments(markers=Markers()), 3)
    prepared = prepare(seen, Arm.from_mjcf(kr10).for_recording(seen))
    case = build_problem(prepared, [Hardening()])
    named = select_model(case, Layout(prepared, [Hardening()])).case.situation
    sensor = states.rotation[:, states.bodies.index("flange")]
    felt = wrench_along(states.wrench, sensor)
    before, after = (
        (np.abs(s.wrench - felt).max(), np.abs(s.rest - states.axis_angle).max())
        for s in (prepared.situation, named)
    )
    assert before[1] > 5e-3
    assert after[0] < before[0] / 3
    assert after[1] < before[1] / 3


def test_columns_may_be_laid_out_under_a_term_without_a_name_that_has_others_there():
    """How many waves of an angle are told apart depends on the torque."""
    ready = prepared("gravity_compensator@a1,torque_nm=40,phase_rad=0.5")
    case = build_problem(ready, ())
    fit = fit_model(case, [nameless(case, "angle", "a1")])
    fewer = replace(fit, coefficients=tuple(c[:-1] for c in fit.coefficients))
    one, other = (linearised(ready, case.split, None, f)[1] for f in (fit, fewer))
    assert_array_equal(one.rest, other.rest)


def test_waves_over_few_angles_leave_the_mean_of_a_spring_to_it():
    """A wave of a period over less than a radian holds most of the spring."""
    ready = prepared("angle_dependent_stiffness@a2,ratio=0.3,order=1,phase_rad=0.2")
    waves = AngleDependentStiffness()
    case = build_problem(ready, [waves])
    term = ModelTerm(waves, "a2", np.array([1.0]))
    fit = fit_model(case, [term])
    here, k = case.situation, case.springs.index(1)
    torque, angle = here.torque[:, 1], here.recording.posture[:, 1]
    wave = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ fit.coefficients[0]
    total = here.compliance[1] + fit.springs[k] + wave
    mean = float(np.average(total, weights=torque**2))
    found = total_softening(case, ready, fit)[k]
    assert found == pytest.approx(mean - ready.situation.compliance[1], rel=1e-6)
    assert abs(found - fit.springs[k]) > 0.1 * abs(fit.springs[k])


def test_the_arm_rests_under_its_fitted_springs_where_nothing_is_named():
    """They are fitted to all poses that may be looked at, and prepared from a few."""
    ready = prepared("lost_motion@a2,width_rad=2e-3")
    case = build_problem(ready, [Hardening()])
    change = case.situation.compliance - ready.situation.compliance
    assert np.abs(change * case.situation.torque).max() > 1e-6
    wound = case.situation.compliance * case.situation.torque
    assert_allclose(case.situation.rest - case.situation.recording.posture, wound)


def test_an_axis_that_turns_far_moves_its_marks_on_a_circle(kr10):
    """Half the square of the turn towards the axis, which no lever arm holds."""
    rig, watch = Rig(kr10), Instruments(Tracker(frame_error=(0.0,) * 6))
    seen = record(rig, tour(rig, 8, parse_path("0"), 0, 0), watch, 3)
    prepared = prepare(seen, Arm.from_mjcf(kr10).for_recording(seen))
    before = prepared.situation
    turn = np.zeros_like(before.rest)
    turn[:, 1] = 0.01
    after = moved_to(before, before.rest + turn)
    last = beyond_linear(prepared, after).parts[-1]
    assert isinstance(last, MarkerDisplacement)
    marks = expected(before, prepared.frames)[:, last.marker]
    axis = before.frame[:, 2, :, 2]
    arm = np.cross(np.cross(axis, marks - before.origin[:, 2]), axis)
    assert_allclose(last.displacement[:, :, 0], -0.5e-4 * arm, atol=1e-6)


# --- Kinematic errors -----------------------------------------------------------------


HYSTERESIS = "hysteresis@a2"


@pytest.mark.parametrize(("offset", "beside"), [(5e-3, ()), (-2e-2, (HYSTERESIS,))])
def test_a_wrong_zero_of_a_degree_is_one_name_with_its_size(offset, beside):
    """To first order alone it looks like two links, and one axis or none."""
    made = recording(f"encoder_offset@a3,offset_rad={offset}", *beside)
    found = diagnose(made, arm(), (*FEW, GeometryError()))
    names = {f"{one.name.effect}@{one.name.where}": one for one in found.named}
    assert found.verdict == "explained"
    assert set(names) == {"encoder_offset@a3", *beside}
    size = names["encoder_offset@a3"].parameters["offset_rad"]
    assert size.low <= offset <= size.high
    assert size.high - size.low < 1e-4


def of_size(law: Hypothesis, where: str, size: np.ndarray) -> ModelFit:
    """Return a set of one term of a known size."""
    return ModelFit((ModelTerm(law, where, NONE),), 0.0, NONE, (size,), 0)


def link_error(shift: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return coefficients of a link's error: the screw whose motion it is."""
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    series = np.eye(3) + cross / 2.0 + cross @ cross / 6.0
    return np.concatenate([np.linalg.solve(series, shift), turn])


SHIFT, TURN = np.array([2e-3, -1e-3, 3e-3]), np.array([4e-3, -6e-3, 5e-3])


@pytest.mark.parametrize(
    ("effect", "fit"),
    [
        (
            "encoder_offset@a2,offset_rad=2e-2",
            of_size(EncoderOffset(), "a2", np.array([2e-2])),
        ),
        (
            "geometry_error@link_3,x_m=2e-3,y_m=-1e-3,z_m=3e-3,"
            "rx_rad=4e-3,ry_rad=-6e-3,rz_rad=5e-3",
            of_size(GeometryError(), "link_3", link_error(SHIFT, TURN)),
        ),
    ],
)
def test_readings_about_kinematic_errors_are_what_their_columns_do(effect, fit):
    """As drawn, the second order stays; so it is said to show, and then no more."""
    made = recording(effect)
    drawn, about = prepare(made, arm()), prepared_about(made, arm(), fit)
    assert curvature(made, arm(), drawn, fit) > 10.0
    assert curvature(made, arm(), about, fit) < 0.1
    left = []
    for ready in (drawn, about):
        columns = fit.members[0].jacobian(ready.situation)
        rest = ready.data.subtract([columns], fit.coefficients[0])
        left.append(rest.mismatch_of_poses.sum())
    freedom = about.data.within.degrees_of_freedom.sum()
    assert abs(left[1]) < 0.1 * freedom
    assert left[0] > 5.0 * freedom


def test_a_link_that_turns_about_its_axis_is_this_axis_offset_about_any_kinematics():
    """So the second order of one is no reason to tell it from the other."""
    made, chain, angle = recording(), arm().chain, 2e-2
    turn = np.array([0.0, 0.0, angle])
    motion = np.stack([np.cross(turn, chain.nominal_origin[3]), turn])
    screw = (motion @ link_axes(chain, 2)).ravel()
    offset = of_size(EncoderOffset(), "a3", np.array([angle]))
    link = of_size(GeometryError(), "link_3", screw)
    for about in (offset, link):
        ready = prepared_about(made, arm(), about)
        own, other = (
            mixture(
                fit.members[0].jacobian(ready.situation), fit.coefficients[0][:, None]
            )
            for fit in (offset, link)
        )
        gram = normal_equations_of(
            ready.data, [own, other], np.zeros(ready.data.visits.poses(), dtype=int)
        ).gram[0]
        apart = np.array([1.0, -1.0])
        assert gram[0, 0] > 1e6
        assert apart @ gram @ apart < 1e-6 * gram[0, 0]
        for fit in (offset, link):
            assert curvature(made, arm(), ready, fit) < 1.0
