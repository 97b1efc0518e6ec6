"""Blind trials of whole arms: what is drawn, what can be known of it, how it counts."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bench import standard_plans
from bench.effects.bearing_tilt import BearingTilt
from bench.effects.creep import Creep
from bench.effects.effect import Effect
from bench.effects.encoder_offset import EncoderOffset
from bench.effects.gravity_compensator import GravityCompensator
from bench.effects.hardening import Hardening
from bench.effects.hysteresis import Hysteresis
from bench.effects.out_of_library.softening import Softening
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.instruments.random_streams import streams
from bench.rig import Rig
from bench.shared.effect_catalogue import CATALOGUE
from bench.shared.plan import DEFAULT_PATH
from bench.shared.recording import Recording
from bench.standard_plans import tour
from bench.study_arm import default_truth
from scenarios.pipelines.inputs import arm_of
from scenarios.studies.blind_trials import effects, generation, report
from scenarios.studies.blind_trials.arms import (
    BY_NAME,
    draw_twins,
    draw_whole_arm,
    springs_about,
)
from scenarios.studies.blind_trials.effects import Ground, knees_of, turning
from scenarios.studies.blind_trials.generation import (
    LEAST_LEFT,
    error_free_instruments,
    generate_trial,
    trial_of,
)
from scenarios.studies.blind_trials.linear_model import explained_share, linear_model_of
from scenarios.studies.blind_trials.method_under_test import linear_share_of
from scenarios.studies.blind_trials.oracle import (
    ArmOracle,
    arm_oracle,
    displaced,
    log_bayes_factor,
    oracle_share,
    prepared_with,
    true_terms,
)
from scenarios.studies.blind_trials.rates import (
    ARM_BARS,
    arm_bars,
    failures,
    lost_names,
    twin_bars,
)
from scenarios.studies.blind_trials.score import score_answer
from scenarios.studies.blind_trials.strata import ALL, EVERY_AXIS, STRATA
from scenarios.studies.blind_trials.visibility import scale_of
from stiffness.diagnosis.result import Name

ARMS = [name for name, stratum in STRATA.items() if stratum.effects]
TWINS = [name for name, stratum in STRATA.items() if stratum.has_twin]

# --- Drawing --------------------------------------------------------------------------


Recorder = Callable[..., tuple[Recording, Recording]]


@pytest.fixture(scope="module")
def ground(kr10):
    rig = Rig(kr10)
    covered = turning(rig.anatomy, tour(rig, 30, DEFAULT_PATH, 12, 0).posture)
    stuck = Markers().stick(rig.nominal, rig.anatomy, streams(0))
    marks = [one.marker.name for one in stuck]
    return Ground(rig.anatomy, marks, 3600.0, knees_of(rig), covered)


def drawn(stratum, number, ground):
    trial = trial_of(0, stratum, number)
    return draw_whole_arm(trial.stratum, np.random.default_rng(trial.chance), ground)


@pytest.mark.parametrize("stratum", ARMS)
def test_arm_has_as_many_effects_as_asked_and_none_twice(stratum, ground):
    effects = drawn(stratum, 0, ground)
    assert len({(e.name, e.where) for e in effects}) == len(effects)
    if STRATA[stratum].effects < ALL:
        assert len(effects) == STRATA[stratum].effects
        assert {e.name for e in effects} <= set(STRATA[stratum].pool)


def test_arm_of_all_effects_has_every_one_on_every_axis_that_can_show_it(ground):
    names = {(e.name, e.where) for e in drawn("arm_all", 0, ground)}
    axes = ground.arm.axes
    expected = {(name, axis) for name in EVERY_AXIS for axis in axes}
    still = set(axes) - set(ground.turning)
    expected -= {("angle_dependent_stiffness", axis) for axis in still}
    expected |= {("link_bending", f"link_{k}") for k in range(1, 6)}
    assert names == expected | {("base_compliance", "base")}


def test_study_arm_has_its_own_effects_with_sizes_within_a_third(ground):
    truth = default_truth()
    for number in range(3):
        effects = drawn("study_arm", number, ground)
        assert len(effects) == len(truth.effects) == 33
        for effect, own in zip(effects, truth.effects, strict=True):
            assert (effect.name, effect.where) == (own.name, own.where)
            for parameter in CATALOGUE[effect.name].parameters:
                now = effect.parameters().get(parameter.name)
                then = own.parameters().get(parameter.name)
                if parameter.role == "magnitude" and now and then:
                    assert 0.7 <= now / then <= 1.3
                else:
                    assert now == then
    springs = springs_about(np.random.default_rng(0)) / truth.stiffness
    assert 0.7 <= springs.min() < springs.max() <= 1.3


def test_magnitudes_lie_in_the_usual_range_of_the_catalogue(ground):
    effects = [e for k in range(20) for e in drawn("arm_12", k, ground)]
    assert {e.name for e in effects} == set(STRATA["arm_12"].pool)
    for effect in effects:
        for parameter in CATALOGUE[effect.name].parameters:
            value = effect.parameters().get(parameter.name)
            if parameter.role == "magnitude" and parameter.usual and value:
                usual = parameter.usual
                assert usual.low <= float(value) <= usual.high


@pytest.mark.parametrize("stratum", [name for name in ARMS if STRATA[name].arm_of])
def test_mechanism_outside_is_added_to_the_arms_of_the_stratum_without(stratum, ground):
    without = STRATA[stratum].arm_of
    one, other = (trial_of(0, name, 3) for name in (stratum, without))
    assert one.seed == other.seed
    assert one.instruments == other.instruments
    assert one.stiffness.tolist() == other.stiffness.tolist()
    assert one.name != other.name
    assert drawn(stratum, 3, ground) == drawn(without, 3, ground)


@pytest.mark.parametrize("stratum", TWINS)
def test_effect_and_its_twin_sit_at_two_places(stratum, ground):
    (kind,) = STRATA[stratum].pool
    kind = BY_NAME[kind]
    chance = np.random.default_rng(0)
    pairs = {
        (effect.where, twin)
        for effect, twin in (draw_twins(kind, chance, ground) for _ in range(60))
    }
    assert all(one != other for one, other in pairs)
    assert {(other, one) for one, other in pairs} == pairs


# --- What can be known ----------------------------------------------------------------

POSES = 24


@pytest.fixture(scope="module")
def recorded(kr10):
    """Return a function that records effects with noise and without, on the KR10."""
    plan = standard_plans.table_one_plan(POSES, revisits=4)
    rig, noisy = Rig(kr10), Instruments(markers=Markers(placement=5e-4))

    def of(*effects: Effect) -> tuple[Recording, Recording]:
        own = replace(rig, effects=effects)
        quiet = error_free_instruments(noisy)
        return record(own, plan, noisy, 3), record(own, plan, quiet, 3)

    return of


def test_own_chi2_of_an_effect_alone_is_its_visibility(kr10, recorded: Recorder):
    """The visibility is computed from simulated displacements, without any law."""
    effect = BearingTilt("a2", 2e-6, 1e-6)
    recording, quiet = recorded(effect)
    prepared = prepared_with(kr10, recording)
    oracle = arm_oracle(prepared, quiet, [effect])
    scale = scale_of(Rig(kr10), recorded()[1], (1e-5,) * 3, known_frame=False)
    seen = scale.visibility(quiet).whole
    assert oracle.own[0] == pytest.approx(seen, rel=0.05)
    assert oracle_share(prepared, [effect]) > 0.9


def test_own_chi2_is_small_where_others_take_the_place_of_an_effect(
    kr10, recorded: Recorder
):
    """A zero of the first axis looks like the tracker's unknown frame."""
    effects = [EncoderOffset("a1", 5e-4), Hysteresis("a2", 2e-4)]
    recording, quiet = recorded(*effects)
    oracle = arm_oracle(prepared_with(kr10, recording), quiet, effects)
    assert oracle.own[0] < 1.0
    assert oracle.own[1] > 1000.0


