import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from bench import patch
from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.tabled_law import TabledLaw
from bench.patch import (
    LIGHT,
    Law,
    Mounted,
    Patch,
    PatchEffect,
    can_build,
    effect_of,
    named,
    rig_of,
    text_of,
    with_arm,
)
from bench.rig import Rig
from bench.shared.effect_catalogue import ALONG, BEYOND_ALL, CATALOGUE, limit, on_slide
from bench.shared.errors import BenchError, UnknownName, Unusable

PLACE = {"axis": "a2", "link": "link_2", "marker": "marker:x"}
EXAMPLES = [
    kind("a5" if kind.name == "wrist_coupling" else PLACE.get(place, place))
    for kind in EFFECTS
    for place in kind.places[:1]
]
IN_MODEL = [
    e
    for e in EXAMPLES
    if e.name in ("hysteresis", "lost_motion", "creep", "wrist_coupling", "hardening")
]
POSTURE = np.array([[0.1, -1.2, 1.5, 0.3, 0.7, 0.2], [0.5, -1.0, 1.2, -0.3, 0.9, 1.0]])


def title(effect):
    return type(effect).__name__


def pulled(rig):
    """Up and down a pull along z, in four steps of 20 s."""
    wrench = np.zeros((2, 4, 6))
    wrench[:, :, 2] = [0.0, -50.0, -100.0, -20.0]
    return rig.respond(POSTURE, wrench, np.full((2, 4), 20.0))


@pytest.mark.parametrize("effect", EXAMPLES, ids=title)
def test_a_named_effect_builds_the_mechanism_it_came_from(effect):
    assert effect_of(named(effect)) == effect


@pytest.mark.parametrize("kind", (*EFFECTS, *OTHER_LAWS), ids=lambda k: k.__name__)
def test_every_name_with_a_mechanism_can_be_patched(kind):
    assert can_build(kind.name)
    assert not can_build("a_name_of_no_effect")


@pytest.mark.parametrize("effect", IN_MODEL, ids=title)
def test_a_patch_leads_to_the_same_states_as_the_effect(effect, kr10):
    """To the last bit, also after it was written and read."""
    axes = ("a1", "a3", "a4", "a5", "a6")
    stiffness: dict[str, float | None] = dict.fromkeys(axes, 1.2e4)
    made = rig_of(Patch(stiffness, (named(effect),)), kr10)
    springs = made.nominal.jnt_stiffness.copy()
    springs[[0, 2, 3, 4, 5]] = 1.2e4
    own = Rig(kr10, (effect,), springs, made.cell)
    one, other = pulled(made), pulled(own)
    assert_array_equal(one.position, other.position)
    assert_array_equal(one.axis_angle, other.axis_angle)


def test_a_folder_holds_the_patched_rig(tmp_path, kr10):
    whole = Patch(
        {"a2": 5e4, "a6": None},
        tuple(named(e) for e in EXAMPLES if e.name in ("hysteresis", "drift")),
        (Law("a3", (-50.0, 0.0, 50.0), (-1e-4, 0.0, 1e-4)),),
        Mounted((0.01, 0.0, 0.03), 0.5, (0.0, 0.01, 0.02)),
        ((1.0, 0.0, 0.0, 0.1), (0.0, 1.0, 0.0, 0.2), (0.0, 0.0, 1.0, 0.3),
         (0.0, 0.0, 0.0, 1.0)),
        {"flange_a": (0.1 / 3, 0.0, 0.0)},
    )  # fmt: skip
    rig = rig_of(whole, kr10)
    whole = with_arm(whole, rig)
    (tmp_path / patch.FILE).write_text(text_of(whole), encoding="utf-8")
    assert patch.read(tmp_path / patch.FILE) == whole
    rebuilt = rig_of(patch.read(tmp_path / patch.FILE))
    assert rebuilt.effects == rig.effects
    assert_array_equal(pulled(rebuilt).position, pulled(rig).position)


def test_every_impossible_number_of_a_patch_is_refused_at_once(tmp_path):
    play = PatchEffect("lost_motion", "a2", {"width_rad": 1e300})
    bend = PatchEffect("link_bending", "link_2", {"bending_nm2": 1e300})
    tilt = PatchEffect("bearing_tilt", "a1", {"u_rad_per_nm": -1e9})
    strange = PatchEffect("hysteresis", "a3", {"breadth": 1.0})
    guide = PatchEffect("lost_motion", "a4", {"width_m": 1e300})
    wave = {"amplitude_rad": 1e-5, "order": 1.0, "phase_rad": 0.0}
    waves = [PatchEffect("transmission_error", "a1", {**wave, "order": k})
             for k in (1.0, 2.0)]  # fmt: skip
    every = (play, bend, tilt, strange, guide, *waves, tilt)
    file = tmp_path / patch.FILE
    file.write_text(text_of(Patch({"a1": -1.0, "a2": None}, every)))
    with pytest.raises(Unusable) as told:
        patch.read(file)
    said = str(told.value)
    for words in (
        "effect 1, lost_motion at a2: width_rad is 1e+300, expected at most 0.2.",
        "effect 3, bearing_tilt at a1: u_rad_per_nm is -1e+09",
        "'breadth'",
        "effect 5, lost_motion at a4: width_m is 1e+300, expected at most 0.2.",
        "effect 8, bearing_tilt at a1: it is given twice",
        "spring of a1: -1, expected above 0",
    ):
        assert words in said
    assert "7 faults" in said


