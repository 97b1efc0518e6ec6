"""What a notebook calls: public names, results that explain themselves, commands."""

import json
import runpy
from dataclasses import asdict, replace
from importlib import import_module

import numpy as np
import pytest
from asked_once import once
from recordings import write_good
from source import ROOT, imports, text

import bench
import stiffness
from bench.shared.errors import UnknownName, Unusable
from bench.shared.settings import SETTINGS
from scenarios import pipelines
from scenarios.pipelines import diagnosis as pipeline
from scenarios.pipelines import schema
from scenarios.pipelines.inputs import arm_of, facts_of
from scenarios.report import command_line
from stiffness.diagnosis import diagnose as engine
from stiffness.diagnosis.result import (
    Decision,
    Detection,
    Diagnosis,
    Interval,
    Name,
    NamedEffect,
    Nominal,
    Rival,
    Warned,
    strongest_withheld,
)

KR10 = "mjcf/kr10_r1100_2/kr10_r1100_2.xml"

# --- Public names ---------------------------------------------------------------------


@pytest.mark.parametrize("package", ["bench", "stiffness", "scenarios.pipelines"])
def test_public_names_are_there_and_type_checkers_find_the_same(package):
    door = import_module(package)
    stated = set(imports(text(f"{package.replace('.', '/')}/__init__.py"), package))
    assert dir(door) == list(door.__all__) == sorted(door.__all__)
    for name in set(door.__all__) - set(vars(door)):
        [home] = {n for n in stated if n.rpartition(".")[2] == name}
        module, _, own = home.rpartition(".")
        same = getattr(import_module(module), own)
        assert getattr(door, name) is same, name


@pytest.mark.parametrize("package", [bench, stiffness])
def test_a_name_that_is_none_is_an_attribute_error(package):
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = package.nothing


@pytest.mark.parametrize("file", [KR10, "mjcf/ur10/ur10.xml"])
def test_a_model_has_the_names_and_limits_that_claims_read_of_it(file):
    """Each side reads them for itself."""
    facts = bench.load_model(ROOT / file).facts
    claimed = facts_of(arm_of(ROOT / file))
    assert (facts.joints, facts.slides) == (claimed.joints, claimed.slides)
    assert np.array_equal(facts.lower, claimed.lower)
    assert np.array_equal(facts.upper, claimed.upper)
    assert set(facts.bodies) == set(claimed.bodies)


