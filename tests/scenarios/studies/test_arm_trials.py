import shutil

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.model_file import load, plain_mjcf
from bench.patch import Patch, PatchEffect, rig_of
from bench.shared.errors import Unusable
from scenarios import arm_trials as command
from scenarios.studies import arm_trials as studies
from scenarios.studies.arm_trials import (
    BASES,
    WOUND_UP,
    ArmTrial,
    bends_otherwise,
    given,
    model_files,
    with_springs,
)
from stiffness.robot.arm import Arm


@pytest.fixture
def models(root, tmp_path):
    folder = tmp_path / "models"
    folder.mkdir()
    shutil.copy(root / "mjcf" / "ur10" / "ur10.xml", folder)
    return folder


@pytest.mark.slow
def test_arms_of_a_folder_are_tried_with_both_bases(models, tmp_path, capsys):
    """Springs and the proof are as good with the base turned as with it as shipped."""
    settings = command.Settings(models, tmp_path / "out", trials=1, poses=16)
    trials = command.main(settings)
    assert [t.base for t in trials] == list(BASES)
    assert trials[0].truth == trials[1].truth
    for trial in trials:
        assert trial.failed == ""
        assert trial.springs_off < 0.15
        assert trial.compliances_inside >= 4 / 6
        assert trial.after_over_noise < 1.5
        assert trial.bends_off < 0.01
    assert "ur10" in (tmp_path / "out" / "report.md").read_text()
    assert "of 2 trials" in capsys.readouterr().out
    again = command.main(settings)  # read, not carried out again
    assert [t.named for t in again] == [t.named for t in trials]
    assert [t.failed for t in again] == ["", ""]


def test_a_trial_that_failed_is_tried_anew(models, tmp_path, monkeypatch):
    """What failed because a mesh was elsewhere would else stay failed."""
    asked, why = [], ["a mesh is missing."]

    def trials_of(models, trials, poses, seed, folder, known, stated):
        asked.append(known)
        for base in BASES:
            own = ("ur10", 0, base, "", "", not why, "explained")
            yield ArmTrial(*own, 0.0, 1.0, 1.0, 0.0, 1.0, *why)

    monkeypatch.setattr(studies, "trials_of", trials_of)
    settings = command.Settings(models, tmp_path / "out", trials=1)
    assert all(trial.failed for trial in command.main(settings))
    why.clear()
    assert not any(trial.failed for trial in command.main(settings))
    command.main(settings)
    assert asked == [set(), set(), {("ur10", 0)}]


def test_a_turned_base_is_the_same_arm_under_another_gravity(models):
    (file,) = model_files(models)
    arms = {}
    for base in BASES:
        text = with_springs(file, base, np.random.default_rng(3))
        arms[base] = Arm.from_mjcf_text(text)
    one, other = (arms[base] for base in BASES)
    np.testing.assert_array_equal(one.stiffness, other.stiffness)
    assert np.all(one.stiffness > 0.0)
    np.testing.assert_allclose(np.linalg.norm(other.chain.gravity), 9.81)
    turn = Rotation.align_vectors(other.chain.gravity[None], one.chain.gravity[None])[0]
    assert turn.magnitude() > 0.1
    torque = one.gravity_torque(np.zeros((1, 6))) / one.stiffness
    assert np.max(np.abs(torque)) <= 1.5 * WOUND_UP


def test_a_turned_arm_as_urdf_stands_and_weighs_as_its_mjcf(models, tmp_path):
    (file,) = model_files(models)
    turned = tmp_path / "turned.xml"
    turned.write_text(with_springs(file, "turned", np.random.default_rng(3)))
    one, other = (
        Arm.from_mjcf_text(plain_mjcf(load(given(turned, stated, tmp_path))))
        for stated in ("none", "urdf")
    )
    posture = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 6))
    assert one.axes == other.axes
    assert not one.stiffness.any() and not other.stiffness.any()
    torque = [arm.gravity_torque(posture) for arm in (one, other)]
    np.testing.assert_allclose(torque[1], torque[0], atol=1e-9)


def test_a_gear_with_friction_is_loaded_where_it_stands(tmp_path):
    """The load takes back half of what the arm's own weight winds up."""
    file = tmp_path / "seesaw.xml"
    file.write_text(
        '<mujoco><worldbody><body name="base"><body name="link" pos="0 0 1">'
        '<joint name="a1" axis="0 1 0" stiffness="2e4"/>'
        '<inertial pos="0.4 0 0" mass="10" diaginertia="1 1 1"/>'
        '<body name="flange" pos="-0.4 0 0"/></body></body></worldbody></mujoco>'
    )
    slack = PatchEffect("hysteresis", "a1", {"width_rad": 1e-3})
    rig = rig_of(Patch(effects=(slack,)), file)
    assert bends_otherwise(rig, file) < 0.01


def test_a_folder_without_models_is_refused(tmp_path):
    with pytest.raises(Unusable, match=r"no \.xml \(MJCF\) or \.urdf"):
        model_files(tmp_path)


def test_of_several_arms_the_longest_chain_is_taken(tmp_path):
    text = """<mujoco><worldbody><body name="base"><body name="l" pos="0 1 0">
    <joint name="l1"/><inertial mass="1" pos="0 0 1" diaginertia="1 1 1"/></body>
    <body name="r"><joint name="r1"/><inertial mass="1" pos="0 0 1"
    diaginertia="1 1 1"/><body name="r_tip" pos="0 0 1"><joint name="r2" axis="0 1 0"/>
    <inertial mass="1" pos="0 0 1" diaginertia="1 1 1"/></body></body></body>
    </worldbody></mujoco>"""
    file = tmp_path / "torso.xml"
    file.write_text(text)
    assert load(file).njnt == 3
    arm = Arm.from_mjcf_text(with_springs(file, "turned", np.random.default_rng(0)))
    assert arm.axes == ("r1", "r2")


def test_the_first_axis_of_an_upright_arm_is_no_softer_than_the_next(tmp_path):
    """Turned, it carries as much: its spring is that of a shoulder, not of a wrist."""
    upright = (
        '<mujoco><worldbody><body><joint name="a1" axis="0 0 1"/>'
        '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        '<body><joint name="a2" axis="0 1 0"/>'
        '<inertial pos="0.5 0 0" mass="20" diaginertia="1 1 1"/>'
        "</body></body></worldbody></mujoco>"
    )
    file = tmp_path / "upright.xml"
    file.write_text(upright)
    text = with_springs(file, "as shipped", np.random.default_rng(0))
    first, second = Arm.from_mjcf_text(text).stiffness
    assert first == pytest.approx(second, rel=0.05)
    assert second == pytest.approx(20 * 9.81 * 0.5 / WOUND_UP, rel=0.05)
