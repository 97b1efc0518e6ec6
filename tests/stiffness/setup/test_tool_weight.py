"""Whether readings hold the tool's weight is told by those without a load."""

from dataclasses import replace

import numpy as np
import pytest
from small_bench import arm, recording

from bench.shared.recording import Payload, Recording
from stiffness.setup.check import setup_errors
from stiffness.setup.loads import of_tool

TOOL = Payload(mass=0.5, com=np.array([0.0, 0.0, 0.05]))


def weighed(mass: float, stated: bool) -> Recording:
    """Return a recording whose readings hold a mass, and one that may be stated."""
    made = recording(poses=20)
    sensor, nominal = made.wrench_sensor, arm()
    assert made.wrench is not None and sensor is not None
    assert np.array_equal(sensor.quaternion_wxyz, [1.0, 0.0, 0.0, 0.0])
    turn = nominal.at(made.posture).turn(sensor.body)
    wrench = made.wrench.copy()
    wrench[:, :3] += mass * np.einsum("rji,j->ri", turn, nominal.chain.gravity)
    wrench[:, :3] += [3.0, -1.0, 2.0]  # its zero is off, too
    sensor = replace(sensor, includes_tool_weight=stated)
    return replace(made, wrench=wrench, wrench_sensor=sensor, tool=TOOL)


@pytest.mark.parametrize(
    ("mass", "stated", "words"),
    [
        (0.5, False, ("hold 0.50 kg", "includes_tool_weight = true")),
        (0.0, True, ("hold 0.00 kg", "includes_tool_weight = false")),
        (0.5, True, ()),
        (0.0, False, ()),
        (0.2, False, ()),  # neither: another mass may be there
    ],
)
def test_a_tools_weight_that_is_stated_wrongly_is_said(mass, stated, words):
    said = setup_errors(weighed(mass, stated), arm())
    assert len(said) == bool(words)
    for one in said:
        assert (one.code, one.where) == ("tool_weight", "wrench_sensor")
        assert all(word in one.text for word in words)


def test_forces_along_the_bases_axes_do_not_tell_a_weight_from_a_zero():
    made = weighed(0.5, stated=False)
    assert made.wrench_sensor is not None
    base = replace(made.wrench_sensor, frame="base")
    assert "tool_weight" not in {
        one.code for one in setup_errors(replace(made, wrench_sensor=base), arm())
    }


@pytest.mark.parametrize("stated", [True, False])
def test_an_arm_on_a_wall_is_no_tool_that_is_stated_wrongly(stated):
    """What is taken off for the tool there pulls along two directions of the base."""
    made, nominal = weighed(0.5, stated=True), arm()
    wall = nominal.chain.gravity[[2, 1, 0]]
    hung = replace(nominal, chain=replace(nominal.chain, gravity=wall))
    assert made.wrench_sensor is not None
    sensor = replace(made.wrench_sensor, includes_tool_weight=stated)
    told = of_tool(replace(made, wrench_sensor=sensor), hung)
    assert told is None
