"""What the engine of the diagnosis promises, on small recordings of the bench."""

from dataclasses import replace

import numpy as np
import pytest
from small_bench import (
    FEW,
    MODEL,
    SOFTER,
    arm,
    diagnosis,
    prepared,
    recording,
    relative,
)

from bench.effects.out_of_library.foot_lift_off import FootLiftOff
from bench.experiment import record
from bench.instruments import Instruments
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.settings import Interval
from bench.standard_plans import table_one_plan
from scenarios.pipelines import schema
from scenarios.pipelines.diagnosis import answer_of
from stiffness.diagnosis.detection import (
    MEASURED,
    MISSTATED,
    DetectionTest,
    Scatter,
    homogeneity_tests,
    residual_after,
)
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.model_fit import ModelTerm, fit_model
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.result import (
    Decision,
    Name,
    NamedEffect,
    other_causes,
    refused_with_size,
)
from stiffness.effects.base_tilt import BaseTilt
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.reading_lag import ReadingLag
from stiffness.effects.tracker_scale import TrackerScale
from stiffness.regression.testing import SIGNIFICANCE, sign_flip_test

CALM = Scatter(1.0, 0.01, 0.0, MISSTATED)


def test_nothing_there_is_no_mismatch():
    found = diagnosis()
    assert found.verdict == "no_mismatch"
    assert found.detection.p_value >= SIGNIFICANCE
    assert found.named == ()


def test_relative_readings_of_a_nominal_arm_are_no_mismatch():
    """Levers and noise too are those of the same arm read absolutely."""
    ready = prepare(relative(recording()), arm())
    assert abs(ready.noise - 1.0) < 0.03
    found = diagnose(relative(recording()), arm(), FEW)
    assert found.verdict == "no_mismatch"


def test_an_effect_is_named_from_relative_readings():
    found = diagnose(relative(recording("bearing_tilt@a3")), arm(), FEW)
    assert [(e.name.effect, e.name.where) for e in found.named] == [
        ("bearing_tilt", "a3")
    ]


def test_relative_readings_of_marks_at_unknown_places_are_refused():
    markers = tuple(replace(m, position=None) for m in recording().markers)
    with pytest.raises(Unusable, match="give position_mm"):
        diagnose(replace(relative(recording()), markers=markers), arm(), FEW)


def test_poses_that_differ_at_random_are_no_law_but_not_passed_over():
    """Each pose gives way its own way by 0.2 mm: ten times the noise, signs random."""
    made = recording()
    assert made.points is not None and made.load_mass is not None
    made = replace(made, markers=made.markers[:12], points=made.points[:, :12])
    assert made.points is not None and made.load_mass is not None
    pose = np.unique(made.posture_id, return_inverse=True)[1]
    sign = np.random.default_rng(3).choice([-1.0, 1.0], pose.max() + 1)[pose]
    load = made.load_mass / np.max(made.load_mass)
    moved = made.points + 2e-4 * (sign * load)[:, None, None]
    found = diagnose(replace(made, points=moved), arm(), FEW)
    assert found.verdict == "unexplained"
    assert found.named == ()
    assert found.unexplained is not None
    assert [one.where for one in found.located] == [found.unexplained.where]
    assert "loop" not in found.unexplained.signature  # the sign alone changes
    assert "scatter" not in [warned.code for warned in diagnosis().warnings]


@pytest.mark.parametrize(
    ("effect", "name", "where"),
    [
        ("hysteresis@a2", "hysteresis", "a2"),
        ("bearing_tilt@a3", "bearing_tilt", "a3"),
        ("encoder_offset@a3,offset_rad=2e-4", "encoder_offset", "a3"),
    ],
)
def test_an_effect_is_found_placed_and_named(effect, name, where):
    found = diagnosis(effect)
    assert found.verdict == "explained"
    assert [(e.name.effect, e.name.where) for e in found.named] == [(name, where)]
    assert found.located[0].where == where


