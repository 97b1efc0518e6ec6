import os
from itertools import pairwise
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench import model_file
from bench.kinematic_chain import anatomy
from bench.model_file import load, plain_mjcf
from bench.shared.errors import BenchError, LeftOut, Unusable
from scenarios.report import command_line

CLOSE = 1e-10
"""In m, 1, N m: the bar on positions, Jacobians and gravity torques."""
THIRD = 1 / 3

URDF = f"""<robot name="two"><!-- lengths that no short decimal is -->
  <link name="base"/>
  <link name="link_1"><inertial><origin xyz="0.1 {THIRD} 0" rpy="0.1 0.2 0.3"/>
    <mass value="{2 + THIRD}"/>
    <inertia ixx="0.05" iyy="0.04" izz="0.03" ixy="0.001" ixz="0.002" iyz="0.003"/>
  </inertial></link>
  <link name="link_2"><inertial><origin xyz="0 0 0.2"/><mass value="1.7"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.01" ixy="0" ixz="0" iyz="0"/>
  </inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="link_1"/>
    <origin xyz="0 0.1 {THIRD}" rpy="0.3 -0.2 0.1"/><axis xyz="0 0.6 0.8"/>
    <limit lower="-2" upper="2.5" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="link_1"/><child link="link_2"/>
    <origin xyz="0.2 0 0.3" rpy="0 1.1 0"/><axis xyz="1 0 0"/>
    <limit lower="-0.2" upper="0.4" effort="1" velocity="1"/></joint>
</robot>"""
MJCF = """<mujoco><compiler angle="degree"/>
  <default><joint damping="3" armature="0.1"/></default>
  <worldbody><geom type="plane" size="1 1 1"/>
    <body name="base" pos="0.1 0.2 0.3" euler="10 20 30">
      <inertial mass="3" pos="0 0 0" diaginertia="1 1 1"/>
      <body name="link_1" pos="0 0 0.5">
        <inertial mass="2" pos="0.1 0 0" diaginertia="0.1 0.2 0.15"/>
        <joint name="a1" axis="0 1 0" pos="0.05 0 0" range="-90 120" stiffness="5e4"
               ref="10" springref="20"/>
        <geom type="box" size="0.1 0.1 0.1" mass="0"/>
      </body>
    </body>
  </worldbody></mujoco>"""


@pytest.fixture
def urdf(tmp_path):
    """A URDF of a hinge that carries a slide."""
    file = tmp_path / "two.urdf"
    file.write_text(URDF)
    return file


def stands(model: mujoco.MjModel, posture: np.ndarray, body: str):
    """Return place, orientation, Jacobian and gravity torque in MuJoCo."""
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((6, model.nv))
    mujoco.mj_jacBody(model, data, jacobian[:3], jacobian[3:], model.body(body).id)
    seen = data.body(body)
    return seen.xpos, seen.xmat.reshape(3, 3), jacobian, data.qfrc_bias


def stands_in_pinocchio(model: pin.Model, posture: np.ndarray, body: str):
    """Return the same by the other engine."""
    data, frame = model.createData(), model.getFrameId(body)
    assert frame < model.nframes
    along_world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    jacobian = pin.computeFrameJacobian(model, data, posture, frame, along_world)
    pin.framesForwardKinematics(model, data, posture)
    placement = data.oMf[frame]
    gravity = pin.computeGeneralizedGravity(model, data, posture)
    return placement.translation, placement.rotation, jacobian, gravity


# --- Plain MJCF ----------------------------------------------------------------------


@pytest.mark.parametrize("arm", ["kr10_r1100_2", "ur10"])
def test_both_engines_agree_on_plain_mjcf(arm, root, tmp_path):
    original = load(root / "mjcf" / arm / f"{arm}.xml")
    file = tmp_path / "plain.xml"
    file.write_text(plain_mjcf(original))
    plain, other = load(file), pin.buildModelFromMJCF(str(file))
    low, high = original.jnt_range.T
    for posture in np.random.default_rng(0).uniform(low, high, (20, 6)):
        first = stands(original, posture, "flange")
        for found in (
            stands(plain, posture, "flange"),
            stands_in_pinocchio(other, posture, "flange"),
        ):
            for one, two in zip(first, found, strict=True):
                np.testing.assert_allclose(two, one, rtol=0, atol=CLOSE)


