import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.optimize import root
from small_truth import HOOK, TABLE_3, cartesian_compliance, postures, pulls

from bench.shared.errors import BenchError, UnknownName, Unusable
from bench.shared.recording import Payload
from stiffness.robot.arm import Arm
from stiffness.robot.chain import link_error_of
from stiffness.robot.equilibrium import equilibrium

CENTRE = np.zeros(3)
HOME = np.deg2rad([[0.0, -90.0, 90.0, 0.0, 0.0, 0.0]])
PAYLOAD = Payload(3.0, np.array([0.02, -0.01, 0.08]))

ODD_ARM = """
<mujoco><option gravity="0.1 -0.2 -9.7"/><default><joint stiffness="7"/>
<default class="soft"><joint stiffness="5 1 0"/></default></default>
<worldbody><body name="rail" pos="0.3 -0.2 0.5" euler="10 20 30">
 <inertial mass="9" pos="0 0 0" diaginertia="1 1 1"/>
 <body name="carriage" pos="0 0.1 0">
  <inertial mass="3" pos="0.1 0 0.02" diaginertia="1 1 1"/>
  <joint name="track" type="slide" axis="0 1 1" pos="0 0.1 0" stiffness="900"/>
  <body name="upper" pos="0 0 0.2" euler="5 0 0">
   <inertial mass="2" pos="0.2 0.1 0" diaginertia="1 1 1"/>
   <joint name="swing" axis="1 1 1" pos="0.1 0 0" class="soft"/>
   <body name="lower" pos="0.4 0 0">
    <inertial mass="1" pos="0.1 0 0.1" diaginertia="1 1 1"/>
    <joint name="bend" axis="0 0 -1"/>
    <body name="hand" pos="0.2 0 0.1" euler="0 40 0">
     <inertial mass="0.5" pos="0 0 0.05" diaginertia="1 1 1"/>
    </body></body></body></body></body></worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def arm(kr10):
    return Arm.from_mjcf(kr10)


@pytest.fixture(scope="module")
def odd():
    """A rail, a skew hinge and a hinge that turns backwards, on a tilted base."""
    return Arm.from_mjcf_text(ODD_ARM)


def by_pinocchio(arm, posture, frame):
    """Placement, Jacobian and gravity torque of one posture along the base's axes."""
    model = arm.file.model.copy()
    model.gravity.linear = np.array(arm.file.gravity)
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, posture)
    place = data.oMf[model.getFrameId(frame, pinocchio.FrameType.BODY)]
    jacobian = pinocchio.computeFrameJacobian(
        model,
        data,
        posture,
        model.getFrameId(frame, pinocchio.FrameType.BODY),
        pinocchio.LOCAL_WORLD_ALIGNED,
    )
    gravity = -pinocchio.computeGeneralizedGravity(model, data, posture)
    return place.homogeneous, jacobian, gravity


@given(angles=st.lists(st.floats(-2.0, 2.0), min_size=6, max_size=6))
def test_arm_stands_where_pinocchio_says_it_stands(arm, angles):
    posture = np.array(angles)
    place, jacobian, gravity = by_pinocchio(arm, posture, "flange")
    standing = arm.at(posture[None])
    # a few times the rounding of six rotations
    np.testing.assert_allclose(standing.placement("flange")[0], place, atol=1e-14)
    np.testing.assert_allclose(
        standing.jacobian("flange", CENTRE)[0], jacobian, atol=1e-13
    )
    np.testing.assert_allclose(standing.gravity_torque()[0], gravity, atol=1e-12)


@given(angles=st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3))
def test_slides_and_skew_axes_on_a_tilted_base_agree_with_pinocchio(odd, angles):
    posture = np.array(angles)
    world_from_base, _, _ = by_pinocchio(odd, posture, "rail")
    place, jacobian, gravity = by_pinocchio(odd, posture, "hand")
    standing = odd.at(posture[None])
    base = np.linalg.inv(world_from_base)
    turn = np.kron(np.eye(2), base[:3, :3])
    np.testing.assert_allclose(standing.placement("hand")[0], base @ place, atol=1e-13)
    np.testing.assert_allclose(
        standing.jacobian("hand", CENTRE)[0], turn @ jacobian, atol=1e-13
    )
    np.testing.assert_allclose(standing.gravity_torque()[0], gravity, atol=1e-12)


def test_springs_are_read_from_joints_classes_and_defaults(odd, arm):
    np.testing.assert_array_equal(odd.stiffness, [900.0, 5.0, 7.0])
    np.testing.assert_array_equal(arm.stiffness, TABLE_3)
    assert odd.slides.tolist() == [True, False, False]


