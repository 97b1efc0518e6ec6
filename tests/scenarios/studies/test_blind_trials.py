import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_bench import recording

from bench import standard_plans
from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.creep import Creep
from bench.effects.hysteresis import Hysteresis
from bench.effects.out_of_library import OUT_OF_LIBRARY_EFFECTS
from bench.effects.places import misplaced
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.rig import Rig
from bench.shared.errors import BenchError, Unusable
from bench.shared.plan import DEFAULT_PATH
from bench.standard_plans import tour
from scenarios import blind_trials
from scenarios.studies.blind_trials import run as sweeping
from scenarios.studies.blind_trials.arms import BUILDS, arm_of
from scenarios.studies.blind_trials.effects import (
    PERIODIC,
    Ground,
    OutOfReach,
    as_large_as,
    draw_site_and_form,
    knees_of,
    scaled,
    turning,
)
from scenarios.studies.blind_trials.generation import (
    error_free_instruments,
    generate_trial,
    kinds_of,
    trial_of,
)
from scenarios.studies.blind_trials.method_under_test import (
    Question,
    Settings,
    answered,
    main,
)
from scenarios.studies.blind_trials.rates import paired_answers
from scenarios.studies.blind_trials.run import (
    Sweep,
    Tried,
    ask,
    digest,
    nudged,
    opened,
    run_trials,
)
from scenarios.studies.blind_trials.strata import SINGLE, STRATA
from scenarios.studies.blind_trials.visibility import (
    Visibility,
    in_base,
    projection_of,
    scale_of,
)

KINDS = (*EFFECTS, *OTHER_LAWS, *OUT_OF_LIBRARY_EFFECTS)
NO_MISMATCH = {"verdict": "no_mismatch", "seconds": 1.0}

# --- Drawing -------------------------------------------------------------------------


def drawing(trial):
    """Return everything of a trial that does not depend on a simulation."""
    draw = np.random.default_rng(trial.chance)
    kinds = [kind.__name__ for kind in kinds_of(trial, draw, 0)]
    return trial.name, trial.seed, trial.stiffness.tolist(), trial.instruments, kinds


def test_trial_is_the_same_however_many_are_asked_for():
    few = [(number, name) for number in range(2) for name in ("one_400", "null")]
    many = [(number, name) for number in range(4) for name in STRATA]
    drawn = {one: drawing(trial_of(5, one[1], one[0])) for one in few}
    again = {one: drawing(trial_of(5, one[1], one[0])) for one in many}
    assert drawn == {one: again[one] for one in few}


def test_trials_differ_by_seed_kind_and_number():
    drawn_ones = [(0, "one_400", 0), (1, "one_400", 0), (0, "one_100", 0)]
    drawn_ones.append((0, "one_400", 1))
    assert len({trial_of(*one).seed for one in drawn_ones}) == len(drawn_ones)
    assert len({trial_of(*one).name for one in drawn_ones}) == len(drawn_ones)


def test_name_of_a_trial_does_not_tell_its_kind():
    names = {trial_of(0, stratum, 0).name for stratum in STRATA}
    assert len(names) == len(STRATA)
    assert not any(stratum[:3] in name for name in names for stratum in STRATA)


def test_stiffness_is_off_by_up_to_three_either_way():
    factors = np.array([trial_of(0, "null", k).stiffness for k in range(200)])
    assert np.all((factors > 1 / 3) & (factors < 3))
    assert np.min(factors) < 0.36  # 1200 draws reach both ends
    assert np.max(factors) > 2.8