@pytest.mark.parametrize(
    ("coupling", "columns"), [(0.0, {2}), (5e-7, {2, 3})], ids=["aligned", "askew"]
)
def test_law_of_a_true_effect_has_no_size_that_the_effect_has_not(
    kr10, recorded: Recorder, coupling, columns
):
    recording, _ = recorded()
    here = prepared_with(kr10, recording).situation
    terms = true_terms(BearingTilt("a2", 2e-6, 1e-6, uv_rad_per_nm=coupling), here)
    assert {term.jacobian(here).columns for term in terms} == columns


def test_effects_of_one_place_are_lost_together_though_each_takes_the_others_part(
    kr10, recorded: Recorder
):
    effects = [Hysteresis("a2", 2e-4), Creep("a2", 0.05, 120.0)]
    recording, quiet = recorded(*effects)
    prepared = prepared_with(kr10, recording)
    own = arm_oracle(prepared, quiet, effects).own
    parts = {"both": quiet, "loop": recorded(effects[0])[1], "none": recorded()[1]}
    found = displaced(prepared, parts)
    assert found["both"] > 1.2 * sum(own)
    assert found["both"] > found["loop"] > own[0]
    assert abs(found["none"]) < 1e-3 * found["both"]


def test_readings_speak_for_an_effect_against_its_twin(kr10, recorded: Recorder):
    tilt = BearingTilt("a3", 2e-6, 1e-6)
    assert log_bayes_factor(*recorded(tilt), kr10, tilt, "a5") > 100.0


