import numpy as np
import pytest

from bench.cell import GRAVITY
from bench.model_file import load
from bench.payload import SHARE, RatedLoad, effort_limits, payload_of, usual_path
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import DEFAULT_PATH

LINK = (
    '<body name="base"><body name="link" pos="0 0 1">'
    '<joint name="a1" axis="0 1 0" range="-1.5 1.5"{0}/>'
    '<inertial pos="0.4 0 0" mass="2" diaginertia="1 1 1"/>'
    '<body name="flange" pos="0.8 0 0"/></body></body>'
)


@pytest.fixture
def lever(tmp_path):
    """An arm of one lying link, whose joint or whose actuator has a limit."""

    def made(joint: str = "", rest: str = "") -> Rig:
        file = tmp_path / "lever.xml"
        file.write_text(
            '<mujoco><compiler angle="radian" autolimits="true"/>'
            f"<worldbody>{LINK.format(joint)}</worldbody>{rest}</mujoco>"
        )
        return Rig(file)

    return made


def test_payload_of_a_lever_is_what_its_torque_holds_lying(lever):
    """Weight of 2 kg at 0.4 m; the hook, 0.065 m high and 0.85 m out, on any rope."""
    rig = lever(' actuatorfrcrange="-50 50"')
    hook = np.array(rig.mounted.hook) + rig.mounted.sensor_position
    arm = np.hypot(0.8 + hook[0], hook[2])
    by_hand = (SHARE * 50 - 2 * 0.4 * GRAVITY) / (GRAVITY * arm)
    found = payload_of(rig)
    assert found is not None
    assert found.mass == pytest.approx(by_hand - rig.mounted.payload.mass, rel=1e-6)
    assert "'a1' comes first" in found.source


@pytest.mark.parametrize(
    ("joint", "rest", "expected"),
    [
        (' actuatorfrcrange="-50 40"', "", 40.0),
        ("", '<actuator><motor joint="a1" gear="3" forcerange="-9 9"/></actuator>', 27),
        (
            ' actuatorfrcrange="-50 50"',
            '<actuator><position joint="a1" kp="9" forcerange="-60 60"/></actuator>',
            50.0,
        ),
        ("", '<actuator><motor joint="a1"/></actuator>', np.inf),
        ("", "", np.inf),
    ],
)
def test_effort_limits_are_those_of_joint_and_actuators(lever, joint, rest, expected):
    model = load(lever(joint, rest).arm_file)
    np.testing.assert_allclose(effort_limits(model, ("a1",)), [expected])


def test_effort_of_a_urdf_is_a_limit_and_none_is_none(tmp_path):
    urdf = (
        '<robot name="r"><link name="base"/><link name="arm"><inertial>'
        '<origin xyz="0.2 0 0"/><mass value="1"/><inertia ixx="1" iyy="1" izz="1"'
        ' ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute">'
        '<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="{}"/></joint></robot>'
    )
    for effort, expected in ((56, 56.0), (0, np.inf)):
        (tmp_path / "arm.urdf").write_text(urdf.format(effort))
        model = load(tmp_path / "arm.urdf")
        np.testing.assert_allclose(effort_limits(model, ("j",)), [expected])


def test_stated_payload_goes_before_limits(lever):
    stated = '<custom><numeric name="payload_kg" data="{}"/></custom>'
    found = payload_of(lever(' actuatorfrcrange="-1 1"', stated.format(7.5)))
    assert found == RatedLoad(7.5, "the payload that its model states")
    with pytest.raises(Unusable, match="payload_kg is -1, expected above 0"):
        payload_of(lever("", stated.format(-1)))


def test_limits_that_do_not_hold_the_arm_are_refused(lever):
    with pytest.raises(Unusable, match="do not hold the arm's own weight"):
        payload_of(lever(' actuatorfrcrange="-5 5"'))


MOTOR = '<actuator><motor joint="a1" gear="2" ctrlrange="-{0} {0}"{1}/></actuator>'


def test_motors_hold_what_the_range_of_their_controls_allows(lever):
    limited = payload_of(lever(' actuatorfrcrange="-50 50"'))
    found = payload_of(lever(' actuatorfrcrange="-90 90"', MOTOR.format(25, "")))
    assert found == limited
    assert payload_of(lever("", MOTOR.format(99, ' forcerange="-25 25"'))) == limited


def test_controls_that_do_not_hold_the_arm_are_no_limits(lever):
    """They may come beside gravity's torque; what the drives hold is not said."""
    assert payload_of(lever("", MOTOR.format(2, ""))) is None
    wide = ' actuatorfrcrange="-50 50"'
    assert payload_of(lever(wide, MOTOR.format(2, ""))) == payload_of(lever(wide))
    servo = MOTOR.replace("motor", "position")
    assert payload_of(lever("", servo.format(25, ""))) is None


def test_nothing_is_claimed_where_the_model_says_nothing(lever):
    assert payload_of(lever()) is None
    assert usual_path(None) == DEFAULT_PATH


def test_arms_of_the_bench_state_their_payload(kr10, root):
    for file in (kr10, root / "mjcf" / "ur10" / "ur10.xml"):
        found = payload_of(Rig(file))
        assert found is not None and found.mass == 10.0
        assert usual_path(found) == DEFAULT_PATH


@pytest.mark.parametrize(
    ("payload", "largest"), [(3.29, 3.2), (0.837, 0.83), (14.0, 10.0), (9.99, 9.9)]
)
def test_usual_loads_scale_down_to_two_digits_of_the_payload(payload, largest):
    path = usual_path(RatedLoad(payload, ""))
    masses = [step.mass for step in path]
    usual = [step.mass * largest / 10.0 for step in DEFAULT_PATH]
    np.testing.assert_allclose(masses, usual, rtol=1e-12)
    assert [step.hold for step in path] == [step.hold for step in DEFAULT_PATH]