def test_urdf_becomes_mjcf_that_both_engines_read(urdf, tmp_path):
    file = tmp_path / "plain.xml"
    file.write_text(plain_mjcf(load(urdf)))
    straight = pin.buildModelFromUrdf(str(urdf))
    plain, other = load(file), pin.buildModelFromMJCF(str(file))
    draws = np.random.default_rng(1).uniform([-2, -0.2], [2.5, 0.4], (20, 2))
    for posture in draws:
        first = stands_in_pinocchio(straight, posture, "link_2")
        for found in (
            stands(plain, posture, "link_2"),
            stands_in_pinocchio(other, posture, "link_2"),
        ):
            for one, two in zip(first, found, strict=True):
                np.testing.assert_allclose(two, one, rtol=0, atol=CLOSE)


def test_everything_that_moves_reads_back_to_the_last_bit(tmp_path):
    model = mujoco.MjModel.from_xml_string(MJCF)
    plain = mujoco.MjModel.from_xml_string(plain_mjcf(model))
    for name in (
        *("body_pos", "body_mass", "body_ipos", "body_inertia", "jnt_pos"),
        *("jnt_axis", "jnt_range", "jnt_stiffness", "qpos0", "qpos_spring"),
        *("dof_armature", "dof_damping"),
    ):
        np.testing.assert_array_equal(getattr(plain, name), getattr(model, name))
    for name in ("body_quat", "body_iquat"):  # normalised once more
        np.testing.assert_allclose(
            getattr(plain, name), getattr(model, name), rtol=0, atol=1e-16
        )
    np.testing.assert_array_equal(plain.opt.gravity, model.opt.gravity)


lengths = st.floats(-2.0, 2.0).map(lambda x: x if abs(x) > 1e-9 else 0.0)


@given(st.tuples(lengths, lengths, lengths), st.floats(1e-3, 1e3))
def test_no_digit_of_a_number_is_lost(place, mass):
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name="b", pos=place)
    body.mass, body.inertia, body.explicitinertial = mass, [1.0, 1.0, 1.0], True
    body.add_joint(name="j")
    plain = mujoco.MjModel.from_xml_string(plain_mjcf(spec.compile()))
    assert tuple(plain.body("b").pos) == place
    assert plain.body("b").mass[0] == mass


def test_plain_is_plain(kr10):
    """One file without defaults, pictures, sites, contacts, tendons or motors."""
    root = ElementTree.fromstring(plain_mjcf(load(kr10)))
    tags = {element.tag for element in root.iter()}
    kept = {"mujoco", "compiler", "option", "worldbody", "body", "inertial", "joint"}
    assert tags <= kept
    assert plain_mjcf(mujoco.MjModel.from_xml_string(plain_mjcf(load(kr10)))) == (
        plain_mjcf(load(kr10))
    )


# --- Refusals ------------------------------------------------------------------------


def test_missing_file_is_refused_with_what_to_give(tmp_path):
    with pytest.raises(BenchError, match=r"no model file .*give an MJCF or URDF"):
        load(tmp_path / "none.xml")
    with pytest.raises(BenchError, match="no model file"):
        load(tmp_path)


def test_file_that_swells_on_reading_is_refused_unread(tmp_path):
    """Ten entities of ten each are a thousand million words: the billion laughs."""
    names = [f"e{k}" for k in range(10)]
    lines = [f'<!ENTITY {names[0]} "ha">']
    lines += [f'<!ENTITY {b} "{10 * f"&{a};"}">' for a, b in pairwise(names)]
    text = f"<!DOCTYPE mujoco [{''.join(lines)}]><mujoco model='&{names[-1]};'/>"
    (tmp_path / "bomb.xml").write_text(text)
    with pytest.raises(BenchError, match="XML entities"):
        load(tmp_path / "bomb.xml")