@pytest.mark.parametrize("arm", ["kr10", *BUILDS])
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_effect_is_drawn_where_it_can_sit_and_can_be_any_size(kind, arm, tmp_path):
    rig = Rig(arm_of(arm, 1, tmp_path).file)
    hinges = turning(rig.anatomy, rig.nominal.jnt_range.T)
    ground = Ground(rig.anatomy, ["link2_a"], 1000.0, knees_of(rig), hinges)
    draw = np.random.default_rng(1)
    for _ in range(5):
        effect = draw_site_and_form(kind, draw, ground)
        assert misplaced(effect, rig.anatomy) == []
        smaller = scaled(effect, 0.25)
        before, after = effect.parameters(), smaller.parameters()
        assert before != after
        assert_allclose_parameters(scaled(smaller, 4.0).parameters(), before)


@pytest.mark.parametrize("kind", PERIODIC, ids=lambda kind: kind.__name__)
def test_what_comes_again_is_drawn_only_where_an_axis_turns(kind):
    rig = Rig(trial_of(0, "null", 0).robot)
    posture = tour(rig, 151, DEFAULT_PATH, 0, 1).posture
    turns = turning(rig.anatomy, posture)
    assert turns == ("a1", "a2", "a3", "a5", "a6")  # Table 1 leaves a4 at rest
    ground = Ground(rig.anatomy, [], 1000.0, knees_of(rig), turns)
    draw = np.random.default_rng(1)
    assert {draw_site_and_form(kind, draw, ground).where for _ in range(60)} == set(
        turns
    )


def assert_allclose_parameters(one, other):
    """Compare parameters, some of which are names."""
    for name, value in one.items():
        if isinstance(value, str):
            assert value == other[name]
        else:
            assert_allclose(value, other[name], rtol=1e-9)


def test_size_that_no_gear_has_is_out_of_reach():
    with pytest.raises(OutOfReach, match="creep at a2"):
        scaled(Creep("a2"), 100.0)


# --- Size ----------------------------------------------------------------------------


def test_size_is_found_where_an_effect_shows_what_is_asked():
    def weigh(effect):
        return Visibility(2e18 * effect.parameters()["width_rad"] ** 2, 0.0, 0.0, 50.0)

    effect, weight = as_large_as(Hysteresis("a2"), 400.0, weigh)
    assert 400.0 <= weight.chi2 <= 500.0
    assert weight == weigh(effect)


def test_effect_that_few_poses_show_is_drawn_again():
    with pytest.raises(OutOfReach, match="19 poses"):
        as_large_as(
            Hysteresis("a2"), 400.0, lambda effect: Visibility(450.0, 0.0, 0.0, 19.0)
        )


def test_projection_is_generalised_least_squares():
    """χ² of the rest of a fit with the whole covariance written out."""
    draw = np.random.default_rng(0)
    nominal, error = draw.normal(size=(4, 6, 3)), draw.normal(size=(4, 6, 2))
    signal, prior = draw.normal(size=(4, 6)), np.array([1e-9, 1.0, 4.0])
    found, share = projection_of(
        nominal, error, prior, np.array([7, 7, 8, 9])
    ).residual(signal)
    covariance = np.zeros((24, 24))
    for v in range(4):
        block = slice(6 * v, 6 * v + 6)
        covariance[block, block] = np.eye(6) + error[v] @ error[v].T
    flat = nominal.reshape(24, 3)
    covariance += flat @ np.diag(1.0 / prior) @ flat.T  # a prior is more noise
    asked = signal.ravel()
    assert_allclose(found, asked @ np.linalg.solve(covariance, asked), rtol=1e-5)
    assert share.shape == (3,)


@pytest.fixture(scope="module")
def small(kr10):
    """A few poses of Table 1, the arm, silent instruments and a scale for effects."""
    instruments = error_free_instruments(Instruments(markers=Markers(placement=5e-4)))
    rig, plan = Rig(kr10), standard_plans.table_one_plan(12, revisits=2)
    reference = record(rig, plan, instruments, 3)
    scale = scale_of(rig, reference, (1e-5,) * 3, known_frame=False)
    return rig, plan, instruments, scale


def seen(small, *effects, stiffness=None):
    rig, plan, instruments, _ = small
    return record(
        replace(rig, effects=effects, stiffness=stiffness), plan, instruments, 3
    )


