import json
from dataclasses import replace
from unittest import mock

import msgspec
import mujoco
import numpy as np
import pytest
from saved_view import entities, timeline

from bench import patch
from bench.shared.errors import BenchError, LeftOut, Unusable
from bench.shared.format import folder
from bench.user_model import ASSETS
from scenarios import diagnose, record
from scenarios.pipelines import diagnosis as steps
from scenarios.pipelines import next_experiments
from scenarios.pipelines.inputs import arm_of
from scenarios.pipelines.schema import Answer, Next
from scenarios.report import route
from scenarios.report.command_line import run
from scenarios.report.data_files import DECISIONS, FILES, refuse_folder, write_folder
from scenarios.report.sections import diagnosis
from stiffness.diagnosis.result import (
    Name,
)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "recording"
    record.main(
        record.Settings(
            out=folder,
            effect=("hysteresis@a2,width_rad=3e-4",),
            poses=18,
            path="0,5,10,5,0",
            seed=4,
        )
    )
    return folder


@pytest.fixture(scope="module", autouse=True)
def _found_once():
    """Diagnose and prove the recording of this file once, for time."""
    with (
        mock.patch.object(route, "asked", once(route.asked)),
        mock.patch.object(route, "proved", once(route.proved)),
    ):
        yield


def once(step):
    """Return a function that keeps what a step returns the first time."""
    kept = []

    def kept_or_found(*given):
        kept[:] = kept or [step(*given)]
        return kept[0]

    return kept_or_found


@pytest.fixture(scope="module")
def answered(recording, kr10, tmp_path_factory):
    out = tmp_path_factory.mktemp("answered") / "answer"
    settings = diagnose.Settings(recording, kr10, out)
    return out, diagnose.main(settings)


def on_the_command_line(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["diagnose", *map(str, words)])
    run(diagnose.main, diagnose.Settings)


def test_one_command_writes_the_whole_answer_and_nothing_else(answered):
    out, told = answered
    assert told.verdict != "no_mismatch"
    assert told.named
    wanted = sorted((*FILES, ASSETS, DECISIONS))
    assert sorted(p.name for p in out.iterdir()) == wanted
    assert (out / "diagnosis.rrd").stat().st_size < 5_000_000
    assert [p for p in out.parent.iterdir() if p != out] == []


def test_answer_has_the_fixed_form(answered):
    out, told = answered
    text = (out / "diagnosis.json").read_bytes()
    assert msgspec.json.decode(text, type=Answer, strict=True) == told
    plain = json.loads(text)
    assert set(plain) == set(Answer.__struct_fields__)
    assert plain["schema"] == 1
    assert plain["proof"]["simulator"] == "mujoco"
    assert plain["proof"]["held_out_poses"] >= 0.2 * 18
    assert plain["proof"]["after_rms_mm"] < plain["proof"]["before_rms_mm"]


def test_the_patched_rig_can_be_rebuilt_from_the_folder(answered):
    out, told = answered
    rig = patch.rig_of(patch.read(out / patch.FILE))
    names = {(e.name, e.where) for e in rig.effects}
    assert {(n.effect, n.where) for n in told.named} <= names


def test_the_model_in_the_folder_is_the_users_with_the_mechanism(answered, kr10):
    """Eight meshes, and the same six axes where it is given as --robot."""
    out, _ = answered
    model = mujoco.MjModel.from_xml_path(str(out / "model.xml"))
    assert model.nmesh == mujoco.MjModel.from_xml_path(str(kr10)).nmesh
    assert any(
        model.tendon(t).name.startswith("patch:a2") for t in range(model.ntendon)
    )
    with pytest.warns(LeftOut, match="of its patch"):
        assert arm_of(out / "model.xml").axes == arm_of(kr10).axes
    rows = 1 + 6 + 6 + 5 * 5 + 6 + 6  # head, zeros, base, geometry, flange, springs
    assert len((out / "controller.csv").read_text("utf-8").splitlines()) == rows


def test_report_is_one_file_with_its_pictures(answered):
    out, _ = answered
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") >= 4
    for word in ("hysteresis", "Before and after", "Placebos", "budget", "catalogues"):
        assert word in page


def test_playback_opens_on_the_timeline_of_poses(answered):
    out, _ = answered
    file = out / "diagnosis.rrd"
    assert timeline(file) == "pose"
    shown = set(entities(file))
    assert {"/cell/before", "/cell/after", "/read_me", "/error/after"} <= shown
    assert "/curves/a2/patch" in shown


