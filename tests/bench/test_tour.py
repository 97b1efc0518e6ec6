import mujoco
import numpy as np
import pytest

from bench import standard_plans
from bench.postures import Room, within
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import DEFAULT_PATH
from bench.standard_plans import is_kr10, once_each, tour

WHERE_THE_HOOK_IS = np.deg2rad([[0, -90, 90, 0, 30, 0], [0, 40, 60, 0, 0, 0]])


@pytest.fixture(scope="module")
def kr10_rig(kr10):
    """The KR10."""
    return Rig(kr10)


@pytest.fixture(scope="module")
def ur10_rig(root):
    """An arm without a table of its own."""
    return Rig(root / "mjcf" / "ur10" / "ur10.xml")


def room(rig):
    return Room(rig.nominal, rig.anatomy, rig.mounted)


def test_room_is_above_the_floor(kr10_rig):
    """Home is free; upper arm down by 40° and forearm by 100° is not."""
    np.testing.assert_array_equal(room(kr10_rig)(WHERE_THE_HOOK_IS), [True, False])


def test_room_knows_the_joint_limits(kr10_rig):
    np.testing.assert_allclose(room(kr10_rig).limits, standard_plans.LIMITS, atol=1e-12)


def test_kr10_tours_the_papers_table(kr10_rig):
    plan = tour(kr10_rig, 151)
    np.testing.assert_array_equal(plan.posture, standard_plans.table_one_postures())
    assert is_kr10(kr10_rig)


def test_rope_that_just_leaves_its_pulley_is_led_over_the_next(kr10_rig):
    """Else the pull jumps as the arm gives way, and it may find no rest."""
    edge = np.deg2rad([22.5, -20.5, -15.6, -93.0, -31.0, 140.9])
    posture = np.array([edge, edge + np.deg2rad([5.0, 0, 0, 0, 0, 0])])
    plans = [once_each("", kr10_rig, one[None], DEFAULT_PATH) for one in posture]
    assert [plan.pulley.tolist() for plan in plans] == [[1], [0]]
    turns = 0.01 * np.concatenate([np.eye(6), -np.eye(6)])
    jumps = []
    for pulley in range(2):
        pulls = np.array([pull_at(kr10_rig, edge + turn, pulley) for turn in turns])
        jumps.append(np.degrees(np.arccos((pulls @ pulls.T).min())))
    assert jumps[0] > 3.0 * jumps[1]


def pull_at(rig, posture, pulley):
    """Return the direction in which a rope leaves the hook."""
    data = mujoco.MjData(rig.model)
    data.qpos[[rig.model.joint(a).qposadr[0] for a in rig.anatomy.axes]] = posture
    mujoco.mj_forward(rig.model, data)
    start = data.ten_wrapadr[rig.model.tendon(f"rope_{pulley}").id]
    hook, after = data.wrap_xpos.reshape(-1, 3)[start : start + 2]
    return (after - hook) / np.linalg.norm(after - hook)


def test_another_arm_tours_the_room_it_has(ur10_rig):
    plan = tour(ur10_rig, 30, revisits=4, seed=1)
    assert not is_kr10(ur10_rig)
    assert (plan.visits, len(np.unique(plan.posture_id))) == (34, 30)
    assert room(ur10_rig)(plan.posture).all()
    np.testing.assert_array_equal(
        plan.posture, tour(ur10_rig, 30, revisits=4, seed=1).posture
    )
    assert np.any(plan.posture != tour(ur10_rig, 30, revisits=4, seed=2).posture)


def test_no_axis_turns_further_than_half_a_turn_unless_asked_to(ur10_rig):
    """The UR10's axes are free for a whole turn either way."""
    assert room(ur10_rig).limits.max() > 1.9 * np.pi
    assert np.abs(tour(ur10_rig, 30).posture).max() <= np.pi
    far = np.abs(tour(ur10_rig, 30, widest=2 * np.pi).posture).max()
    assert np.pi < far <= 2 * np.pi
    near = np.abs(tour(ur10_rig, 10, widest=np.deg2rad(100)).posture).max()
    assert near <= np.deg2rad(100)


def test_ranges_are_cut_at_the_widest_turn_and_slides_are_left_alone():
    limits = np.array([[-6.0, 6.0], [-1.0, 2.0], [0.0, 9.0], [4.0, 11.0]])
    cut = within(limits, (False, False, True, False), 3.0)
    np.testing.assert_allclose(cut, [[-3, 3], [-1, 2], [0, 9], [4.5, 10.5]])
    with pytest.raises(Unusable, match="expected above 0"):
        within(limits, (False,) * 4, 0.0)


def test_arm_that_finds_no_posture_is_told_what_is_in_the_way(root, ur10_rig):
    """Six hinges on one line carry the hook nowhere."""
    with pytest.raises(Unusable, match="100% the hook to within 100 mm") as error:
        tour(Rig(root / "mjcf" / "six_hinges" / "six_hinges.xml"), 1)
    assert "a rope cannot load such an arm" in str(error.value)
    with pytest.raises(Unusable, match="check the base's frame"):
        tour(ur10_rig, 1, widest=0.05)
