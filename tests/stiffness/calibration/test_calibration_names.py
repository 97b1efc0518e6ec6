from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_calibration import NOISE, PLACE, UR10, recorded

from bench import patch
from bench.effects.effect import Command
from bench.effects.reading_lag import ReadingLag
from bench.patch import PatchEffect
from bench.rig import Rig
from bench.shared.recording import DrawingAccuracy, Marker, Recording
from bench.shared.settings import Interval
from scenarios.pipelines.calibration import calibrate_and_prove, not_seen_text
from scenarios.pipelines.calibration_proof import rms
from scenarios.pipelines.inputs import arm_of
from scenarios.report.sections.calibration import write_files
from stiffness.calibration import model
from stiffness.calibration.model import CalibrationState, entries_of, readings_of
from stiffness.calibration.result import (
    calibrated,
    held_by_friction,
    is_told,
    mean_lag,
)
from stiffness.calibration.rigid_fit import fitted, not_seen
from stiffness.calibration.selection import spatial_folds_of
from stiffness.experiment.visits import commanded_lags

LINKS = (
    ("link_1", {"x_m": 3e-4, "rx_rad": -6e-4}),
    ("link_2", {"x_m": -4e-4, "rx_rad": 5e-4}),
    ("link_3", {"x_m": 2e-4, "rx_rad": 4e-4}),
    ("link_4", {"y_m": -3e-4, "rx_rad": 6e-4}),
)
GEOMETRY = tuple(
    PatchEffect("geometry_error", where, dict(own)) for where, own in LINKS
)
SOFT = {"compliance_rad_per_nm": 2e-5}


@pytest.fixture(scope="module")
def wrist(tmp_path_factory) -> Path:
    """Six axes, the fourth one's origin on the third one's axis; no springs."""
    place = (
        ((0, 0, 0.4), "0 0 1", 30, (0, 0.02, -0.1)),
        ((0.05, 0, 0.1), "0 1 0", 25, (0, 0, 0.25)),
        ((0, 0, 0.5), "0 1 0", 3, (0, 0, 0.02)),
        ((0, 0, 0), "0 0 1", 12, (0, 0.01, 0.25)),
        ((0, 0, 0.45), "0 1 0", 3, (0, 0, 0.03)),
        ((0, 0, 0.09), "0 0 1", 1, (0, 0, 0.02)),
    )
    inertial = '<inertial mass="{}" pos="{} {} {}" diaginertia="0.1 0.1 0.1"/>'
    text = '<body name="flange" pos="0 0 0.05"/>'
    for k in range(6, 0, -1):
        at, axis, mass, centre = place[k - 1]
        text = (
            f'<body name="link_{k}" pos="{at[0]} {at[1]} {at[2]}">'
            f'{inertial.format(mass, *centre)}<joint name="a{k}" axis="{axis}"/>'
            f"{text}</body>"
        )
    base = inertial.format(40, 0, 0, 0.1)
    file = tmp_path_factory.mktemp("wrist") / "wrist.xml"
    file.write_text(
        f'<mujoco><worldbody><body name="base">{base}{text}</body></worldbody></mujoco>'
    )
    return file


@pytest.fixture(scope="module")
def soft(wrist):
    effects = [PatchEffect("joint_compliance", a, dict(SOFT)) for a in ("a2", "a3")]
    recording = recorded(wrist, effects, 150, 8)
    return calibrate_and_prove(recording, arm_of(wrist), wrist)


@pytest.fixture(scope="module")
def crooked():
    """An arm whose links are all a little wrong, and nothing else."""
    recording = recorded(UR10, GEOMETRY, 120, 9)
    return calibrate_and_prove(recording, arm_of(UR10), UR10)


def longer(factor: float) -> Recording:
    """An arm as drawn, by a tracker that reads all lengths too long."""
    plain = recorded(UR10, (), 150, 11)
    return replace(plain, points=factor * np.asarray(plain.points))


def test_an_arm_that_is_only_drawn_wrongly_is_no_agreement(crooked):
    answer = crooked.answer
    assert answer.verdict != "no_mismatch"
    assert answer.detection.p_value < 0.005
    assert answer.proof.gain_mm.low > 0.0
    named = {(n.effect, n.where) for n in answer.named}
    assert named >= {("geometry_error", "link_2"), ("geometry_error", "link_3")}
    assert {e for e, _ in named} <= {"geometry_error", "encoder_offset"}


def test_numbers_of_the_drawing_that_are_right_stay_as_drawn(soft):
    """What a soft joint does is no geometry, though geometry came first to mind."""
    assert not soft.found.corrected_geometry.values.any()
    assert {(n.effect, n.where) for n in soft.answer.named} == {
        ("joint_compliance", "a2"), ("joint_compliance", "a3"),
    }  # fmt: skip


