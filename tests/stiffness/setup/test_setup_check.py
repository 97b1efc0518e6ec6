"""Each mistake of a set-up is said in its own words, and an honest recording has none.

It is over 600 lines long: each mistake is one function of a table that all tests share.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.experiment import record
from bench.instruments import Instruments
from bench.instruments.markers import Markers
from bench.rig import Rig
from bench.shared.plan import parse_path
from bench.shared.recording import Marker, Recording
from bench.standard_plans import table_one_plan
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.pipelines.synthetic_recording import Watching
from scenarios.record import Settings, main
from stiffness.diagnosis.diagnose import diagnose
from stiffness.robot.arm import Arm
from stiffness.setup import check
from stiffness.setup.alternatives import of_angles, of_columns
from stiffness.setup.check import setup_errors

ROOT = Path(__file__).parents[3]
MODELS = {
    "kr10": ROOT / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml",
    "ur10": ROOT / "mjcf" / "ur10" / "ur10.xml",
}
SOFT = tuple(
    f"joint_compliance@a{k},compliance_rad_per_nm={c}"
    for k, c in enumerate((1e-6, 1e-6, 2e-6, 1e-5, 1e-5, 2e-5), start=1)
)
"""The UR10's model is rigid; its truth is not."""
LARGE = (
    "encoder_offset@a2,offset_rad=0.017",
    "bearing_tilt@a4,u_rad_per_nm=1e-4,v_rad_per_nm=1e-4",
    "lost_motion@a6,width_rad=3e-3",
    "tracker_misalignment@tracker,x_m=0.01,rz_rad=0.01",
    "wrench_gain@wrench_sensor,fx=0.3",
)
"""Ten times what catalogues allow, and more."""

Cell = tuple[Recording, Arm]
Mistake = Callable[[Recording], Recording]


def recorded(folder: Path, arm: str, targets, frame: bool, *effects: str) -> Cell:
    effects = (*(SOFT if arm == "ur10" else ()), *effects)
    watch = Watching(targets=targets, state_frame=frame, placement_mm=0.5)
    recording = main(
        Settings(
            out=folder,
            robot=MODELS[arm],
            effect=effects,
            poses=20,
            path="0,10,0",
            watch=watch,
            seed=3,
        )
    )
    nominal = arm_of(MODELS[arm])
    return recording, nominal.for_recording(recording)


@pytest.fixture(scope="module", params=["kr10-all", "ur10-flange"])
def cell(request, tmp_path_factory) -> Cell:
    """One arm with markers on all links and no frame; one with a target alone."""
    arm, targets = request.param.split("-")
    folder = tmp_path_factory.mktemp("recorded") / "r"
    return recorded(folder, arm, targets, targets == "flange")


def said(recording: Recording, arm: Arm) -> list[tuple[str, str]]:
    return [(w.code, w.where) for w in setup_errors(recording, arm)]


def unplaced(recording: Recording) -> Recording:
    markers = tuple(replace(m, position=None) for m in recording.markers)
    return replace(recording, markers=markers)


def unframed(recording: Recording) -> Recording:
    return replace(recording, base_from_tracker=None)


def signed(*axes: int) -> Mistake:
    def reverse(r: Recording) -> Recording:
        sign = np.ones(r.posture.shape[1])
        sign[list(axes)] = -1.0
        return replace(r, posture=r.posture * sign)

    return reverse


def summed(axis: int, **others: float) -> Mistake:
    """Count an axis against others: what is written is the sum of their angles."""

    def couple(r: Recording) -> Recording:
        posture = r.posture.copy()
        for name, factor in others.items():
            posture[:, axis] += factor * r.posture[:, int(name[1:]) - 1]
        return replace(r, posture=posture)

    return couple


def shifted(axis: int, degrees: float) -> Mistake:
    def shift(r: Recording) -> Recording:
        off = np.radians(degrees) * (np.arange(r.posture.shape[1]) == axis)
        return replace(r, posture=r.posture + off)

    return shift


def ordered(*order: int) -> Mistake:
    return lambda r: replace(r, posture=r.posture[:, list(order)])


