"""A handful of poses shows what is gross, and the answer says that they are few."""

import numpy as np
import pytest
from small_bench import FEW, arm, recording

from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.result import Diagnosis
from stiffness.regression.testing import SIGNIFICANCE


def found_in(poses: int, *effects: str) -> Diagnosis:
    """Diagnose some poses of a recording."""
    made = recording(*effects)
    some = np.isin(made.posture_id, np.unique(made.posture_id)[:poses])
    return diagnose(made.take(np.flatnonzero(some)), arm(), FEW)


@pytest.mark.parametrize("poses", [1, 2, 3, 4, 6, 9])
def test_few_poses_of_nothing_are_no_mismatch_and_called_few(poses):
    """Signs that come out all alike are no less likely than the data themselves."""
    found = found_in(poses)
    assert found.verdict == "no_mismatch"
    assert "few_poses" in [warned.code for warned in found.warnings]


def test_what_is_gross_shows_in_few_poses():
    found = found_in(6, "lost_motion@a2,width_rad=4e-4")
    assert found.detection.p_value < SIGNIFICANCE
    assert "few_poses" in [warned.code for warned in found.warnings]


def test_what_would_show_in_few_poses_is_as_large_as_their_noise():
    few, many = found_in(6).detection, found_in(30).detection
    assert few.smallest_effect > few.noise_rms
    assert many.smallest_effect < many.noise_rms / 3


def test_enough_poses_are_not_called_few():
    assert "few_poses" not in [warned.code for warned in found_in(10).warnings]
