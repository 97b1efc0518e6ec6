from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_truth import HOOK, TABLE_3, postures, pulls, record

from stiffness.experiment.static_state import static_state_of
from stiffness.robot.arm import Arm
from stiffness.robot.equilibrium import equilibrium


@pytest.mark.parametrize("frame", ["sensor", "base"])
def test_a_soft_arm_rests_where_its_load_and_its_sensor_turn_each_other(kr10, frame):
    """The load turns the sensor by 0.04 rad: it stands where it truly stood."""
    arm, soft = Arm.from_mjcf(kr10), 15.0 / TABLE_3
    posture, forces = postures(arm, 6, seed=3), pulls(6, 2, seed=4)
    seen = record(arm, posture, forces, compliance=soft, frame=frame)
    force = np.concatenate([np.zeros((6, 1, 3)), forces], axis=1).reshape(-1, 3)
    wrench = np.concatenate([force, np.zeros_like(force)], axis=1)
    true = equilibrium(arm, seen.posture, soft, wrench, HOOK)
    assert np.abs(true - seen.posture).max() > 0.04
    found = static_state_of(arm, seen, soft, ())
    assert_allclose(found.rest, true, atol=1e-9)
    assert_allclose(found.wrench[:, :3], force, atol=1e-6)


def test_what_depends_on_where_the_arm_stands_alone_is_worked_out_once(kr10):
    """By states of other loads and springs too, and anew for other readings."""
    arm = Arm.from_mjcf(kr10)
    seen = record(arm, postures(arm, 4, seed=3), pulls(4, 2, seed=4))
    state, count = static_state_of(arm, seen, 1.0 / TABLE_3, ()), [0]

    def work() -> int:
        count[0] += 1
        return count[0]

    loaded = replace(state, torque=2.0 * state.torque)
    others = (state, loaded, state.with_compliance(2.0 * state.compliance))
    assert [one.once_standing("x", work) for one in others] == [1, 1, 1]
    assert state.some(np.arange(3)).once_standing("x", work) == 2
    assert replace(state, wrench=state.wrench + 1.0).once_standing("x", work) == 3
    assert state.once_standing("y", work) == 4
