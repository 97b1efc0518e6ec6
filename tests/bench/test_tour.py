import numpy as np
import pytest

from bench import standard_plans
from bench.postures import Room
from bench.rig import Rig
from bench.standard_plans import is_kr10, tour

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


def test_another_arm_tours_the_room_it_has(ur10_rig):
    plan = tour(ur10_rig, 30, revisits=4, seed=1)
    assert not is_kr10(ur10_rig)
    assert (plan.visits, len(np.unique(plan.posture_id))) == (34, 30)
    assert room(ur10_rig)(plan.posture).all()
    np.testing.assert_array_equal(
        plan.posture, tour(ur10_rig, 30, revisits=4, seed=1).posture
    )
    assert np.any(plan.posture != tour(ur10_rig, 30, revisits=4, seed=2).posture)