def test_of_two_names_that_do_the_same_the_common_one_comes_first(soft):
    (a3,) = [n for n in soft.answer.named if n.where == "a3"]
    assert ("bearing_tilt", "a4") in {(e.effect, e.where) for e in a3.equivalents}


def test_every_name_has_a_number_that_is_clearly_not_zero(soft, crooked):
    for outcome in (soft, crooked):
        for called in outcome.answer.named:
            sizes = [p for p in called.parameters.values() if p.low is not None]
            assert any(p.low > 0.0 or p.high < 0.0 for p in sizes), called
            assert all(p.low <= p.estimate <= p.high for p in sizes), called


NARROW = tuple(
    PatchEffect(
        "transmission_error",
        f"a{k}",
        {"amplitude_rad": 1e-4, "order": 31.0, "phase_rad": 0.4 * k},
    )
    for k in range(1, 7)
)
"""Waves too short for so few poses: what an arm does beside every law fitted."""


SHORTER = PatchEffect("geometry_error", "link_2", {"x_m": -2e-3})


def narrow(seed: int) -> Recording:
    """Parallel axes a2 to a4 that hardly move, a target 3 mm beside the last one."""
    beside, effects = np.array([0.003, 0.001, 0.05]), (SHORTER, *NARROW)
    return recorded(UR10, effects, 60, seed, place=beside, reach=0.2)


@pytest.mark.parametrize("seed", [3, 5])
def test_what_a_recording_hardly_shows_stays_at_the_drawing(seed):
    """Without sizes of the drawing zeros come out 8 and 23 mrad off; all are right."""
    readings = readings_of(narrow(seed), arm_of(UR10))
    rigid = fitted(readings, redraw=True).geometry
    found = calibrated(readings, spatial_folds_of(readings))
    assert np.abs(rigid.values).max() < 5e-3
    assert np.abs(found.corrected_geometry.values).max() < 5e-3
    assert "encoder_offset" not in {effect for effect, _ in found.named}


def test_numbers_that_the_postures_do_not_show_are_said_to_be_unseen(crooked):
    readings = readings_of(narrow(3), arm_of(UR10))
    unseen = not_seen(readings, fitted(readings, redraw=True))
    assert [(e.where, e.parameter) for e in unseen] == [("link_5", "rx_rad")]
    chosen = replace(crooked.found.selected, not_seen=unseen)
    text = not_seen_text(replace(crooked.found, selected=chosen))
    assert text.endswith("left as drawn: geometry_error at link_5 (rx).")
    assert not_seen_text(crooked.found) == ""
    assert crooked.answer.warnings == ()


SIZES = {"offset_rad": 3.5e-3, "x_m": 1e-3, "y_m": 1e-3, "z_m": 1e-3} | dict.fromkeys(
    ("rx_rad", "ry_rad", "rz_rad"), 1.75e-3
)
"""One sigma of each number of a drawing, as taken where nothing is stated."""


@pytest.mark.parametrize("seed", [1, 3])
def test_intervals_hold_what_numbers_that_were_not_chosen_may_be_off_by(seed):
    """A third of the drawing is wrong; else 4 of 11 and 4 of 7 intervals miss it."""
    arm, random = arm_of(UR10), np.random.default_rng(seed)
    entries = entries_of(arm.chain)
    wrong = {e: random.normal(0.0, SIZES[e.parameter]) for e in entries
             if random.uniform() < 0.3}  # fmt: skip
    effects = [PatchEffect(e.effect, e.where, {e.parameter: v})
               for e, v in wrong.items()]  # fmt: skip
    readings = readings_of(
        recorded(UR10, (*effects, *NARROW), 60, seed, reach=0.3), arm
    )
    found = calibrated(readings, spatial_folds_of(readings))
    truth = as_kept(readings, np.array([wrong.get(e, 0.0) for e in entries]))
    missed = [
        entry
        for entry, value in zip(entries, truth, strict=True)
        for i in [found.estimates.get((entry.effect, entry.where), {})]
        if entry.parameter in i
        if not i[entry.parameter].low <= value <= i[entry.parameter].high
    ]
    assert not missed
    names = {k for k in found.named if k[0] in ("geometry_error", "encoder_offset")}
    true = {(e.effect, e.where) for e, v in zip(entries, truth, strict=True) if v}
    assert names <= true