@pytest.mark.parametrize("axis", range(6))
def test_softer_spring_moves_markers_as_its_column_says(small, axis):
    rig, _, _, scale = small
    stiffness = rig.springs.copy()
    stiffness[axis] /= 1.001
    moved = in_base(seen(small, stiffness=stiffness)) - in_base(scale.reference)
    column = 0.001 * scale.standing.turned(axis).reshape(moved.shape)
    felt = scale.standing.wrench(seen(small, stiffness=stiffness))
    moved -= scale.standing.response(felt - scale.standing.wrench(scale.reference))
    left = np.linalg.norm(moved - column) / np.linalg.norm(column)
    assert left < 0.03  # levers change by the deflection of the other axes


def test_what_is_nominal_weighs_a_thousandth_of_what_it_moves(small):
    rig, _, _, scale = small
    softer = seen(small, stiffness=rig.springs / np.linspace(1.002, 1.01, 6))
    moved = in_base(softer) - in_base(scale.reference)
    assert scale.visibility(softer).whole < 1e-3 * np.sum((moved / 1e-5) ** 2)


def test_markers_that_sit_elsewhere_weigh_nothing(small):
    rig, plan, instruments, scale = small
    elsewhere = replace(instruments, markers=Markers(placement=6e-4))
    weight = scale.visibility(record(rig, plan, elsewhere, 3))
    moved = np.sum((1e-4 / 1e-5) ** 2) * scale.reference.points.size
    assert weight.whole < 0.01 * moved  # half of a thousandth is the prior's


def test_twice_the_creep_weighs_four_times_as_much(small):
    scale = small[3]
    once = scale.visibility(seen(small, Creep("a2", 0.01)))
    twice = scale.visibility(seen(small, Creep("a2", 0.02)))
    assert_allclose(twice.within / once.within, 4.0, rtol=0.02)
    assert once.chi2 == max(once.within, once.between) <= once.whole * 1.001


# --- Making and asking ---------------------------------------------------------------


PUBLISHED = (
    (0.0429526572, -1.0858694055, 2.5676613706),
    (-0.2581906708, 0.0731657125, 2.3714893900),
    (0.2946456564, -0.1278120465, 2.0270235590),
)
"""Readings of the flange's last mark in m at start, half-time and end, as published."""


@pytest.fixture(scope="module")
def scaled_tracker(tmp_path_factory):
    """A generated trial whose tracker has another scale."""
    number = SINGLE.index("tracker_scale")
    folder = tmp_path_factory.mktemp("models")
    return generate_trial(trial_of(0, "one_400", number), folder, 60)


def test_trial_is_at_least_as_large_as_its_kind_asks_and_conceals_what_it_is(
    scaled_tracker,
):
    made = scaled_tracker
    assert 400.0 <= made.truth["chi2"][0] <= 500.0
    assert [e["effect"] for e in made.truth["effects"]] == ["tracker_scale"]
    assert made.recording.base_from_tracker is None
    assert made.recording.link_posture is None
    number = SINGLE.index("tracker_scale")
    assert made.recording.name == trial_of(0, "one_400", number).name
    hidden = np.isnan(np.asarray(made.recording.points))
    assert hidden.mean() == pytest.approx(0.02, abs=0.005)


