"""What is promised of the cost of many poses: it is measured on what is asked about."""

import numpy as np
import pytest

from bench.errors import BenchError
from scenarios import many_poses


def test_under_its_own_weight_an_arm_has_one_target_on_its_flange_and_no_load():
    recording = many_poses.recorded("weight", 5)
    assert recording.wrench is None and recording.load_mass is None
    assert [marker.body for marker in recording.markers] == ["flange"]
    assert len(recording.time) == 5


def test_with_loads_the_load_rises_and_falls_in_each_of_so_many_poses():
    recording = many_poses.recorded("loads", 3)
    assert recording.wrench is not None and recording.load_mass is not None
    np.testing.assert_array_equal(recording.load_mass[:4], [0.0, 5.0, 10.0, 5.0])
    assert len(np.unique(recording.pose)) == 3


def test_a_diagnosis_that_fails_is_no_measurement(tmp_path):
    with pytest.raises(BenchError, match="ended with status 2"):
        many_poses.spent(tmp_path / "none", tmp_path / "out")
