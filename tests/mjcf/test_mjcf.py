"""The KUKA in mjcf/ is the public robot: kinematics, masses, springs and signs."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

MJCF = Path(__file__).parents[2] / "mjcf"
KUKA = MJCF / "kr10_r1100_2" / "kr10_r1100_2.xml"
MICROMETRE = 1e-6

# Flange in mm and KUKA's A, B, C (Z-Y-X angles) in deg; computed with numpy from the
# joint frames of kroshu/kuka_robot_descriptions, commit 7766e92, without MuJoCo.
FLANGE_AT = [
    ((0, 0, 0, 0, 0, 0), (1190, 0, 425), (0, 90, 0)),
    ((0, -90, 0, 0, 0, 0), (0, 0, 1565), (0, 0, 0)),
    ((0, -90, 90, 0, 0, 0), (630, 0, 985), (0, 90, 0)),
    ((0, -90, 90, 0, 90, 0), (540, 0, 895), (0, 180, 0)),
    ((30, -90, 90, 0, 0, 0), (545.596, -315, 985), None),
    ((0, 0, 90, 0, 0, 0), (610, 0, -205), None),
    ((0, -120, 30, 0, 90, 0), (-190, 0, 1399.974), None),
    ((20, -70, 100, 10, 60, -30), (630.252, -243.796, 601.404), None),
]

# Same source: mass in kg; principal inertias in kg m²; their axes, rpy in rad.
INERTIALS = {
    "base": (16.916, (0.162092004, 0.108811816, 0.184615915),
             (1.61655928, -1.22128928, 3.10031147)),
    "link_1": (8.416, (0.0740618386, 0.0890478352, 0.110395707),
               (1.30451934, -0.942861602, -1.42265109)),
    "link_2": (17.8369, (0.875159506, 0.0921504945, 0.915711776),
               (1.95248738, -1.54223588, -0.390281567)),
    "link_3": (6.075, (0.0446938112, 0.0189695089, 0.0498412587),
               (-2.67693037, -1.32189586, 1.18609203)),
    "link_4": (5.16238, (0.0123014139, 0.0846961219, 0.0873983419),
               (-2.22809425, -1.53261195, 2.17978395)),
    "link_5": (1.6128, (0.00173177561, 0.00221950081, 0.00246709006),
               (1.56789871, -0.861171676, -3.10028026)),
    "link_6": (0.734, (0.000183698268, 0.000182136218, 0.00029589),
               (0, 0, 1.22342719)),
}  # fmt: skip

# Centres of mass with all angles zero, base frame, mm; computed with numpy.
COM_AT_ZERO = {
    "link_1": (6.4, 16.3, 314.6),
    "link_2": (216.2, 15.5, 404.7),
    "link_3": (628.9, 18.2, 412.5),
    "link_4": (922.0, 8.6, 426.3),
    "link_5": (1109.3, 24.0, 424.2),
    "link_6": (1173.3, 0.0, 425.0),
}


@pytest.fixture(scope="module")
def kuka() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(KUKA))


def at(model: mujoco.MjModel, posture) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_forward(model, data)
    return data


@pytest.mark.parametrize(("angles_deg", "place_mm", "abc_deg"), FLANGE_AT)
def test_flange_stands_where_kukas_angles_put_it(kuka, angles_deg, place_mm, abc_deg):
    flange = at(kuka, np.radians(angles_deg)).body("flange")
    # Printed to 1 µm, so half a micrometre of rounding is within the bound.
    np.testing.assert_allclose(flange.xpos, np.array(place_mm) / 1e3, atol=MICROMETRE)
    if abc_deg is not None:
        expected = Rotation.from_euler("ZYX", abc_deg, degrees=True).as_matrix()
        np.testing.assert_allclose(flange.xmat.reshape(3, 3), expected, atol=1e-12)


def test_positive_angles_turn_as_kuka_says(kuka):
    def moved(joint: int) -> np.ndarray:
        home = np.radians([0, -90, 90, 0, 30, 0])
        turned = home + np.radians(10) * np.eye(6)[joint - 1]
        return at(kuka, turned).body("flange").xpos - at(kuka, home).body("flange").xpos

    assert moved(1)[1] < 0, "A1 turns about base -z"
    assert moved(2)[0] > 0, "A2 lowers the arm forwards"
    assert moved(3)[2] < 0, "A3 folds the forearm down"
    assert moved(5)[2] < 0, "A5 bends the hand down"
    for axis in ("a4", "a6"):
        np.testing.assert_allclose(
            at(kuka, 0).joint(axis).xaxis, [-1, 0, 0], atol=1e-12
        )


def test_flange_and_tool_are_one_frame(kuka):
    data = at(kuka, np.radians([20, -70, 100, 10, 60, -30]))
    np.testing.assert_array_equal(data.body("flange").xpos, data.body("tool").xpos)
    np.testing.assert_array_equal(data.body("flange").xmat, data.body("tool").xmat)


def test_springs_are_those_of_the_papers_table_3(kuka):
    published = np.array([50.90, 63.36, 50.34, 2.27, 8.89, 1.39]) * 1e3
    np.testing.assert_allclose(kuka.jnt_stiffness, published, rtol=1e-15)


def test_limits_are_the_data_sheets(kuka):
    limits_deg = [(-170, 170), (-190, 45), (-120, 156), (-185, 185), (-120, 120)]
    limits_deg += [(-350, 350)]
    np.testing.assert_allclose(np.degrees(kuka.jnt_range), limits_deg, rtol=1e-14)
    assert kuka.jnt_limited.all()


@pytest.mark.parametrize("name", INERTIALS)
def test_inertia_is_the_published_one(kuka, name):
    mass, principal, rpy = INERTIALS[name]
    body = kuka.body(name)
    axes = Rotation.from_euler("xyz", rpy).as_matrix()
    wxyz = body.iquat
    read = Rotation.from_quat(wxyz[[1, 2, 3, 0]]).as_matrix()
    assert body.mass[0] == mass
    np.testing.assert_allclose(
        read @ np.diag(body.inertia) @ read.T,
        axes @ np.diag(principal) @ axes.T,
        atol=1e-10,  # the published digits
    )


@pytest.mark.parametrize("name", COM_AT_ZERO)
def test_centre_of_mass_is_the_published_one(kuka, name):
    centre_mm = at(kuka, 0).body(name).xipos * 1e3
    np.testing.assert_allclose(centre_mm, COM_AT_ZERO[name], atol=0.051)  # as printed


def test_masses_add_up(kuka):
    # Sum of the seven published masses in kg; the covers add nothing.
    np.testing.assert_allclose(kuka.body_mass.sum(), 56.75308, rtol=1e-12)


def test_stretched_arm_loads_its_second_axis_with_140_newton_metres(kuka):
    stretched = at(kuka, 0).qfrc_bias
    home = at(kuka, np.radians([0, -90, 90, 0, 0, 0])).qfrc_bias
    np.testing.assert_allclose([stretched[1], home[1]], [-140.3, -31.4], atol=0.05)