def seen(matrix) -> Mistake:
    def change(r: Recording) -> Recording:
        assert r.points is not None
        return replace(r, points=r.points @ np.array(matrix, float).T)

    return change


def turned(factor: float) -> Mistake:
    return lambda r: replace(r, posture=r.posture * factor)


def one_turned(axis: int, factor: float) -> Mistake:
    scale = np.where(np.arange(6) == axis, factor, 1.0)
    return lambda r: replace(r, posture=r.posture * scale)


def one_seen(marker: int, coordinates: list[int], factor: float) -> Mistake:
    """Give columns of one marker in another unit than the rest."""

    def change(r: Recording) -> Recording:
        assert r.points is not None
        points = r.points.copy()
        points[:, marker, coordinates] *= factor
        return replace(r, points=points)

    return change


def pulled(*factors: float) -> Mistake:
    def change(r: Recording) -> Recording:
        assert r.wrench is not None
        return replace(r, wrench=r.wrench * np.repeat(factors, 3))

    return change


def in_base(r: Recording) -> Recording:
    assert r.wrench_sensor is not None
    return replace(r, wrench_sensor=replace(r.wrench_sensor, frame="base"))


def y_reversed(r: Recording) -> Recording:
    assert r.wrench is not None
    return replace(r, wrench=r.wrench * [1, -1, 1, 1, -1, 1])


def columns(*order: int) -> Mistake:
    def wrong(r: Recording) -> Recording:
        assert r.wrench is not None
        return replace(r, wrench=r.wrench[:, order])

    return wrong


def rows(by: int) -> Mistake:
    def wrong(r: Recording) -> Recording:
        assert r.wrench is not None
        return replace(r, wrench=np.roll(r.wrench, by, axis=0))

    return wrong


def on_body(body: str, *others: str) -> Mistake:
    """Say that markers of other bodies are on this one, at places that nobody knows."""

    def wrong(r: Recording) -> Recording:
        markers = tuple(
            replace(m, body=body, position=None) if m.body in others else m
            for m in r.markers
        )
        return replace(r, markers=markers)

    return wrong


def unhung(mistake: Mistake) -> Mistake:
    """Do not say what hangs on the hook either."""
    return lambda r: replace(mistake(r), load_mass=None)


