import io
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import unstated_springs
from recordings import (
    added,
    both,
    cell,
    said,
    save,
    table,
    without,
    write_good,
)
from small_bench import recording as loaded_recording

from bench.shared.format.folder import read, write
from bench.shared.recording import Marker, TrackerSpec
from scenarios import SAYS, check
from scenarios.pipelines.inputs import arm_of, legend_of, read_for
from scenarios.pipelines.recording_check import (
    abilities,
    axis_views,
    confounded_axes,
    contents_of,
    replicate_noise,
)
from scenarios.report.command_line import run
from stiffness.robot.arm import Arm

ROOT = Path(__file__).parents[3]
MODEL = ROOT / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"


@pytest.fixture(scope="module")
def arm() -> Arm:
    return arm_of(MODEL)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_good(tmp_path / "recording")


@pytest.fixture
def answers(folder: Path, arm: Arm) -> Callable[[], dict]:
    def ask() -> dict:
        recording, named, _ = read_for(folder, arm)
        found = abilities(recording, named, axis_views(recording, named))
        return {ability.question: ability for ability in found}

    return ask


def test_a_load_that_rises_and_falls_can_show_hysteresis_and_one_that_rises_cannot(
    folder, answers
):
    assert answers()["hysteresis, lost motion"].can
    rows = table(folder)
    ends = [rows[0], *(r for i, r in enumerate(rows[1:]) if i % 5 in (0, 2, 4))]
    save(folder, ends)
    assert answers()["hysteresis, lost motion"].can  # unloaded once more is enough
    save(folder, [rows[0], *(r for i, r in enumerate(rows[1:]) if i % 5 < 3)])
    answer = answers()["hysteresis, lost motion"]
    assert not answer.can and "unload" in answer.add


def test_a_dwell_can_show_creep_and_single_readings_cannot(folder, answers):
    assert not answers()["creep"].can
    cell(4, "load_kg", "10")(folder)
    answer = answers()["creep"]
    assert answer.can and "10 s" in answer.why


def test_markers_on_one_body_leave_places_to_inference(folder, answers):
    assert answers()["on which link it gives way"].can
    said('"link_3"', '"flange"')(folder)
    assert not answers()["on which link it gives way"].can


def test_without_a_wrench_weight_is_the_only_load(folder, answers):
    without("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm")(folder)
    answer = answers()["how it gives way to a load"]
    assert not answer.can and "weight" in answer.why


def test_without_a_second_visit_the_noise_is_taken_as_stated(folder, answers):
    assert answers()["whether the stated noise is real"].can
    for row in range(16, 21):
        cell(row, "pose", "4")(folder)
    assert not answers()["whether the stated noise is real"].can


def test_an_axis_whose_torque_does_not_vary_is_named(folder, answers):
    assert answers()["how soft each axis is"].can
    for column in ("fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"):
        for row in range(1, 21):
            cell(row, column, "0")(folder)
    assert "a1" in answers()["how soft each axis is"].why


def test_an_axis_that_moves_no_marker_is_named(folder, answers):
    said('body = "flange"\nposition_mm = [10, 20, 30]', 'body = "link_3"')(folder)
    why = answers()["how far each axis really turns"].why
    assert why.startswith("a4, a5, a6:")


def test_relative_displacements_show_no_geometry_and_no_drift(folder, answers):
    added("temperature_c", "21")(folder)
    assert answers()["drift with temperature"].can
    said('"absolute"', '"relative"')(folder)
    found = answers()
    for question in (
        *("geometry, offsets of encoders", "drift with temperature"),
        "errors that vary with an axis' angle",
    ):
        assert not found[question].can
        assert "relative" in found[question].why


def test_what_an_unknown_frame_takes_up_is_said(folder, answers):
    assert "frame" not in answers()["geometry, offsets of encoders"].why
    frame = (
        "[frames.tracker]\nposition_mm = [100, 0, 0]\nquaternion_wxyz = [1, 0, 0, 0]"
    )
    said(frame, "")(folder)
    assert "first axis' offset" in answers()["geometry, offsets of encoders"].why


