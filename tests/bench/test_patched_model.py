"""The user's file with a patch in it, run by MuJoCo alone and read back as a robot."""

from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bench.kinematic_chain import anatomy, pose_in
from bench.model_file import PATCH, load, plain_mjcf
from bench.patch import Law, Mounted, Patch, PatchEffect, Value, rig_of
from bench.patched_model import PatchedModel, patched_model
from bench.rig import Rig
from bench.shared.errors import LeftOut
from bench.user_model import ASSETS
from stiffness.robot.arm import Arm

pytestmark = pytest.mark.filterwarnings("ignore::bench.shared.errors.LeftOut")

LOAD = np.array([30.0, 40.0, -100.0])
SETTLED = 2.0
"""Seconds after which a test looks; the damping lets all come to rest in less."""

TILT = PatchEffect("bearing_tilt", "a2", {"u_rad_per_nm": 2e-6, "v_rad_per_nm": 3e-6})
OFFSET = PatchEffect("encoder_offset", "a2", {"offset_rad": 2e-3})
LENGTH = PatchEffect("geometry_error", "link_1", {"x_m": 1e-3, "ry_rad": 1e-3})
MASS = PatchEffect("gravity_load", "link_2", {"mass_kg": 2.0, "com_x_m": 0.1})
FOOT = PatchEffect("base_compliance", "base", {"rx_rad_per_nm": 5e-7})
BEAM = PatchEffect("link_bending", "link_1", {"bending_nm2": 6e5, "torsion_nm2": 4e5})
HARD = PatchEffect("hardening", "a2", {"stiffness_ratio": 1.6, "torque_nm": 30.0})
SPRING = PatchEffect("gravity_compensator", "a2", {"torque_nm": 80.0, "phase_rad": 0.2})
PLAY = PatchEffect("lost_motion", "a1", {"width_rad": 1e-4})
LOOP = PatchEffect("hysteresis", "a2", {"width_rad": 1e-4})
WAVE = PatchEffect(
    "transmission_error", "a1", {"amplitude_rad": 1e-3, "order": 2.0, "phase_rad": 1.0}
)
DRIFT = PatchEffect("drift", "tracker", {"x_m_per_h": 1e-5})
ALL = (TILT, OFFSET, LENGTH, MASS, FOOT, BEAM, HARD, SPRING, PLAY, LOOP, WAVE, DRIFT)
LAWS = (Law("a1", (-50.0, 0.0, 50.0), (-1e-4, 0.0, 1e-4)),)
HELD = Mounted((0.01, 0.0, 0.03), 0.5, (0.0, 0.01, 0.02))

OWN = """<mujoco model="own"><compiler angle="degree" meshdir="parts" eulerseq="zyx"/>
  <option timestep="0.004"/>
  <default><joint damping="3" armature="0.1" frictionloss="0.5"/>
    <default class="shell"><geom contype="0" conaffinity="0" mass="0"/></default>
    <default class="servo"><position kp="1234.5678912" ctrlrange="-3 3"/></default>
  </default>
  <asset><mesh name="tetra" file="tetra.obj" scale="0.1 0.1 0.1"/></asset>
  <worldbody><geom name="floor" type="plane" size="1 1 0.1"/>
    <body name="pedestal" pos="0.1 0.2 0" euler="10 20 30">
      <geom name="foot" type="box" size="0.1 0.1 0.1" mass="5"/>
      <frame pos="0 0 0.1" euler="0 0 20">
        <body pos="0 0 0.4" childclass="shell">
          <inertial mass="9" pos="0 0 0.1" diaginertia="0.2 0.2 0.1"/>
          <joint name="swivel" axis="0 0 1" pos="0.05 0 0" range="-90 120" ref="10"
                 stiffness="4e4"/>
          <geom type="mesh" mesh="tetra"/>
          <body name="upper" pos="0.1 0 0.3">
            <joint name="lift" axis="0 1 0" range="-90 120" stiffness="5e4"/>
            <geom class="main" type="capsule" fromto="0 0 0 0.6 0 0" size="0.05"
                  mass="7"/>
            <body name="flange" pos="0.6 0 0.1" euler="0 30 0">
              <geom type="mesh" mesh="tetra" mass="1"/><site name="tool"/>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
  <actuator><position class="servo" name="first" joint="swivel"/>
    <motor name="second" joint="lift" gear="50.123456789"/></actuator>
  <sensor><jointpos name="seen" joint="lift"/></sensor>
  <keyframe><key name="home" qpos="0.2 0.12345678912" ctrl="0.1 3"/>
    <key name="low" qpos="-0.2 0.7"/></keyframe>
</mujoco>"""
TETRA = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
URDF = """<robot name="two"><link name="base"/>
  <link name="one"><inertial><origin xyz="0.2 0 0"/><mass value="5"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="two"><inertial><origin xyz="0.1 0 0"/><mass value="3"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j1" type="revolute"><parent link="base"/><child link="one"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="j2" type="revolute"><parent link="one"/><child link="two"/>
    <origin xyz="0.4 0 0" rpy="0.1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.fixture
def own(tmp_path) -> Path:
    """A model with all that a user's file may have, and its mesh."""
    folder = tmp_path / "robot"
    (folder / "parts").mkdir(parents=True)
    (folder / "parts" / "tetra.obj").write_text(TETRA)
    (folder / "own.xml").write_text(OWN)
    return folder / "own.xml"