def test_share_of_an_answer_is_that_of_its_names_on_poses_kept_back(
    kr10, recorded: Recorder
):
    recording, _ = recorded(Hysteresis("a2", 2e-4))

    def share(*names):
        named = [
            SimpleNamespace(name=Name(effect, where), shape=shape)
            for effect, where, shape in names
        ]
        found: Any = SimpleNamespace(named=named)
        return linear_share_of(found, recording, arm_of(kr10))

    shares = [share(), share(("creep", "a4", (20.0, 0.0)))]
    shares.append(share(("hysteresis", "a2", (14.0, 1.0))))
    assert shares[0] == 0.0
    assert abs(shares[1]) < 0.1
    assert 0.6 < shares[2] < 1.1  # the loop's shape is a guess
    waves = ("angle_dependent_stiffness", "a2", (2.0, 4.0))
    assert_allclose(
        share(("hysteresis", "a2", (14.0, 1.0)), waves), shares[2], rtol=0.1
    )


def test_true_names_leave_what_a_mechanism_outside_does(kr10, recorded: Recorder):
    effects = (Hysteresis("a2", 2e-4),)
    residuals, shares = [], []
    for more in ((), (Softening("a3", ratio=0.7),)):
        recording, quiet = recorded(*effects, *more)
        prepared = prepared_with(kr10, recording)
        residuals.append(arm_oracle(prepared, quiet, effects).residual)
        shares.append(oracle_share(prepared, effects))
    assert residuals[1] > residuals[0] + 1000.0
    assert shares[1] < shares[0] - 0.1


def test_share_of_true_names_counts_what_they_change_of_each_other(
    kr10, recorded: Recorder
):
    """One layout of columns is too few for a compensator beside a gear that hardens."""
    effects = (
        GravityCompensator("a6", torque_nm=3.5, phase_rad=-2.6),
        Hardening("a6", stiffness_ratio=1.7, torque_nm=1.8),
    )
    recording, _ = recorded(*effects)
    prepared = prepared_with(kr10, recording)
    choices = [true_terms(effect, prepared.situation) for effect in effects]
    model = linear_model_of(prepared, choices, with_shapes=True)
    assert explained_share(model) < oracle_share(prepared, effects) - 0.02
    assert oracle_share(prepared, effects) > 0.97