@pytest.mark.parametrize("body", ["link_3", "flange", "tool"])
def test_jacobian_is_the_derivative_of_placement(arm, body):
    posture = postures(arm, 5, seed=1)
    jacobian = arm.jacobian(posture, body, HOOK)
    step = 1e-6
    for k in range(6):
        ends = [posture.copy(), posture.copy()]
        ends[0][:, k] -= step
        ends[1][:, k] += step
        points = [arm.point_in_base(end, body, HOOK) for end in ends]
        moved = (points[1] - points[0]) / (2 * step)
        # central differences: step^2 and rounding over step
        np.testing.assert_allclose(jacobian[:, :3, k], moved, atol=1e-9)
        turns = [arm.at(end).turn(body) for end in ends]
        spin = (turns[1] - turns[0]) / (2 * step) @ arm.at(posture).turn(body).mT
        angular = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
        np.testing.assert_allclose(jacobian[:, 3:, k], angular, atol=1e-9)


def test_load_torque_is_the_work_of_the_wrench(arm):
    """J^T w: what the wrench does along a small motion, the axes' torques do too."""
    posture = postures(arm, 4, seed=2)
    wrench = np.random.default_rng(0).standard_normal((4, 6))
    motion = 1e-3 * np.random.default_rng(1).standard_normal((4, 6))
    torque = arm.load_torque(posture, wrench, "flange", HOOK)
    twist = (arm.jacobian(posture, "flange", HOOK) @ motion[:, :, None])[:, :, 0]
    np.testing.assert_allclose(
        np.sum(torque * motion, axis=1), np.sum(wrench * twist, axis=1), atol=1e-15
    )


def test_payload_weighs_as_a_force_at_its_centre(arm):
    posture = postures(arm, 4, seed=3)
    more = arm.gravity_torque(posture, PAYLOAD) - arm.gravity_torque(posture)
    weight = np.tile([0.0, 0.0, -9.81 * PAYLOAD.mass, 0, 0, 0], (4, 1))
    np.testing.assert_allclose(
        more, arm.load_torque(posture, weight, "flange", PAYLOAD.com), atol=1e-12
    )


def test_gravity_pulls_axis_2_of_the_stretched_arm_down(arm):
    """A2 is positive downwards, so gravity's torque on it is positive: 140.3 N m.

    Masses and centres of KUKA's own description of the KR10 R1100-2.
    """
    torque = arm.gravity_torque(np.zeros((1, 6)))
    assert torque[0, 1] == pytest.approx(140.3, abs=0.05)


@pytest.mark.parametrize(
    ("force", "moved_mm"),
    [
        ([0, 0, -100], [0.589, 0.0, -1.396]),
        ([100, 0, 0], [0.541, 0.0, -0.589]),
        ([0, 100, 0], [0.0, 0.780, 0.0]),
    ],
)
def test_table_3_bends_the_home_posture_as_computed_by_hand(arm, force, moved_mm):
    """Eq. 6 of Wu et al. 2024 with its Table 3, 100 N at the flange's centre."""
    soft = cartesian_compliance(arm, HOME, 1 / TABLE_3, CENTRE)
    moved = soft[0, :3, :3] @ force
    np.testing.assert_allclose(1e3 * moved, moved_mm, atol=5e-4)


@pytest.mark.parametrize(("force", "axis", "mm"), [(-100, 2, -2.96), (100, 1, 2.78)])
def test_table_3_bends_the_stretched_arm_as_computed_by_hand(arm, force, axis, mm):
    soft = cartesian_compliance(arm, np.zeros((1, 6)), 1 / TABLE_3, CENTRE)
    assert 1e3 * soft[0, axis, axis] * force == pytest.approx(mm, abs=5e-3)


def test_cartesian_compliance_is_the_inverse_of_the_papers_stiffness(arm):
    """K_X = J^-T K_theta J^-1 where the Jacobian has an inverse."""
    posture = np.deg2rad([[20.0, -70.0, 100.0, 10.0, 60.0, -30.0]])
    inverse = np.linalg.inv(arm.jacobian(posture, "flange", CENTRE)[0])
    stiffness = inverse.T @ np.diag(TABLE_3) @ inverse
    soft = cartesian_compliance(arm, posture, 1 / TABLE_3, CENTRE)[0]
    np.testing.assert_allclose(soft @ stiffness, np.eye(6), atol=1e-9)


def test_equilibrium_is_the_root_that_another_solver_finds_with_pinocchio(arm):
    posture = postures(arm, 3, seed=4)
    wrench = np.concatenate([pulls(3, 1, 5)[:, 0], np.ones((3, 3))], axis=1)
    rest = equilibrium(arm, posture, 1 / TABLE_3, wrench, HOOK)
    for k in range(3):

        def unbalanced(q, k=k):
            place, jacobian, gravity = by_pinocchio(arm, q, "flange")
            lever = place[:3, :3] @ HOOK
            about = np.append(
                wrench[k, :3], wrench[k, 3:] + np.cross(lever, wrench[k, :3])
            )
            return TABLE_3 * (q - posture[k]) - gravity - jacobian.T @ about

        other = root(unbalanced, posture[k], tol=1e-13)
        np.testing.assert_allclose(rest[k], other.x, atol=1e-12)


