import inspect
import re
from dataclasses import FrozenInstanceError, fields, replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.creep import Creep, creeping
from bench.effects.effect import InstrumentEffect
from bench.effects.gravity_load import GravityLoad
from bench.effects.joint_compliance import JointCompliance
from bench.effects.places import misplaced, places_for
from bench.rig import Rig
from bench.shared.errors import Unusable
from bench.shared.plan import Plan, parse_path
from bench.study_arm import default_truth

KINDS = (*EFFECTS, *OTHER_LAWS)
PLACE = {"axis": "a2", "link": "link_2", "marker": "marker:x"}
EXAMPLES = [
    kind("a5" if kind.name == "wrist_coupling" else PLACE.get(place, place))
    for kind in KINDS
    for place in kind.places[:1]
]
"""Of catalogue size, one of each."""
IN_THE_ARM = [e for e in EXAMPLES if not isinstance(e, InstrumentEffect)]
ALL_AT_ONCE = tuple(e for e in IN_THE_ARM if type(e) in EFFECTS)
STATES = ("position", "rotation", "axis_angle", "wrench")
LINEAR = {
    "joint_compliance": ("compliance_rad_per_nm",),
    "creep": ("ratio",),
    "angle_dependent_stiffness": ("ratio",),
    "wrist_coupling": ("compliance_rad_per_nm",),
    "bearing_tilt": ("u_rad_per_nm", "v_rad_per_nm"),
    "base_compliance": ("rx_rad_per_nm", "ry_rad_per_nm"),
    "gravity_load": ("mass_kg",),
    "gravity_compensator": ("torque_nm",),
    "transmission_error": ("amplitude_rad",),
    "encoder_offset": ("offset_rad",),
    "geometry_error": ("x_m", "ry_rad"),
    "pulley_friction": ("ratio",),
}
"""What the size of a linear effect is."""


def named(effect):
    return type(effect).__name__


@pytest.fixture(scope="module")
def plan():
    """Two postures, up and down."""
    posture = np.array(
        [[0.1, -1.2, 1.5, 0.3, 0.7, 0.2], [0.5, -1.0, 1.2, -0.3, 0.9, 1.0]]
    )
    return Plan(
        "contract",
        posture,
        posture_id=np.arange(2),
        pulley=np.array([0, 3]),
        path=parse_path("0,5,10,5,0"),
    )


@pytest.fixture(scope="module")
def nominal(kr10, plan):
    return Rig(kr10).carry_out(plan)


def same(one, other):
    return all(np.array_equal(getattr(one, n), getattr(other, n)) for n in STATES)


def flange_shift(states, nominal):
    b = nominal.bodies.index("flange")
    return states.position[:, b] - nominal.position[:, b]


@pytest.mark.parametrize("effect", IN_THE_ARM, ids=named)
def test_effect_switched_off_changes_nothing(effect, kr10, plan, nominal):
    """To the last bit."""
    assert same(Rig(kr10, (effect.off(),)).carry_out(plan), nominal)


def test_effects_switched_off_change_nothing_about_the_others(kr10, plan):
    rest = tuple(effect.off() for effect in ALL_AT_ONCE[::2])
    on = ALL_AT_ONCE[1::2]
    assert same(Rig(kr10, (*rest, *on)).carry_out(plan), Rig(kr10, on).carry_out(plan))


@pytest.mark.parametrize("effect", IN_THE_ARM, ids=named)
def test_effect_of_catalogue_size_moves_the_flange(effect, kr10, plan, nominal):
    """By more than a micrometre, and none by more than a robot's soft axes do."""
    moved = flange_shift(Rig(kr10, (effect,)).carry_out(plan), nominal)
    assert 1e-6 < np.abs(moved).max() < 5e-3


def test_order_of_effects_does_not_matter_to_the_last_bit(kr10, plan):
    first = Rig(kr10, ALL_AT_ONCE).carry_out(plan)
    for shift in (1, 7):
        turned = (*ALL_AT_ONCE[shift:], *ALL_AT_ONCE[:shift])
        assert same(Rig(kr10, turned[::-1]).carry_out(plan), first)


def test_effects_of_one_kind_add_up(kr10, plan, nominal):
    load = GravityLoad("link_2", 1.0)
    both = flange_shift(Rig(kr10, (load, load)).carry_out(plan), nominal)
    one = flange_shift(
        Rig(kr10, (replace(load, mass_kg=2.0),)).carry_out(plan), nominal
    )
    assert_allclose(both, one, atol=1e-12)


@pytest.mark.parametrize(
    "half", [JointCompliance("a2", 1e-5), Creep("a2", ratio=0.015)], ids=named
)
def test_an_effect_twice_on_one_axis_is_twice_the_effect(half, kr10, plan):
    size = LINEAR[half.name][0]
    whole = replace(half, **{size: 2 * getattr(half, size)})
    twice = Rig(kr10, (half, half)).carry_out(plan)
    once = Rig(kr10, (whole,)).carry_out(plan)
    assert_allclose(twice.position, once.position, atol=1e-9)


