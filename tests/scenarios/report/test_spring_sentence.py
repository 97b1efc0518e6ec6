import numpy as np

from scenarios.report.summary import sentence
from stiffness.diagnosis.result import Nominal

MODELLED = np.array([2e-6, 3e-6, 5e-6])


def fitted(over: tuple[float, ...]) -> Nominal:
    """Springs as fitted, so many times as stiff as the model's."""
    compliance = MODELLED / np.array(over)
    return Nominal(
        compliance=compliance,
        sigma=1e-3 * compliance,
        modelled=MODELLED,
        blind=(),
        base_from_tracker=np.eye(4),
        places=np.zeros((0, 3)),
        noise_ratio=1.0,
        pose_repeatability=np.zeros(3),
    )


def test_springs_that_are_all_off_by_one_factor_are_said_to_be():
    assert "One factor does for all within 10%: 0.8." in sentence(
        fitted((0.8, 0.79, 0.81))
    )


def test_springs_that_are_off_by_factors_of_their_own_have_no_common_one():
    told = sentence(fitted((0.8, 1.3, 1.0)))
    assert "a1 0.8" in told and "a2 1.3" in told
    assert "One factor" not in told
    assert sentence(fitted((1.0, 1.0, 1.0))) == ""
