"""Answers with thirty names, made by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure as Picture

from bench.shared.effect_catalogue import CATALOGUE
from scenarios.pipelines.diagnosis import Curves
from scenarios.pipelines.schema import (
    Answer,
    At,
    Called,
    Detected,
    Interval,
    Open,
    Proved,
    large_corrections,
    sizes_far_off,
    span,
)
from scenarios.report import error_budget, figures, page, playback, summary
from scenarios.report.error_budget import (
    HEAT,
    ErrorBudget,
    body_shades,
    budget_of,
    percent,
    shares_of_names,
)
from scenarios.report.page import Fold, Paragraph, Points, Table
from scenarios.report.sections import diagnosis
from stiffness.diagnosis.result import Detection, Diagnosis


def called(effect, where, share, **sizes):
    """A name; of each size the estimate, and a twentieth of it to both sides."""
    known = {k: Interval(v, 0.95 * v, 1.05 * v) for k, v in sizes.items()}
    return Called(effect, where, 1.0, (), known, budget_share=share)


AXES = range(1, 7)
NAMES = (
    *(called("hardening", f"a{k}", 0.03, stiffness_ratio=1.2 + k / 10) for k in AXES),
    *(called("hysteresis", f"a{k}", 0.05, width_rad=k * 2e-5) for k in AXES),
    *(called("creep", f"a{k}", 0.01, ratio=0.03, time_s=60.0) for k in AXES),
    *(called("bearing_tilt", f"a{k}", 0.004, u_rad_per_nm=1e-6) for k in (4, 5)),
    *(called("link_bending", f"link_{k}", 0.001, bending_nm2=4e5) for k in range(1, 6)),
    called("base_compliance", "base", 0.02, rx_rad_per_nm=5e-7),
    called("transmission_error", "a1", 0.002, amplitude_rad=1e-5, order=2.0),
    called("tracker_scale", "tracker", 0.001, ratio=1e-5),
    called("marker_slip", "marker:link3_a", 0.0004, x_m=1e-5),
    called("gravity_load", "link_3", 0.001, mass_kg=2.0),
)


@pytest.fixture
def answer():
    """Thirty names that explain 58 %, with something open at a2."""
    gain = Interval(0.04, 0.03, 0.05)
    proof = Proved("mujoco", 12, 0.05, 0.01, 0.005, gain)
    return Answer(
        schema=1,
        recording="by hand",
        verdict="partly_explained",
        detection=Detected(2e-4, 0.05, 0.005, None),
        located=(),
        explained_share=Interval(0.5774, 0.55, 0.6),
        named=NAMES,
        rivals=(),
        unexplained=None,
        confounded=(),
        warnings=(),
        proof_requested=True,
        proof=proof,
        next_experiments=(),
        seconds=8.0,
        unexplained_places=(Open("a2", 0.02, ("angle",), "odd in torque"),),
    )


# --- The budget -----------------------------------------------------------------------


def test_budget_adds_up_to_the_whole_mismatch(answer):
    budget = budget_of(answer)
    own = sum(budget.of_places.values())
    assert budget.unexplained == pytest.approx(0.4226)
    assert own + (budget.unexplained or 0.0) == pytest.approx(1.0)
    assert sum(budget.of_families.values()) == pytest.approx(own)
    assert budget.of["a4"] == pytest.approx({"gear": 0.09, "structure": 0.004})
    assert list(budget.of)[:3] == ["base", "a1", "link_1"]  # along the arm


def test_shares_follow_what_the_proof_explains(answer):
    half = Interval(0.2887, 0.27, 0.3)
    shares = shares_of_names(msgspec.structs.replace(answer, explained_share=half))
    assert shares[At("hysteresis", "a2")] == pytest.approx(0.025)


def test_pairs_that_readings_tell_apart_are_not_said_to_be_alike(answer):
    tilt, bend = At("bearing_tilt", "a4"), At("link_bending", "link_4")
    alike = msgspec.structs.replace(answer, confounded=((tilt, bend),))
    assert not [*summary.undecided(alike)]
    for change in ({"probability": 0.9}, {"equivalents": (bend,)}):
        names = [
            msgspec.structs.replace(n, **change)
            if n.effect in ("bearing_tilt", "link_bending") and n.where[-1] == "4"
            else n
            for n in NAMES
        ]
        open_ = msgspec.structs.replace(alike, named=tuple(names))
        assert [*summary.undecided(open_)] == [(tilt, bend)]


def test_geometry_beyond_what_arms_have_asks_for_the_model():
    """A link of another length stands as an error of a link, which says so."""
    longer = called("geometry_error", "link_2", 0.5, x_m=0.06, y_m=1e-4)
    unsure = {"z_m": Interval(0.03, -0.02, 0.08)}
    others = (
        called("geometry_error", "link_3", 0.1, x_m=2e-3),
        msgspec.structs.replace(longer, where="link_4", parameters=unsure),
        called("gravity_load", "link_3", 0.1, mass_kg=2.0),
        called("transmission_error", "a1", 0.1, amplitude_rad=1e-5, order=16.0),
    )
    (said,) = large_corrections((longer, *others))
    assert said.where == "link_2"
    assert "is x 60 mm (57 to 63):" in said.text
    assert "model of this arm" in said.text


def test_budget_without_a_proof_claims_nothing_of_what_is_open(answer):
    unproved = msgspec.structs.replace(answer, explained_share=None)
    assert budget_of(unproved).unexplained is None
    shares = shares_of_names(unproved)
    assert all(shares[At(n.effect, n.where)] == n.budget_share for n in NAMES)


def test_names_without_a_share_have_none_in_the_budget(answer):
    bare = tuple(
        msgspec.structs.replace(n, budget_share=msgspec.UNSET) for n in answer.named
    )
    budget = budget_of(msgspec.structs.replace(answer, named=bare))
    assert set(budget.of_places.values()) == {0.0}


@pytest.mark.parametrize(
    ("share", "said"),
    [
        (0.274, "27 %"),
        (0.0134, "1.3 %"),
        (2e-4, "< 0.1 %"),
        (0.0, "0 %"),
        (-0.012, "−1.2 %"),
    ],
)
def test_a_share_is_said_with_two_digits_at_most(share, said):
    assert percent(share) == said


# --- Sentences ------------------------------------------------------------------------


def test_thirty_names_are_a_line_for_each_effect_the_largest_first(answer):
    told = list(summary.grouped(answer, 6))
    assert len(NAMES) == 30
    assert len(told) == len({n.effect for n in NAMES}) == 10
    assert told[0] == "All six gears hold back wind-up: 20 to 120 µrad wide (30 %)."
    for line in (
        "All six gears harden: 1.30 to 1.80 times as stiff (18 %).",
        "All six gears creep under load: 3.00 % of wind-up (6.0 %).",
        "The bearings of a4 and a5 tilt: 1.00 µrad/(N m) (0.8 %).",
        "Links 1, 2, 3, 4 and 5 bend: 400 kN m² stiff (0.5 %).",
        "The gear of a1 errs with the angle: 19 to 21 µrad peak to peak (0.2 %).",
        "Link 3 weighs other than modelled: 1.90 to 2.10 kg (0.1 %).",
        "Mark link3_a moved on its body (< 0.1 %).",
    ):
        assert line in told


def test_the_sizes_of_one_name_are_said_as_far_as_their_intervals_go():
    sizes = {
        "u_rad_per_nm": Interval(4.00e-6, 3.8e-6, 4.2e-6),
        "v_rad_per_nm": Interval(4.01e-6, 3.2e-6, 4.7e-6),
    }
    one = msgspec.structs.replace(NAMES[0], effect="bearing_tilt", parameters=sizes)
    assert summary._magnitudes("bearing_tilt", [one]) == "3.2 to 4.7 µrad/(N m)"


def test_every_effect_has_plain_words():
    assert set(summary.PLAIN) == set(CATALOGUE)


def test_a_name_that_would_do_as_well_is_said(answer):
    first = msgspec.structs.replace(NAMES[0], equivalents=(At("lost_motion", "a1"),))
    story = summary.narrative(
        msgspec.structs.replace(answer, named=(first, *NAMES[1:]))
    )
    assert "As well by these data: lost_motion at a1 for hardening at a1." in story


def test_story_of_many_names_fits_a_screen_and_says_what_stays_open(answer):
    finding: Any = SimpleNamespace(
        answer=answer,
        proof=None,
        unproved="",
        diagnosis=SimpleNamespace(nominal=None),
        recording=SimpleNamespace(posture=np.zeros((1, 6))),
    )
    told = list(summary.headlines(finding))
    assert len(told) <= 15
    assert told[-1] == (
        "Something without a name is left at a2 (2.0 %; angle; odd in torque)."
    )
    assert [line for line in told if line.startswith("What: ")] == [told[1]]


def test_numbers_are_rounded_to_their_intervals_and_waves_are_peak_to_peak():
    assert span("ratio", Interval(1.23456, 1.13, 1.34)) == "1.23 (1.13 to 1.34)"
    assert span("torque_nm", Interval(31.64, 24.1, 39.2)) == "32 N m (24 to 39)"
    wave = Interval(1e-5, 0.9e-5, 1.1e-5)
    assert span("amplitude_rad", wave) == "20 µrad (18 to 22)"


# --- Figures --------------------------------------------------------------------------


@pytest.fixture
def view():
    """Six axes up a mast, one triangle at each link."""
    axes = np.array([[0.1 * k, 0.0, 0.2 * k] for k in AXES])
    triangle = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0, 0.1]])
    return error_budget.ArmView(
        np.stack([triangle + at for at in axes]),
        tuple(f"link_{k}" for k in AXES),
        axes,
        np.zeros(3),
        axes[-1] + [0.1, 0.0, 0.0],
    )


def words_of(figure: Picture) -> str:
    return "\n".join(t.get_text() for ax in figure.axes for t in ax.texts)


def test_arm_is_drawn_with_every_place_its_share_and_what_is_beside_it(answer, view):
    budget = budget_of(answer)
    figure = error_budget.of_arm(view, budget, None, "")
    said = words_of(figure)
    for where, share in budget.of_places.items():
        if where in ("tracker", "marker:link3_a"):
            assert where in said[said.index("Beside the arm") :]
        else:
            assert f"{where}  {percent(share)}" in said
    assert "a2  9.0 %, 2.0 % open" in said
    (drawn,) = [c for c in figure.axes[0].collections if isinstance(c, PolyCollection)]
    assert len(drawn.get_paths()) == len(view.triangles)


def test_the_larger_a_share_the_darker_its_place(answer):
    budget = budget_of(answer)
    bright = {w: sum(rgb) for w, rgb in error_budget.shades(budget).items()}
    assert min(bright, key=lambda w: bright[w]) == max(
        budget.totals, key=lambda w: budget.totals[w]
    )
    assert bright["a2"] < bright["a4"] < bright["base"] < bright["link_1"]


def test_places_without_a_name_add_up_to_no_more_than_names_leave_open(answer):
    places = (Open("a2", 0.6, ("angle",), ""), Open("a7", 0.2, ("load",), ""))
    more = msgspec.structs.replace(answer, unexplained_places=places)
    shares = {p.where: p.share for p in error_budget.open_places(more)}
    assert shares == pytest.approx({"a2": 0.4226 * 0.75, "a7": 0.4226 * 0.25})
    assert budget_of(more).totals["a7"] == pytest.approx(0.4226 * 0.25)
    assert error_budget.open_places(answer) == answer.unexplained_places


def test_a_model_without_visible_shapes_is_drawn_as_a_line(answer, view):
    bare = replace(view, triangles=np.zeros((0, 3, 3)), body=())
    figure = error_budget.of_arm(bare, budget_of(answer), None, "")
    assert "a1  " in words_of(figure)


def test_no_cloud_is_drawn_where_a_turn_is_mostly_noise():
    chance = np.random.default_rng(1).normal(0.0, 1e-5, (200, 2))
    torque = np.linspace(-1.0, 1.0, 200)[:, None] * np.ones(2)
    measured = chance + torque * [0.0, 1e-4]
    curves = Curves(
        *(("a1", "a2"), torque, measured, 0.0 * chance, np.zeros(200, bool)),
        *(np.zeros(200, int), (False, False), np.full(2, 1e-5), torque),
    )
    assert curves.visible == (False, True)
    figure = figures.of_axes(curves, frozenset(("a1", "a2")))
    assert [len(ax.lines) for ax in figure.axes] == [2]
    assert "a1 (± 10 µrad)" in figure.get_supxlabel()


def test_marks_stand_on_the_line_where_the_patch_does_what_was_measured(monkeypatch):
    """Two marks, one of them unseen in the last row; noise lies across the patch."""
    patch = np.array([[3.0, 0, 0, 4.0, 0, 0], [0, 2.0, 0, 0, 0, 0]]) * 1e-6
    across = np.array([[0, 9.0, 0, 0, 9.0, 0], [5.0, 0, 0, np.nan, 0, 0]]) * 1e-6
    across[1, 3:] = np.nan
    left = {"nominal": patch + across, "patched": across}
    simulation = SimpleNamespace(
        recording=SimpleNamespace(markers=(1, 2)), see=lambda which: which
    )
    mode = SimpleNamespace(keep=np.array([True, False]))
    proof: Any = SimpleNamespace(
        simulation=simulation, mode=mode, nominal="nominal", patched="patched", folds=1
    )
    monkeypatch.setattr(figures, "residual_of", lambda _, which, mode: left[which])
    (axes,) = figures.of_marks(proof).axes
    points = np.concatenate([line.get_xydata() for line in axes.lines[1:]])
    np.testing.assert_allclose(points[:, 0], [5.0 / np.sqrt(2.0), 2.0])
    np.testing.assert_allclose(points[:, 1], points[:, 0])


def test_a_law_is_drawn_over_what_it_depends_on_and_its_split_and_mean_are_said():
    angle = np.linspace(-1.0, 1.0, 30)[:, None]
    wave, row = 1e-4 * np.sin(3.0 * angle), np.arange(30)
    curves = Curves(
        *(("a1",), 0.0 * angle, wave, wave, row < 6, row // 3, (False,)),
        *(np.full(1, 1e-6), angle, False, 5),
    )
    left, right = figures.of_law(curves, "a1", over="angle").axes
    assert left.get_xlabel() == "angle [°]"
    assert right.get_title(loc="left") == "all rows, each visit's mean taken off"
    legend = right.get_legend()
    assert legend is not None
    assert [t.get_text() for t in legend.get_texts()] == [
        "fitted poses, first of 5 fits",
        "poses kept back, first of 5 fits",
    ]
    right = figures.of_law(replace(curves, absolute=True, folds=1), "a1").axes[1]
    assert right.get_title(loc="left") == "all rows"


# --- The page -------------------------------------------------------------------------


def test_folds_hold_what_is_read_on_demand(tmp_path):
    inner = Table("Sizes.", ("a", "b"), [("x", "1")])
    fold = Fold("a1: <harden>", [inner, Fold("deeper", [Paragraph("last")])])
    page.write(tmp_path, "t", "s", [Points(["one", "two <b>"]), fold])
    text = (tmp_path / "report.html").read_text("utf-8")
    assert text.count("<details>") == text.count("</details>") == 2
    assert "<summary>a1: &lt;harden&gt;</summary>" in text
    assert "<li>one</li><li>two &lt;b&gt;</li>" in text
    start, end = text.index("<details>"), text.rindex("</details>")
    assert start < text.index("Sizes.") < text.index("last") < end
    markdown = (tmp_path / "report.md").read_text("utf-8")
    assert "| x | 1 |" in markdown and "- one\n- two &lt;b&gt;" in markdown


def test_report_of_thirty_names_opens_with_lines_and_folds_the_rest(answer, tmp_path):
    finding: Any = SimpleNamespace(
        answer=answer,
        proof=None,
        simulated=None,
        unproved="it was not asked for.",
        replicates=None,
        diagnosis=Diagnosis(
            "by hand", "partly_explained", Detection(2e-4, 1e-5, 1e-6, 1e-6)
        ),
        recording=SimpleNamespace(
            posture=np.zeros((4, 6)),
            posture_id=np.arange(4),
            time=np.zeros(4),
            tracker=None,
            markers=(),
        ),
    )
    blocks = diagnosis.blocks_of(finding, tmp_path)
    open_ = [b for b in blocks if not isinstance(b, Fold)]
    assert not any(isinstance(b, Table) for b in open_)
    folds = [b.text for b in blocks if isinstance(b, Fold)]
    assert "a2: hardening, hysteresis, creep (9.0 %)" in folds
    assert "Error budget" in folds
    page.write(tmp_path, "t", "s", blocks)
    assert "1.40 (1.33 to 1.47)" in (tmp_path / "report.html").read_text("utf-8")


# --- The playback ---------------------------------------------------------------------


def test_all_that_is_shown_is_within_the_field_of_view():
    points = np.random.default_rng(2).uniform(-1.0, 2.0, (500, 3)) * [1.0, 0.3, 2.0]
    eye, centre = playback.eye_on(points)
    ahead = (centre - eye) / np.linalg.norm(centre - eye)
    ray = (points - eye) / np.linalg.norm(points - eye, axis=1)[:, None]
    angle = np.arccos(np.clip(ray @ ahead, -1.0, 1.0))
    assert angle.max() <= playback.FIELD / 2.0 + 1e-9


def test_a_wrist_axis_that_goes_against_the_rest_has_a_colour():
    """No link of its number need be among the places."""
    of = {"a2": {"gears": 0.9}, "a6": {"gears": -0.002}, "link_2": {"links": 0.1}}
    found = body_shades(ErrorBudget(of, None, {}))
    assert found["link_6"] == HEAT(-0.002 / 0.9)[:3]
    assert found["link_2"] == HEAT(1.0)[:3]


def test_sizes_of_a_patch_far_from_their_intervals_are_said():
    """A tilt took what has no name; the width is beside its interval, and a little."""
    tilt = called("bearing_tilt", "a6", 0.1, u_rad_per_nm=7e-6, v_rad_per_nm=2e-6)
    gear = called("hysteresis", "a2", 0.1, width_rad=1e-4)
    sizes = {
        ("bearing_tilt", "a6"): {"u_rad_per_nm": 2.07e-5, "v_rad_per_nm": 2e-6},
        ("hysteresis", "a2"): {"width_rad": 1.06e-4},
    }
    (far,) = sizes_far_off((tilt, gear), sizes)
    assert far.startswith("bearing_tilt at a6 u 20.70 µrad/(N m)")
    assert sizes_far_off((tilt, gear), {}) == []
