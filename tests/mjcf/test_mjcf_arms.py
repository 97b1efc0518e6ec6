"""Both arms mean the same to MuJoCo and Pinocchio; the UR10 is its DH table."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

MJCF = Path(__file__).parents[2] / "mjcf"
KUKA = MJCF / "kr10_r1100_2" / "kr10_r1100_2.xml"
SCENE = MJCF / "kr10_r1100_2" / "scene.xml"
UR10 = MJCF / "ur10" / "ur10.xml"

UR10_DH = [  # d, a in m, alpha in rad; Universal Robots, UR10 (CB3)
    (0.1273, 0.0, np.pi / 2),
    (0.0, -0.612, 0.0),
    (0.0, -0.5723, 0.0),
    (0.163941, 0.0, np.pi / 2),
    (0.1157, 0.0, -np.pi / 2),
    (0.0922, 0.0, 0.0),
]


def at(model: mujoco.MjModel, posture) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize("path", [KUKA, SCENE, UR10], ids=lambda p: p.stem)
def test_shapes_weigh_nothing_and_touch_nothing(path):
    spec = mujoco.MjSpec.from_file(str(path))
    assert all(geom.mass == 0 for geom in spec.geoms if geom.name != "floor")
    model = spec.compile()
    assert not model.geom_contype.any()
    assert not model.geom_conaffinity.any()


@pytest.mark.parametrize("path", [KUKA, UR10], ids=lambda p: p.stem)
def test_two_engines_read_the_same_arm(path):
    model = mujoco.MjModel.from_xml_path(str(path))
    arm = pin.buildModelFromMJCF(str(path))
    scratch = arm.createData()
    flange = arm.getFrameId("flange")
    assert flange < arm.nframes
    postures = np.random.default_rng(0).uniform(*model.jnt_range.T, size=(50, 6))
    for posture in postures:
        data = at(model, posture)
        jacobian = np.zeros((6, 6))
        mujoco.mj_jacBody(
            model, data, jacobian[:3], jacobian[3:], model.body("flange").id
        )
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        other = pin.computeFrameJacobian(arm, scratch, posture, flange, world)
        pin.framesForwardKinematics(arm, scratch, posture)
        placement = scratch.oMf[flange]
        gravity = pin.computeGeneralizedGravity(arm, scratch, posture)
        seen = data.body("flange")
        np.testing.assert_allclose(seen.xpos, placement.translation, atol=1e-10)
        np.testing.assert_allclose(
            seen.xmat.reshape(3, 3), placement.rotation, atol=1e-10
        )
        np.testing.assert_allclose(jacobian, other, atol=1e-10)
        np.testing.assert_allclose(data.qfrc_bias, gravity, atol=1e-10)


def dh_product(angles: np.ndarray) -> np.ndarray:
    """Return base_from_flange by the standard Denavit-Hartenberg convention."""
    product = np.eye(4)
    for angle, (d, a, alpha) in zip(angles, UR10_DH, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        product = product @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return product


def test_ur10_is_its_denavit_hartenberg_table():
    model = mujoco.MjModel.from_xml_path(str(UR10))
    for posture in np.random.default_rng(2).uniform(-np.pi, np.pi, size=(50, 6)):
        flange = at(model, posture).body("flange")
        expected = dh_product(posture)
        np.testing.assert_allclose(flange.xpos, expected[:3, 3], atol=1e-12)
        np.testing.assert_allclose(
            flange.xmat.reshape(3, 3), expected[:3, :3], atol=1e-12
        )


def test_ur10_is_rigid_and_weighs_what_its_maker_says():
    model = mujoco.MjModel.from_xml_path(str(UR10))
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    assert [model.joint(j).name for j in range(6)] == [f"{n}_joint" for n in names]
    masses = [model.body(f"link_{k}").mass[0] for k in range(1, 7)]
    np.testing.assert_array_equal(masses, [7.1, 12.7, 4.27, 2.0, 2.0, 0.365])
    assert not model.jnt_stiffness.any()
    np.testing.assert_allclose(model.jnt_range, 6 * [[-2 * np.pi, 2 * np.pi]])


def test_ur10_centres_of_mass_are_the_makers():
    # Universal Robots gives them in the DH frame at the far end of each link, in m.
    makers = [[0.021, 0, 0.027], [0.38, 0, 0.158], [0.24, 0, 0.068]]
    makers += [[0, 0.007, 0.018], [0, 0.007, 0.018], [0, 0, -0.026]]
    model = mujoco.MjModel.from_xml_path(str(UR10))
    data = at(model, np.zeros(6))
    frame = np.eye(4)
    for k, (centre, (d, a, alpha)) in enumerate(zip(makers, UR10_DH, strict=True), 1):
        turn = Rotation.from_euler("x", alpha).as_matrix()
        frame = frame @ np.block([[turn, np.array([[a], [0], [d]])], [0, 0, 0, 1]])
        expected = frame[:3, :3] @ centre + frame[:3, 3]
        np.testing.assert_allclose(data.body(f"link_{k}").xipos, expected, atol=1e-12)