def test_file_that_is_too_large_is_refused_unread(tmp_path, monkeypatch):
    monkeypatch.setattr(model_file, "LARGEST_MODEL", 100)
    (tmp_path / "large.xml").write_text(MJCF)
    with pytest.raises(BenchError, match="larger than 100 bytes"):
        load(tmp_path / "large.xml")


ARM = """<body><joint name="{}" axis="0 1 0"/><geom size="0.1"/>{}</body>"""
HUGE = [
    pytest.param(
        '<worldbody><replicate count="200"><replicate count="200" offset="0 0 1">'
        '<geom size="1"/></replicate></replicate></worldbody>',
        r"unfolds to 8.*e\+04 parts; the most is 20000",
        id="replicate",
    ),
    pytest.param(
        '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>',
        r"hfield has 3.6e\+09 cells; the most is 10000000",
        id="hfield",
    ),
    pytest.param(
        '<asset><hfield name="h" nrow="+6000 " ncol=" 6000" size="1 1 1 1"/></asset>',
        r"hfield has 3.6e\+07 cells; the most is 10000000",
        id="sign and spaces",
    ),
    pytest.param(
        '<asset><mesh name="m" file="../secret.stl"/></asset>',
        r"'\.\./secret\.stl' leaves the model's folder",
        id="elsewhere",
    ),
    pytest.param('<include file="pipe.xml"/>', "'pipe.xml' is not a file", id="pipe"),
    pytest.param(
        '<asset><texture name="t" type="cube" fileright="../secret.stl"/></asset>',
        r"'\.\./secret\.stl' leaves the model's folder",
        id="side of a cube",
    ),
    pytest.param('<size nuserdata="2000000000"/>', r"size has 2e\+09 cells", id="size"),
    pytest.param(
        f'<worldbody><replicate count="² {"9" * 5000}"/></worldbody>',
        "unfolds to inf parts",
        id="count that is none",
    ),
]


@pytest.mark.parametrize(("asked", "says"), HUGE)
def test_model_that_asks_for_too_much_or_elsewhere_is_refused(tmp_path, asked, says):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.stl").write_text("x")
    os.mkfifo(inside / "pipe.xml")
    (inside / "deep.xml").write_text(f"<mujoco>{asked}</mujoco>")
    main = '<mujoco><include file="deep.xml"/></mujoco>'
    (inside / "main.xml").write_text(main)
    with pytest.raises(Unusable, match=says):
        load(inside / "main.xml")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("</mujoco>", "<!-- é --></mujoco>", "is not UTF-8 text"),
        ('name="j"', 'name="j" stiffness="inf"', "has the stiffness inf"),
        ("<worldbody>", '<option gravity="nan 0 0"/><worldbody>', "or gravity in it"),
        (
            "</mujoco>",
            '<custom><text name="follows:j" data="x:j"/></custom></mujoco>',
            "'j' follows 'j' by what is no number",
        ),
    ],
)
def test_what_no_arm_can_be_is_refused_in_a_sentence(tmp_path, old, new, says):
    body = ARM.format("j", "")
    text = f"<mujoco><worldbody>{body}</worldbody></mujoco>"
    text = text.replace(old, new, 1)
    (tmp_path / "arm.xml").write_text(text, encoding="latin-1")
    with pytest.raises(Unusable, match=says):
        load(tmp_path / "arm.xml")


def test_two_joints_of_one_body_are_refused_by_name(tmp_path):
    text = ARM.format("one", '<joint name="two" axis="1 0 0"/>')
    file = tmp_path / "two.xml"
    file.write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    with pytest.raises(Unusable, match="'body_1' has 2 joints; give each a body of"):
        load(file)


# --- What is left out ----------------------------------------------------------------