def as_kept(readings, values):
    """Return a drawing's errors as those of the columns that a fit keeps."""
    fit = fitted(readings, redraw=True)
    start = replace(fit.geometry, values=np.zeros(len(values)))
    a = CalibrationState.of(readings, start).nuisance_jacobian()
    a = a.reshape(-1, len(fit.kept))
    lost = np.flatnonzero(~fit.kept[: len(values)])
    moved = a[:, lost] @ values[lost]
    found = np.append(values, np.zeros(len(fit.kept) - len(values)))
    found[lost] = 0.0
    found[fit.kept] += np.linalg.lstsq(a[:, fit.kept], moved, rcond=None)[0]
    return found[: len(values)]


def test_a_drawing_that_is_far_off_is_corrected_where_the_data_insist():
    wrong = PatchEffect("encoder_offset", "a3", {"offset_rad": 0.03})
    readings = readings_of(recorded(UR10, (wrong,), 60, 5), arm_of(UR10))
    values = fitted(readings, redraw=True).geometry.values
    assert values[2] == pytest.approx(0.03, abs=1e-4)
    assert np.abs(np.delete(values, 2)).max() < 3e-4


def test_a_drawing_stated_to_be_true_is_believed():
    exact = DrawingAccuracy(length=1e-9, angle=1e-9, offset=1e-9)
    readings = readings_of(replace(narrow(3), drawing=exact), arm_of(UR10))
    assert np.abs(fitted(readings, redraw=True).geometry.values).max() < 1e-8


def test_a_tracker_is_not_off_by_more_than_any_tracker_is():
    """Everything 2 per mille longer is an arm that was drawn too short."""
    outcome = calibrate_and_prove(longer(1.002), arm_of(UR10), UR10)
    names = {(n.effect, n.where) for n in outcome.answer.named}
    assert "tracker_scale" not in {effect for effect, _ in names}
    assert ("geometry_error", "link_2") in names


def test_a_tracker_s_scale_is_said_to_be_as_well_the_links_lengths():
    outcome = calibrate_and_prove(longer(1.0002), arm_of(UR10), UR10)
    for called in outcome.answer.named:
        if called.effect == "tracker_scale":
            assert "geometry_error" in {e.effect for e in called.equivalents}
    assert {n.effect for n in outcome.answer.named} <= {
        *("tracker_scale", "geometry_error", "encoder_offset"),
    }
    assert outcome.answer.named


def test_what_shows_of_the_drawing_does_not_hang_on_a_place_being_stated():
    """At the flange's centre a target would not see the last axis turn."""
    recording = recorded(UR10, (), 60, 6)
    stated = replace(recording, markers=(Marker("target", "flange", PLACE),))
    arm = arm_of(UR10)
    count = len(model.entries_of(arm.chain))
    kept = [
        fitted(readings_of(r, arm), redraw=True).kept[:count]
        for r in (recording, stated)
    ]
    np.testing.assert_array_equal(kept[0], kept[1])


def test_springs_that_the_model_has_are_fitted_for_both_sides_of_the_proof(kr10):
    """Twice as soft as stated is nominal: neither side may miss by it."""
    softer = arm_of(kr10).stiffness / 2.0
    wanted = {f"a{k + 1}": float(s) for k, s in enumerate(softer)}
    recording = recorded(kr10, (), 120, 12, springs=wanted)
    outcome = calibrate_and_prove(recording, arm_of(kr10), kr10)
    assert outcome.answer.verdict == "no_mismatch"
    assert rms(outcome.proof.before) < 1.3 * NOISE * np.sqrt(3.0)


def test_a_link_that_grows_while_it_warms_is_left_open_with_its_place():
    """Nothing in the vocabulary does that; a place and a look can be said."""
    quiet = recorded(UR10, (), 160, 13)
    longer_arm = [PatchEffect("geometry_error", "link_2", {"x_m": 1e-3})]
    warm = recorded(UR10, longer_arm, 160, 13)
    share = 1.0 - np.exp(-quiet.time / 1500.0)[:, None, None]
    first, last = np.asarray(quiet.points), np.asarray(warm.points)
    seen = replace(quiet, points=first + share * (last - first))
    answer = calibrate_and_prove(seen, arm_of(UR10), UR10).answer
    assert answer.verdict in ("unexplained", "partly_explained")
    assert answer.unexplained is not None
    assert answer.unexplained.where == "link_2"
    assert "grows with time" in answer.unexplained.signature


def test_the_patched_simulator_is_written_and_can_be_loaded(soft, wrist, tmp_path):
    write_files(tmp_path / "out", soft)
    assert (tmp_path / "out" / patch.MODEL_FILE).exists()
    rig = patch.rig_of(patch.read(tmp_path / "out" / patch.FILE))
    assert {e.where for e in rig.effects if e.name == "joint_compliance"} >= {
        "a2",
        "a3",
    }


# --- Angles that were read before the axis rested -------------------------------------