MISTAKES: dict[str, tuple[Mistake, list[tuple[str, str]]]] = {
    "a1 reversed": (signed(0), [("axis_reversed", "a1")]),
    "a2 reversed": (signed(1), [("axis_reversed", "a2")]),
    "a3 reversed": (signed(2), [("axis_reversed", "a3")]),
    "a5 reversed": (signed(4), [("axis_reversed", "a5")]),
    "a2, a3 reversed": (
        signed(1, 2),
        [("axis_reversed", "a2"), ("axis_reversed", "a3")],
    ),
    "a3 with a2": (summed(2, a2=1.0), [("axis_coupled", "a3")]),
    "a6 against a5": (summed(5, a5=-1.0), [("axis_coupled", "a6")]),
    "a5 with a4, a6": (summed(4, a4=1.0, a6=-1.0), [("axis_coupled", "a5")]),
    "zero of a2 at 90°": (shifted(1, -90.0), [("axis_zero", "a2")]),
    "zero of a3 off by 13°": (shifted(2, 13.0), [("axis_zero", "a3")]),
    "zero of a5 off by 137°": (shifted(4, -137.0), [("axis_zero", "a5")]),
    "a2, a3 swapped": (ordered(0, 2, 1, 3, 4, 5), [("axis_order", "a2")]),
    "a1, a6 swapped": (ordered(5, 1, 2, 3, 4, 0), [("axis_order", "a1")]),
    "order turned round": (ordered(5, 4, 3, 2, 1, 0), [("axis_order", "a1")]),
    "y mirrored": (seen(np.diag([1, -1, 1])), [("mirrored", "tracker")]),
    "x and y swapped": (
        seen([[0, 1, 0], [1, 0, 0], [0, 0, 1]]),
        [("mirrored", "tracker")],
    ),
    "m for mm": (seen(np.eye(3) / 1e3), [("units", "tracker")]),
    "µm for mm": (seen(np.eye(3) * 1e3), [("units", "tracker")]),
    "radians for degrees": (turned(np.pi / 180), [("units", "axes")]),
    "degrees for radians": (turned(180 / np.pi), [("units", "axes")]),
    "a1 in radians": (one_turned(0, np.pi / 180), [("units", "a1")]),
    "a5 in radians": (one_turned(4, np.pi / 180), [("units", "a5")]),
    "a3 for radians": (one_turned(2, 180 / np.pi), [("units", "a3")]),
    "one x in m": (one_seen(-1, [0], 1e-3), [("units", "tracker")]),
    "one y, z in m": (one_seen(-2, [1, 2], 1e-3), [("units", "tracker")]),
    "one marker in m": (one_seen(-3, [0, 1, 2], 1e-3), [("units", "tracker")]),
    "one z for m": (one_seen(-1, [2], 1e3), [("units", "tracker")]),
    "wrench reversed": (pulled(-1, -1), [("wrench_sign", "wrench_sensor")]),
    "kN for N": (pulled(1e-3, 1e-3), [("units", "wrench_sensor")]),
    "mN for N": (pulled(1e3, 1e3), [("units", "wrench_sensor")]),
    "Nmm for Nm": (pulled(1, 1e3), [("units", "wrench_sensor")]),
    "axes of the base": (in_base, [("wrench_frame", "wrench_sensor")]),
    "y reversed": (y_reversed, [("wrench_sign", "wrench_sensor")]),
    "y for z": (columns(0, 2, 1, 3, 5, 4), [("wrench_columns", "wrench_sensor")]),
    "x y z turned": (columns(1, 2, 0, 4, 5, 3), [("wrench_columns", "wrench_sensor")]),
    "moments first": (columns(3, 4, 5, 0, 1, 2), [("wrench_columns", "wrench_sensor")]),
    "one row late": (rows(1), [("wrench_rows", "wrench_sensor")]),
    "one row early": (rows(-1), [("wrench_rows", "wrench_sensor")]),
    "kgf for N": (pulled(1 / 9.80665, 1 / 9.80665), [("units", "wrench_sensor")]),
    "kgf for N, no load_kg": (
        unhung(pulled(1 / 9.80665, 1 / 9.80665)),
        [("units", "wrench_sensor")],
    ),
    "lbf for N, no load_kg": (
        unhung(pulled(1 / 4.4482216, 1 / 4.4482216)),
        [("units", "wrench_sensor")],
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_said_in_so_many_words(name, cell):
    recording, arm = cell
    mistake, expected = MISTAKES[name]
    assert said(mistake(recording), arm) == expected


@pytest.mark.parametrize("change", [unplaced, unframed])
@pytest.mark.parametrize(
    "name",
    [
        *("a3 reversed", "y mirrored", "m for mm", "wrench reversed"),
        *("a5 in radians", "one x in m", "one marker in m"),
    ],
)
def test_it_is_said_without_stated_places_or_frame_too(name, change, cell):
    recording, arm = cell
    mistake, expected = MISTAKES[name]
    assert said(mistake(change(recording)), arm) == expected


def test_a_column_in_another_unit_is_named_and_each_other_one_too(cell):
    recording, arm = cell
    three = one_seen(-2, [1, 2], 1e-3)(one_seen(-1, [0], 1e-3)(recording))
    last, other = recording.markers[-1].name, recording.markers[-2].name
    texts = [w.text for w in setup_errors(three, arm)]
    assert [t.split(":")[0] for t in texts] == [
        f"{other}_y_mm, {other}_z_mm",
        f"{last}_x_mm",
    ]
    assert all("given in m where mm are expected" in t for t in texts)


def test_one_target_alone_tells_which_of_its_columns_is_in_another_unit(cell):
    recording, arm = cell
    assert recording.points is not None
    last = replace(recording.markers[-1], position=None)
    alone = replace(recording, markers=(last,), points=recording.points[:, -1:])
    assert said(alone, arm) == []
    (told,) = setup_errors(one_seen(0, [1], 1e-3)(alone), arm)
    assert told.text.startswith(f"{last.name}_y_mm: given in m")


def test_an_axis_that_hardly_moves_is_in_no_other_unit():
    """A small angle times 57 would pass for an offset, which an arm may have."""
    posture = np.full((20, 6), 0.1) + np.linspace(0.0, 1e-4, 20)[:, None]
    others = of_angles(posture, np.zeros(6, dtype=bool))
    doubted = {o.warned.where for o in others if o.warned.code == "units"}
    assert doubted == {"axes"}


def relative(r: Recording) -> Recording:
    assert r.points is not None
    start = np.searchsorted(r.visit, r.visit)
    return replace(r, points=r.points - r.points[start], displacement="relative")


@pytest.mark.parametrize(
    "name",
    [
        *("a3 reversed", "a2, a3 swapped", "wrench reversed", "kN for N"),
        *("a3 with a2", "a6 against a5", "zero of a3 off by 13°"),
        "zero of a5 off by 137°",
    ],
)
def test_differences_within_visits_show_it_where_places_do_not(name, cell):
    recording, arm = cell
    if recording.base_from_tracker is None:
        pytest.skip("relative readings need a frame")
    mistake, expected = MISTAKES[name]
    code = expected[0][0]
    assert [c for c, _ in said(mistake(relative(recording)), arm)] == [code]


def test_zero_and_coupling_are_said_with_their_numbers(cell):
    recording, arm = cell
    (zero,) = setup_errors(shifted(2, 13.0)(recording), arm)
    _, _, after = zero.text.partition("it fits with ")
    assert float(after.partition("°")[0]) == pytest.approx(-13.0, abs=0.2)
    (coupled,) = setup_errors(summed(2, a2=1.0)(recording), arm)
    assert "it fits as a3 - a2." in coupled.text


def test_an_axis_that_is_coupled_names_no_effect_in_relative_readings(tmp_path):
    """Many robots report their third angle against the horizontal."""
    recording, arm = recorded(tmp_path / "r", "kr10", "flange", True, "hysteresis@a2")
    found = diagnose(summed(2, a2=1.0)(relative(recording)), arm)
    assert [(w.code, w.where) for w in found.warnings] == [("axis_coupled", "a3")]
    assert found.named == () and found.verdict == "unexplained"


def test_axes_that_no_marker_shows_are_no_mistake_of_the_wrench(tmp_path):
    """Markers as far as link_3: a4 to a6 explain nothing, rounding or not."""
    effects = ("hysteresis@a2", "bearing_tilt@a3")
    recording, arm = recorded(tmp_path / "r", "kr10", "all", False, *effects)
    assert recording.points is not None
    near = np.array([arm.attachment(m.body).axis < 3 for m in recording.markers])
    markers = tuple(m for m, keep in zip(recording.markers, near, strict=True) if keep)
    some = replace(recording, markers=markers, points=recording.points[:, near])
    assert said(some, arm) == []


def test_an_honest_recording_has_no_mistake(cell):
    recording, arm = cell
    for change in (lambda r: r, unplaced, unframed):
        assert said(change(recording), arm) == []


@pytest.mark.slow
@pytest.mark.parametrize("effect", LARGE)
def test_no_effect_however_large_is_taken_for_a_mistake(effect, tmp_path):
    recording, arm = recorded(tmp_path / "r", "kr10", "flange", True, effect)
    for change in (lambda r: r, unplaced, unframed, relative):
        assert said(change(recording), arm) == []


def test_a_stated_frame_that_is_inverted_is_said(cell):
    recording, arm = cell
    transform = np.eye(4)
    transform[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    transform[:3, 3] = 1.5, 0.5, 0.2
    assert recording.points is not None
    true = recording.base_from_tracker
    if true is None:
        pytest.skip("its frame is not stated")
    back = np.linalg.inv(transform)
    base = recording.points @ true[:3, :3].T + true[:3, 3]
    points = base @ back[:3, :3].T + back[:3, 3]
    good = replace(recording, points=points, base_from_tracker=transform)
    assert said(good, arm) == []
    wrong = replace(good, base_from_tracker=back)
    assert said(wrong, arm) == [("tracker_frame", "tracker")]


def test_markers_that_belong_to_other_rows_are_no_recording_of_this_arm(cell):
    recording, arm = cell
    assert recording.points is not None
    order = np.random.default_rng(0).permutation(len(recording.time))
    shuffled = replace(recording, points=recording.points[order])
    assert said(shuffled, arm) == [("wrong_model", "rig")]


def test_another_arm_s_model_is_not_diagnosed(cell):
    recording, _ = cell
    other = arm_of(MODELS["ur10" if "kr10" in recording.robot else "kr10"])
    found = diagnose(replace(recording, axes=(), bodies={}), other)
    assert [w.code for w in found.warnings] == ["wrong_model"]
    assert found.named == () and found.verdict == "unexplained"


def test_one_reading_far_off_is_no_mistake(cell):
    recording, arm = cell
    assert recording.points is not None
    points = recording.points.copy()
    points[0, 0, 0] = 1e5
    assert said(replace(recording, points=points), arm) == []


def renamed(r: Recording, names: dict[int, int], visits=None) -> Recording:
    """Give what was seen of the last body's k-th marker to another one."""
    assert r.points is not None
    points, first = r.points.copy(), len(r.markers) - 4
    rows = np.isin(r.visit, r.visit if visits is None else visits)
    for to, seen in names.items():
        points[rows, first + to] = r.points[rows, first + seen]
    return replace(r, points=points)


def test_two_markers_of_a_body_that_are_swapped_are_named(cell):
    recording, arm = cell
    names = [m.name for m in recording.markers[-4:]]
    for i, j in ((0, 1), (0, 2), (2, 3)):
        wrong = renamed(recording, {i: j, j: i})
        (warned,) = setup_errors(wrong, arm)
        assert warned.code == "marker_names"
        assert warned.text.startswith(f"{names[i]} and {names[j]} look swapped:")
    assert said(renamed(recording, {0: 1, 1: 2, 2: 0}), arm) == [
        ("marker_names", "markers")
    ]


def test_names_mixed_up_between_the_first_and_the_last_of_a_body_are_told(cell):
    recording, arm = cell
    own, weights = recording.markers[-4:], np.array([1.2, -0.9, 0.8, -0.1])
    place = weights @ np.array([m.position for m in own])
    fifth = Marker("fifth", own[0].body, place)
    assert recording.points is not None
    seen = np.einsum("m,rmi->ri", weights, recording.points[:, -4:])
    five = replace(
        recording,
        markers=(*recording.markers[:-1], fifth, own[-1]),
        points=np.insert(recording.points, -1, seen, axis=1),
    )
    assert said(five, arm) == []
    assert five.points is not None
    points = five.points.copy()
    points[:, [-4, -3, -2]] = five.points[:, [-3, -2, -4]]
    assert said(replace(five, points=points), arm) == [("marker_names", "markers")]


def test_places_that_do_not_fit_a_single_pose_are_told(cell):
    recording, arm = cell
    one = recording.take(np.flatnonzero(recording.visit == recording.visit[0]))
    assert said(one, arm) == []
    wrong = renamed(one, {0: 3, 3: 0})
    assert said(wrong, arm) == [("marker_places", "markers")]


def test_a_mirrored_tracker_is_not_taken_for_swapped_markers():
    """In some postures the mirror image of a body's marks is another order of them."""
    rig = Rig(MODELS["kr10"])
    watched = Instruments(markers=Markers("all", placement=5e-4))
    plan = table_one_plan(poses=20, path=parse_path("0,10,0"))
    recording = record(rig, plan, watched, seed=5)
    mirrored = seen(np.diag([1, -1, 1]))(recording)
    assert said(mirrored, arm_of(MODELS["kr10"])) == [("mirrored", "tracker")]


@pytest.mark.parametrize("change", [lambda r: r, unplaced])
def test_markers_that_are_swapped_in_some_visits_are_named_with_their_poses(
    change, cell
):
    recording, arm = cell
    wrong = renamed(change(recording), {1: 3, 3: 1}, visits=[4, 9, 11])
    (warned,) = setup_errors(wrong, arm)
    assert warned.code == "marker_names"
    poses = np.unique(recording.posture_id[np.isin(recording.visit, [4, 9, 11])])
    assert f"in 3 of 20 visits (poses {', '.join(map(str, poses))})" in warned.text


def test_names_of_markers_whose_places_nobody_states_do_not_matter(cell):
    recording, arm = cell
    assert said(renamed(unplaced(recording), {0: 1, 1: 0}), arm) == []


def test_the_words_name_columns_rows_and_units(cell):
    recording, arm = cell

    def words(mistake: Mistake) -> str:
        return " ".join(w.text for w in setup_errors(mistake(recording), arm))

    assert "fy_n and fz_n, ty_nm and tz_nm look exchanged" in words(
        columns(0, 2, 1, 3, 5, 4)
    )
    assert "moments look given before the forces" in words(columns(3, 4, 5, 0, 1, 2))
    assert "fits the deflections of the row before" in words(rows(1))
    kilos = pulled(1 / 9.80665, 1 / 9.80665)
    assert "as if in kgf" in words(kilos)
    assert "looks given in kgf" in words(unhung(kilos))
    assert "Or the controller takes out 90% of the sag" in words(unhung(kilos))
    columns_of = [warned.text for warned, _ in of_columns(recording)]
    assert any(
        text.startswith("tx_nm looks reversed: turned about") for text in columns_of
    )


@pytest.mark.parametrize(
    ("body", "others"),
    [
        ("link_2", ["link_3"]),
        ("flange", ["base", "link_1", "link_2", "link_3"]),
    ],
)
def test_markers_on_another_body_than_is_said_are_named_with_their_own(
    body, others, tmp_path
):
    """As a mapping leaves them that gives all columns the same body."""
    recording, arm = recorded(tmp_path / "r", "kr10", "all", False)
    (told,) = setup_errors(on_body(body, *others)(recording), arm)
    assert (told.code, told.where) == ("marker_body", "markers")
    for own in others:
        names = [m.name for m in recording.markers if m.body == own]
        assert f"{', '.join(names)} to {own!r}" in told.text


def test_one_marker_on_another_body_than_is_said_is_named(tmp_path):
    recording, arm = recorded(tmp_path / "r", "kr10", "all", False)
    k = next(i for i, m in enumerate(recording.markers) if m.body == "link_2") + 1
    markers = list(recording.markers)
    markers[k] = replace(markers[k], body="flange", position=None)
    (told,) = setup_errors(replace(recording, markers=tuple(markers)), arm)
    assert (told.code, told.where) == ("marker_body", f"marker:{markers[k].name}")
    assert f"{markers[k].name} to 'link_2'" in told.text


COMPENSATOR = "gravity_compensator@a2,torque_nm=120,phase_rad=-2.4"
"""It turns its axis as gravity along another line would, and no other axis."""


def test_a_marker_on_another_body_is_named_where_a_soft_arm_sags(tmp_path):
    """Its sag is a millimetre, more than a well calibrated arm misses by."""
    main(Settings(tmp_path / "r", stiffness_scale=(0.5,), path="0", poses=40))
    recording, arm, _ = read_for(tmp_path / "r", arm_of(MODELS["kr10"]))
    flange = [k for k, m in enumerate(recording.markers) if m.body == "flange"]
    only = unplaced(recording.watching(flange))
    assert setup_errors(only, arm) == ()
    markers = (replace(only.markers[0], body="link_5"), *only.markers[1:])
    (told,) = setup_errors(replace(only, markers=markers), arm)
    assert (told.code, told.where) == ("marker_body", f"marker:{markers[0].name}")
    assert "to 'link_6'" in told.text or "to 'flange'" in told.text


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda p: p[:, [1, 2], 1], "link3_b_y_mm and link3_c_y_mm look exchanged"),
        (lambda p: p[:, 1, [1, 0]], "link3_b_x_mm and link3_b_y_mm look exchanged"),
        (lambda p: -p[:, 1, 1], "link3_b_y_mm looks as if it had the other sign"),
        (lambda p: p[:, 1, 1] * 25.4, "link3_b_y_mm looks as if taken for inches"),
        (lambda p: p[:, 1, 1] / 25.4, "link3_b_y_mm looks as if given in inches"),
        (lambda p: p[:, 2, 1], "link3_b_y_mm and link3_c_y_mm hold the same numbers"),
    ],
    ids=["exchanged", "own", "sign", "over", "inches", "twice"],
)
@pytest.mark.parametrize("change", [lambda r: r, unplaced])
def test_a_column_that_is_another_s_is_named_by_the_distances_within_its_body(
    wrong, words, change, tmp_path
):
    """Places that nobody stated would follow the mistake."""
    recording, arm = recorded(tmp_path / "r", "kr10", "all", False)
    names = [m.name for m in recording.markers]
    own = [names.index(f"link3_{letter}") for letter in "abcd"]
    whole = change(recording)
    points = whole.points.copy()
    column = wrong(points[:, own])
    if column.ndim == 1:
        points[:, own[1], 1] = column
    elif "link3_c" in words:
        points[:, own[2], 1], points[:, own[1], 1] = column.T
    else:
        points[:, own[1], 0], points[:, own[1], 1] = column.T
    (told,) = setup_errors(replace(whole, points=points), arm)
    assert told.code == "marker_columns"
    assert words in told.text


