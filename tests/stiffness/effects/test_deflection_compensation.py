"""A controller that takes out sag is named with its share, not as masses."""

import pytest
from small_bench import FEW, arm, recording

from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.deflection_compensation import DeflectionCompensation
from stiffness.effects.gravity_compensator import GravityCompensator
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.mass_scale import MassScale

WEIGHTS = (GravityLoad(), MassScale(), GravityCompensator(), DeflectionCompensation())


@pytest.mark.parametrize("true", [{"a2": 0.6, "a3": 0.5}, {"a2": 1.0, "a3": 1.0}])
def test_sag_that_a_controller_takes_out_is_named_with_its_share(true):
    """By its own model, while the true springs are stiffer: beside a gear's wind-up.

    A share of 1 lifts the arm by more than it sags.
    """
    effects = (f"deflection_compensation@{a},ratio={r}" for a, r in true.items())
    made = recording(*effects, "hysteresis@a3,width_rad=2e-4")
    found = diagnose(made, arm(), (*FEW, *WEIGHTS)).named
    shares = {n.name.where: n.parameters["ratio"] for n in found if is_taken_out(n)}
    others = [(n.name.effect, n.name.where) for n in found if not is_taken_out(n)]
    assert others == [("hysteresis", "a3")]
    assert shares.keys() == true.keys()
    for axis, share in shares.items():
        assert share.low < true[axis] < share.high
        assert share.high - share.low < 0.1


def test_a_mass_that_is_missing_is_no_sag_that_is_taken_out():
    found = diagnose(
        recording("gravity_load@link_3,mass_kg=-3"), arm(), (*FEW, *WEIGHTS)
    )
    [one] = found.named
    assert (one.name.effect, one.name.where) == ("gravity_load", "link_3")


def is_taken_out(named) -> bool:
    return named.name.effect == "deflection_compensation"