def test_friction_that_no_load_overcomes_is_a_loop_beside_the_right_spring():
    """A part slips; the rest winds up and lets go with the spring, which seems hard."""
    found = diagnosis("hysteresis@a2,width_rad=8e-4")
    (loop,) = found.named
    assert loop.name == Name("hysteresis", "a2")
    width, nominal = loop.parameters["width_rad"], found.nominal
    assert width.low < 8e-4 < width.high
    assert nominal is not None
    assert abs(SOFTER * nominal.compliance[1] / nominal.modelled[1] - 1.0) < 0.15


@pytest.mark.parametrize("law", ["lag_rad", "share_lag_rad"])
@pytest.mark.parametrize("lag", [3e-4, -3e-4])
def test_a_lag_of_the_report_is_named_with_its_law_and_its_sign(lag, law):
    """Constant, or in proportion to the axis' share of the move."""
    made = recording(f"reading_lag@a2,{law}={lag}")
    (named,) = diagnose(made, arm(), (*FEW, ReadingLag())).named
    assert (named.name.effect, named.name.where) == ("reading_lag", "a2")
    assert set(named.parameters) == {law}
    size = named.parameters[law]
    assert size.low <= lag <= size.high
    assert size.low * size.high > 0.0


def test_a_name_that_was_refused_keeps_its_size_and_its_sign():
    size = {"lag_rad": Interval(-3e-4, -4e-4, -2e-4)}
    stop = ("posterior", False, 0.9, 0.95, "probability")
    refused = Decision(("reading_lag", "a2"), *stop, size)
    without = Decision(("creep", "a2"), *stop)
    passed = Decision(("hysteresis", "a2"), "left_out", True, 1.0, 0.0, "", size)
    found = replace(diagnosis(), decisions=(refused, without, passed))
    assert refused_with_size(found) == [refused]
    (said,) = answer_of(found, None, "", (), 0.0).refused
    assert (said.effect, said.where) == ("reading_lag", "a2")
    assert said.parameters == {"lag_rad": schema.Interval(-3e-4, -4e-4, -2e-4)}
    assert said.reason.startswith("Probability")


def test_a_size_that_no_instrument_has_is_said_with_what_would_need_it():
    """A scale of 0.1 % is one of the set-up; that alone no place and no law says."""
    made = recording("tracker_scale@tracker,ratio=1e-3")
    found = diagnose(made, arm(), (*FEW, TrackerScale()))
    assert found.named == ()
    (told,) = [w for w in found.warnings if w.code == "beyond_limits"]
    assert told.where == "tracker"
    assert "would need ratio 0.000999 (-0.0005 to 0.0005 is possible)" in told.text


def test_more_than_three_effects_are_named_one_after_the_other():
    effects = (
        *("hysteresis@a2", "hysteresis@a3", "bearing_tilt@a1", "bearing_tilt@a3"),
        "encoder_offset@a5,offset_rad=4e-4",
    )
    found = diagnosis(*effects)
    names = {f"{e.name.effect}@{e.name.where}" for e in found.named}
    assert names == {effect.partition(",")[0] for effect in effects}
    assert found.verdict == "explained"


def test_the_interval_holds_the_true_size():
    """Seeded; a 95 % interval widened once over."""
    width = diagnosis("hysteresis@a2").named[0].parameters["width_rad"]
    half = 0.5 * (width.high - width.low)
    assert abs(width.estimate - 1.5e-4) < 2.0 * half


def test_what_no_hypothesis_describes_gets_no_name_but_a_place():
    found = diagnosis("creep@a2,ratio=0.2")
    assert found.verdict == "unexplained"
    assert found.named == ()
    assert found.unexplained is not None
    assert found.located[0].where == "a2"


def test_a_reversed_axis_is_said_and_nothing_named():
    whole = recording()
    posture = whole.posture * [1, 1, -1, 1, 1, 1]
    found = diagnose(replace(whole, posture=posture), arm(), FEW)
    assert [(w.code, w.where) for w in found.warnings] == [("axis_reversed", "a3")]
    assert found.named == () and found.verdict == "unexplained"


