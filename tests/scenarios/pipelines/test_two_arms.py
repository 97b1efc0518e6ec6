import os
from dataclasses import replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
import pytest

from bench.model_file import load
from bench.patch import Patch, PatchEffect, rig_of
from bench.proof.proof import prove
from bench.proof.setup import why_not_simulated
from bench.rig import Rig
from bench.shared.errors import BenchError, Unusable
from bench.shared.recording import Marker, Recording, TrackerSpec, WrenchSpec
from scenarios import record
from scenarios.pipelines.calibration import (
    answer_of,
    calibrate_and_prove,
    first_sentence,
)
from scenarios.pipelines.calibration_proof import unproved
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.pipelines.recording_check import (
    abilities,
    axis_views,
    unpulled_axes,
)
from scenarios.pipelines.synthetic_recording import Watching
from scenarios.report.sections.calibration import write_files
from stiffness.effects.hysteresis import spread_stop
from stiffness.experiment.static_state import StaticState, static_state_of
from stiffness.robot.arm import Arm

ARM = (
    '<body name="{0}_1" pos="0 {1} 0.4"><joint name="{0}_j1" axis="0 1 0"/>'
    '<inertial pos="0.1 0 0" mass="3" diaginertia="1 1 1"/>'
    '<body name="{0}_hand" pos="0.3 0 0"><joint name="{0}_j2" axis="0 0 1"/>'
    '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body>'
)
TORSO = (
    '<mujoco><worldbody><body name="base"><body name="torso">'
    '<joint name="waist" axis="0 0 1"/>'
    '<inertial pos="0 0 0.2" mass="9" diaginertia="1 1 1"/>'
    f"{ARM.format('left', 0.2)}{ARM.format('right', -0.2)}"
    "</body></body></worldbody></mujoco>"
)


def loaded(side: str) -> tuple[StaticState, np.ndarray]:
    """Pull one hand by a force and a torque along the base's axes."""
    arm = Arm.from_mjcf_text(TORSO)
    posture = np.array([[0.3, 0.2, -0.4, 0.5, 0.1]] * 2)
    wrench = np.array([np.zeros(6), [10.0, 20.0, 30.0, 3.0, 2.0, 1.0]])
    sensor = WrenchSpec(0.1, 0.01, f"{side}_hand", np.array([0, 0, 0.1]), frame="base")
    recording = Recording(
        name="torso",
        time=np.array([0.0, 10.0]),
        posture_id=np.zeros(2, int),
        visit=np.zeros(2, int),
        posture=posture,
        load_time=np.array([0.0, 5.0]),
        stage=np.array(["unloaded", "loaded"]),
        wrench=wrench,
        markers=(Marker("m", f"{side}_hand", np.zeros(3)),),
        points=np.zeros((2, 1, 3)),
        tracker=TrackerSpec(np.full(3, 1e-5)),
        wrench_sensor=sensor,
    )
    standing = arm.at(posture)
    expected = standing.load_torque(wrench, sensor.body, sensor.position)
    expected = expected + standing.gravity_torque()
    return static_state_of(arm, recording, np.zeros(5), (f"{side}_hand",)), expected


def test_a_load_on_either_hand_turns_that_arm_s_axes_and_the_waist_alone():
    """Torques from moments of places are those of the Jacobian."""
    for side, others in (("left", [3, 4]), ("right", [1, 2])):
        situation, expected = loaded(side)
        np.testing.assert_allclose(situation.torque, expected, atol=1e-12)
        np.testing.assert_allclose(np.diff(situation.torque[:, others], axis=0), 0.0)


def test_check_says_which_axes_the_one_wrench_does_not_pull():
    situation, _ = loaded("left")
    arm, seen = situation.arm, situation.recording
    found = {a.question: a for a in abilities(seen, arm, axis_views(seen, arm))}
    other = found["how the other arm gives way to a load"]
    assert not other.can
    assert other.why == "one wrench is read, and it pulls none of a4, a5"
    assert unpulled_axes(seen, Arm.from_mjcf_text(TORSO)) == ("a4", "a5")


@pytest.fixture
def torso(tmp_path) -> Path:
    file = tmp_path / "torso.xml"
    springs = TORSO.replace("<joint ", '<joint stiffness="2e4" range="-1.5 1.5" ')
    file.write_text(springs.replace("<mujoco>", '<mujoco><compiler angle="radian"/>'))
    return file


def recorded(
    torso: Path,
    *hands: str,
    effects: tuple[str, ...] = (),
    poses: int = 8,
    path="0,40,0",
    targets: Literal["all", "flange"] = "flange",
) -> Recording:
    watch = Watching(targets=targets, state_frame=True)
    out = torso.parent / hands[0]
    return record.main(
        record.Settings(
            out, effects, robot=torso, hand=hands, poses=poses, path=path, watch=watch
        )
    )


@pytest.mark.parametrize("side", ["left", "right"])
def test_one_arm_of_a_torso_is_recorded_and_proved_by_itself(torso, side):
    hand = f"{side}_hand"
    slack = f"hysteresis@{side}_j1,width_rad=5e-4"
    recording = recorded(torso, hand, effects=(slack,))
    assert recording.axes == ("waist", f"{side}_j1", f"{side}_j2")
    again, arm, _ = read_for(torso.parent / hand, arm_of(torso))
    assert arm.axes == recording.axes and arm.attachment("flange") == arm.attachment(
        hand
    )
    named = PatchEffect("hysteresis", "a2", {"width_rad": 5e-4})
    frame = np.asarray(recording.base_from_tracker)
    patch = Patch(effects=(named,), base_from_tracker=tuple(map(tuple, frame.tolist())))
    proof = prove(again, torso, patch, (1, 2), thorough=False)
    assert proof.markers is not None
    assert proof.markers.after < 0.5 * proof.markers.before


