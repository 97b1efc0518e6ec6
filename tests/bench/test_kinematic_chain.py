from dataclasses import replace

import numpy as np
import pytest
from torso import TORSO, alone, drawn_postures

from bench.effects.encoder_offset import EncoderOffset
from bench.effects.geometry_error import GeometryError
from bench.effects.places import places_for
from bench.kinematic_chain import anatomy
from bench.model_file import load, plain_mjcf
from bench.proof.setup import point_in_base
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import Plan
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium

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


# --- A torso with two arms ------------------------------------------------------------


@pytest.fixture
def torso(tmp_path):
    path = tmp_path / "torso.xml"
    path.write_text(TORSO)
    return path


@pytest.mark.parametrize("hand", ["left_hand", "right_hand"])
def test_both_engines_find_a_loaded_tree_in_the_same_place(torso, hand):
    """All sixteen springs give way to a pull at one hand: to a nanometre."""
    rig = alone(Rig(torso, hand=hand))
    posture, pull = (
        drawn_postures(rig, 5),
        np.array([30.0, -20.0, 40.0, 2.0, 1.0, -3.0]),
    )
    states = rig.respond(posture, np.tile(pull, (5, 1, 1)), np.ones((5, 1)))
    arm = Arm.from_mjcf_text(plain_mjcf(load(torso)))
    compliance, each = arm.compliance, np.tile(pull, (5, 1))
    rest = equilibrium(arm, posture, compliance, each, np.zeros(3), body=hand)
    for body in ("left_hand", "right_hand", "chest"):
        there = point_in_base(rig, states, body, np.zeros(3))
        np.testing.assert_allclose(
            arm.point_in_base(rest, body, np.zeros(3)), there, atol=1e-9
        )


def test_a_tree_has_an_end_of_its_chest_for_each_arm(torso):
    parts, arm = Rig(torso, hand="left_hand").anatomy, Arm.from_mjcf_text(TORSO)
    assert [parts.axes[k] for k in parts.chain[:3]] == ["lift", "waist", "left_1"]
    assert parts.hands == {8: "left_hand", 15: "right_hand"} and parts.mount == 8
    ends = [name for name in arm.chain.links if ":" in name]
    assert ends == ["link_2:a3", "link_2:a10"]
    assert set(arm.chain.links) < set(places_for(("link",), parts))


def test_an_error_at_one_end_of_a_link_moves_that_arm_alone(torso):
    rig = Rig(torso, hand="left_hand")
    posture, none = drawn_postures(rig, 2), np.zeros((2, 1, 6))
    moved = replace(rig, effects=(GeometryError("link_2:a10", x_m=1e-3, ry_rad=0.0),))
    before, after = (
        one.respond(posture, none, np.ones((2, 1))) for one in (rig, moved)
    )
    for body, size in (("right_hand", 1e-3), ("left_hand", 0.0)):
        way = after.point(body, np.zeros(3)) - before.point(body, np.zeros(3))
        np.testing.assert_allclose(np.linalg.norm(way, axis=1), size, atol=1e-6)


def test_a_link_with_several_ends_needs_one_to_be_named(torso):
    for where in ("link_2", "link_2:a4", "chest"):
        rig = Rig(torso, (GeometryError(where),), hand="left_hand")
        with pytest.raises(Unusable, match="write link_2:a3 or link_2:a10"):
            _ = rig.model