def patched(file, effects=ALL, springs=None, laws=LAWS) -> tuple[Rig, PatchedModel]:
    given: dict[str, float | None] = {"a1": 4e4, "a2": 5e4}
    given = given if springs is None else springs
    rig = rig_of(Patch(given, tuple(effects), laws, HELD), file)
    return rig, patched_model(rig, file)


def stepped(model, body: str, force=(0.0, 0.0, 0.0), seconds=SETTLED):
    """Step as anyone would, with a force on a body's origin; return the data."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    b = model.body(body).id
    for _ in range(round(seconds / model.opt.timestep)):
        mujoco.mj_step1(model, data)
        data.xfrc_applied[b, :3] = force
        data.xfrc_applied[b, 3:] = np.cross(data.xpos[b] - data.xipos[b], force)
        mujoco.mj_step2(model, data)
    assert not [w.number for w in data.warning if w.number]
    return data


def bent(rig: Rig, held, force) -> np.ndarray:
    """Return where the rig's flange stands without and with the same force."""
    flange = rig.anatomy.flange
    base = pose_in(rig.spec.body(rig.anatomy.base), rig.spec.worldbody)[0]
    posture, one = np.array([list(held.values())]), np.ones((1, 1))
    bare = rig.respond(posture, np.zeros((1, 1, 6)), one)
    turn = bare.rotation[0, bare.bodies.index(flange)]
    lever = -turn @ np.array(rig.mounted.sensor_position)
    wrench = np.zeros((1, 2, 6))
    wrench[0, 1] = [*(base.T @ force), *(base.T @ np.cross(lever, force))]
    return rig.respond(posture, wrench, np.full((1, 2), 60.0)).point(
        flange, np.zeros(3)
    )


def bends_as_the_rig(rig, model, share=0.01):
    """Assert that plain MuJoCo bends under a force as the patched rig does."""
    flange, built = rig.anatomy.flange, model.compiled()
    still, loaded = (stepped(built, flange, f) for f in ((0, 0, 0), LOAD))
    assert abs(still.qvel).max() < 1e-6
    assert abs(loaded.qvel).max() < 1e-6
    stands, pulled = bent(rig, model.held, LOAD)
    b = built.body(flange).id
    assert_allclose(still.xpos[b], stands, atol=5e-5)
    size = np.linalg.norm(pulled - stands)
    assert size > 1e-4
    found = loaded.xpos[b] - still.xpos[b]
    assert np.linalg.norm(found - (pulled - stands)) < share * size


@pytest.mark.parametrize("arm", ["kr10_r1100_2", "ur10"])
def test_plain_mujoco_bends_a_known_arm_as_the_patched_rig(arm, root):
    springs: dict[str, float | None] = {f"a{k}": 2e4 for k in range(1, 6)}
    file = root / "mjcf" / arm / f"{arm}.xml"
    rig, model = patched(file, springs=springs | {"a6": None})
    bends_as_the_rig(rig, model)
    before = mujoco.MjModel.from_xml_path(str(file))
    after = model.compiled()
    assert after.nmesh == before.nmesh
    assert after.ngeom == before.ngeom


