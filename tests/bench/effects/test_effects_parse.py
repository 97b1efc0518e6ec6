import pytest

from bench.effects.geometry_error import GeometryError
from bench.effects.hysteresis import Hysteresis
from bench.effects.marker_slip import MarkerSlip
from bench.effects.parse import parse, parse_all
from bench.effects.wrist_coupling import WristCoupling
from bench.model_file import load
from bench.shared.errors import UnknownName, Unusable


@pytest.fixture(scope="module")
def model(kr10):
    return load(kr10)


@pytest.mark.parametrize(
    ("text", "effect"),
    [
        ("hysteresis@a2", Hysteresis("a2")),
        ("hysteresis@a2,width_rad=2e-4", Hysteresis("a2", 2e-4)),
        (" hysteresis @ a2 , elements = 6 ", Hysteresis("a2", elements=6)),
        (
            "wrist_coupling@a6,with=a5,compliance_rad_per_nm=-1e-6",
            WristCoupling("a6", "a5", -1e-6),
        ),
        ("geometry_error@link_2,x_m=-1e-3", GeometryError("link_2", -1e-3, ry_rad=0.0)),
        ("marker_slip@marker:elbow", MarkerSlip("marker:elbow")),
    ],
)
def test_word_becomes_the_effect(model, text, effect):
    assert parse(text, model) == effect


def test_misspelt_effect_is_told_its_nearest_name(model):
    with pytest.raises(UnknownName, match="Did you mean 'hysteresis'"):
        parse("hystersis@a2", model)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("creep", r"'creep' has no place; write creep@WHERE"),
        ("creep@", r"No place for 'creep' is called ''"),
        ("creep@a7", r"called 'a7'.* Known: a1, a2, .*a6\."),
        ("creep@link_2", r"No place for 'creep' is called 'link_2'"),
        ("link_bending@base", r"Known: link_1, link_2, .*link_6\."),
        ("base_compliance@a1", r"Known: base\."),
        ("gravity_load@flange", r"Known: link_1, .*link_6, tool\."),
        ("marker_slip@marker:", r"Known: marker:<name>\."),
        ("pulley_friction@a1", r"Known: rig\."),
        ("drift@wrench_sensor", r"Known: base, tracker\."),
        ("creep@a1,time=3", r"Did you mean 'time_s'\? Known: time_s, ratio\."),
        ("creep@a1,where=a2", "No parameter of 'creep' is called 'where'"),
        ("creep@a1,ratio", r"ratio is '', expected a finite number"),
        ("creep@a1,ratio=nan", r"ratio is 'nan', expected a finite number"),
        ("creep@a1,ratio=1,ratio=2", "ratio is given twice"),
        ("creep@a1,ratio=-1", r"ratio is -1.0, expected at least 0.0"),
        ("hysteresis@a1,elements=2.5", "elements is '2.5', expected a whole number"),
        ("wrist_coupling@a5,with=b", "No axis to couple with is called 'b'"),
    ],
)
def test_unusable_word_is_refused_with_what_is_allowed(model, text, says):
    with pytest.raises(Unusable, match=says):
        parse(text, model)


def test_all_faults_of_all_effects_are_named_at_once(model):
    texts = ["hysteresis@a9,width_rad=x,widt=2", "creep@a1", "crepe@a1"]
    with pytest.raises(Unusable, match="The list of effects") as refusal:
        parse_all(texts, model)
    faults = "\n".join(refusal.value.faults)
    for words in ("'a9'", "width_rad is 'x'", "'widt'", "'crepe'"):
        assert words in faults
    assert len(refusal.value.faults) == 4


def test_several_effects_keep_their_order(model):
    texts = ["creep@a1", "hysteresis@a2"]
    assert [e.name for e in parse_all(texts, model)] == ["creep", "hysteresis"]


def test_effect_made_with_an_impossible_size_is_refused():
    with pytest.raises(Unusable, match=r"width_rad is -0\.1, expected at least 0"):
        Hysteresis("a2", width_rad=-0.1)


def test_components_left_out_beside_others_are_zero(model):
    bent = parse("geometry_error@link_2,x_m=1e-3", model).parameters()
    assert bent == {**dict.fromkeys(bent, 0.0), "x_m": 1e-3}