@pytest.mark.parametrize("effect", IN_THE_ARM, ids=named)
def test_effect_can_be_there_twice_or_is_refused_with_the_reason(effect, kr10, plan):
    rig = Rig(kr10, (effect, effect))
    if effect.name == "link_bending":  # five joints each
        with pytest.raises(Unusable, match="gives way in 6 ways already; leave one"):
            _ = rig.model
    else:
        assert rig.carry_out(plan).residual <= 1e-9


def test_default_truth_has_room_for_more_of_what_it_is_made_of(kr10, plan):
    known = default_truth().effects
    more = [e for e in known if e.name in ("hardening", "hysteresis", "creep")]
    assert Rig(kr10, (*known, *more)).carry_out(plan).residual <= 1e-9


def test_two_creeps_of_one_axis_keep_their_own_times(kr10):
    both = Rig(kr10, tuple(Creep("a2", ratio=0.1, time_s=t) for t in (20.0, 300.0)))
    hold = np.array([[20.0, 300.0, 6000.0]])
    pull = np.broadcast_to([0.0, 0.0, -100.0, 0.0, 0.0, 0.0], (1, 3, 6))
    posture = np.array([[0.1, -1.2, 1.5, 0.3, 0.7, 0.2]])
    creep = both.respond(posture, pull, hold)
    fast, slow = (both.model.joint(n).id for n in ("a2_creep", "a2_creep_2"))
    assert creeping(both._sorted, both.model, both.anatomy) == {fast: 20.0, slow: 300.0}
    assert len(np.unique(creep.axis_angle[:, 1])) == 3


def test_all_effects_at_once_leave_a_nanonewton_metre_unbalanced(kr10, plan):
    assert Rig(kr10, ALL_AT_ONCE).carry_out(plan).residual <= 1e-9


def test_same_plan_gives_the_same_bits(kr10, plan):
    one, other = (Rig(kr10, ALL_AT_ONCE).carry_out(plan) for _ in range(2))
    assert same(one, other)


@pytest.mark.parametrize(
    "effect", [e for e in IN_THE_ARM if e.name in LINEAR], ids=named
)
def test_small_linear_effect_of_double_size_deflects_twice_as_far(
    effect, kr10, plan, nominal
):
    """Sizes of 1 % of the catalogue's, so that squares are below a thousandth."""

    def shift(factor):
        size = {n: factor * getattr(effect, n) for n in LINEAR[effect.name]}
        rig = Rig(kr10, (replace(effect, **size),))
        return flange_shift(rig.carry_out(plan), nominal)

    once, twice = shift(0.01), shift(0.02)
    assert_allclose(twice, 2 * once, atol=2e-3 * np.abs(twice).max())


def test_link_half_as_stiff_bends_twice_as_far(kr10, plan, nominal):
    stiff = next(e for e in IN_THE_ARM if e.name == "link_bending")

    def shift(factor):
        size = {n: v * factor for n, v in stiff.parameters().items()}
        return flange_shift(
            Rig(kr10, (replace(stiff, **size),)).carry_out(plan), nominal
        )

    once, twice = shift(100.0), shift(50.0)
    assert_allclose(twice, 2 * once, atol=2e-3 * np.abs(twice).max())


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_effect_file_states_equation_source_validity_and_what_it_ignores(kind):
    manual = inspect.getdoc(inspect.getmodule(kind)) or ""
    rows = re.findall(r"^(\w+) {2,}\S", manual, re.MULTILINE)
    assert rows == ["Equation", "Source", "Valid", "Ignores"]


@pytest.mark.parametrize("effect", EXAMPLES, ids=named)
def test_effect_reports_what_it_was_made_with(effect):
    """Its parameters are its fields, so that a patch can be made from a report."""
    with pytest.raises(FrozenInstanceError):
        effect.where = "a1"
    made = {
        f.name.removesuffix("_axis"): getattr(effect, f.name) for f in fields(effect)
    }
    reported = effect.parameters()
    assert reported
    assert reported.items() <= made.items()


@pytest.mark.parametrize("effect", EXAMPLES, ids=named)
def test_effect_switched_off_stays_what_it_is(effect):
    off = effect.off()
    assert type(off) is type(effect)
    assert off.where == effect.where
    assert off != effect
    assert off.off() == off


def test_every_name_has_one_effect_and_other_laws_reuse_names():
    names = [kind.name for kind in EFFECTS]
    assert len(set(names)) == len(names)
    assert {kind.name for kind in OTHER_LAWS} <= set(names)


@pytest.mark.parametrize("effect", EXAMPLES, ids=named)
def test_effect_accepts_exactly_its_own_kinds_of_places(effect, kr10):
    rig = Rig(kr10)
    every = (
        "axis",
        "link",
        "base",
        "flange",
        "tool",
        "rig",
        "tracker",
        "wrench_sensor",
    )
    places = [(k, p) for k in every for p in places_for([k], rig.anatomy)]
    for kind, place in (*places, ("marker", "marker:x"), ("nowhere", "nowhere")):
        moved = replace(effect, where=place)
        assert (misplaced(moved, rig.anatomy) == []) == (kind in effect.places)