def test_thirteen_effects_and_offsets_of_10_mrad_bend_as_in_the_rig(root):
    """Creep goes on while the load stands: ten of its time constants pass here."""
    slow = PatchEffect("creep", "a3", {"ratio": 0.1, "time_s": SETTLED / 10})
    axes = [f"a{k}" for k in range(1, 7)]
    size: dict[str, Value] = {"offset_rad": 1e-2}
    offsets = [PatchEffect("encoder_offset", axis, size) for axis in axes]
    effects = [e for e in ALL if e is not OFFSET] + [slow, *offsets]
    file = root / "mjcf" / "ur10" / "ur10.xml"
    rig, model = patched(file, effects, dict.fromkeys(axes, 2e4))
    bends_as_the_rig(rig, model, share=0.003)


def test_plain_mujoco_bends_a_users_own_arm_as_the_patched_rig(own):
    bends_as_the_rig(*patched(own))


def test_plain_mujoco_bends_a_urdf_as_the_patched_rig(tmp_path):
    file = tmp_path / "two.urdf"
    file.write_text(URDF)
    bends_as_the_rig(*patched(file))


def test_ten_seconds_pass_without_a_warning_and_end_in_rest(own):
    _, model = patched(own)
    data = stepped(model.compiled(), "flange", LOAD, seconds=10.0)
    assert abs(data.qvel).max() < 1e-9


@pytest.mark.parametrize("arm", ["own", "two"])
def test_at_the_first_key_frame_all_is_at_rest_under_its_own_weight(arm, own):
    """What creeps has come to its end; a held axis gives by its torque over 1e9."""
    (own.parent / "two.urdf").write_text(URDF)
    slow = PatchEffect("creep", "a2", {"ratio": 0.1, "time_s": 1e3})
    file = own if arm == "own" else own.parent / "two.urdf"
    model = patched(file, (*ALL, slow))[1].compiled()
    data, moved = mujoco.MjData(model), 0.0
    mujoco.mj_resetDataKeyframe(model, data, 0)
    wound = abs(model.key_qpos[0] - model.qpos_spring).max()
    for _ in range(1000):
        mujoco.mj_step(model, data)
        moved = max(moved, abs(data.qpos - model.key_qpos[0]).max())
    assert wound > 1e-4
    assert moved < 1e-6


@pytest.mark.parametrize("effect", ALL, ids=lambda e: e.effect)
def test_each_mechanism_alone_bends_as_in_the_rig(effect, own):
    bends_as_the_rig(*patched(own, (effect,), laws=()), share=0.002)


def test_everything_of_the_users_file_is_in_it(own):
    before = mujoco.MjModel.from_xml_path(str(own))
    _, model = patched(own)
    after = model.compiled()
    for count in ("nmesh", "ngeom", "nu", "nkey", "nsensor", "nmat"):
        assert getattr(after, count) == getattr(before, count), count
    for array in ("gear", "gainprm", "biasprm", "ctrlrange"):
        name = f"actuator_{array}"
        assert_array_equal(getattr(after, name), getattr(before, name), array)
    assert_array_equal(after.key_ctrl, before.key_ctrl)
    for joint in ("swivel", "lift"):
        one, two = before.joint(joint), after.joint(joint)
        assert_array_equal(
            after.key_qpos[:, two.qposadr], before.key_qpos[:, one.qposadr]
        )
        assert_array_equal(two.range, one.range)
        assert after.dof_damping[two.dofadr] == before.dof_damping[one.dofadr]
    classes = {
        d.get("class") for d in ElementTree.fromstring(model.text).iter("default")
    }
    assert {"shell", "servo"} <= classes
    assert after.opt.timestep == before.opt.timestep


