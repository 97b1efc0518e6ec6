"""What is named changes what all else feels, and is laid out so."""

from dataclasses import replace

import hypothesis_truth as truth
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from small_bench import FEW, arm, recording

from bench.recording import Payload
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.hypotheses.gravity_load import GravityLoad, seen, torques
from stiffness.diagnosis.situation import Situation

MASS, CENTRE = 3.0, np.array([0.02, -0.03, 0.05])


def carrying(mass: float) -> Situation:
    tool = Payload(mass, CENTRE)
    return truth.situation_in(replace(truth.recording(), tool=tool, wrench=None))


@pytest.mark.parametrize("felt", ["force", "moment", "torque"])
def test_mass_that_was_named_is_felt_as_one_that_was_known(felt):
    """But for where the arm comes to rest under it, a thousandth of a radian."""
    nothing, known = carrying(0.0), carrying(MASS)
    size = np.array([MASS, *(MASS * CENTRE)])
    named = truth.BY_NAME["gravity_load"].acting(nothing, "tool", size)
    want = getattr(known, felt) - getattr(nothing, felt)
    found = getattr(named, felt) - getattr(nothing, felt)
    assert np.abs(want).max() > 1.0
    assert_allclose(found, want, atol=2e-3 * np.abs(want).max())


def test_mass_on_a_link_is_felt_by_what_carries_the_link_alone():
    """The weight at the base, whatever carries it; nothing at the axes beyond."""
    nothing = truth.situation()
    size = np.array([MASS, 0.0, 0.0, 0.0])
    hypothesis = truth.BY_NAME["gravity_load"]
    shown = seen(nothing, torques(nothing, "link_3"))
    named = hypothesis.acting(nothing, "link_3", size[shown])
    more = named.force - nothing.force
    assert_allclose(more[:, :4], np.broadcast_to([0.0, 0.0, -9.81 * MASS], (90, 4, 3)))
    assert_array_equal(more[:, 4:], 0.0)
    axes = named.frame[:, 1:, :, 2]
    own = np.einsum("rai,rai->ra", axes, named.moment[:, 1:] - nothing.moment[:, 1:])
    assert_allclose(named.torque - nothing.torque, own, atol=1e-9)


@pytest.mark.parametrize("effect", sorted(set(truth.BY_NAME) - {"gravity_load"}))
def test_other_effects_pull_at_nothing(effect):
    situation, hypothesis = truth.showing(effect), truth.BY_NAME[effect]
    where = hypothesis.places(situation)[0]
    shape = truth.middle(situation, hypothesis, where)
    size = np.ones(hypothesis.signature(situation, where, shape).columns)
    assert hypothesis.acting(situation, where, size) is situation


def test_mass_and_what_gives_way_under_it_are_both_named():
    """What the one tilts of the other is in neither's own columns: 1 of 8 kg."""
    seen = recording(
        "bearing_tilt@a1,u_rad_per_nm=4e-6,v_rad_per_nm=2e-6",
        "gravity_load@link_3,mass_kg=8.0",
        poses=20,
    )
    found = diagnose(seen, arm(), (*FEW, GravityLoad()))
    names = {(n.name.effect, n.name.where) for n in found.named}
    assert found.verdict == "explained"
    assert names == {("bearing_tilt", "a1"), ("gravity_load", "link_3")}
    mass = next(n for n in found.named if n.name.where == "link_3")
    size = mass.parameters["mass_kg"]
    assert size.low < 8.0 < size.high
    assert size.high - size.low < 1.0
