"""Laws are only so true: little that is left where a name stands earns no other."""

import numpy as np
import pytest

from stiffness.diagnosis.detection import MEASURED, DetectionTest, Scatter
from stiffness.diagnosis.model_fit import ModelFit, ModelTerm
from stiffness.diagnosis.residual_checks import CONTRADICTS, is_same_law_residual
from stiffness.effects.hysteresis import Hysteresis
from stiffness.regression import testing

CALM = Scatter(1.0, 0.01, 0.0, MEASURED)
STRONG = 1e5
"""Whitened square that the named law explains."""


@pytest.mark.parametrize(
    ("where", "share", "own"),
    [("a2", 0.5, True), ("a2", 2.0, False), ("a3", 0.5, False), ("", 0.5, True)],
)
def test_a_little_left_is_a_law_s_own_only_where_it_stands(where, share, own):
    left = _left(where, share * CONTRADICTS * STRONG, 0.001)
    assert is_same_law_residual(left, _named_at("a2"), [STRONG]) == own


def test_what_does_not_speak_is_nobody_s():
    assert not is_same_law_residual(_left("a2", 10.0, 0.5), _named_at("a2"), [STRONG])


def test_where_nothing_is_named_nothing_is_a_law_s_own():
    nothing = ModelFit((), 0.0, np.zeros(6), (), 0)
    assert not is_same_law_residual(_left("a2", 10.0, 0.001), nothing, [])


def _left(where: str, captured: float, p_value: float) -> DetectionTest:
    """Return a test of two blocks, of which the second captures something."""
    count, p = np.array([0.0, captured]), np.array([1.0, p_value])
    tested = testing.MaxTResult(count, np.zeros(2), count, p, p)
    return DetectionTest(tested, 2, 0, (), ("a5", where), 1.0, 100, CALM)


def _named_at(where: str) -> ModelFit:
    law = ModelTerm(Hysteresis(), where, np.array([10.0, 0.0]))
    return ModelFit((law,), STRONG, np.zeros(6), (np.ones(1),), 3)