def test_every_part_that_was_added_says_so_in_its_name(own):
    names = [
        {element.get("name", "") for element in root.iter() if element.tag in tags}
        for tags in (("body", "joint", "site", "fixed", "spatial", "exclude"),)
        for root in (
            ElementTree.fromstring(plain_mjcf(load(own))),
            ElementTree.fromstring(patched(own)[1].text),
        )
    ]
    added = names[1] - names[0] - {"", "tool"}
    assert len(added) > 20
    assert all(name.startswith(PATCH) for name in added)


def test_the_folder_can_be_moved(own, tmp_path):
    _, model = patched(own)
    place = tmp_path / "elsewhere"
    (place / ASSETS).mkdir(parents=True)
    (place / "model.xml").write_text(model.text, encoding="utf-8")
    for name, data in model.assets.items():
        (place / ASSETS / name).write_bytes(data)
    assert mujoco.MjModel.from_xml_path(str(place / "model.xml")).nmesh == 1


def written(model: PatchedModel, folder: Path) -> Path:
    for name, data in model.assets.items():
        (folder / ASSETS).mkdir(exist_ok=True)
        (folder / ASSETS / name).write_bytes(data)
    (folder / "model.xml").write_text(model.text, encoding="utf-8")
    return folder / "model.xml"


def test_as_a_robot_it_has_the_users_axes_and_all_corrections(own, tmp_path):
    """Base, axes, links by their names; zeros, lengths, masses, springs corrected."""
    rig, model = patched(own)
    file = written(model, tmp_path)
    with pytest.warns(LeftOut, match=r"\d+ springs and \d+ tendons of its patch"):
        read = load(file)
    found = anatomy(read)
    assert found == rig.anatomy
    assert read.jnt_stiffness.tolist() == [4e4, 5e4]
    arm = Arm.from_mjcf_text(plain_mjcf(read))
    assert arm.axes == ("swivel", "lift")
    bare = rig_of(Patch({}, ALL, LAWS), own).model
    data = mujoco.MjData(bare)
    for axis, angle, offset in zip(arm.axes, (0.4, -0.3), (0.0, 2e-3), strict=True):
        data.joint(axis).qpos[:] = angle + offset
    mujoco.mj_forward(bare, data)
    mine = mujoco.MjData(read)
    mine.qpos[:] = [0.4, -0.3]
    mujoco.mj_forward(read, mine)
    expected = data.body("flange")
    assert_allclose(mine.body("flange").xpos, expected.xpos, atol=1e-12)
    assert_allclose(mine.body("flange").xmat, expected.xmat, atol=1e-12)
    axes = [bare.joint(axis).dofadr[0] for axis in arm.axes]
    light = 1e-9  # N m: what the bench's own bodies without mass weigh
    assert_allclose(mine.qfrc_bias, data.qfrc_bias[axes], atol=light)


def test_what_was_mounted_is_no_part_of_the_robot(own, tmp_path):
    """A recording says itself what it carries; in plain MuJoCo it hangs on the arm."""
    _, model = patched(own, (MASS,), laws=())
    bare = load(own).body_mass.sum()
    assert model.compiled().body_mass.sum() == pytest.approx(bare + 2.0 + HELD.mass_kg)
    read = load(written(model, tmp_path))
    assert read.body_mass.sum() == pytest.approx(bare + 2.0)


def test_it_can_be_patched_once_more(own, tmp_path):
    """As the robot of a second diagnosis, with bodies that the first one inserted."""
    _, model = patched(own)
    file = written(model, tmp_path)
    with pytest.warns(LeftOut):
        rig, again = patched(file, (TILT, FOOT))
    bends_as_the_rig(rig, again)
    assert len(again.not_held) == 0
    assert again.compiled().nkey == 2
    assert again.compiled().nu == 2


def test_a_rigid_arm_stays_rigid_when_it_is_read_back(root, tmp_path):
    file = root / "mjcf" / "ur10" / "ur10.xml"
    _, model = patched(file, (OFFSET,), {}, ())
    assert not load(written(model, tmp_path)).jnt_stiffness.any()


