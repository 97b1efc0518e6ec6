"""Arms whose base, flange and sensor are turned and moved, loaded, with a tool."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from bench.effects.hysteresis import Hysteresis
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.instruments.random_streams import streams
from bench.instruments.tracker import standpoint
from bench.model_file import load, plain_mjcf
from bench.patch import Patch, named
from bench.proof.proof import Proof, prove
from bench.rig import Rig
from bench.shared.plan import parse_path
from bench.shared.recording import Recording
from bench.standard_plans import tour
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.hysteresis import Hysteresis as OnPaper
from stiffness.robot.arm import Arm

BASE = Rotation.from_rotvec([0.7, -1.9, 0.8])
"""How the base stands in the world: on a slanted wall."""
FLANGE = Rotation.from_rotvec([-1.1, 0.4, 2.0])
SENSOR = Rotation.from_rotvec([0.3, 1.2, -0.6])
MOUNT_KG = 2.0
"""Mass of plate and hook beyond the sensor; a wrong sense of down costs 40 µm."""
SEED, POSES = 3, 24
SCALE = np.array([1.5, 0.7, 1.2, 0.8, 2.0, 0.5])
WIDTH = 3e-4
"""Of the loop that is concealed at a2, in rad."""


def quaternion(turn: Rotation) -> str:
    return " ".join(map(repr, turn.as_quat(scalar_first=True).tolist()))


def turned(kr10: Path, folder: Path, gravity_too: bool) -> Path:
    """Write the arm with base and flange turned and moved.

    Args:
        kr10: The arm on its feet.
        folder: Where to.
        gravity_too: Whether gravity turns with the base, so that nothing changes for
            an observer who stands on it.
    """
    root = ElementTree.fromstring(plain_mjcf(load(kr10)))
    bodies = {body.get("name"): body for body in root.iter("body")}
    bodies["base"].set("pos", "0.4 -0.7 1.3")
    bodies["base"].set("quat", quaternion(BASE))
    if gravity_too:
        option = root.find("option")
        assert option is not None
        option.set(
            "gravity", " ".join(map(repr, BASE.apply([0.0, 0.0, -9.81]).tolist()))
        )
    else:
        own = np.array(bodies["flange"].get("quat", "").split(), dtype=float)
        flange = Rotation.from_quat(own, scalar_first=True) * FLANGE
        bodies["flange"].set("quat", quaternion(flange))
    path = folder / "turned.xml"
    path.write_text(ElementTree.tostring(root, encoding="unicode"), encoding="utf-8")
    return path


def recorded(model: Path) -> Recording:
    rig = Rig(model)
    rig = replace(rig, cell=replace(rig.mounted, mount_mass=MOUNT_KG))
    plan = tour(rig, POSES, parse_path("0,5,10,5,0"), 0, 0)
    stiff = rig.nominal.jnt_stiffness * SCALE
    true = replace(rig, effects=(Hysteresis("a2", width_rad=WIDTH),), stiffness=stiff)
    return record(true, plan, Instruments(markers=Markers(placement=5e-4)), seed=SEED)


def weighed(recording: Recording, model: Path, frame: str) -> Recording:
    """Let the sensor read the tool's weight too, along turned axes or the base's.

    By Pinocchio's kinematics of the reported posture, apart from the simulator.
    """
    arm = Arm.from_mjcf_text(plain_mjcf(load(model))).for_recording(recording)
    stand = arm.at(recording.posture)
    spec, tool = recording.wrench_sensor, recording.tool
    assert spec is not None and tool is not None and recording.wrench is not None
    axes = stand.turn("flange")
    lever = stand.point("flange", tool.com) - stand.point("flange", spec.position)
    weight = np.broadcast_to(tool.mass * arm.chain.gravity, lever.shape)
    force, torque = (
        np.einsum("nij,nj->ni", axes, half) for half in np.hsplit(recording.wrench, 2)
    )
    read = [force + weight, torque + np.cross(lever, weight)]
    if frame == "sensor":
        along = axes @ SENSOR.as_matrix()
        read = [np.einsum("nji,nj->ni", along, half) for half in read]
    sensor = replace(
        spec,
        frame=frame,
        quaternion_wxyz=SENSOR.as_quat(scalar_first=True),
        includes_tool_weight=True,
    )
    return replace(recording, wrench=np.hstack(read), wrench_sensor=sensor)


def relative(recording: Recording) -> Recording:
    """Keep of each visit what differs from its first row."""
    points = recording.points
    assert points is not None
    first = np.unique(recording.visit, return_index=True, return_inverse=True)
    return replace(
        recording,
        displacement="relative",
        points=points - points[first[1][first[2]]],
    )


def proved(recording: Recording, model: Path) -> Proof:
    held = tuple(int(p) for p in np.unique(recording.posture_id)[::4])
    found = named(Hysteresis("a2", width_rad=WIDTH / 2))
    frame = standpoint(streams(SEED)["tracker_frame"])
    frame[:3, 3] += 1e-3
    start = tuple(map(tuple, frame.tolist()))
    patch = Patch(effects=(found,), base_from_tracker=start)
    return prove(recording, model, patch, held, thorough=False)


def test_turning_an_arm_with_its_gravity_changes_nothing(kr10, tmp_path):
    """What is read on the base cannot tell how the base stands: 1 nm, a millionth."""
    model = turned(kr10, tmp_path, gravity_too=True)
    one, other = recorded(kr10), recorded(model)
    assert one.points is not None and other.points is not None
    assert one.wrench is not None and other.wrench is not None
    assert_allclose(other.points, one.points, atol=1e-9)
    assert_allclose(other.wrench, one.wrench, atol=1e-6)
    straight, slanted = proved(one, kr10), proved(other, model)
    assert straight.markers is not None and slanted.markers is not None
    assert slanted.markers.after == pytest.approx(straight.markers.after, rel=1e-6)
    assert slanted.markers.noise == pytest.approx(straight.markers.noise, rel=1e-6)


@pytest.mark.parametrize("frame", ["sensor", "base"])
@pytest.mark.parametrize("displacement", ["absolute", "relative"])
def test_springs_and_loop_are_right_on_a_slanted_arm(
    kr10, tmp_path, frame, displacement
):
    """With a turned flange, a turned sensor and a tool in its readings."""
    model = turned(kr10, tmp_path, gravity_too=False)
    seen = weighed(recorded(model), model, frame)
    if displacement == "relative":
        seen = relative(seen)
    proof = proved(seen, model)
    marks = proof.markers
    assert marks is not None
    assert marks.after < 1.05 * marks.noise < marks.before
    springs = np.array(list(proof.patch.stiffness_nm_per_rad.values()), dtype=float)
    assert_allclose(springs / Rig(model).nominal.jnt_stiffness, SCALE, rtol=0.05)
    width = proof.patch.effects[0].parameters["width_rad"]
    assert width == pytest.approx(WIDTH, rel=0.05)


CHAIN = """<mujoco><compiler angle="radian"/><worldbody>{}</worldbody></mujoco>"""
LINK = """<body name="link" pos="0.1 0 0.4"><joint name="a1" axis="0 1 0"/>
<inertial mass="3" pos="0.2 0.1 0" diaginertia="1 1 1"/></body>"""
STAND = 'pos="1 2 3" quat="0.5 0.1 -0.7 0.2"'
BASE_LINK = f'<body name="base" {STAND}>{LINK}</body>'


@pytest.mark.parametrize(
    "bodies",
    [
        pytest.param(BASE_LINK, id="base"),
        pytest.param(
            f'<body name="column" {STAND}>{BASE_LINK}</body>', id="base on a column"
        ),
        pytest.param(
            f'<body name="base" euler="0.3 -0.8 1.2">{LINK}</body>', id="by angles"
        ),
        pytest.param(LINK.replace("pos=", f"{STAND[12:]} pos=", 1), id="no base"),
    ],
)
def test_gravity_pulls_down_however_the_first_body_stands(tmp_path, bodies):
    """MuJoCo and Pinocchio say the same torque, to 1e-12 N m."""
    file = tmp_path / "arm.xml"
    file.write_text(CHAIN.format(bodies), encoding="utf-8")
    model = load(file)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.4
    mujoco.mj_forward(model, data)
    for arm in (Arm.from_mjcf_text(plain_mjcf(model)), Arm.from_mjcf(file)):
        torque = arm.gravity_torque(np.array([[0.4]]))
        assert_allclose(torque[0], -data.qfrc_bias, atol=1e-12)


def test_names_are_right_on_a_slanted_arm(kr10, tmp_path):
    model = turned(kr10, tmp_path, gravity_too=False)
    arm = Arm.from_mjcf_text(plain_mjcf(load(model)))
    found = diagnose(recorded(model), arm, (OnPaper(), BearingTilt(), EncoderOffset()))
    assert [(n.name.effect, n.name.where) for n in found.named] == [
        ("hysteresis", "a2")
    ]
    width = found.named[0].parameters["width_rad"]
    assert width.low <= 1.1 * WIDTH and width.high >= 0.9 * WIDTH
    assert found.nominal is not None
    stiffness = 1.0 / found.nominal.compliance / arm.stiffness
    assert_allclose(stiffness, SCALE, rtol=0.05)