def test_generated_trial_is_the_published_one_to_a_nanometre(scaled_tracker):
    points = np.asarray(scaled_tracker.recording.points)
    rows = [0, len(points) // 2, len(points) - 1]
    assert_allclose(points[rows, -1], PUBLISHED, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("build", BUILDS)
def test_arm_of_another_build_is_another_with_each_seed_and_can_be_tried(
    build, tmp_path
):
    one, other = (arm_of(build, seed, tmp_path) for seed in (1, 2))
    assert one.file.read_text() != other.file.read_text()
    assert len(Rig(one.file).anatomy.axes) == one.axes == len(BUILDS[build])
    number = SINGLE.index("tracker_scale")
    made = generate_trial(trial_of(0, "one_400", number, one), tmp_path, 40)
    assert 400.0 <= made.truth["chi2"][0] <= 500.0
    assert made.model == one.file


def test_model_is_rigid_where_a_compliance_is_the_finding(tmp_path):
    number = SINGLE.index("joint_compliance")
    made = generate_trial(trial_of(0, "one_400", number), tmp_path, 60)
    (effect,) = made.truth["effects"]
    stiffness = Rig(made.model).nominal.jnt_stiffness
    axis = Rig(made.model).anatomy.axes.index(effect["where"])
    assert np.flatnonzero(stiffness == 0.0).tolist() == [axis]


def test_lag_of_its_stratum_goes_with_the_share_of_the_move_alone(tmp_path):
    made = generate_trial(trial_of(0, "share_lag", 0), tmp_path, 40)
    (effect,) = made.truth["effects"]
    assert effect["effect"] == "reading_lag"
    sizes = effect["parameters"]
    assert sizes["lag_rad"] == 0.0 != sizes["share_lag_rad"]
    assert 400.0 <= made.truth["chi2"][0] <= 50_000.0


STRATA_TRIED = ("null", "null_nuisance")


@pytest.fixture(scope="module")
def stubbed(tmp_path_factory):
    """A sweep of two trials in which nothing was there, and what could be read of it.

    The method under test is a stub that always sees nothing.
    """
    readable, folder = [], tmp_path_factory.mktemp("sweep")

    def asked(question):
        near = Path(question.answer).parent.rglob("*")
        readable.append({p.name for p in (*near, *folder.rglob("*")) if p.is_file()})
        answer = NO_MISMATCH | {"truth_sha256": question.truth_sha256}
        Path(question.answer).write_text(json.dumps(answer), encoding="utf-8")

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sweeping, "ask", asked)
        sweep = Sweep(folder, poses=4, jobs=0)
        assert list(run_trials(sweep, STRATA_TRIED, 0, 1)) == [0, 1, 1]
    return folder, readable


@pytest.fixture
def finished(stubbed, tmp_path):
    """A copy of that sweep."""
    return Sweep(shutil.copytree(stubbed[0], tmp_path / "sweep"), poses=4, jobs=0)


def test_truth_is_on_no_disk_while_the_method_answers(stubbed):
    """Of the trial itself; the second sees the finished row of the first."""
    first, second = stubbed[1]
    assert first == {"samples.csv", "recording.toml"}
    assert {name.partition(".")[2] for name in second - first} == {"jsonl"}


@pytest.mark.parametrize("kind", ["answer", "truth"])
def test_what_was_changed_after_it_was_sealed_is_refused(finished, kind):
    row = next(iter(finished.rows.read().values()))
    answer, truth, _ = opened(row)
    assert (answer["verdict"], truth["stratum"]) == ("no_mismatch", "null")
    changed = {**row, kind: {**row[kind], "recording": "another"}}
    with pytest.raises(Unusable, match=f"the {kind} of trial .* not the one"):
        opened(changed)
    with pytest.raises(Unusable, match="is no result of a blind trial"):
        opened({**row, kind: "copied from elsewhere"})


def test_answer_that_was_given_before_the_truth_was_fixed_is_refused(finished):
    row = next(iter(finished.rows.read().values()))
    truth = {**row["truth"], "number": 7}
    later = {**row["seal"], "truth_sha256": digest(truth)}
    with pytest.raises(Unusable, match="does not seal its truth"):
        opened({**row, "truth": truth, "seal": later})


def test_slices_of_two_machines_are_the_whole(finished, monkeypatch):
    (file,) = finished.rows.folder.iterdir()
    first, second = file.read_text().splitlines(keepends=True)
    file.write_text(first)
    (finished.rows.folder / "of_another_machine.jsonl").write_text(second)
    monkeypatch.setattr(sweeping, "tried", None)  # nothing may be carried out again
    assert list(run_trials(finished, STRATA_TRIED, 0, 1)) == [2]
    assert list(run_trials(finished, STRATA_TRIED[1:], 0, 1)) == [1]


def test_slice_begins_where_it_is_told(tmp_path, monkeypatch):
    begun = []

    def tried(request, _shared):
        begun.append((request.stratum, request.number))
        return Tried({"key": f"{request.number}"})

    monkeypatch.setattr(sweeping, "tried", tried)
    list(run_trials(Sweep(tmp_path, jobs=0), ("null", "removed"), 3, 2))
    assert begun == [(s, n) for n in (3, 4) for s in ("null", "removed")]


def test_answer_names_what_went_wrong_instead_of_stopping(tmp_path):
    question = Question(str(tmp_path / "none"), str(tmp_path / "none.xml"), "", "")
    assert "There is no model file" in json.loads(answered(question))["failed"]


def test_method_under_test_refuses_questions_that_are_none(monkeypatch):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=[b"{}\n"]))
    with pytest.raises(Unusable, match="missing required field"):
        main(Settings())