def test_a_patch_of_thousands_is_refused_in_a_screen(tmp_path):
    twice = (PatchEffect("hysteresis", "a2", {"width_rad": 1e-8}),) * 5000
    (tmp_path / patch.FILE).write_text(text_of(Patch(effects=twice)))
    with pytest.raises(Unusable, match="and 4979 more like these"):
        patch.read(tmp_path / patch.FILE)


def test_patches_of_the_committed_results_are_read(root):
    files = sorted((root / "results").rglob(patch.FILE))
    assert files
    assert all(patch.read(file).effects for file in files)


def test_what_is_mounted_weighs_as_the_recording_says(kr10):
    light = rig_of(Patch(), kr10)
    heavy = rig_of(Patch(mounted=Mounted(mass_kg=2.0, com_m=(0.0, 0.0, 0.1))), kr10)
    assert heavy.model.body_mass.sum() - light.model.body_mass.sum() == 2.0
    sensor = rig_of(Patch(mounted=Mounted(sensor_m=(0.1, 0.2, 0.3))), kr10)
    assert_allclose(sensor.model.body("sensor_far_side").pos, [0.1, 0.2, 0.3])


def test_a_tabled_law_winds_up_as_its_table_says(kr10):
    """The difference to linear springs, against the torque that those carry.

    Softer and stiffer pieces, uneven sides. 1 %: the load's lever moves with the arm.
    """
    torque = np.array([-100.0, -50.0, -20.0, 0.0, 20.0, 50.0, 100.0])
    extra = 1e-5 * np.array([-6.0, -4.0, -3.0, 0.0, 1.0, 1.1, 0.4])
    stiff = dict.fromkeys(("a1", "a3", "a4", "a5", "a6"), None) | {"a2": 5e4}
    law = Law("a2", tuple(torque), tuple(extra))
    posture = np.tile([0.0, -np.pi / 2, np.pi / 2, 0.0, 0.0, 0.0], (21, 1))
    wrench = np.zeros((21, 1, 6))
    wrench[:, 0, 4] = np.linspace(-110.0, 50.0, 21)
    bent, straight = (
        rig_of(Patch(stiff, laws=laws), kr10).respond(posture, wrench, np.ones((21, 1)))
        for laws in ((law,), ())
    )
    carried = (straight.axis_angle[:, 1] - posture[:, 1]) * 5e4
    inside = np.abs(carried) < 95.0
    assert inside.sum() > 10
    found = (bent.axis_angle - straight.axis_angle)[inside, 1]
    expected = np.interp(carried[inside], torque, extra)
    assert_allclose(found, expected, rtol=0.01, atol=1e-8)


def test_a_law_of_two_branches_has_a_loop_of_their_distance():
    law = Law("a2", (-10.0, 10.0), (-1e-5, 1e-5), (1e-5, 3e-5))
    (tabled,) = patch.effects_of(Patch(laws=(law,)))
    assert isinstance(tabled, TabledLaw)
    assert_allclose(tabled.width_rad, 2e-5)
    assert_allclose(tabled.wind_up_rad, (0.0, 2e-5))
    assert not any(tabled.off().wind_up_rad)
    with pytest.raises(Unusable, match="differ in length"):
        patch.effects_of(Patch(laws=(replace(law, unloading_rad=(0.0,)),)))


def test_a_piece_steeper_than_a_spring_can_be_is_practically_rigid():
    """2 % of the axis' own compliance is left."""
    own = 5e4
    law = TabledLaw("a2", (0.0, 10.0, 20.0), (0.0, -1e-3, 0.0))
    _, slopes = law.pieces(own)
    assert slopes.max() == pytest.approx(own / 0.02)


@pytest.mark.parametrize(
    ("torque", "wound", "say"),
    [((0.0, 1.0), (0.0,), "a wind-up for each"), ((1.0, 0.0), (0.0, 0.0), "increase")],
)
def test_a_table_that_is_none_is_refused(torque, wound, say):
    with pytest.raises(Unusable, match=say):
        TabledLaw("a2", torque, wound)


def test_sizes_that_are_not_given_are_zero():
    tilt = effect_of(PatchEffect("bearing_tilt", "a2", {"u_rad_per_nm": 2e-6}))
    assert tilt.parameters()["v_rad_per_nm"] == 0.0


def test_what_no_mechanism_can_have_is_taken_as_its_bound():
    foot = effect_of(PatchEffect("base_compliance", "base", {"rx_rad_per_nm": -1e-9}))
    assert foot.parameters()["rx_rad_per_nm"] == 0.0
    beam = PatchEffect(
        "link_bending", "link_2", {"bending_nm2": -5e5, "torsion_nm2": None}
    )
    assert set(effect_of(beam).parameters().values()) == {math.inf}