def test_another_posture_is_commanded_by_the_axes_spring_references(own):
    rig, model = patched(own)
    built = model.compiled()
    command = {"swivel": -0.3, "lift": -0.4}
    for axis, angle in command.items():
        built.qpos_spring[built.joint(axis).qposadr] = angle
    stands = stepped(built, "flange").body("flange").xpos
    wave = 1e-3 * (np.sin(2 * 0.2 + 1) - np.sin(2 * -0.3 + 1))  # WAVE stays behind
    assert_allclose(stands, bent(rig, command, LOAD)[0], atol=abs(wave) + 5e-5)


def test_actuators_drive_the_patched_arm_where_they_are_let(own):
    """Servo of 1234 N m/rad on an axis whose holding spring is taken away."""
    _, model = patched(own, (TILT, HARD), laws=())
    built = model.compiled()
    swivel = built.joint("swivel")
    held = stepped(built, "flange").qpos[swivel.qposadr[0]]
    assert held == pytest.approx(0.2, abs=1e-6)
    built.jnt_stiffness[swivel.id] = 0.0
    built.opt.disableactuator = 0
    driven = stepped(built, "flange", seconds=6.0).qpos[swivel.qposadr[0]]
    assert driven == pytest.approx(0.1, abs=0.02)


def test_what_mjcf_cannot_hold_is_listed(own):
    _, model = patched(own)
    listed = " ".join(model.not_held)
    for words in ("transmission_error at a1", "drift at tracker", "friction of joint"):
        assert words in listed
        assert words in model.text
    assert "hysteresis" not in listed


def test_it_is_held_at_the_first_key_frame_and_inside_the_ranges(own, tmp_path):
    held = patched(own)[1].held
    assert held == {"swivel": 0.2, "lift": 0.12345678912}
    bare = OWN[: OWN.index("  <keyframe>")] + "</mujoco>"
    own.write_text(bare.replace('range="-90 120" stiffness', 'range="20 40" stiffness'))
    held = patched(own)[1].held
    assert_allclose([*held.values()], np.radians([10.0, 30.0]))


def test_parts_that_overlap_do_not_push_each_other(own):
    """The foot stands in the floor, and the base gives way: both stay quiet."""
    text = OWN.replace('class="main" type="capsule"', 'class="main" type="capsule"')
    own.write_text(text.replace('size="0.1 0.1 0.1"', 'size="0.4 0.4 0.9"'))
    rig, model = patched(own, (FOOT, TILT), laws=())
    bends_as_the_rig(rig, model)
    assert "overlap" in " ".join(model.not_held)


def test_a_file_that_mujoco_cannot_write_back_is_replaced_by_the_arm(own, monkeypatch):
    """A long diagnosis is not lost over a picture; the model says what is missing."""
    rig = rig_of(Patch({"a1": 4e4, "a2": 5e4}, (TILT,)), own)
    monkeypatch.setattr("bench.patched_model.user_model", _broken)
    model = patched_model(rig, own)
    assert "no such mesh" in model.not_held[0]
    bends_as_the_rig(rig, model)


def _broken(file):
    raise ValueError("no such mesh")


def test_a_robot_with_a_reference_angle_is_read_with_its_zero_at_zero(own):
    """Pinocchio reads no ref; the body is turned instead, angles keep their meaning."""
    first, read = mujoco.MjModel.from_xml_path(str(own)), load(own)
    assert not read.qpos0.any()
    places = []
    for model in (first, read, mujoco.MjModel.from_xml_string(plain_mjcf(read))):
        data = mujoco.MjData(model)
        data.qpos[:] = [0.5, -0.7]
        mujoco.mj_kinematics(model, data)
        places.append([*data.body("flange").xpos, *data.body("flange").xmat])
    assert_allclose(places[1:], places[:1] * 2, atol=1e-14)


def test_a_spring_reference_in_the_file_moves_no_law(own):
    """The command says where springs are slack, those beside the axis' own too."""
    effects, posture = (HARD, LOOP), {"swivel": 0.3, "lift": -0.4}
    plain = bent(patched(own, effects, laws=())[0], posture, LOAD)
    own.write_text(OWN.replace('stiffness="5e4"', 'stiffness="5e4" springref="20"'))
    assert_allclose(bent(patched(own, effects, laws=())[0], posture, LOAD), plain)