def test_axes_that_move_the_markers_alike_are_named(folder, arm):
    """Stretched out and pulled down, a2 and a3 both move a flange's marker down."""
    recording, _ = read(folder)
    posture = np.tile(np.deg2rad([0.0, -20.0, 20.0, 0.0, 0.0, 0.0]), (20, 1))
    one = (Marker("m", "flange", np.zeros(3)),)
    seen = replace(recording, posture=posture, markers=one, points=np.zeros((20, 1, 3)))
    assert ("a2", "a3") in confounded_axes(seen, arm)
    between = (*one, Marker("n", "link_2", np.array([0.5, 0.0, 0.0])))
    more = replace(seen, markers=between, points=np.zeros((20, 2, 3)))
    assert ("a2", "a3") not in confounded_axes(more, arm)


def test_an_encoder_after_the_gear_shows_its_axis(folder, answers):
    said('body = "flange"\nposition_mm = [10, 20, 30]', 'body = "link_3"')(folder)
    added("a6_link_deg", "5")(folder)
    assert answers()["how far each axis really turns"].why.startswith("a4, a5:")


def test_the_lever_of_a_marker_is_its_distance_from_the_axis(folder, arm):
    """Base to flange at zero posture: 1190 mm stretched out, 425 - 400 above A2."""
    recording, _ = read(folder)
    still = recording.take(np.array([0]))
    flange = replace(
        still,
        posture=np.zeros((1, 6)),
        wrench=None,
        markers=(Marker("m", "flange", np.zeros(3)),),
        points=np.zeros((1, 1, 3)),
    )
    lever = [view.lever for view in axis_views(flange, arm)]
    np.testing.assert_allclose(lever[0], 1.190, atol=1e-9)
    np.testing.assert_allclose(lever[1], np.hypot(1.190 - 0.025, 0.025), atol=1e-9)
    np.testing.assert_allclose(lever[5], 0.0, atol=1e-9)


def test_replicates_show_the_noise_that_was_put_in(folder):
    """Two visits of five rows and two markers: 10 degrees of freedom a coordinate."""
    recording, _ = read(folder)
    random = np.random.default_rng(0)
    sigma = np.array([1e-5, 2e-5, 5e-5])
    many = tuple(Marker(f"m{k}", "flange") for k in range(400))
    points = sigma * random.standard_normal((20, 400, 3))
    noisy = replace(
        recording, markers=many, points=points, tracker=TrackerSpec(np.full(3, 1e-5))
    )
    found = replicate_noise(noisy)
    assert found is not None
    assert found[1] == 5 * 400
    np.testing.assert_allclose(found[0], sigma, rtol=0.06)  # 4 sigma of 2000 values


def test_contents_names_what_is_there(folder, arm):
    both(added("operator", "x"), added("temperature_c", "21"))(folder)
    recording, _, notes = read_for(folder, arm)
    contents = dict(contents_of(recording))
    assert contents["poses"] == "3 in 4 visits, 1 visited again"
    assert contents["load path"] == "0 5 10 5 0 kg in 4 of 4 visits"
    assert contents["markers on link_3"] == "1; places not stated; always seen"
    assert contents["temperature"] == "21.0 to 21.0 °C"
    assert notes == ("samples.csv: column 'operator' left alone.",)


def test_what_commanded_angles_tell_of_the_reported_ones_is_said(folder, arm):
    recording, _, _ = read_for(folder, arm)
    assert "commanded angles" not in dict(contents_of(recording))
    went = np.abs(recording.side).any(axis=0)
    lags = np.where(went, 3e-4, 0.0)
    for sign, word in ((1.0, "lags behind"), (-1.0, "leads"), (0.0, "")):
        told = recording.posture + sign * lags * recording.side
        said = dict(contents_of(replace(recording, commanded=told)))["commanded angles"]
        k = int(np.flatnonzero(went)[0]) + 1
        assert f"a{k} {word} its command along its last move by 0.3 mrad" in said or (
            not sign and said.endswith("no report lags behind its command")
        )


# --- The command ---------------------------------------------------------------------


