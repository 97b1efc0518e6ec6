import numpy as np
import pytest

from bench.effects.encoder_offset import EncoderOffset
from bench.kinematic_chain import anatomy
from bench.model_file import load, plain_mjcf
from bench.rig import Rig
from bench.shared.plan import Plan
from stiffness.robot.arm import Arm

BRANCHING = """<mujoco><worldbody>
  <body name="table" pos="0 0 -1"><geom size="0.1" mass="1"/></body>
  <body name="foot" pos="0.1 0 0.2"><geom size="0.1" mass="1"/>
    <body pos="0 0 0.3"><joint name="a2" axis="0 0 1" range="-2 2"/>
      <geom size="0.1" mass="1"/>
      <body pos="0.3 0 0"><joint name="a1" axis="0 1 0" range="-2 2"/>
        <geom size="0.1" mass="1"/>
        <body name="finger" pos="0.2 0.05 0"><geom size="0.02" mass="0.1"/></body>
        <body name="thumb" pos="0.2 -0.05 0"><geom size="0.02" mass="0.1"/></body>
      </body></body></body>
  <body name="stand" pos="2 0 0"><geom size="0.1" mass="1"/></body>
</worldbody></mujoco>"""
"""Joints in the other order, links without a name, a last link that branches."""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "branching.xml"
    path.write_text(BRANCHING)
    return path


def test_a1_is_the_first_axis_whatever_joints_are_called(file):
    rig = Rig(file, (EncoderOffset("a1", offset_rad=0.1),))
    assert rig.anatomy.axes == ("a2", "a1")
    assert [rig.anatomy.axis(a) for a in ("a1", "a2")] == ["a2", "a1"]
    plan = Plan("one", np.zeros((1, 2)), np.array([0]), np.array([0]))
    np.testing.assert_allclose(rig.carry_out(plan).axis_angle[0], [0.1, 0], atol=1e-3)
    assert Arm.from_mjcf_text(plain_mjcf(load(file))).axes == rig.anatomy.axes


def test_bench_and_claims_find_the_same_parts_in_the_same_places(file):
    model = load(file)
    parts, arm = anatomy(model), Arm.from_mjcf_text(plain_mjcf(model))
    assert (parts.base, parts.flange) == ("foot", "thumb")
    for name in ("base", "link_1", "link_2", "flange"):
        own, found = arm.attachment(parts.body(name)), arm.attachment(name)
        assert own.axis == found.axis
        np.testing.assert_array_equal(own.placement, found.placement)