@pytest.mark.slow
def test_process_that_answers_puts_the_hash_it_was_given_into_its_answer(tmp_path):
    """Two questions, one process; it ends when it is asked something else."""
    recording, model, file = (str(tmp_path / n) for n in ("none", "none.xml", "answer"))
    for given in ("ab", "cd"):
        ask(Question(recording, model, file, given))
        answer = json.loads((tmp_path / "answer").read_text())
        assert answer["truth_sha256"] == given
        assert answer["failed"]
    with pytest.raises(
        BenchError, match=r"The diagnosis stopped: (?s:.*)A question cannot"
    ):
        ask({})  # pyright: ignore[reportArgumentType]


# --- The scenario --------------------------------------------------------------------


def settings(folder, **others):
    return blind_trials.Settings(
        folder, trials=1, strata=STRATA_TRIED, poses=4, jobs=0, **others
    )


def test_finished_trials_are_kept_and_reported(finished, monkeypatch, capsys):
    folder = finished.folder
    (rows,) = finished.rows.folder.iterdir()
    before = rows.read_bytes()
    monkeypatch.setattr(sweeping, "tried", None)  # nothing may be carried out again
    found = blind_trials.main(settings(folder))
    assert [s.detected for s in found] == [False, False]
    summary = json.loads((folder / "summary.json").read_text())
    command = json.loads((folder / "run.json").read_text())["command"]
    assert "--strata null null_nuisance" in command
    assert summary["failures"] == []
    assert (summary["bars"][0]["trials"], summary["bars"][0]["met"]) == (2, True)
    for name in ("report.html", "report.md", "confusion.csv", "confusion.png"):
        assert (folder / name).stat().st_size > 0
    told = (folder / "report.md").read_text()
    assert "No trial fails a bar." in told
    assert (
        "| null_nuisance | nothing there, but instruments at their worst | 1 |" in told
    )
    assert "|---|\n\n" not in told
    assert rows.read_bytes() == before
    assert "met    detected: null and null_nuisance: 0/2" in capsys.readouterr().out


def test_marks_are_compared_with_those_of_another_run_of_the_same_trials(finished):
    own = finished.folder
    blind_trials.main(settings(own))
    blind_trials.main(settings(own, against=own))
    against = json.loads((own / "summary.json").read_text())["against"]
    assert [(r["stratum"], r["before"], r["after"]) for r in against] == [
        ("null", 1, 1),
        ("null_nuisance", 1, 1),
    ]
    assert "| null_nuisance | detected | 1 | 1 | 1 |" in (own / "report.md").read_text()
    answers = json.loads((own / "summary.json").read_text())["answers_against"]
    assert [(a["trial"], a["differ"], a["largest"]) for a in answers] == [
        ("null 0", [], 0.0),
        ("null_nuisance 0", [], 0.0),
    ]
    with pytest.raises(BenchError, match="has --seed 0, this run 1: other trials"):
        blind_trials.main(settings(own.parent / "other", seed=1, against=own))
    with pytest.raises(BenchError, match="is no run of blind trials"):
        blind_trials.main(settings(own.parent / "other", against=own.parent))