def test_mechanism_is_drawn_again_until_the_names_leave_enough_of_it(
    tmp_path, monkeypatch
):
    left = iter([0.0, LEAST_LEFT / 2, 0.0, LEAST_LEFT])  # alone, tried, alone, tried

    def oracle(prepared, quiet, effects):
        return ArmOracle(tuple(1.0 for _ in effects), next(left))

    monkeypatch.setattr(generation, "arm_oracle", oracle)
    monkeypatch.setattr(generation, "FEWEST", 5.0)
    monkeypatch.setattr(effects, "FEWEST", 5.0)
    without, outside = (
        generate_trial(trial_of(0, name, 2), tmp_path, 20).truth
        for name in ("arm_6", "arm_6_outside")
    )
    assert outside["effects"][:-1] == without["effects"]
    assert outside["effects"][-1]["where"] == outside["outside"]["where"]
    assert outside["own_chi2"] == (*without["own_chi2"], LEAST_LEFT)
    places = {one["where"] for one in outside["effects"]}
    assert {*outside["place_chi2"]} == places
    assert min(outside["place_chi2"].values()) > 0.0
    assert next(left, None) is None


# --- Marking --------------------------------------------------------------------------

TRUE = ("hysteresis@a2", "bearing_tilt@a3", "creep@a4")


def at(name):
    effect, _, where = name.partition("@")
    return {"effect": effect, "where": where}


def truth_of(own, stratum="arm_6", outside="", names=TRUE):
    effects = [at(n) | {"parameters": {}, "mechanism": "X"} for n in names]
    truth = {"stratum": stratum, "effects": effects, "chi2": own, "own_chi2": own}
    truth["oracle_share"] = 0.99
    where = [one["where"] for one in effects]
    truth["place_chi2"] = dict(zip(where, own, strict=True))
    if outside:
        truth["outside"] = {"where": outside}
    return truth


def answer_of(*names, first="a2", share=0.98, unexplained=()):
    given = [
        at(one) | {"probability": 1.0, "equivalents": [*map(at, more)]}
        for one, *more in names
    ]
    return {
        "verdict": "partly_explained",
        "located": [{"where": first}],
        "named": [one | {"parameters": {}} for one in given],
        "unexplained_places": [{"where": where} for where in unexplained],
        "linear_share": share,
        "explained_share": None,
        "seconds": 8.0,
    }


OWN = [5000.0, 400.0, 20.0]
GIVEN = answer_of(
    ("hysteresis@a2",), ("bearing_tilt@a2", "bearing_tilt@a3"), ("hardening@a1",)
)


def marked(answer, truth, number=0) -> Any:
    label = f"{truth['stratum']} {number}"
    return score_answer(label, f"n{label}", answer, truth)


def test_names_count_with_their_equivalents_and_effects_by_their_own_chi2():
    arm = marked(GIVEN, truth_of(OWN)).arm
    assert dict(arm.names) == {
        "hysteresis@a2": True,
        "bearing_tilt@a2": True,
        "hardening@a1": False,
    }
    assert dict(arm.visible) == {"hysteresis@a2": True, "bearing_tilt@a3": True}
    assert (arm.share, arm.oracle, arm.outside) == (0.98, 0.99, None)


def test_first_place_is_that_whose_effects_lose_most_chi2():
    assert marked(GIVEN, truth_of(OWN)).arm.place_first
    assert not marked(GIVEN, truth_of([40.0, 50.0, 2000.0])).arm.place_first
    together = truth_of(OWN) | {"place_chi2": {"a2": 5e3, "a3": 4e2, "a4": 9e3}}
    assert not marked(GIVEN, together).arm.place_first


def test_first_place_may_be_that_of_an_equivalent_of_a_name_there():
    """The tilt at a2 has that at a3 as an equivalent."""
    assert marked(GIVEN, truth_of([400.0, 5000.0, 20.0])).arm.place_first
    other = GIVEN | {"located": [{"where": "a1"}]}
    assert not marked(other, truth_of([400.0, 5000.0, 20.0])).arm.place_first