def test_parts_without_a_name_are_numbered_and_keep_clear_of_names(tmp_path):
    text = ARM.format("", ARM.format("joint_1", ""))
    file = tmp_path / "nameless.xml"
    file.write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    model = load(file)
    assert [model.joint(j).name for j in range(2)] == ["joint_2", "joint_1"]
    assert [model.body(b).name for b in (1, 2)] == ["body_1", "body_2"]


def test_what_moves_the_arm_and_is_left_out_is_said(tmp_path):
    file = tmp_path / "tied.xml"
    tie = '<equality><joint joint1="one" polycoef="0 1 0 0 0"/></equality>'
    file.write_text(
        f"<mujoco>{tie}<worldbody>{ARM.format('one', '')}</worldbody></mujoco>"
    )
    with pytest.warns(LeftOut, match=r"tied\.xml.*equality constraints.* left out"):
        load(file)


def test_what_is_left_out_is_said_once_however_often_the_model_is_read(capsys):
    said = LeftOut("Model 'two.xml': tendons left out.")
    for _ in range(3):
        command_line._noted(said, LeftOut, "bench/model_file.py", 1)
    assert capsys.readouterr().err == f"Note: {said}\n"


def test_urdf_keeps_its_fixed_links_and_needs_no_mesh(urdf):
    mesh = '<geometry><mesh filename="package://arm/meshes/1.stl"/></geometry>'
    shapes = f"<visual>{mesh}</visual><collision>{mesh}</collision></link>"
    tool = '<link name="tool0"/><joint name="f" type="fixed"><parent link="link_2"/>'
    tool += '<child link="tool0"/><origin xyz="0 0 0.1"/></joint></robot>'
    text = URDF.replace("</link>", shapes).replace("</robot>", tool)
    urdf.write_text(text)
    model = load(urdf)
    assert model.ngeom == 0
    assert anatomy(model).flange == "tool0"


@pytest.mark.parametrize("text", ["", "no model", "<mujoco><worldbody>", "<unknown/>"])
def test_file_that_is_no_model_is_refused_by_name(tmp_path, text):
    (tmp_path / "bad.xml").write_text(text)
    with pytest.raises(Unusable, match=r"bad\.xml.*cannot be used"):
        load(tmp_path / "bad.xml")


@pytest.mark.parametrize("kind", ["ball", "free"])
def test_joint_that_neither_turns_nor_slides_is_refused_by_name(kind):
    text = f"""<mujoco><worldbody><body><joint name="odd" type="{kind}"/>
        <geom size="1"/></body></worldbody></mujoco>"""
    with pytest.raises(Unusable, match="'odd' is neither a hinge nor a slide"):
        plain_mjcf(mujoco.MjModel.from_xml_string(text))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (
            '<mass value="1.7"/>',
            '<mass value="-4"/>',
            "link 'link_2' has the mass '-4'",
        ),
        ('<mass value="1.7"/>', '<mass value="x"/>', "link 'link_2' has the mass 'x'"),
        (
            '</joint>\n  <joint name="slide"',
            '<mimic joint="gone"/></joint>\n  <joint name="slide"',
            "joint 'turn' follows 'gone', which is none",
        ),
        ("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', ""),
        (
            '<robot name="two">',
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="two">'
            '<xacro:property name="x" value="1"/>',
            "expand them first",
        ),
    ],
)
def test_what_mujoco_passes_over_in_a_urdf_is_refused(tmp_path, old, new, says):
    file = tmp_path / "two.urdf"
    file.write_text(URDF.replace(old, new))
    assert file.read_text() != URDF
    if not says:
        assert load(file).njnt == 2
        return
    with pytest.raises(Unusable, match=says):
        load(file)


def test_a_spring_that_is_slack_elsewhere_is_said_to_be_left_out(tmp_path):
    (tmp_path / "arm.xml").write_text(MJCF)
    with pytest.warns(LeftOut, match="angles at which springs are slack left out"):
        load(tmp_path / "arm.xml")