def command(*words: object) -> None:
    """Run the command in this process, as from a terminal."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["check", *map(str, words)])
        run(check.main, check.Settings)


def test_the_command_shows_three_tables_and_ends_with_0(folder):
    """In a process of its own; the other tests save its imports."""
    words = (sys.executable, "-m", "scenarios.check", folder, "--robot", MODEL)
    done = subprocess.run(words, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    for words in ("a small one", "Axes", "What it can show"):
        assert words in done.stdout


def test_every_line_of_the_tables_can_be_read_by_itself(folder, arm, answers):
    """A marker that was missed, places that are stated, and what an axis lacks."""
    cell(3, "p2_y_mm", "")(folder)
    recording, _, _ = read_for(folder, arm)
    contents = dict(contents_of(recording))
    assert contents["markers on flange"] == "1; places stated; always seen"
    missed = "1; places not stated; not seen in 5.0% of readings"
    assert contents["markers on link_3"] == missed
    assert "0.0100 mm in x, y, z; poses visited" in contents["tracker's noise"]
    assert answers()["how soft each axis is"].why == "its torque varies"
    assert answers()["how far each axis really turns"].why.startswith("each moves a")


def test_a_mistake_of_the_set_up_is_said_before_the_tables(folder, arm, capsys):
    recording, named, _ = read_for(folder, arm)
    places = (np.array([0.05, 0.0, 0.1]), np.array([0.0, 0.2, 0.1]))
    draw = np.random.default_rng(0)
    posture = draw.uniform(-0.7, 0.7, (20, 6))
    seen = [
        named.point_in_base(posture * [1, 1, -1, 1, 1, 1], body, place)
        for body, place in zip(("flange", "link_3"), places, strict=True)
    ]
    order = {"posture_id": np.arange(20), "visit": np.arange(20)}
    points = np.stack(seen, axis=1)
    write(folder, replace(recording, posture=posture, points=points, **order))
    check.main(check.Settings(folder, MODEL))
    text = " ".join(capsys.readouterr().out.split())
    assert text.startswith("Mistake (a3): a3 looks reversed")
    assert text.index("names no effect") < text.index("what")


def test_a_row_that_is_there_twice_is_said(folder, capsys):
    rows = table(folder)
    save(folder, [*rows[:8], rows[7], *rows[8:]])
    check.main(check.Settings(folder, MODEL))
    text = " ".join(capsys.readouterr().out.split())
    assert "Note: samples.csv, line 9 (row 8 below the header): the row above" in text


def test_a_name_that_a_terminal_would_obey_is_only_shown(folder, capsys):
    manifest = folder / "recording.toml"
    text = manifest.read_text()
    manifest.write_text(text.replace('name = "', 'name = "\\u001b]0;mine\\u0007', 1))
    command(folder, "--robot", MODEL)
    shown = capsys.readouterr().out
    assert "\x1b]" not in shown
    assert "\\x1b]0;mine\\x07" in shown


def test_a_flag_nobody_knows_ends_with_2(folder, capsys):
    with pytest.raises(SystemExit) as ended:
        command(folder, "--robt", MODEL)
    assert ended.value.code == 2
    assert "--robt" in "".join(capsys.readouterr())


def test_another_arm_s_model_ends_with_2_and_the_joints_it_knows(
    folder, tmp_path, capsys
):
    model = tmp_path / "two.xml"
    model.write_text(
        "<mujoco><worldbody><body><joint name='j1'/><geom size='1'/>"
        "<body><joint name='j2'/><geom size='1'/></body></body></worldbody></mujoco>"
    )
    with pytest.raises(SystemExit) as ended:
        command(folder, "--robot", model)
    assert ended.value.code == 2
    assert "this model has 2 axes: j1, j2" in capsys.readouterr().err


@pytest.fixture
def _interruptible():
    """Interrupts count, though the tests may have been started where they do not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("_interruptible")