def test_proof_counts_before_the_linear_model():
    proved = GIVEN | {"explained_share": {"estimate": 0.91}}
    assert marked(proved, truth_of(OWN)).arm.share == 0.91


def test_failed_answer_names_nothing_and_explains_nothing():
    score = marked({"failed": "Unusable"}, truth_of(OWN))
    assert score.arm.names == ()
    assert score.arm.share is None
    assert [hit for _, hit in score.arm.visible] == [False, False]
    assert score in failures([score])


def with_and_without():
    """One arm without and with a mechanism outside, which costs it a name."""
    without = marked(GIVEN, truth_of(OWN))
    names = (*TRUE, "softening@a1")
    truth = truth_of([*OWN, 900.0], "arm_6_outside", "a1", names)
    answer = answer_of(("hysteresis@a2",), share=0.8, unexplained=("a5", "a1"))
    return [without, marked(answer, truth)]


def test_mechanism_outside_is_no_name_to_be_given_but_a_place_to_be_said():
    _, outside = with_and_without()
    assert outside.truth == tuple(sorted(TRUE))
    assert outside.arm.outside
    named = answer_of(("softening@a1",))
    truth = truth_of([*OWN, 900.0], "arm_6_outside", "a1", (*TRUE, "softening@a1"))
    assert marked(named, truth).arm.names == (("softening@a1", False),)


def test_names_lost_are_those_that_the_same_arm_without_it_got():
    scores = with_and_without()
    assert lost_names(scores, scores[1:]) == [False, True]
    assert lost_names(scores[1:], scores[1:]) == []


def test_every_stratum_of_whole_arms_has_bars():
    assert sorted(name for bar in ARM_BARS for name in bar.strata) == sorted(ARMS)


def test_rates_of_arms_count_names_effects_places_and_shares():
    rates = {r.what: (r.successes, r.trials) for r in arm_bars(with_and_without())}
    assert rates["names that are false: whole arms"] == (1, 3)
    assert rates["effects with an own χ² of 100 or more named: whole arms"] == (2, 2)
    assert rates["arms of which 97% are explained: whole arms"] == (1, 1)
    assert rates["largest place first: whole arms"] == (1, 1)
    end = "whole arms with a mechanism outside"
    assert rates[f"places outside the vocabulary said: {end}"] == (1, 1)
    assert rates[f"right names lost by it: {end}"] == (1, 2)


@pytest.mark.parametrize(
    ("factor", "names", "good"),
    [
        (0.5, ("drift@base", "drift@tracker"), True),
        (0.5, ("drift@base",), False),
        (50.0, ("drift@base", "drift@tracker"), False),
        (50.0, ("drift@base",), True),
        (5.0, ("drift@base",), True),
    ],
)
def test_twins_are_to_be_declared_where_readings_do_not_tell_them(factor, names, good):
    truth = {
        "stratum": "alike_drift",
        "effects": [at("drift@base") | {"parameters": {}, "mechanism": "Drift"}],
        "chi2": [900.0],
        "twin": "tracker",
        "log_bayes_factor": factor,
    }
    score = marked(answer_of(names), truth)
    assert (score not in failures([score])) == good
    counted = [r.successes == r.trials for r in twin_bars([score]) if r.trials]
    assert counted == ([] if factor == 5.0 else [good])


def test_report_has_a_table_of_whole_arms(tmp_path):
    report.write(tmp_path, with_and_without(), {})
    text = (tmp_path / "report.md").read_text("utf-8")
    assert "| arm_6 | 1 | 3 | 2 of 2 | 2 | 1 | 98.0% (98.0%) | 99.0% | 1 | – |" in text
    arms = (tmp_path / "arms.csv").read_text("utf-8").splitlines()
    assert arms[1].startswith("arm_6 0,2,,3,hardening@a1,0.98,0.99,1,,")