def test_a_model_without_joints_is_refused_under_its_own_name(tmp_path):
    file = tmp_path / "stone.xml"
    body = '<body name="stone"><geom size="0.1"/></body>'
    file.write_text(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    with pytest.raises(Unusable, match=r"stone\.xml' cannot be used") as caught:
        arm_of(file)
    assert caught.value.faults[0].startswith("it has no joint")


def test_effects_that_the_robot_has_no_place_for_are_refused_by_name():
    model = bench.load_model(ROOT / KR10)
    nowhere = [bench.effects.Hysteresis("a9"), bench.effects.LinkBending("a2")]
    with pytest.raises(Unusable, match=r"(?s)2 faults.*'a9'.*'a2'"):
        bench.simulate(model, bench.plan(poses=1), nowhere)


def test_a_recording_brings_its_notes(tmp_path):
    folder = write_good(tmp_path / "good")
    table = (folder / "samples.csv").read_text().splitlines()
    table = [f"{line},{'remark' if k == 0 else 1}" for k, line in enumerate(table)]
    (folder / "samples.csv").write_text("\n".join(table) + "\n")
    [note] = bench.read(folder).notes
    assert "remark" in note


def test_a_recording_is_read_against_a_model_s_file_and_says_what_it_is(tmp_path):
    folder = write_good(tmp_path / "good")
    read = bench.read(folder, ROOT / KR10)
    assert repr(read) == repr(bench.read(folder, bench.load_model(ROOT / KR10)))
    assert len(repr(read)) < 150
    assert f"{len(read.time)} rows of plateaus" in repr(read)


@pytest.mark.slow
def test_the_example_runs_from_its_first_cell_to_its_last(monkeypatch, capsys):
    """It finds what it concealed, and its patch holds in a later recording.

    Both ways to ask for the diagnosis ask the same, and it is worked out once.
    """
    monkeypatch.chdir(ROOT)
    diagnose = once(engine.diagnose)
    for module in (engine, pipeline):
        monkeypatch.setattr(module, "diagnose", diagnose)
    seen = runpy.run_path("scenarios/examples/first_diagnosis.py")
    result, found, proof = seen["result"], seen["found"], seen["proof"]
    assert [(n.effect, n.where) for n in result.answer.named] == [("hysteresis", "a2")]
    assert seen["width"].low < 3e-4 < seen["width"].high
    assert {n.name for n in found.named} == {Name("hysteresis", "a2")}
    assert proof.markers.low > 0.0
    assert repr(result) in capsys.readouterr().out
    assert 4 <= len(repr(result).splitlines()) <= 6
    assert len(seen["figure"].axes) == 2
    assert seen["page"].is_file()
    written = json.loads((seen["page"].parent / "diagnosis.json").read_text("utf-8"))
    assert written == json.loads(schema.text_of(result.answer))
    assert written["settings"] == asdict(SETTINGS)
    with pytest.raises(UnknownName, match="a7"):
        result.figure("a7")


# --- A diagnosis explains itself ------------------------------------------------------


@pytest.fixture
def found():
    """A diagnosis as the engine gives it, by hand."""
    return Diagnosis(
        recording="by hand",
        verdict="partly_explained",
        detection=Detection(2e-4, 3e-5, 1.7e-5, 5e-7),
        named=(
            NamedEffect(
                Name("hysteresis", "a2"),
                0.98,
                (Name("lost_motion", "a2"),),
                {"width_rad": Interval(1.5e-4, 1.3e-4, 1.7e-4)},
            ),
        ),
        rivals=(Rival(0.011, (Name("link_bending", "link_2"),)),),
        nominal=Nominal(
            *(np.ones(6), np.zeros(6), np.ones(6), (), np.eye(4), np.zeros((0, 3))),
            *(1.0, np.zeros(6)),
        ),
        decisions=(
            Decision(("creep", "a3"), "log_evidence", True, 9.0, 0.0, "worth more"),
            Decision(("creep", "a3"), "left_out", False, 0.14, 0.02, "no gain"),
            Decision(("drift", "base"), "magnitude", False, 0.0, 0.0, "may be nothing"),
        ),
    )


def test_a_diagnosis_states_itself_in_five_lines(found):
    lines = repr(found).splitlines()
    assert len(lines) == 5
    assert "'by hand': partly explained" in lines[0]
    assert "30.0 µm" in lines[1]
    assert "hysteresis at a2, probability 0.980: width_rad 0.00015 (0.00013" in lines[3]


def test_a_mismatch_is_stated_as_readings_are_and_as_most_proofs_compare_them(found):
    sizes = {"within_rms": 2e-5, "noise_within_rms": 1.6e-5}
    both = replace(found, detection=replace(found.detection, **sizes))
    said = "by 30.0 µm, noise alone leaves 17.0 µm"
    assert repr(found).splitlines()[1].endswith(f"{said}.")
    assert f"{said}; within visits 20.0 µm and 16.0 µm." in repr(both)


def test_a_name_gives_its_parameters_and_one_that_is_not_there_its_reason(found):
    assert found["hysteresis", "a2"].parameters["width_rad"].low == 1.3e-4
    with pytest.raises(KeyError, match=r"do as well in 0\.14"):
        _ = found["creep", "a3"]


@pytest.mark.parametrize(
    ("effect", "where", "reason"),
    [
        ("creep", "a3", "do as well in 0.14, less than 0.02 is needed"),
        ("drift", "base", "May be nothing."),
        ("lost_motion", "a2", "do as well as hysteresis at a2"),
        ("hysteresis", "a2", "It is named: hysteresis at a2, probability 0.980"),
        ("link_bending", "link_2", "has a probability of 0.011; 0.95 is needed"),
        ("encoder_offset", "a1", "No gate has decided on encoder_offset at a1"),
    ],
)
def test_why_a_name_was_withheld_is_said_with_its_numbers(found, effect, where, reason):
    assert reason in found.why_not(effect, where)


def test_names_that_came_furthest_are_the_strongest_that_were_withheld(found):
    stopped = strongest_withheld(found)
    assert [d.candidate[0] for d in stopped] == ["creep", "drift"]
    assert [d.gate for d in stopped] == ["left_out", "magnitude"]
    many = [replace(stopped[0], candidate=("creep", f"a{k}")) for k in range(9)]
    assert len(strongest_withheld(replace(found, decisions=tuple(many)))) == 5


def test_targets_that_are_hidden_under_every_load_get_a_report_all_the_same(tmp_path):
    model = bench.load_model(ROOT / KR10)
    seen = bench.simulate(model, bench.plan(poses=6), seed=1)
    assert seen.points is not None and seen.load_mass is not None
    points = np.where((seen.load_mass > 0.0)[:, None, None], np.nan, seen.points)
    result = pipelines.diagnose(replace(seen, points=points), model)
    assert result.report(tmp_path / "answer").is_file()


def test_why_nothing_was_looked_for_is_said(found):
    calm = replace(found, verdict="no_mismatch", named=())
    assert "0.005 is needed" in calm.why_not("creep", "a3")
    wrong = (Warned("axis_reversed", "a3", "a3 is counted backwards."),)
    stopped = replace(found, nominal=None, named=(), warnings=wrong)
    assert stopped.why_not("creep", "a3").endswith("a3 is counted backwards.")


def test_an_effect_that_nobody_knows_is_named_with_the_nearest(found):
    with pytest.raises(UnknownName, match="Did you mean 'creep'"):
        found.why_not("crepe", "a3")


def test_an_answer_of_any_engine_says_why_too():
    detected = schema.Detected(1e-3, 0.1, 0.01, 0.001)
    at = schema.At("lost_motion", "a2")
    named = schema.Called("hysteresis", "a2", 0.99, (at,), {})
    answer = schema.Answer(
        schema=1,
        recording="r",
        verdict="explained",
        detection=detected,
        located=(),
        explained_share=None,
        named=(named,),
        rivals=(),
        unexplained=None,
        confounded=(),
        warnings=(),
        proof_requested=True,
        proof=None,
        next_experiments=(),
        seconds=1.0,
    )
    gate = "regions_left_out"
    refused = (Decision(("drift", "base"), gate, False, 0.3, 2.0, "no gain"),)
    ask = {
        ("drift", "base"): "gain there is 0.3 standard errors, 2 are needed",
        ("hysteresis", "a2"): "It is named",
        ("lost_motion", "a2"): "as well as hysteresis at a2",
        ("creep", "a1"): "No gate has decided on creep at a1",
    }
    for (effect, where), reason in ask.items():
        assert reason in schema.why_not(answer, refused, effect, where)


# --- The command ----------------------------------------------------------------------


def called(monkeypatch, *words: str) -> int | str | None:
    monkeypatch.setattr("sys.argv", ["stiffness-bench", *words])
    try:
        command_line.main()
    except SystemExit as ended:
        return ended.code
    return 0


def test_the_command_alone_lists_all_commands_with_a_line_each(monkeypatch, capsys):
    assert called(monkeypatch) == 0
    listed = capsys.readouterr().out.splitlines()[1:]
    files = {f.stem for f in (ROOT / "scenarios").glob("*.py")} - {"__init__"}
    assert {line.split()[0] for line in listed} == files
    assert all(line.rstrip().endswith((".", "?")) for line in listed)


def test_a_command_that_nobody_knows_ends_with_2_and_the_nearest(monkeypatch, capsys):
    assert called(monkeypatch, "diagnos") == command_line.USER_MISTAKE
    assert "Did you mean 'diagnose'?" in capsys.readouterr().err


def test_its_commands_have_the_manuals_faults_and_status_of_the_modules(
    monkeypatch, capsys, tmp_path
):
    assert called(monkeypatch, "check", "--help") == 0
    shown = capsys.readouterr().out
    assert shown.startswith("usage: stiffness-bench check ")
    assert "python -m scenarios.check" in shown
    nowhere = str(tmp_path / "no.xml")
    status = called(monkeypatch, "check", str(tmp_path), "--robot", nowhere)
    assert status == command_line.USER_MISTAKE
    assert "no model file" in capsys.readouterr().err
    status = called(monkeypatch, "blind_trials", "--strata", "--out", str(tmp_path))
    assert status == command_line.USER_MISTAKE
    assert "--strata is empty" in capsys.readouterr().err