@pytest.mark.parametrize(
    ("effect", "where", "parameter"),
    [
        ("hysteresis", "a2", "width_rad"),
        ("deflection_compensation", "a2", "ratio"),
        ("wrist_coupling", "a5", "with"),
    ],
)
def test_nothing_but_a_stiffness_may_be_infinite(effect, where, parameter):
    with pytest.raises(Unusable, match=f"{parameter} is inf"):
        effect_of(PatchEffect(effect, where, {parameter: None}))


@pytest.mark.parametrize("effect", EXAMPLES, ids=title)
def test_stiffnesses_alone_are_absent_at_infinity_and_have_no_limit(effect):
    """What a size is follows from the catalogue, whatever it is called."""
    sizes = {n for n, v in effect.off().parameters().items() if v == math.inf}
    known = [p.name for p in CATALOGUE[effect.name].parameters]
    assert {n for n in known if limit(effect.name, n) == math.inf} == sizes
    assert limit(effect.name, "other_nm2") == BEYOND_ALL


def test_a_first_moment_without_a_mass_is_a_light_mass_far_out():
    """Moment = mass × place."""
    pull = effect_of(PatchEffect("gravity_load", "link_3", {"moment_x_kg_m": 0.25}))
    sizes = pull.parameters()
    assert sizes["mass_kg"] == LIGHT
    assert float(sizes["mass_kg"]) * float(sizes["com_x_m"]) == pytest.approx(0.25)
    known = {"mass_kg": 2.0, "com_x_m": 0.125}
    mass = PatchEffect("gravity_load", "link_3", {**known, "moment_x_kg_m": 0.25})
    assert known.items() <= effect_of(mass).parameters().items()


@pytest.mark.parametrize("name", ALONG)
def test_an_axis_that_slides_has_metres_and_newtons_in_its_names(name):
    """The same mechanism, whether written for a slide or not."""
    kind = next(kind for kind in EFFECTS if kind.name == name)
    turning = named(kind("a1"))
    values = {on_slide(name, known): x for known, x in turning.parameters.items()}
    assert values.keys() != turning.parameters.keys()
    assert effect_of(replace(turning, parameters=values)) == effect_of(turning)


def test_a_partner_may_be_a_number():
    pair = effect_of(PatchEffect("wrist_coupling", "a5", {"with": 4.0}))
    assert pair.parameters()["with"] == "a4"


def test_names_and_parameters_that_do_not_exist_are_refused(kr10):
    with pytest.raises(UnknownName, match="channel_delay"):
        effect_of(PatchEffect("channel_delay", "tracker"))
    with pytest.raises(Unusable, match="'width'"):
        effect_of(PatchEffect("hysteresis", "a2", {"width": 1e-4}))
    with pytest.raises(Unusable, match="expected a number"):
        effect_of(PatchEffect("hysteresis", "a2", {"width_rad": "wide"}))
    with pytest.raises(Unusable, match="no axis is called 'a9'"):
        rig_of(Patch({"a9": 1e4}), kr10)


def test_a_patch_of_another_arm_is_refused_with_every_place_it_lacks(kr10):
    nowhere = (PatchEffect("hysteresis", "a9"), PatchEffect("link_bending", "a2"))
    law = Law("base", (-1.0, 1.0), (0.0, 0.0))
    with pytest.raises(Unusable, match="4 faults") as told:
        rig_of(Patch({"a8": 1e4}, nowhere, (law,)), kr10)
    for words in ("'a9'", "'link_bending' is called 'a2'", "'base'", "'a8'"):
        assert words in str(told.value)


@pytest.mark.parametrize(
    "text",
    [
        '{"schema": 2}',
        '{"fitted": {"a1": {"angle_rad": [], "torque_nm": [0, 0]}}}',
        '{"laws": [{"where": "a1", "torque_nm": [], "loading_rad": []}]}',
        '{"laws": [{"where": "a1", "torque_nm": [0, 1], "loading_rad": [0]}]}',
    ],
)
def test_a_patch_of_another_form_is_refused(tmp_path, text):
    (tmp_path / patch.FILE).write_text(text, encoding="utf-8")
    with pytest.raises(Unusable, match="1 fault"):
        patch.read(tmp_path / patch.FILE)


def test_a_folder_without_a_patch_is_refused(tmp_path):
    with pytest.raises(BenchError, match=r"no patch\.json"):
        patch.read(tmp_path / patch.FILE)
    (tmp_path / patch.FILE).write_text('{"effects": 3}', encoding="utf-8")
    with pytest.raises(Unusable, match="effects"):
        patch.read(tmp_path / patch.FILE)


def test_what_is_mounted_may_be_lighter_than_the_recording_says(kr10):
    """The model's own tool has no mass; what is mounted hangs on the flange."""
    lighter = PatchEffect("gravity_load", "tool", {"mass_kg": -0.28, "com_z_m": 0.05})
    model = rig_of(Patch(effects=(lighter,), mounted=Mounted(mass_kg=0.6)), kr10).model
    plain = rig_of(Patch(), kr10).model
    flange = [m.body("flange").mass[0] for m in (model, plain)]
    assert flange[0] - flange[1] == pytest.approx(0.6 - 0.28)