def test_both_arms_at_once_are_recorded_and_proved(torso):
    hands, slack = ("left_hand", "right_hand"), "left_j1"
    recording = recorded(torso, *hands, effects=(f"hysteresis@{slack},width_rad=5e-4",))
    names = ("waist", "left_j1", "left_j2", "right_j1", "right_j2")
    assert recording.axes == names
    assert {m.body for m in recording.markers} == {"flange", "right_hand"}
    again, arm, _ = read_for(torso.parent / hands[0], arm_of(torso))
    assert arm.attachment("flange") == arm.attachment(hands[0])
    assert arm.attachment("tool") == arm.attachment(hands[0])
    named = PatchEffect("hysteresis", f"a{names.index(slack) + 1}", {"width_rad": 5e-4})
    frame = tuple(map(tuple, np.asarray(recording.base_from_tracker)))
    patch = Patch(effects=(named,), base_from_tracker=frame)
    proof = prove(again, torso, patch, (1, 2), thorough=False)
    assert proof.markers is not None
    assert proof.markers.after < 0.5 * proof.markers.before
    assert rig_of(proof.patch).anatomy.flange == hands[0]


def test_both_arms_are_calibrated_and_proved_at_once(torso):
    """The chest has an end at each arm, with errors of its own."""
    left, right = "link_1:a2,z_m=8e-4", "link_1:a4,x_m=5e-4"
    errors = tuple(f"geometry_error@{one}" for one in (left, right))
    recorded(torso, "left_hand", "right_hand", effects=errors, poses=40, path="0")
    recording, arm, _ = read_for(torso.parent / "left_hand", arm_of(torso))
    outcome = calibrate_and_prove(recording, arm, torso)
    assert outcome.answer.verdict == "explained"
    found = {e.where: e.parameters for e in outcome.proof.patch.effects}
    assert found["link_1:a2"]["z_m"] == pytest.approx(8e-4, abs=2e-5)
    assert found["link_1:a4"]["x_m"] == pytest.approx(5e-4, abs=2e-5)
    # had the simulator failed after the fit, what was found would be written still
    proof = unproved(outcome.found, "it finds no rest.")
    answer = answer_of("both", outcome.found, proof, outcome.residual, 1.0)
    assert (answer.verdict, answer.proof) == ("unproved", None)
    assert answer.named == outcome.answer.named
    assert "Nothing was proved: it finds no rest." in first_sentence(answer, proof)
    out = torso.parent / "answer"
    write_files(out, replace(outcome, proof=proof, answer=answer))
    assert {"diagnosis.json", "report.html", "patch.json"} <= set(os.listdir(out))


def test_the_other_arm_is_held_at_zero(torso):
    whole, one = load(torso), Rig(torso, axes=("waist", "left_j1", "left_j2")).nominal
    assert one.njnt == 3 and one.body_mass.sum() == whole.body_mass.sum()
    data, held = mujoco.MjData(whole), mujoco.MjData(one)
    data.qpos[:3] = held.qpos[:] = 0.3, 0.2, -0.4
    mujoco.mj_kinematics(whole, data)
    mujoco.mj_kinematics(one, held)
    np.testing.assert_allclose(held.xpos, data.xpos, atol=1e-12)


def test_what_the_simulator_cannot_replay_is_known_before_any_fit(torso):
    recording = recorded(torso, "left_hand")
    assert why_not_simulated(recording, torso) == ""
    gone = tuple(replace(m, body="gripper") for m in recording.markers)
    lost = replace(recording, markers=gone)
    assert "'gripper'" in why_not_simulated(lost, torso)


def test_of_several_arms_record_asks_which_one_is_pulled(torso):
    with pytest.raises(Unusable, match="left_hand, right_hand: say by --hand"):
        record.main(record.Settings(torso.parent / "out", robot=torso))
    with pytest.raises(BenchError, match="No body is called 'foot'"):
        recorded(torso, "foot")


def test_an_axis_that_no_load_turns_has_no_loop():
    situation, _ = loaded("left")
    assert np.all(spread_stop(situation, 4, 0.0) == 0.0)


def test_a_slide_that_sags_is_proved_by_marks_below_it_too(tmp_path):
    """Fit and simulator hold the same: the column's own spring under its load."""
    sprung = TORSO.replace("<joint ", '<joint stiffness="2e4" range="-1.5 1.5" ')
    column = (
        '<body name="column"><inertial pos="0 0 0.1" mass="30" diaginertia="1 1 1"/>'
        '<joint name="lift" type="slide" axis="0 0 1" range="0 0.4" stiffness="2e5"/>'
    )
    file = tmp_path / "column.xml"
    file.write_text(
        sprung.replace("<mujoco>", '<mujoco><compiler angle="radian"/>')
        .replace('<body name="torso">', f'{column}<body name="torso">')
        .replace("</body></worldbody>", "</body></body></worldbody>")
    )
    recorded(
        file, "left_hand", effects=("encoder_offset@a3,offset_rad=8e-4",), poses=40,
        path="0", targets="all",
    )  # fmt: skip
    recording, arm, _ = read_for(tmp_path / "left_hand", arm_of(file))
    assert {m.body for m in recording.markers} >= {"base", "flange"}
    outcome = calibrate_and_prove(recording, arm, file)
    assert outcome.answer.verdict == "explained"
    proof = outcome.answer.proof
    assert proof is not None
    after, noise = proof.after_rms_mm, proof.noise_rms_mm
    assert isinstance(after, float)
    assert isinstance(noise, float)
    assert after < 1.2 * noise