def test_a_reversed_wrench_is_said_and_nothing_named():
    whole = recording()
    assert whole.wrench is not None
    found = diagnose(replace(whole, wrench=-whole.wrench), arm(), FEW)
    assert [w.code for w in found.warnings] == ["wrench_sign"]
    assert found.named == ()


def test_a_reading_far_off_counts_less_and_is_told():
    whole = recording()
    assert whole.points is not None
    points = whole.points.copy()
    row = int(np.flatnonzero(np.isfinite(points[:, 9, 0]))[17])
    points[row, 9] += 1e-3
    ready = prepare(replace(whole, points=points), arm())
    assert (row, 9) in {(r, m) for r, m, _ in ready.downweighted}


def test_right_law_is_the_same_in_all_groups_and_a_wrong_one_is_not():
    """A foot that lifts off its plate is no foot that gives way."""
    right = build_problem(prepared("hysteresis@a2"), FEW)
    law = ModelTerm(Hysteresis(), "a2", np.array([22.3, 0.0]))
    (even,) = _tested(right, law)
    assert even.p_value >= SIGNIFICANCE
    rig = Rig(MODEL, effects=(FootLiftOff("base", 2e-6, preload_nm=20.0),))
    seen = record(rig, table_one_plan(poses=40), Instruments(), seed=1)
    wrong = build_problem(prepare(seen, arm()), FEW)
    law = ModelTerm(BaseTilt(), "base", np.zeros(0))
    (uneven,) = _tested(wrong, law)
    assert uneven.p_value < SIGNIFICANCE
    assert uneven.captured > 25.0


def _tested(case, *members):
    fit = fit_model(case, members)
    return homogeneity_tests(case, fit, residual_after(case, fit))


def test_poses_that_differ_at_random_are_a_mismatch_where_noise_is_measured():
    """Random signs cannot see a law that changes its sign from pose to pose."""
    random = np.random.default_rng(11)
    tested = sign_flip_test([random.normal(size=(60, 1)) / np.sqrt(60)], seed=1)
    assert tested.p_value > SIGNIFICANCE

    def test_of(dispersion: float, wild: float) -> DetectionTest:
        return DetectionTest(
            tested,
            1,
            0,
            (),
            ("a1",),
            dispersion,
            60,
            replace(CALM, dispersion_limit=wild),
        )

    stated = test_of(9.0, MISSTATED)  # noise that nothing measured may be larger
    assert stated.p_value == tested.p_value
    assert stated.noise_ratio == pytest.approx(3.0)
    assert test_of(1.2, MEASURED).p_value == tested.p_value
    assert test_of(3.0, MEASURED).p_value < SIGNIFICANCE


@pytest.mark.parametrize(
    ("name", "sizes", "words"),
    [
        ("mass_scale", {"ratio": (0.8, 0.78, 0.82)}, "part of the sag"),
        ("creep", {"ratio": (0.1, 0.08, 0.12)}, ""),
        ("tracker_scale", {"ratio": (1.15e-4, 1.1e-4, 1.2e-4)}, "5.0 K warmer"),
        ("tracker_scale", {"ratio": (-1.15e-4, -1.2e-4, -1.1e-4)}, "5.0 K colder"),
        ("tracker_scale", {"ratio": (5e-6, 4e-6, 6e-6)}, ""),
        ("transmission_error", {"order": (1.0, -0.3, 2.3)}, "spring across the axis"),
        ("transmission_error", {"order": (1.0, -np.inf, np.inf)}, ""),
        ("reading_lag", {"lag_rad": (-1e-4, -2e-4, -5e-5)}, "friction that holds"),
        ("reading_lag", {"share_lag_rad": (-1e-4, -2e-4, -5e-5)}, "friction that"),
        ("reading_lag", {"lag_rad": (1e-4, 5e-5, 2e-4)}, ""),
    ],
)
def test_what_no_effect_is_but_looks_like_a_name_is_said_beside_it(name, sizes, words):
    given = {parameter: Interval(*size) for parameter, size in sizes.items()}
    said = other_causes([NamedEffect(Name(name, "a2"), 1.0, (), given)])
    assert len(said) == bool(words)
    assert all(words in one.text and one.where == "a2" for one in said)
