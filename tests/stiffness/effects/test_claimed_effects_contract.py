"""What is promised of every hypothesis, and what some say by hand."""

import re
from dataclasses import fields, replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from source import docstring, python_files, text

from bench.effects import EFFECTS
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.recording import Recording
from bench.shared.settings import Interval
from stiffness.diagnosis.gate import may_be_nothing
from stiffness.diagnosis.localisation import zone_of
from stiffness.diagnosis.model_fit import ModelTerm
from stiffness.diagnosis.noise_model import AT_FLANGE, max_pose_repeatability
from stiffness.effects import HYPOTHESES
from stiffness.effects.base import WIDE, Hypothesis, point_of
from stiffness.effects.creep import followed
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.jacobian import (
    EffectJacobian,
    EncoderError,
    JointRotation,
    values,
)
from stiffness.effects.link_bending import LinkBending
from stiffness.experiment.static_state import StaticState
from stiffness.robot.tracker_frame import TrackerFit

SHIFT, TURN = ("x_m", "y_m", "z_m"), ("rx_rad", "ry_rad", "rz_rad")
VOCABULARY = {
    "joint_compliance": {"compliance_rad_per_nm"},
    "hardening": {"stiffness_ratio", "torque_nm"},
    "asymmetric_stiffness": {"ratio"},
    "lost_motion": {"width_rad"},
    "hysteresis": {"width_rad"},
    "creep": {"ratio", "time_s"},
    "angle_dependent_stiffness": {"ratio", "order", "phase_rad"},
    "transmission_error": {"amplitude_rad", "order", "phase_rad"},
    "bearing_tilt": {"u_rad_per_nm", "v_rad_per_nm", "centre_m", "uv_rad_per_nm"}
    | {"compliance_ratio", "moment_nm"},
    "wrist_coupling": {"compliance_rad_per_nm", "with"},
    "encoder_offset": {"offset_rad"},
    "reading_lag": {"lag_rad", "share_lag_rad"},
    "link_bending": {"bending_nm2", "torsion_nm2", "bending_ratio"},
    "gravity_load": {"mass_kg", "com_x_m", "com_y_m", "com_z_m"}
    | {f"moment_{axis}_kg_m" for axis in "xyz"},
    "mass_scale": {"ratio"},
    "deflection_compensation": {"ratio"},
    "gravity_compensator": {"torque_nm", "phase_rad", "free_length_ratio", "arm_ratio"},
    "geometry_error": {*SHIFT, *TURN},
    "base_compliance": {f"r{axis}_rad_per_nm" for axis in ("x", "y", "z", "xy")}
    | {f"{axis}_m_per_n" for axis in "xyz"},
    "wrench_bias": {"fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"},
    "wrench_gain": {"fx", "fy", "fz", "tx", "ty", "tz"},
    "wrench_misalignment": {*SHIFT, *TURN},
    "pulley_friction": {"ratio"},
    "tracker_scale": {"ratio"},
    "tracker_misalignment": {*SHIFT, *TURN},
    "drift": {*(f"{name}_per_h" for name in (*SHIFT, *TURN)), "time_s"},
    "marker_slip": {*SHIFT, "time_s"},
    "channel_delay": {"delay_s"},
}
"""The effects that an answer can name, and the parameters that it then gives."""

IN_MEANS = (
    *("transmission_error", "encoder_offset", "gravity_load", "gravity_compensator"),
    *("geometry_error", "wrench_bias", "tracker_scale", "tracker_misalignment"),
    *("marker_slip", "reading_lag", "mass_scale"),
    "deflection_compensation",
)
"""What stays the same within a visit, and so cancels in differences."""

each = pytest.mark.parametrize("hypothesis", HYPOTHESES, ids=lambda h: type(h).__name__)


def places(hypothesis: Hypothesis) -> list[tuple[StaticState, str]]:
    """Return the first and the last place of a hypothesis, with a situation."""
    situation = truth.showing(hypothesis.effect)
    found = hypothesis.places(situation)
    return [(situation, where) for where in dict.fromkeys((found[0], found[-1]))]