@pytest.mark.parametrize("spoil", ["samples.csv", "recording.toml"])
def test_damaged_recording_ends_with_2_and_leaves_nothing(
    spoil, recording, kr10, tmp_path, monkeypatch, capsys
):
    bad = tmp_path / "bad"
    bad.mkdir()
    for file in recording.iterdir():
        text = file.read_text(encoding="utf-8")
        cut = text[: len(text) // 2] if file.name == spoil else text
        (bad / file.name).write_text(cut, encoding="utf-8")
    with pytest.raises(SystemExit) as ended:
        on_the_command_line(
            monkeypatch, bad, "--robot", kr10, "--out", tmp_path / "answer"
        )
    assert ended.value.code == 2
    assert not (tmp_path / "answer").exists()
    said = capsys.readouterr().err
    assert "fault" in said
    assert "Traceback" not in said


def test_a_model_that_is_missing_ends_with_2(recording, tmp_path, monkeypatch, capsys):
    with pytest.raises(SystemExit) as ended:
        on_the_command_line(
            monkeypatch, recording, "--robot", tmp_path / "no.xml", "--out", tmp_path
        )
    assert ended.value.code == 2
    assert "no model file" in capsys.readouterr().err


def test_the_recording_itself_is_no_place_for_the_answer(recording, kr10):
    with pytest.raises(Unusable, match="the recording itself"):
        diagnose.main(diagnose.Settings(recording, kr10, recording))


def test_interrupted_diagnosis_ends_with_130(recording, kr10, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(route, "asked", stopped)
    with pytest.raises(SystemExit) as ended:
        on_the_command_line(
            monkeypatch, recording, "--robot", kr10, "--out", tmp_path / "o"
        )
    assert ended.value.code == 130
    assert not (tmp_path / "o").exists()


def test_numbers_that_break_the_engine_are_the_recordings_fault(
    recording, kr10, monkeypatch
):
    def broken(*_):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(steps, "diagnose", broken)
    good, _ = folder.read(recording)
    with pytest.raises(BenchError, match="Singular matrix"):
        steps.asked(good, arm_of(kr10))


@pytest.mark.parametrize("where", ["proved", "write_diagnosis"])
def test_a_defect_of_ours_is_raised_once_what_was_found_is_written(
    recording, kr10, where, monkeypatch, tmp_path
):
    """It is none of the user's mistakes, and costs nothing that was found before."""

    def broken(*_):
        raise TypeError("ours")

    home = route if where == "proved" else diagnosis
    monkeypatch.setattr(home, where, broken)
    settings = diagnose.Settings(recording, kr10, tmp_path / "o")
    with pytest.raises(TypeError, match="ours"):
        diagnose.main(settings)
    written = json.loads((tmp_path / "o" / "diagnosis.json").read_text())
    assert [n["effect"] for n in written["named"]] == ["hysteresis"]
    if where == "proved":
        assert written["verdict"] == "unproved"
        report = (tmp_path / "o" / "report.html").read_text()
        assert "this tool has a defect" in report


def test_a_defect_of_the_engine_is_not_called_the_recording_s_fault(
    recording, kr10, monkeypatch
):
    def broken(*_):
        raise IndexError("ours")

    monkeypatch.setattr(steps, "diagnose", broken)
    good, _ = folder.read(recording)
    with pytest.raises(IndexError, match="ours"):
        steps.asked(good, arm_of(kr10))


def test_an_answer_that_cannot_be_made_leaves_the_earlier_one(tmp_path):
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "proof.json").write_text("earlier", encoding="utf-8")

    def makes(folder):
        (folder / "diagnosis.json").write_text("{}", encoding="utf-8")

    def fails(folder):
        makes(folder)
        raise OSError("disk full")

    with pytest.raises(Unusable, match="disk full"):
        write_folder(tmp_path / "o", fails)
    assert [p.name for p in tmp_path.iterdir()] == ["o"]
    assert [p.name for p in (tmp_path / "o").iterdir()] == ["proof.json"]
    write_folder(tmp_path / "o", makes)
    assert [p.name for p in (tmp_path / "o").iterdir()] == ["diagnosis.json"]


def test_an_answer_takes_the_files_of_an_earlier_one_of_any_engine_away(tmp_path):
    """What belongs to nobody stays; what was only needed on the way goes."""
    (tmp_path / "o").mkdir()
    for name in ("gears.png", "looks_like.png", "proof.json", "draws.csv"):
        (tmp_path / "o" / name).write_text("earlier", encoding="utf-8")

    def makes(folder):
        for name in ("report.html", "report.md", "law_a2.png"):
            (folder / name).write_text("now", encoding="utf-8")

    write_folder(tmp_path / "o", makes, FILES)
    left = sorted(p.name for p in (tmp_path / "o").iterdir())
    assert left == ["draws.csv", "report.html"]


def test_no_answer_takes_the_place_of_files_that_are_none(tmp_path):
    model = tmp_path / "model.xml"
    model.write_text("mine", encoding="utf-8")
    with pytest.raises(Unusable, match=r"holds model\.xml, and no answer of ours"):
        write_folder(tmp_path, lambda _: None)
    (tmp_path / "diagnosis.json").write_text("{}", encoding="utf-8")
    with pytest.raises(Unusable, match=r"model\.xml in it is the robot's model"):
        refuse_folder(tmp_path, tmp_path / "recording", model)
    assert model.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("link", ["o", "o/model_assets", "o/model_assets/arm"])
def test_an_answer_is_not_written_through_a_link_into_another_folder(tmp_path, link):
    other = tmp_path / "other"
    other.mkdir()
    (tmp_path / link).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / link).symlink_to(other)

    def makes(folder):
        (folder / "model_assets" / "arm").mkdir(parents=True)
        (folder / "model_assets" / "arm" / "a.stl").write_text("now", encoding="utf-8")
        (folder / "diagnosis.json").write_text("{}", encoding="utf-8")

    for refused in (
        lambda: refuse_folder(tmp_path / "o", tmp_path / "recording", tmp_path / "m"),
        lambda: write_folder(tmp_path / "o", makes),
    ):
        with pytest.raises(Unusable, match="a symbolic link"):
            refused()
    assert not list(other.iterdir())
    assert not (tmp_path / "o" / "diagnosis.json").exists()