def test_rigid_arm_rests_where_it_is_commanded(arm):
    posture = postures(arm, 3, seed=6)
    rest = equilibrium(arm, posture, np.zeros(6), payload=PAYLOAD)
    np.testing.assert_array_equal(rest, posture)


def test_springs_too_soft_for_the_load_are_refused_by_name(arm):
    compliance = 1 / TABLE_3
    compliance[2] = 1.0
    with pytest.raises(BenchError, match=r"no rest.*'a3' is the softest"):
        equilibrium(arm, HOME, compliance)


def test_named_axes_come_in_the_order_asked_for(odd, arm):
    swapped = Arm.of(arm.file, axes=[f"a{k}" for k in (6, 5, 4, 3, 2, 1)])
    posture = postures(arm, 3, seed=7)
    np.testing.assert_allclose(
        swapped.jacobian(posture[:, ::-1], "flange", HOOK),
        arm.jacobian(posture, "flange", HOOK)[:, :, ::-1],
        atol=1e-15,
    )
    fewer = Arm.of(odd.file, axes=["swing", "bend"])
    held = np.array([[0.3, -0.4]])
    whole = np.concatenate([np.zeros((1, 1)), held], axis=1)
    np.testing.assert_allclose(
        fewer.gravity_torque(held), odd.gravity_torque(whole)[:, 1:], atol=1e-12
    )
    np.testing.assert_array_equal(fewer.stiffness, [5.0, 7.0])


def test_an_axis_may_bear_the_name_of_a_body(odd):
    """As it often does; a body's place is still found where other axes are fixed."""
    alike = ODD_ARM.replace('"bend"', '"lower"').replace('"track"', '"carriage"')
    fewer = Arm.of(Arm.from_mjcf_text(alike).file, axes=["swing"])
    expected = Arm.of(odd.file, axes=["swing"])
    bodies, posture = ["carriage", "upper", "lower", "hand"], np.array([[0.4]])
    np.testing.assert_array_equal(
        fewer.placements(posture, bodies), expected.placements(posture, bodies)
    )


def test_standard_names_of_bodies_work_on_a_model_without_them(odd):
    posture = np.array([[0.1, 0.2, 0.3]])
    bodies = ["base", "link_1", "link_3", "flange", "tool"]
    own = ["rail", "carriage", "lower", "hand", "hand"]
    np.testing.assert_array_equal(
        odd.placements(posture, bodies), odd.placements(posture, own)
    )
    named = Arm.of(odd.file, bodies={"flange": "lower"})
    np.testing.assert_array_equal(
        named.placements(posture, ["flange"]), odd.placements(posture, ["lower"])
    )


def test_unknown_names_are_refused_with_the_nearest_known(arm):
    with pytest.raises(UnknownName, match=r"joint.*'a7'.*Known"):
        Arm.of(arm.file, axes=["a1", "a7"])
    with pytest.raises(UnknownName, match="Did you mean 'flange'"):
        Arm.of(arm.file, bodies={"tool": "flangge"})
    with pytest.raises(UnknownName, match="body"):
        arm.point_in_base(HOME, "gripper", CENTRE)


def test_posture_that_is_no_number_is_refused_by_row_and_axis(arm):
    posture = postures(arm, 3, seed=8)
    posture[1, 4] = np.nan
    with pytest.raises(Unusable, match="row 1, axis a5"):
        arm.at(posture)
    with pytest.raises(Unusable, match=r"\(cases, 6\)"):
        arm.at(posture[:, :5])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<mujoco", "no MJCF"),
        ("<robot name='x'><link name='a'/></robot>", "no MJCF"),
        (ODD_ARM.replace('type="slide"', 'type="ball"'), "'track' is a"),
        (ODD_ARM.replace('name="bend"', 'name="bend" ref="0.5"'), "'bend' has a ref"),
        ("<mujoco><worldbody><body name='b'/></worldbody></mujoco>", "no joint"),
    ],
)
def test_model_that_is_no_arm_is_refused_with_its_fault(text, words):
    with pytest.raises(Unusable, match=words):
        Arm.from_mjcf_text(text)


def test_missing_model_file_is_said_to_be_missing(tmp_path):
    with pytest.raises(BenchError, match="no model file"):
        Arm.from_mjcf(tmp_path / "arm.xml")


@given(arrays(float, 6, elements=st.floats(-0.05, 0.05)))
def test_link_error_of_a_screw_is_the_exponential_map(screw):
    """Its shift t is v + r x v / 2 + r x (r x v) / 6."""
    twist = np.zeros((4, 4))
    x, y, z = screw[3:]
    twist[:3] = [[0.0, -z, y, screw[0]], [z, 0.0, -x, screw[1]], [-y, x, 0.0, screw[2]]]
    assert_allclose(link_error_of(screw)[:3], expm(twist)[:3, 3], atol=2e-6)