def signatures(hypothesis: Hypothesis) -> list[tuple[StaticState, str, EffectJacobian]]:
    """Return the signatures at these places, at the outermost shapes and between."""
    found = []
    for situation, where in places(hypothesis):
        shapes = hypothesis.shapes(situation, where)
        for shape in shapes[[0, len(shapes) // 2, -1]]:
            found.append(
                (situation, where, hypothesis.jacobian(situation, where, shape))
            )
    return found


# --- The library as a whole ----------------------------------------------------------


def test_every_effect_of_the_vocabulary_has_a_hypothesis_and_no_other_has():
    names = {hypothesis.effect for hypothesis in HYPOTHESES}
    assert names == set(VOCABULARY)
    assert {effect.name for effect in EFFECTS} <= names
    assert len({type(hypothesis) for hypothesis in HYPOTHESES}) == len(HYPOTHESES)


def test_every_file_states_equation_source_validity_and_what_it_ignores():
    generic = "stiffness/effects/residual_map.py"  # no law: whatever a place may do
    files = [file for file in python_files("stiffness/effects") if file != generic]
    kinds = "|".join({"Hypothesis", *(type(law).__name__ for law in HYPOTHESES)})
    held = [file for file in files if re.search(rf"\(({kinds})\):", text(file))]
    assert len(held) == len(HYPOTHESES)
    for file in held:
        rows = re.findall(r"^(\w+) {2,}\S", docstring(file), re.MULTILINE)
        assert rows == ["Equation", "Source", "Valid", "Ignores"], file


# --- Each hypothesis -----------------------------------------------------------------


@each
def test_every_effect_says_at_which_sizes_it_is_nothing(hypothesis):
    """Where the intervals of all of them may be so, its name is withheld."""
    sizes = hypothesis.nothing
    assert sizes
    assert set(sizes) <= VOCABULARY[hypothesis.effect]
    held = {name: Interval(v, v - 1.0, v + 1.0) for name, v in sizes.items()}
    assert may_be_nothing(hypothesis, held)
    (first, value), *_ = sizes.items()
    assert not may_be_nothing(
        hypothesis, held | {first: Interval(value + 2.0, value + 1.0, value + 3.0)}
    )


@each
def test_parameters_have_the_vocabulary_s_names_and_limits(hypothesis):
    same = [h for h in HYPOTHESES if h.effect == hypothesis.effect]
    assert set(hypothesis.limits) <= VOCABULARY[hypothesis.effect]
    assert set().union(*(h.limits for h in same)) == VOCABULARY[hypothesis.effect]
    assert set(hypothesis.magnitudes) <= set(hypothesis.limits)
    assert all(low < high for low, high in hypothesis.limits.values())
    for situation, where in places(hypothesis):
        shape = truth.middle(situation, hypothesis, where)
        columns = hypothesis.jacobian(situation, where, shape).columns
        found = hypothesis.parameters(situation, where, shape, np.full(columns, 1e-6))
        assert set(found) <= set(hypothesis.limits)
        assert all(np.isfinite(value) for value in found.values())


@each
def test_shapes_are_few_within_limits_and_leave_the_columns_their_number(hypothesis):
    for situation, where in places(hypothesis):
        shapes = hypothesis.shapes(situation, where)
        assert shapes.shape[1] == len(hypothesis.shape_names)
        assert 1 <= len(shapes) <= 12
        assert len(np.unique(shapes, axis=0)) == len(shapes)
        for name, grid in zip(hypothesis.shape_names, shapes.T, strict=True):
            low, high = hypothesis.limits.get(name, (-np.inf, np.inf))
            assert np.all((low <= grid) & (grid <= high))
        columns = {hypothesis.jacobian(situation, where, s).columns for s in shapes}
        assert len(columns) == 1


@each
def test_signature_has_a_value_for_every_row_and_moves_something(hypothesis):
    for situation, _, signature in signatures(hypothesis):
        assert signature.columns > 0
        for part in signature.parts:
            assert len(values(part)) == situation.rows
            assert np.all(np.isfinite(values(part)))
        moved = truth.moved(situation, signature)
        assert np.all(np.any(moved != 0.0, axis=(0, 1, 2)))


@each
def test_columns_of_a_signature_are_no_multiples_of_each_other(hypothesis):
    for situation, where, signature in signatures(hypothesis):
        columns = truth.moved(situation, signature).reshape(-1, signature.columns)
        columns = columns / np.linalg.norm(columns, axis=0)
        least = np.linalg.svd(columns, compute_uv=False)[-1]
        assert least > 1e-3, where


@pytest.mark.parametrize(
    "hypothesis",
    [h for h in HYPOTHESES if h.effect != "channel_delay"],  # a stream is one visit
    ids=lambda h: type(h).__name__,
)
def test_signature_is_absolute_and_each_visit_speaks_for_itself(hypothesis):
    """Nothing is centred: rows of some visits are the same without the other visits."""
    for situation, where in places(hypothesis):
        rows = np.flatnonzero(situation.visit >= truth.VISITS // 2)
        part = rows_of(situation, rows)
        shape = truth.middle(situation, hypothesis, where)
        whole = hypothesis.jacobian(situation, where, shape)
        own = hypothesis.jacobian(part, where, shape)
        for one, other in zip(whole.parts, own.parts, strict=True):
            assert_allclose(values(one)[rows], values(other), rtol=1e-12, atol=1e-15)


@each
def test_signature_depends_on_no_reading_of_markers_or_encoders(
    hypothesis,
):
    for situation, where in places(hypothesis):
        recording = situation.recording
        assert recording.points is not None
        others = replace(
            recording,
            points=np.full_like(recording.points, np.nan),
            link_posture=np.ones_like(recording.posture),
        )
        blind = replace(situation, recording=others)
        shape = truth.middle(situation, hypothesis, where)
        one = hypothesis.jacobian(situation, where, shape)
        other = hypothesis.jacobian(blind, where, shape)
        for part, same in zip(one.parts, other.parts, strict=True):
            assert_array_equal(values(part), values(same))


@each
def test_parameters_are_smooth_and_tell_all_coefficients_apart(hypothesis):
    """Two ways to differentiate agree, and the derivative has full rank."""
    for situation, where in places(hypothesis):
        shape = truth.middle(situation, hypothesis, where)
        columns = hypothesis.jacobian(situation, where, shape).columns
        start = 1e-6 * (1.0 + np.arange(columns))

        def found(at, shape=shape, situation=situation, where=where):
            return np.array(
                list(hypothesis.parameters(situation, where, shape, at).values())
            )

        size = np.abs(found(2.0 * start) - found(start)) + 1e-9
        slopes = []
        for step in (1e-3, 1e-4):
            moves = step * start * np.eye(columns)
            pairs = [(found(start + m) - found(start - m)) / size for m in moves]
            slopes.append(np.array(pairs).T / (2 * step))
        assert_allclose(slopes[0], slopes[1], rtol=1e-4, atol=1e-5)
        assert np.linalg.matrix_rank(slopes[1], tol=1e-4) == columns


@pytest.mark.parametrize(
    "hypothesis", [h for h in HYPOTHESES if h.sized_by], ids=lambda h: h.effect
)
def test_a_coefficient_is_before_any_reading_as_large_as_effects_usually_are(
    hypothesis,
):
    """A size at an end of the catalogue's usual range is a third of one sigma."""
    name = hypothesis.sized_by
    known = CATALOGUE[hypothesis.effect].usual(name)
    assert known is not None
    for situation, where in places(hypothesis):
        sigma = hypothesis.prior_sigma(situation, where)
        shape = truth.middle(situation, hypothesis, where)
        columns = hypothesis.jacobian(situation, where, shape).columns
        size = np.array([sigma[0] / WIDE, *np.full(columns - 1, 1e-9)])
        found = hypothesis.parameters(situation, where, shape, size)
        usual = min((known.low, known.high), key=lambda end: abs(end - found[name]))
        assert_allclose(found[name], usual, rtol=0.05)


def test_sizes_of_a_slide_and_of_links_have_no_prior(tmp_path):
    """A slide's are in other units, and arms are large and small."""
    here = truth.palletiser(tmp_path)
    for k, slides in enumerate(here.arm.slides):
        for effect in ("hysteresis", "creep", "asymmetric_stiffness"):
            found = truth.BY_NAME[effect].prior_sigma(here, here.axes[k])
            assert (found is None) == slides
    for effect, where in (("link_bending", "link_2"), ("bearing_tilt", "a2")):
        assert truth.BY_NAME[effect].prior_sigma(here, where) is None


@each
def test_variants_speak_of_the_same_rows(hypothesis):
    for situation, where in places(hypothesis):
        shape = truth.middle(situation, hypothesis, where)
        other = hypothesis.variants(situation, where, shape)
        assert all(len(values(part)) == situation.rows for part in other.parts)


@each
def test_what_cancels_within_a_visit_has_no_place_in_relative_readings(hypothesis):
    relative = replace(truth.recording(), displacement="relative")
    found = hypothesis.places(replace(truth.situation(), recording=relative))
    usual = hypothesis.places(truth.situation())
    assert found == (() if hypothesis.effect in IN_MEANS else usual)


def rows_of(situation: StaticState, rows: np.ndarray) -> StaticState:
    """Return a situation with some of its rows alone."""
    kept = {}
    for field in fields(situation):
        value = getattr(situation, field.name)
        if isinstance(value, np.ndarray) and len(value) == situation.rows:
            kept[field.name] = value[rows]
    return replace(situation, recording=situation.recording.take(rows), **kept)


def test_arm_with_a_slide_and_no_turn_of_the_wrist_has_sound_signatures(tmp_path):
    """No column is empty and none a multiple of others, whatever the arm lacks."""
    situation = truth.palletiser(tmp_path)
    named = set()
    for hypothesis in HYPOTHESES:
        for where in hypothesis.places(situation):
            shape = truth.middle(situation, hypothesis, where)
            found = hypothesis.jacobian(situation, where, shape)
            columns = truth.moved(situation, found).reshape(-1, found.columns)
            columns = columns / np.linalg.norm(columns, axis=0)
            least = np.linalg.svd(columns, compute_uv=False)[-1]
            assert least > 1e-6, (hypothesis.effect, where)
            named.add(hypothesis.effect)
    assert named >= {"wrench_bias", "gravity_load", "link_bending", "creep"}
    bias = truth.BY_NAME["wrench_bias"]
    felt = bias.parameters(situation, "wrench_sensor", np.zeros(0), np.ones(4))
    assert felt.keys() == {"fx_n", "fy_n", "fz_n", "tz_nm"}  # none feels a tilt


def test_an_axis_that_slides_errs_and_is_loaded_in_its_own_units(tmp_path):
    """It misses its posture by what the flange does, without a lever, and in N."""
    situation = truth.palletiser(tmp_path)
    slide = int(np.flatnonzero(situation.arm.slides)[0])
    most = max_pose_repeatability(situation)
    assert most[slide] == AT_FLANGE
    assert np.all(most[~situation.arm.slides] > AT_FLANGE)
    law, where = truth.BY_NAME["hardening"], situation.axes[slide]
    term = ModelTerm(law, where, law.shapes(situation, where)[0])
    assert "force" in zone_of(situation, term)
    assert zone_of(situation, term).endswith(" N")


# --- Where an effect cannot show -----------------------------------------------------


def in_recording(**changes) -> StaticState:
    """Return the usual situation with another recording of it."""
    recording: Recording = replace(truth.recording(), **changes)
    return replace(truth.situation(), recording=recording)


def test_what_the_data_cannot_show_has_no_place():
    by, usual = truth.BY_NAME, truth.recording()
    assert by["creep"].places(in_recording(load_time=usual.time)) == ()
    still = in_recording(posture=np.zeros_like(usual.posture))
    assert by["angle_dependent_stiffness"].places(still) == ()
    unseen = in_recording(base_from_tracker=None)
    assert by["tracker_misalignment"].places(unseen) == ()
    nothing = in_recording(wrench=None)
    for effect in ("wrench_bias", "wrench_gain", "wrench_misalignment"):
        assert by[effect].places(nothing) == ()
    one_way = replace(truth.situation(), torque=np.abs(truth.situation().torque) + 1.0)
    assert by["lost_motion"].places(one_way) == ()
    assert by["asymmetric_stiffness"].places(one_way) == ()


def test_compensator_of_an_axis_that_stands_still_is_an_offset_of_its_encoder():
    by, usual = truth.BY_NAME, truth.recording()
    still = in_recording(posture=np.full_like(usual.posture, 0.3))
    spring, offset = GravityCompensator(), by["encoder_offset"]
    one, other = (h.jacobian(still, "a3", np.zeros(0)) for h in (spring, offset))
    assert_array_equal(truth.moved(still, one), truth.moved(still, other))
    found = spring.parameters(still, "a3", np.zeros(0), np.array([-2e-5]))
    torque = found["torque_nm"] * np.sin(0.3 - found["phase_rad"])
    assert torque * still.compliance[2] == pytest.approx(-2e-5)


def test_transmission_error_of_an_axis_that_stands_is_an_encoder_s_offset():
    """And the parameters that are reported have the value that shows."""
    usual = truth.recording()
    still = in_recording(posture=np.full_like(usual.posture, 0.4))
    hypothesis, offset = (
        truth.BY_NAME[e] for e in ("transmission_error", "encoder_offset")
    )
    shape = truth.middle(still, hypothesis, "a4")
    one = hypothesis.jacobian(still, "a4", shape)
    other = offset.jacobian(still, "a4", np.zeros(0))
    assert_array_equal(truth.moved(still, one), truth.moved(still, other))
    found = hypothesis.parameters(still, "a4", shape, np.array([-1e-4]))
    turned = np.sin(found["order"] * 0.4 + found["phase_rad"])
    assert_allclose(found["amplitude_rad"] * turned, -1e-4, rtol=1e-9)


def test_drift_of_a_tracker_is_along_its_own_axes_wherever_its_frame_comes_from():
    stated, unknown = truth.situation(), in_recording(base_from_tracker=None)
    frame, places = stated.tracker, np.zeros((len(stated.recording.markers), 3))
    assert frame is not None and unknown.tracker is None
    fitted = TrackerFit(frame[:3, :3], frame[:3, 3], places)
    unstated = replace(unknown, frames=fitted)
    hypothesis, slow = truth.BY_NAME["drift"], np.array([1e6])
    one, other = (
        values(hypothesis.jacobian(s, "tracker", slow).parts[0])
        for s in (stated, unstated)
    )
    assert_array_equal(one, other)
    assert np.any(one != values(hypothesis.jacobian(stated, "base", slow).parts[0]))


def test_axis_that_the_model_calls_rigid_is_a_place_for_compliance_and_no_other_is():
    hypothesis = truth.BY_NAME["joint_compliance"]
    assert hypothesis.places(truth.situation()) == ()
    assert hypothesis.places(truth.showing("joint_compliance")) == ("a2", "a4")


def test_play_shows_on_an_axis_that_the_model_calls_rigid():
    """Its width is no share of a stiffness; what is such a share has no place there."""
    rigid = truth.showing("joint_compliance")
    assert "a2" in truth.BY_NAME["lost_motion"].places(rigid)
    assert "a2" not in truth.BY_NAME["asymmetric_stiffness"].places(rigid)


def test_wrist_couples_each_pair_of_the_last_three_axes():
    hypothesis, situation = truth.BY_NAME["wrist_coupling"], truth.situation()
    assert hypothesis.places(situation) == ("a5", "a6")
    assert hypothesis.shapes(situation, "a5").tolist() == [[4.0]]
    assert hypothesis.shapes(situation, "a6").tolist() == [[4.0], [5.0]]


def test_plateaus_show_no_delay_and_streams_do():
    hypothesis = truth.BY_NAME["channel_delay"]
    assert hypothesis.places(truth.situation()) == ()
    found = hypothesis.places(truth.swinging())
    assert found == (*truth.situation().axes, "tracker", "wrench_sensor")


# --- By hand -------------------------------------------------------------------------


def test_creep_follows_a_step_with_one_minus_exp():
    """63.2 % after one time constant, from the arrival on and from the change on."""
    usual = truth.recording()
    visit = usual.take(np.arange(3))
    visit = replace(
        visit, time=np.array([10.0, 30.0, 50.0]), load_time=np.array([0.0, 20.0, 20.0])
    )
    situation = rows_of(truth.situation(), np.arange(3))
    torque = np.zeros((3, 6))
    torque[:, 1] = [8.0, 2.0, 2.0]
    situation = replace(situation, recording=visit, torque=torque)
    arrived = 8.0 * (1 - np.exp(-2))
    found = followed(situation, 1, 10.0)
    expected = [
        8.0 * (1 - np.exp(-1)),
        2.0 + (arrived - 2.0) * np.exp(-1),
        2.0 + (arrived - 2.0) * np.exp(-3),
    ]
    assert_allclose(found, expected, rtol=1e-12)


def test_link_bends_by_the_cubed_length_over_three():
    """A force of 1 N across a beam of 1 N m²: L³/3 and L²/2; L of link 2 is 0.56 m."""
    situation = truth.situation()
    tip, along = situation.origin[:, 3], situation.origin[:, 3] - situation.origin[:, 2]
    across = np.cross(along, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    force, moment = np.zeros_like(situation.force), np.zeros_like(situation.moment)
    force[:, 3] = across
    loaded = replace(situation, force=force, moment=moment)
    bend = LinkBending().jacobian(loaded, "link_2", np.zeros(1))
    twist = values(bend.parts[0])
    length = np.linalg.norm(along, axis=1)[0]
    assert_allclose(length, 0.560, atol=1e-3)
    moved = truth.at_point(twist, tip)[..., 0]
    assert_allclose(np.sum(moved * across, axis=1), length**3 / 3, rtol=1e-9)
    turned = np.linalg.norm(twist[:, 3:, 0], axis=1)
    assert_allclose(turned, length**2 / 2, rtol=1e-9)


def test_stiffness_that_varies_with_the_angle_is_inverted_exactly():
    """1/(1 + e cos x) has the first harmonic -2ρ beside its mean, e = 2ρ/(1 + ρ²)."""
    x = np.linspace(0.0, 2 * np.pi, 720, endpoint=False)
    give = 1.0 / (1.0 + 0.6 * np.cos(x))
    mean, a, b = (
        give.mean(),
        2 * np.mean(give * np.cos(x)),
        2 * np.mean(give * np.sin(x)),
    )
    situation = truth.situation().with_compliance(np.full(6, mean))
    hypothesis = truth.BY_NAME["angle_dependent_stiffness"]
    found = hypothesis.parameters(situation, "a1", np.ones(1), np.array([a, b]))
    assert_allclose([found["ratio"], found["phase_rad"]], [0.6, 0.0], atol=1e-12)


def test_gravity_weighs_on_a_lever_as_archimedes_says():
    """1 kg in the tool's origin: torque of an axis = m g x the level distance to it."""
    situation = truth.situation()
    found = truth.BY_NAME["gravity_load"].jacobian(situation, "tool", np.zeros(0))
    [law] = (
        part.law[:, 0]
        for part in found.parts
        if isinstance(part, JointRotation) and part.axis == 1
    )
    lever = point_of(situation, "tool", np.zeros(3)) - situation.origin[:, 2]
    along = situation.frame[:, 2, :, 2]
    torque = np.einsum("ri,ri->r", along, np.cross(lever, [0.0, 0.0, -9.81]))
    assert_allclose(law, situation.compliance[1] * torque, rtol=1e-9)


def test_delay_of_the_tracker_leaves_encoders_behind_the_gears_alone():
    """They tell their angles in time: the turns of the axes leave their readings."""
    stream = truth.swinging()
    found = truth.BY_NAME["channel_delay"].jacobian(stream, "tracker", np.zeros(0))
    turns = [values(part) for part in found.parts if not isinstance(part, EncoderError)]
    readings = [values(part) for part in found.parts if isinstance(part, EncoderError)]
    assert_array_equal(np.array(turns), -np.array(readings))


@pytest.mark.parametrize("effect", ["gravity_load", "wrench_gain", "wrench_bias"])
def test_names_of_sizes_stay_when_a_fit_takes_a_spring_to_nothing(effect):
    """Columns were laid out before springs moved; their sizes keep their names."""
    law, situation = truth.BY_NAME[effect], truth.situation()
    for where in law.places(situation):
        shape = truth.middle(situation, law, where)
        count = law.jacobian(situation, where, shape).columns
        for axis in range(len(situation.axes)):
            compliance = situation.compliance.copy()
            compliance[axis] = 0.0
            moved = situation.with_compliance(compliance)
            usual, other = (
                law.parameters(one, where, shape, np.full(count, 0.1))
                for one in (situation, moved)
            )
            assert usual.keys() == other.keys()