def test_meshes_of_an_earlier_model_go_and_files_of_others_stay(tmp_path):
    def answer(*meshes, extra=()):
        def makes(folder):
            named = "".join(f'<mesh file="model_assets/{m}"/>' for m in meshes)
            (folder / "model.xml").write_text(named or "<none/>", encoding="utf-8")
            (folder / "diagnosis.json").write_text("{}", encoding="utf-8")
            for mesh in meshes:
                (folder / "model_assets").mkdir(exist_ok=True)
                (folder / "model_assets" / mesh).write_text("now", encoding="utf-8")

        write_folder(tmp_path / "o", makes)
        for name in extra:
            (tmp_path / "o" / "model_assets" / name).write_text("", encoding="utf-8")
        there = (tmp_path / "o").glob("model_assets/*")
        return sorted(p.name for p in there)

    assert answer("a.stl", "b.stl") == ["a.stl", "b.stl"]
    assert answer("b.stl", "c.stl", extra=("own.txt",)) == ["b.stl", "c.stl", "own.txt"]
    assert answer() == ["own.txt"]
    (tmp_path / "o" / "model_assets" / "own.txt").unlink()
    assert answer("d.stl") == ["d.stl"]
    assert answer() == []
    assert not (tmp_path / "o" / "model_assets").exists()


def test_next_measurements_tell_equivalents_apart(recording, kr10):
    good, _ = folder.read(recording)
    arm = arm_of(kr10)
    engine = route.asked(good, arm)
    one = replace(engine.named[0], equivalents=(Name("creep", "a2"),))
    simulated, unproved = route.proved(engine, good, arm, kr10)
    assert unproved == ""
    listed = next_experiments.proposed(replace(engine, named=(one,)), simulated)
    assert 0 < len(listed) <= 3
    for step in listed:
        assert step.why == f"tells {one.name.effect} from creep on a2"
        assert len(step.pose_deg) == 6
        assert step.load_path_kg[0] == 0.0
    factors = [step.expected_log_bayes_factor for step in listed]
    assert factors == sorted(factors, reverse=True)
    assert next_experiments.proposed(engine, None) == ()


def test_a_proposed_pose_of_an_arm_on_a_slide_is_written_in_mm_and_degrees():
    slides = (True, False)
    pose = next_experiments.pose_at_border(np.array([0.5, np.pi / 6]), slides)
    step = Next("tells one from another", pose, (0.0, 5.0), 3.2)
    written = msgspec.json.decode(msgspec.json.encode(step))
    assert written["pose_deg"] == [500.0, 30.0]
    assert step.pose_text(slides) == "500 mm, 30°"
    assert step.pose_text(()) == "500°, 30°"