@pytest.mark.parametrize("effects", [(), (COMPENSATOR,)])
@pytest.mark.parametrize("degrees", [20.0, 90.0, 180.0])
def test_a_base_that_is_mounted_otherwise_is_told_by_where_gravity_pulls(
    degrees, effects, tmp_path
):
    recording, arm = recorded(tmp_path / "r", "kr10", "all", False, *effects)
    assert said(recording, arm) == []
    angle = np.radians(degrees)
    turned_down = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    other = replace(arm, chain=replace(arm.chain, gravity=turned_down))
    (told,) = setup_errors(recording, other)
    assert (told.code, told.where) == ("base_mounting", "base")
    assert f"{degrees:.0f}° from where the model has it" in told.text
    assert "(0.00, 0.00, -1.00) of the base" in told.text.replace("-0.00", "0.00")


@pytest.mark.parametrize(
    ("share", "change"),
    [(0.2, unhung), (0.8, unhung), (1.0 - 1.0 / 9.80665, lambda mistake: mistake)],
)
def test_a_controller_that_takes_out_sag_is_no_other_unit(share, change, tmp_path):
    """What 80 % leave is near a pound-force, but not within what postures allow.

    Nor is what leaves a kilogram-force, where as much hangs on the hook.
    """
    recording, arm = recorded(tmp_path / "r", "kr10", "flange", True)
    frame, standing = recording.base_from_tracker, arm.at(recording.posture)
    assert frame is not None and recording.points is not None
    turn = standing.gravity_torque(recording.tool) / arm.stiffness
    places = [(m.body, np.array(m.position)) for m in recording.markers]
    jacobians = [standing.jacobian(*place)[:, :3] for place in places]
    sag = np.stack([np.einsum("rij,rj->ri", j, turn) for j in jacobians], axis=1)
    points = recording.points - share * sag @ frame[:3, :3]
    assert said(change(lambda r: replace(r, points=points))(recording), arm) == []


def test_a_recording_whose_readings_have_a_spread_is_looked_at_as_any_other(cell):
    recording, arm = cell
    assert recording.points is not None
    spread = np.full(recording.points.shape, 2e-5)
    assert said(replace(recording, spread=spread), arm) == []
    turned = summed(2, a2=1.0)(recording)
    assert said(replace(turned, spread=spread), arm) == said(turned, arm) != []


def test_of_many_visits_some_are_looked_at_and_the_text_says_so(cell, monkeypatch):
    recording, arm = cell
    monkeypatch.setattr(check, "MANY", 10)
    wrong = renamed(recording, {1: 3, 3: 1}, visits=[4, 8, 12])
    (warned,) = setup_errors(wrong, arm)
    assert "in 3 of 10 visits looked at (poses" in warned.text