LAG = 4e-4
LAGS = [PatchEffect("reading_lag", a, {"lag_rad": s * LAG}) for a, s in
        (("a2", 1.0), ("a3", -1.0))]  # fmt: skip


@pytest.fixture(scope="module")
def early() -> Recording:
    """An arm that is read before it rests: a2 has still to go, a3 swings back."""
    return recorded(UR10, LAGS, 100, 12)


@pytest.fixture(scope="module")
def late(early):
    return calibrate_and_prove(early, arm_of(UR10), UR10)


def test_lag_of_a_reported_angle_is_named_with_its_sign_and_proved(late):
    (a2,) = [n for n in late.answer.named if n.where == "a2"]
    assert a2.effect == "reading_lag"
    friction = {("hysteresis", "a2"), ("lost_motion", "a2")}
    assert friction <= {(e.effect, e.where) for e in a2.equivalents}
    lag = a2.parameters["lag_rad"]
    assert 0.0 < lag.low <= LAG <= lag.high < 1.5 * LAG
    assert late.answer.proof.after_rms_mm < 1.2 * late.answer.detection.noise_rms_mm
    assert ("reading_lag", "a2") in {(e.effect, e.where) for e in late.patch.effects}
    named = {(n.effect, n.where) for n in late.answer.named}
    assert not named & {(r.effect, r.where) for r in late.answer.refused}


@pytest.mark.parametrize("lag", [LAG, -LAG])
def test_lag_by_an_axis_share_of_the_move_is_told_from_a_constant_one(lag):
    """What goes with the speed of arrival is the report's, whatever its sign."""
    by_share = [PatchEffect("reading_lag", "a2", {"share_lag_rad": lag})]
    found = calibrate_and_prove(recorded(UR10, by_share, 100, 12), arm_of(UR10), UR10)
    (a2,) = [n for n in found.answer.named if n.where == "a2"]
    assert a2.effect == "reading_lag"
    assert set(a2.parameters) == {"share_lag_rad"}
    size = a2.parameters["share_lag_rad"]
    assert size.low <= lag <= size.high
    assert np.prod(np.array([size.low, size.high], dtype=float)) > 0.0
    assert rms(found.proof.after) < 1.2 * NOISE * np.sqrt(3.0)


def test_report_that_leads_looks_like_friction_and_both_are_said(late):
    (a3,) = [n for n in late.answer.named if n.where == "a3"]
    assert a3.effect == "hysteresis"
    assert ("reading_lag", "a3") in {(e.effect, e.where) for e in a3.equivalents}
    assert a3.parameters["width_rad"].low <= 2 * LAG <= a3.parameters["width_rad"].high


def test_commanded_angles_tell_a_report_that_leads_from_friction(early, late):
    sizes = np.array([0.0, LAG, -LAG, 0.0, 0.0, 0.0])
    told = replace(early, commanded=early.posture + sizes * early.side)
    lags = commanded_lags(told)[:, 0]
    np.testing.assert_allclose(lags, sizes, atol=1e-12)
    (key,) = [k for k in late.found.estimates if k == ("hysteresis", "a3")]
    wide = late.found.estimates[key]["width_rad"]
    lag = {"lag_rad": Interval(-wide.estimate / 2, -wide.high / 2, -wide.low / 2)}
    lag_key = ("reading_lag", "a3")
    assert held_by_friction({lag_key: lag}, np.full(6, np.nan)) == {lag_key: key}
    assert held_by_friction({lag_key: lag}, 0.2 * lags) == {lag_key: key}
    assert held_by_friction({lag_key: lag}, lags) == {}
    assert [is_told(LAG, told) for told in (LAG, 0.2 * LAG, -LAG, np.nan)] == [
        True, False, False, False,
    ]  # fmt: skip


@pytest.mark.parametrize("law", ["lag_rad", "share_lag_rad"])
@pytest.mark.parametrize("lag", [LAG, -LAG])
def test_mean_lag_has_the_sign_of_what_commands_show_of_the_same_lag(early, law, lag):
    """Commands lead the report by all that the arm has still to go."""
    made = ReadingLag("a2", **{"lag_rad": 0.0, law: lag})
    nominal = Command(early.posture, np.ones_like(early.posture), early.moves)
    ahead = made.command(early.posture, nominal, Rig(UR10).anatomy).reference
    told = replace(early, last_move=early.moves, commanded=early.posture + ahead)
    mean = mean_lag({law: Interval(lag, lag, lag)}, readings_of(told, arm_of(UR10)), 1)
    assert mean * lag > 0.0
    assert mean == pytest.approx(commanded_lags(told)[1, 0], rel=0.05)
    assert is_told(mean, commanded_lags(told)[1, 0])
