import numpy as np
import pytest
from small_truth import TABLE_3, cartesian_compliance, postures

from bench.shared.errors import Unusable
from stiffness.networks.source_domain import (
    FORCE_ORDER,
    TABLE_5,
    SourceDomain,
    SourcePlan,
    source_domain,
    spanning_plan,
    table_4_postures,
    table_5_plan,
)
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium

POINT, ORIGIN = np.array([0.01, -0.02, 0.03]), np.array([0.0, 0.0, 0.0254])
COMPLIANCE = 1.0 / TABLE_3


@pytest.fixture(scope="module")
def arm(kr10) -> Arm:
    return Arm.from_mjcf(kr10)


def answers(arm: Arm, plan: SourcePlan) -> SourceDomain:
    return source_domain(arm, COMPLIANCE, plan, POINT, ORIGIN)


def test_table_4_has_the_papers_21280_postures():
    """Wu et al. 2024, section 4.1."""
    posture = table_4_postures()
    assert posture.shape == (21280, 6)
    assert len(np.unique(posture, axis=0)) == 21280
    low, high = np.rad2deg(posture.min(axis=0)), np.rad2deg(posture.max(axis=0))
    np.testing.assert_allclose(low, [-45, -180, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(high, [45, 0, 150, 0, 90, 0], atol=1e-12)


@pytest.mark.parametrize("plan", [table_5_plan, spanning_plan])
def test_plan_asks_106400_questions(plan):
    assert plan().rows == 106_400


def test_wrenches_of_table_5_span_three_dimensions_of_six():
    assert np.linalg.matrix_rank(TABLE_5) == 3
    assert np.linalg.matrix_rank(table_5_plan().wrench_in_base[0]) == 3


def test_spanning_wrenches_span_all_six_dimensions_and_stay_within_their_size():
    wrench = spanning_plan(force=80.0, lever=0.05).wrench_in_base.reshape(-1, 6)
    unit = wrench / np.repeat([80.0, 4.0], 3)
    smallest = np.linalg.eigvalsh(np.cov(unit.T))[0]
    assert smallest > 0.02  # even over balls it would be 1/9 and about 1/50
    assert np.linalg.norm(wrench[:, :3], axis=1).max() <= 80.0
    assert np.linalg.norm(wrench[:, 3:], axis=1).max() <= 80.0 * 0.05
    np.testing.assert_allclose(
        np.einsum("ri,ri->r", wrench[:, :3], wrench[:, 3:]), 0.0, atol=1e-9
    )  # a rope makes no torque about itself


def test_letters_of_table_5_are_kukas_and_can_be_read_in_the_order_of_the_forces():
    """KUKA's A, B, C turn about z, y, x."""
    kuka, forces = table_5_plan(), table_5_plan(torque_order=FORCE_ORDER)
    np.testing.assert_array_equal(kuka.wrench_in_base[0, 0, 3:], [2.0, 10.0, 10.0])
    np.testing.assert_array_equal(forces.wrench_in_base[0, 0, 3:], [10.0, 10.0, 2.0])


def test_same_seed_draws_the_same_wrenches(arm):
    few = postures(arm, 7, seed=1)
    first, again, other = (spanning_plan(few, seed=s) for s in (0, 0, 1))
    np.testing.assert_array_equal(first.wrench_in_base, again.wrench_in_base)
    assert not np.array_equal(first.wrench_in_base, other.wrench_in_base)


def test_deflection_is_compliance_times_wrench_where_both_points_are_one(arm):
    """Wu et al. 2024, Eq. 6."""
    plan = spanning_plan(postures(arm, 20, seed=2), seed=3)
    domain = source_domain(arm, COMPLIANCE, plan, POINT, POINT)
    per_wrench = cartesian_compliance(arm, plan.posture, COMPLIANCE, POINT)
    expected = np.einsum("pij,pwj->pwi", per_wrench[:, :3], plan.wrench_in_base)
    np.testing.assert_allclose(domain.deflection, expected.reshape(-1, 3), atol=1e-15)


def test_deflection_agrees_with_the_equilibrium_to_half_a_percent(arm):
    """What is left is sag and how the load changes the lever arms."""
    plan = spanning_plan(postures(arm, 50, seed=4), seed=5)
    domain = answers(arm, plan)
    ends = [
        arm.point_in_base(
            equilibrium(arm, domain.posture, COMPLIANCE, wrench, ORIGIN),
            "flange",
            POINT,
        )
        for wrench in (domain.wrench_in_base, None)
    ]
    exact = ends[0] - ends[1]
    assert np.linalg.norm(domain.deflection - exact) < 0.005 * np.linalg.norm(exact)


def test_rows_run_over_postures_then_wrenches(arm):
    plan = spanning_plan(postures(arm, 3, seed=6), wrenches=2)
    domain = answers(arm, plan)
    np.testing.assert_array_equal(domain.posture[:2], plan.posture[[0, 0]])
    np.testing.assert_array_equal(domain.wrench_in_base[3], plan.wrench_in_base[1, 1])
    alone = SourcePlan("alone", plan.posture[1:2], plan.wrench_in_base[1:2, 1:])
    np.testing.assert_allclose(
        answers(arm, alone).deflection[0], domain.deflection[3], rtol=1e-12
    )


def test_plan_without_wrenches_is_refused():
    with pytest.raises(Unusable, match=r"expected \(4, at least 1, 6\)"):
        SourcePlan("nothing", np.zeros((4, 6)), np.zeros((4, 0, 6)))
