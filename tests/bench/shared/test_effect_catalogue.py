"""What the catalogue says of each effect is what mechanism and claim are."""

from dataclasses import fields

import pytest

from bench.effects import EFFECTS, WITHOUT_MECHANISM
from bench.shared.effect_catalogue import CATALOGUE, usual
from stiffness.effects import HYPOTHESES
from stiffness.robot.tracker_frame import LARGEST_SCALE

EXAMPLE = {"axis": "a5", "link": "link_2", "marker": "marker:x"}
MECHANISMS = {kind.name: kind for kind in EFFECTS}


def test_every_effect_has_one_entry_and_every_entry_is_an_effect():
    claims = {law.effect for law in HYPOTHESES}
    assert claims == set(CATALOGUE)
    assert set(MECHANISMS) == set(CATALOGUE) - WITHOUT_MECHANISM


def test_effects_are_listed_in_one_order():
    known = [name for name in CATALOGUE if name in MECHANISMS]
    assert known == [kind.name for kind in EFFECTS]


@pytest.mark.parametrize("kind", EFFECTS, ids=lambda kind: kind.name)
def test_mechanism_has_the_sites_and_parameters_of_its_entry(kind):
    info = CATALOGUE[kind.name]
    where = EXAMPLE.get(kind.places[0], kind.places[0])
    assert info.sites == kind.places
    optional = [f.name for f in fields(kind) if f.metadata.get("optional")]
    given = kind(where, **dict.fromkeys(optional, 1e-9))
    assert [p.name for p in info.parameters] == list(given.parameters())
    assert set(kind(where).parameters()) == {*given.parameters()} - {*optional}


@pytest.mark.parametrize("law", HYPOTHESES, ids=lambda law: type(law).__name__)
def test_claim_reports_parameters_of_its_entry(law):
    """First moments of mass stand beside mass and centre, or for them."""
    known = {p.name for p in CATALOGUE[law.effect].parameters}
    is_load = law.effect == "gravity_load"
    moments = {f"moment_{i}_kg_m" for i in "xyz"} if is_load else set()
    assert set(law.limits) <= known | moments
    assert set(law.magnitudes) <= {*CATALOGUE[law.effect].magnitudes, *moments}


@pytest.mark.parametrize("law", HYPOTHESES, ids=lambda law: type(law).__name__)
def test_claim_says_at_which_sizes_it_is_nothing(law):
    """Else no interval takes its name; of a compensator two parts are told together."""
    assert law.magnitudes or law.neutral or law.effect == "gravity_compensator"


@pytest.mark.parametrize("info", CATALOGUE.values(), ids=lambda info: info.name)
def test_usual_ranges_are_ranges_with_a_source(info):
    for parameter in info.parameters:
        if parameter.usual is not None:
            assert parameter.usual.low < parameter.usual.high
            assert parameter.usual.source
            assert usual(info.name, parameter.name) is parameter.usual
    assert info.magnitudes and info.visible_in and info.leaves_out
    assert usual(info.name, "of no effect") is None


def test_largest_scale_is_the_one_that_claims_allow():
    assert CATALOGUE["tracker_scale"].largest == LARGEST_SCALE