@pytest.mark.parametrize("by", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_command_says_that_it_can_go_on(monkeypatch, folder, by):
    def interrupted(_):
        signal.raise_signal(by)

    interrupted.__module__ = "scenarios.check"
    monkeypatch.setattr(sys, "argv", ["check", str(folder), "--robot", str(MODEL)])
    error = io.StringIO()
    monkeypatch.setattr(sys, "stderr", error)
    with pytest.raises(SystemExit) as left:
        run(interrupted, check.Settings)
    assert left.value.code == 130
    assert error.getvalue() == f"{SAYS}\n"


INTERRUPT = """import sys
class Interrupt:
    def find_spec(self, name, *_):
        if name == "numpy": raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupt())
"""
"""The interrupt comes when the first library asks for numpy."""


def interrupted_while_loading(folder, *words):
    """Run a fresh Python, whose import of numpy is interrupted."""
    (folder / "sitecustomize.py").write_text(INTERRUPT)
    return subprocess.run(
        [sys.executable, *words],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )


def test_a_command_interrupted_while_it_loads_ends_with_130_and_no_trace(tmp_path):
    done = interrupted_while_loading(tmp_path, "-m", "scenarios.check", "x")
    assert (done.returncode, done.stderr) == (130, f"{SAYS}\n")


def test_a_program_of_somebody_else_is_interrupted_as_usual(tmp_path):
    """A notebook that imports these packages is none of their commands."""
    program = "import scenarios; from bench.shared import recording"
    done = interrupted_while_loading(tmp_path, "-c", program)
    assert SAYS not in done.stderr
    assert "KeyboardInterrupt" in done.stderr


def test_of_a_log_of_torques_alone_it_is_said_what_it_could_show(folder, arm):
    recording, named, _ = read_for(folder, arm)
    torque = np.zeros(recording.posture.shape)
    log = replace(recording, markers=(), points=None, axis_torque=torque)
    found = {a.question: a for a in abilities(log, named, axis_views(log, named))}
    told = found["masses and friction of the axes"]
    assert not told.can
    assert "torque of 6 axes is read" in told.why
    assert "displacements alone" in told.why
    assert not any("masses" in a.question for a in abilities(recording, named, []))


def test_axes_go_by_one_name_and_a_legend_says_which_joint_each_is(arm):
    """The KR10's joints are called as the columns; a UR10's are not."""
    assert legend_of(arm) == ()
    other = arm_of(MODEL.parents[1] / "ur10" / "ur10.xml")
    (said,) = legend_of(other)
    assert "a1 is 'shoulder_pan_joint', a2 is 'shoulder_lift_joint', a3" in said
    own = MODEL.read_text().replace('body name="flange"', 'body name="hand"')
    own = own.replace('body name="tool"', 'body name="gripper"')
    (said,) = legend_of(Arm.from_mjcf_text(own.replace('"a1"', '"waist"')))
    assert "a1 is 'waist', a2 is 'a2'" in said
    assert said.endswith("a6 is 'a6', and the flange is 'gripper'.")


def test_a_recording_written_again_checks_alike(folder, tmp_path, arm):
    recording, _, _ = read_for(folder, arm)
    write(tmp_path / "again", recording)
    again, _, _ = read_for(tmp_path / "again", arm)
    assert dict(contents_of(again)) == dict(contents_of(recording))


def test_springs_that_the_model_does_not_state_are_said(tmp_path, capsys):
    folder = tmp_path / "loaded"
    write(folder, loaded_recording(poses=8))
    check.main(check.Settings(folder, unstated_springs.as_urdf(MODEL, tmp_path)))
    text = " ".join(capsys.readouterr().out.split())
    said = "Note: the model states no joint stiffness; a diagnosis fits compliances of"
    assert f"{said} all axes as nominal: a1, a2, a3, a4, a5, a6." in text
    check.main(check.Settings(folder, MODEL))
    assert "joint stiffness" not in capsys.readouterr().out


def test_rows_under_a_load_that_pulls_nobody_knows_where_are_left_out(folder, arm):
    """A weight without a wrench: they were taken for unloaded ones by prove."""
    whole, _, before = read_for(folder, arm)
    loaded = whole.stage != "unloaded"
    assert loaded.any() and not any("no wrench" in note for note in before)
    write(folder, replace(whole, wrench=None, wrench_sensor=None))
    recording, _, notes = read_for(folder, arm)
    assert np.all(recording.stage == "unloaded")
    assert len(recording.time) == np.count_nonzero(~loaded)
    (note,) = (n for n in notes if "no wrench says" in n)
    assert f"{np.count_nonzero(loaded)} of {len(loaded)} rows" in note
