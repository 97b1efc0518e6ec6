import numpy as np

from bench.recording import Marker, Recording, TrackerSpec, WrenchSpec
from stiffness.arm import Arm
from stiffness.diagnosis.hypotheses.hysteresis import stop
from stiffness.diagnosis.situation import Situation
from stiffness.diagnosis.standing_under_load import situation_of

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


def loaded(side: str) -> tuple[Situation, np.ndarray]:
    """Pull one hand by a force and a torque along the base's axes."""
    arm = Arm.from_mjcf_text(TORSO)
    posture = np.array([[0.3, 0.2, -0.4, 0.5, 0.1]] * 2)
    wrench = np.array([np.zeros(6), [10.0, 20.0, 30.0, 3.0, 2.0, 1.0]])
    sensor = WrenchSpec(0.1, 0.01, f"{side}_hand", np.array([0, 0, 0.1]), frame="base")
    recording = Recording(
        name="torso",
        time=np.array([0.0, 10.0]),
        pose=np.zeros(2, int),
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
    return situation_of(arm, recording, np.zeros(5), (f"{side}_hand",)), expected


def test_a_load_on_either_hand_turns_that_arm_s_axes_and_the_waist_alone():
    """Torques from moments of places are those of the Jacobian."""
    for side, others in (("left", [3, 4]), ("right", [1, 2])):
        situation, expected = loaded(side)
        np.testing.assert_allclose(situation.torque, expected, atol=1e-12)
        np.testing.assert_allclose(np.diff(situation.torque[:, others], axis=0), 0.0)


def test_an_axis_that_no_load_turns_has_no_loop():
    situation, _ = loaded("left")
    assert np.all(stop(situation, 4, 0.0) == 0.0)