def answer_of(size: float, where: str = "a2", open_at: str = "") -> dict[str, Any]:
    """Make an answer with one name, a size with its interval, and a place left open."""
    size_of = {"estimate": size, "low": size - 1e-3, "high": size + 1e-3}
    name = {
        "effect": "hysteresis",
        "where": where,
        "parameters": {"width_rad": size_of},
    }
    places = [{"where": open_at}] if open_at else []
    return {"verdict": "explained", "named": [name], "unexplained_places": places}


@pytest.mark.parametrize(
    ("other", "differ", "largest"),
    [
        (answer_of(2.0), (), 0.0),
        (answer_of(2.0 + 1e-7), (), 5e-8),
        (answer_of(2.0 + 1e-5), ("numbers",), 5e-6),
        (answer_of(2.0, where="a3"), ("names",), 0.0),
        (answer_of(2.0, open_at="a4"), ("open places",), 0.0),
        ({"failed": "no"}, ("verdict", "names"), 0.0),
    ],
)
def test_answers_of_two_runs_are_compared_to_the_digits_that_count(
    other, differ, largest
):
    truth = {"stratum": "null", "number": 3}
    mine = {"k": {"truth": truth, "answer": answer_of(2.0)}, "alone": {}}
    (found,) = paired_answers(mine, {"k": {"answer": other}})
    assert (found.trial, found.differ) == ("null 3", differ)
    assert found.largest == pytest.approx(largest, rel=1e-3)


def test_difference_of_a_size_near_nothing_is_one_of_its_interval():
    truth = {"stratum": "null", "number": 3}
    mine = {"k": {"truth": truth, "answer": answer_of(1e-15)}}
    (found,) = paired_answers(mine, {"k": {"answer": answer_of(-1e-15)}})
    assert found.differ == () and found.largest == pytest.approx(2e-12)


def test_another_axis_is_a_whole_difference():
    answers = []
    for axis in ("a4", "a4", "a5"):
        answers.append(answer_of(2.0))
        with_axis = dict.fromkeys(("estimate", "low", "high"), axis)
        answers[-1]["named"][0]["parameters"]["with"] = with_axis
    truth = {"stratum": "null", "number": 3}
    mine = {"k": {"truth": truth, "answer": answers[0]}}
    same, other = (paired_answers(mine, {"k": {"answer": a}})[0] for a in answers[1:])
    assert same.differ == () and same.largest == 0.0
    assert other.differ == ("numbers",) and other.largest == 1.0


def test_readings_are_nudged_by_less_than_is_asked_and_all_alike_again():
    made = recording("hysteresis@a2")
    once, again = nudged(made, 1e-9), nudged(made, 1e-9)
    assert made.points is not None and once.points is not None
    moved = np.abs(once.points - made.points)
    assert 0.0 < np.nanmax(moved) <= 1.01e-12
    assert_array_equal(once.points, again.points)
    assert nudged(made, 0.0) is made


def test_folder_of_another_seed_is_refused(finished):
    blind_trials.main(settings(finished.folder))
    with pytest.raises(Unusable, match="it holds trials of kr10, seed 0, 4 poses"):
        blind_trials.main(settings(finished.folder, seed=1))


def test_wrong_flags_are_named_all_at_once(tmp_path):
    wrong = blind_trials.Settings(tmp_path / "x", trials=0, seed=-1, strata=("nul",))
    with pytest.raises(BenchError) as caught:
        blind_trials.main(wrong)
    assert [word in str(caught.value) for word in ("--trials", "--seed", "'null'")] == [
        True
    ] * 3
    assert not (tmp_path / "x").exists()
