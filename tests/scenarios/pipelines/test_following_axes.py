import numpy as np
import pytest

from bench.model_file import followers_of, load, plain_mjcf
from bench.proof.setup import why_not_simulated
from bench.rig import Rig
from bench.shared.format import folder
from scenarios import record
from scenarios.pipelines.inputs import arm_of, read_for

SECOND = """<body name="upper" pos="0 0 0.3">
      <joint name="second" type="slide" axis="0 0 1" range="-1 1" stiffness="1e6"/>
      <inertial pos="0 0 0.1" mass="5" diaginertia="1 1 1"/>"""
LIFT = f"""<mujoco><worldbody><body name="base"><inertial pos="0 0 0" mass="9"
    diaginertia="1 1 1"/><body name="lower" pos="0 0 0.3">
      <joint name="first" type="slide" axis="0 0 1" range="0 0.4" stiffness="1e6"/>
      <inertial pos="0 0 0.1" mass="8" diaginertia="1 1 1"/>
      {SECOND}<body name="yoke" pos="0 0 0.2">
        <joint name="turn" axis="0 0 1" range="-120 120" stiffness="5e4"/>
        <inertial pos="0.2 0 0" mass="3" diaginertia="1 1 1"/>
        <body name="flange" pos="0.5 0 0"/></body></body></body></body></worldbody>
<equality><joint joint1="second" joint2="first" polycoef="0.02 0.8"/></equality>
</mujoco>"""
"""A lift of two stages: the second follows the first, 20 mm and four fifths of it."""
URDF = """<robot name="lift">
  <link name="base"/><link name="lower"/><link name="upper"/>
  <joint name="first" type="prismatic"><parent link="base"/><child link="lower"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.4" effort="9" velocity="1"/></joint>
  <joint name="second" type="prismatic"><parent link="lower"/><child link="upper"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="9" velocity="1"/>
    <mimic joint="first" multiplier="0.8" offset="0.02"/></joint></robot>"""


@pytest.fixture
def lift(tmp_path):
    file = tmp_path / "lift.xml"
    file.write_text(LIFT)
    return file


def test_mjcf_and_urdf_say_the_same_of_a_joint_that_follows(lift, tmp_path):
    urdf = tmp_path / "lift.urdf"
    urdf.write_text(URDF)
    law = {"second": ("first", (0.02, 0.8))}
    assert followers_of(load(lift)) == followers_of(load(urdf)) == law
    assert arm_of(lift).file.followers == arm_of(urdf).file.followers == law
    from_refs = LIFT.replace('range="0 0.4"', 'range="0 0.4" ref="0.1"')
    lift.write_text(from_refs.replace('range="-1 1"', 'range="-1 1" ref="0.3"'))
    ((leader, shifted),) = followers_of(load(lift)).values()
    assert leader == "first"
    np.testing.assert_allclose(shifted, (0.3 + 0.02 - 0.8 * 0.1, 0.8), atol=1e-15)


def test_a_recording_leaves_out_what_follows_and_both_engines_fill_it_in(
    lift, tmp_path
):
    """Markers stand where the simulator has them, with a column that nobody read."""
    watch = record.Watching(targets="flange", state_frame=True, noise_mm=(0.0,))
    settings = record.Settings(
        tmp_path / "all", robot=lift, poses=6, path="0,5,0", watch=watch
    )
    made = record.main(settings)
    assert made.axes == ("first", "second", "turn")
    np.testing.assert_allclose(made.posture[:, 1], 0.02 + 0.8 * made.posture[:, 0])
    columns = [0, 2]
    bare = made.__class__(
        **{
            **{name: getattr(made, name) for name in made.__dataclass_fields__},
            "posture": made.posture[:, columns],
            "axes": (),
            "slides": (True, False),
        }
    )
    folder.write(tmp_path / "read", bare)
    recording, arm, notes = read_for(tmp_path / "read", arm_of(lift))
    assert recording.axes == arm.axes == ("first", "turn", "second")
    assert any("'second' follows 'first'" in note for note in notes)
    np.testing.assert_allclose(recording.posture, made.posture[:, [0, 2, 1]])
    assert why_not_simulated(recording, lift) == ""
    rest = arm.at(recording.posture[:1]).point("flange", np.zeros(3))
    posture = made.posture[:1]
    rig = Rig(lift, stiffness=np.full(3, 1e12))
    states = rig.respond(posture, np.zeros((1, 1, 6)), np.ones((1, 1)))
    np.testing.assert_allclose(rest, states.point("flange", np.zeros(3)), atol=1e-9)


def test_a_joint_whose_leader_is_no_axis_stays_where_it_is(lift):
    plain = plain_mjcf(load(lift))
    assert 'name="follows:second" data="0.02 0.8:first"' in plain
    held = Rig(lift, axes=("second", "turn")).anatomy
    posture = np.array([[0.3, 1.0]])
    np.testing.assert_allclose(held.following(posture), [[0.02, 1.0]])
