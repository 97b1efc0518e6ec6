import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from msgspec import structs
from saved_view import entities, viewer_into
from scipy.spatial.transform import Rotation
from torso import TORSO, alone, drawn_postures

from bench.effects.bearing_tilt import BearingTilt
from bench.effects.lost_motion import LostMotion
from bench.patch import Mounted, Patch, PatchEffect, rig_of
from bench.proof.setup import point_in_base
from bench.rig import RIGID, Rig
from bench.shared.errors import Unusable
from bench.shared.recording import (
    UNLOADED,
    DrawingAccuracy,
    LastMoves,
    Marker,
    Payload,
    Recording,
    TrackerSpec,
)
from scenarios.pipelines.calibration import (
    NOT_PROVED,
    answer_of,
    calibrate_and_prove,
    first_sentence,
    names_told,
)
from scenarios.pipelines.inputs import arm_of
from scenarios.report.data_files import DECISIONS, read_table, write_decisions
from scenarios.report.sections.calibration import figure, show, write_files
from scenarios.studies import public_recordings
from stiffness.calibration import model as geometry
from stiffness.calibration import result
from stiffness.calibration.columns import candidates_of
from stiffness.calibration.model import CalibrationState, readings_of
from stiffness.calibration.result import outlier_distances
from stiffness.calibration.rigid_fit import fitted, rigid_outlier_distances
from stiffness.calibration.selection import spatial_folds_of

ROOT = Path(__file__).resolve().parents[3]
UR10 = ROOT / "mjcf" / "ur10" / "ur10.xml"
KR10 = ROOT / "mjcf" / "kr10_r1100_2" / "kr10_r1100_2.xml"
PLACE = np.array([0.03, -0.06, 0.1])
ON_AXIS = np.array([0.0, 0.0, 0.1])
ARM = 0.05
"""Of a 6D target's points, in m: 0.2 mrad are then one sigma of orientation."""
NOISE = 1e-5
TABLE = "transmission_error"
OFFSET, SHORT, COMPLIANCE = 6e-4, -4e-4, 2e-5
WAVES = ((7.0, 2e-4, 0.4), (16.0, 1.2e-4, -1.0))
TRUTH = (
    PatchEffect("encoder_offset", "a3", {"offset_rad": OFFSET}),
    PatchEffect("geometry_error", "link_2", {"x_m": SHORT}),
    PatchEffect("joint_compliance", "a2", {"compliance_rad_per_nm": COMPLIANCE}),
    *(
        PatchEffect(
            "transmission_error",
            "a2",
            {"amplitude_rad": size, "order": order, "phase_rad": phase},
        )
        for order, size, phase in WAVES
    ),
)


def recorded(
    model: Path,
    effects,
    poses: int,
    seed: int,
    springs: dict | None = None,
    tool: Payload | None = None,
    *,
    place: np.ndarray = PLACE,
    reach: float = 1.0,
    axes: np.ndarray | None = None,
) -> Recording:
    """A target on the flange, seen where MuJoCo says it is.

    With axes it is in 6D.
    """
    held = Mounted(mass_kg=tool.mass, com_m=tuple(tool.com)) if tool else Mounted()
    rig = rig_of(Patch(dict(springs or {}), tuple(effects), mounted=held), model)
    random = np.random.default_rng(seed)
    middle = np.array([0.0, -1.4, 1.2, 0.3, 0.8, 0.0])
    span = reach * np.array([2, 0.8, 0.8, 1, 1, 2])
    posture = middle + random.uniform(-1.0, 1.0, (poses, 6)) * span
    still = np.zeros((poses, 1, 6))
    states = rig.respond(posture, still, np.full((poses, 1), 1e-3))
    point = states.point(rig.anatomy.flange, place)
    point = point[:, None] + random.normal(0.0, NOISE, (poses, 1, 3))
    markers: tuple[Marker, ...] = (Marker("target", "flange"),)
    if axes is not None:
        body = states.rotation[:, states.bodies.index(rig.anatomy.flange)]
        error = Rotation.from_rotvec(random.normal(0.0, NOISE / ARM, (poses, 3)))
        ends = np.vstack([np.zeros(3), ARM * np.eye(3)]) @ axes.T
        point = point + ends @ (error.as_matrix() @ body).swapaxes(1, 2)
        markers = tuple(Marker(f"target_{e}", "flange", target="t") for e in "oxyz")
    when = 30.0 * np.arange(poses)
    return Recording(
        name="an arm under its own weight",
        time=when,
        posture_id=np.arange(poses),
        visit=np.arange(poses),
        posture=posture,
        load_time=when,
        stage=np.full(poses, UNLOADED),
        markers=markers,
        points=point,
        tracker=TrackerSpec(np.full(3, NOISE)),
        tool=tool,
    )


@pytest.fixture(scope="module")
def recording() -> Recording:
    return recorded(UR10, TRUTH, 240, 3)


@pytest.fixture(scope="module")
def outcome(recording):
    return calibrate_and_prove(recording, arm_of(UR10), UR10)


def test_what_was_left_out_is_named_and_nothing_else_of_its_size(outcome):
    names = {(n.effect, n.where) for n in outcome.answer.named}
    assert names >= {("transmission_error", "a2"), ("joint_compliance", "a2")}
    assert {effect for effect, _ in names} <= {
        *("transmission_error", "joint_compliance"),
        *("encoder_offset", "geometry_error"),
    }


def test_true_sizes_lie_within_a_little_more_than_their_intervals(outcome):
    found = outcome.found.estimates
    for value, key, name in (
        (OFFSET, ("encoder_offset", "a3"), "offset_rad"),
        (SHORT, ("geometry_error", "link_2"), "x_m"),
        (COMPLIANCE, ("joint_compliance", "a2"), "compliance_rad_per_nm"),
    ):
        e = found[key][name]
        half = (e.high - e.low) / 2
        assert abs(e.estimate - value) < 2 * half, (key, e)
        assert half < 0.2 * abs(value), (key, e)


def test_the_table_of_a_gear_is_its_law_at_the_angles_that_were_fitted(outcome):
    """Up to a line, which an offset and the next waves of the arm share with it."""
    angle = np.linspace(-2.1, -0.7, 200)
    true = sum(size * np.sin(order * angle + phase) for order, size, phase in WAVES)
    apart = outcome.found.error_tables["a2"].at(angle) - true
    line = np.polynomial.Polynomial.fit(angle, apart, 1)
    assert np.std(apart - line(angle)) < 0.1 * np.std(true)


def test_the_simulator_comes_down_to_the_noise_on_poses_kept_back(outcome):
    proof = outcome.answer.proof
    noise_mm = 1e3 * NOISE * np.sqrt(3.0)
    assert proof.before_rms_mm > 10 * noise_mm
    assert proof.after_rms_mm < 1.5 * noise_mm
    assert proof.gain_mm.low > 0.0


def test_what_is_left_is_told_in_micrometres_as_elsewhere(outcome):
    said = first_sentence(outcome.answer, outcome.proof)
    assert f"to {1e3 * outcome.answer.proof.after_rms_mm:.1f} µm rms (gain" in said
    assert " mm" not in said + outcome.residual.signature


def test_nothing_kept_back_is_fitted_or_shares_a_region_with_what_is(outcome):
    regions = outcome.found.spatial_folds
    held = set(regions.region[regions.kept_back])
    assert held == set(regions.held)
    assert not held & set(regions.region[~regions.kept_back])
    assert 0.15 < regions.kept_back.mean() < 0.45


def test_a_table_without_a_name_is_in_no_patch_and_is_told(recording, monkeypatch):
    """As one of noise, that came in early for what later names explain."""
    told: list[str] = []
    own = result.named
    monkeypatch.setattr(
        result, "named", lambda *a: (k for k in own(*a) if k[0] != TABLE)
    )
    found = calibrate_and_prove(recording, arm_of(UR10), UR10, said=told.append)
    assert not found.found.error_tables
    assert TABLE not in {e.effect for e in found.patch.effects}
    said = told[-2]
    assert said.startswith("Named in the end: ")
    assert said.index("No name, taken out again") < said.index(f"{TABLE}@a2")


def test_names_that_the_simulator_does_not_prove_are_withheld_for_that(outcome):
    proof = replace(outcome.proof, improves=False)
    answer = answer_of("seen", outcome.found, proof, outcome.residual, 1.0)
    reasons = {(r.effect, r.where): r.reason for r in answer.refused}
    assert not answer.named and outcome.found.named
    assert {reasons[key] for key in outcome.found.named} == {NOT_PROVED}
    assert f"No name, {NOT_PROVED}: " in names_told(outcome.found, answer)


def test_tables_that_lose_their_names_one_after_another_are_all_left_out(monkeypatch):
    """Without one table another may be told from noise no more."""
    waves = [
        replace(e, where=where) for e in TRUTH for where in ("a2", "a3", "a4")
        if e.effect == TABLE
    ]  # fmt: skip
    readings = readings_of(recorded(UR10, waves, 240, 3), arm_of(UR10))
    own, gone = result.named, ["a2", "a3", "a4"]
    tables: list[set[str]] = []

    def named(chosen, estimates, harmonics, regions):
        tables.append({*harmonics})
        lost = {(TABLE, axis) for axis in gone[: len(tables)]}
        return (k for k in own(chosen, estimates, harmonics, regions) if k not in lost)

    monkeypatch.setattr(result, "named", named)
    found = result.calibrated(readings, spatial_folds_of(readings), highest=33)
    assert len(tables) > 2 and not found.error_tables


def test_every_effect_that_was_tried_has_a_reason_and_the_result_a_figure(
    outcome, tmp_path
):
    """Believed, refused for its gain, or for a size that it cannot have."""
    tried = {step.key for step in outcome.found.selected.steps}
    assert {d.candidate for d in outcome.decisions} >= tried
    refused = [d for d in outcome.decisions if not d.accepted]
    z = min(
        (d for d in refused if d.gate == "regions_left_out"), key=lambda d: d.statistic
    )
    said = outcome.why_not(*z.candidate)
    assert f"{z.statistic:.2g} standard errors, 2 are needed" in said
    assert "It is named" in outcome.why_not("transmission_error", "a2")
    assert len(figure(outcome).axes) >= 3
    write_decisions(tmp_path / DECISIONS, outcome.decisions)
    assert len(read_table(tmp_path / DECISIONS)) == len(outcome.decisions)


def test_a_name_that_the_proof_takes_back_has_that_for_a_reason(outcome):
    gone = outcome.answer.named[0]
    answer = structs.replace(outcome.answer, named=outcome.answer.named[1:])
    less = replace(outcome, answer=answer)
    assert "not surely better" not in outcome.why_not(gone.effect, gone.where)
    assert "not surely better" in less.why_not(gone.effect, gone.where)


def test_an_arm_as_drawn_is_said_to_be_as_drawn(tmp_path):
    """Nor has its report a picture of gears or an empty table."""
    plain = recorded(UR10, (), 100, 4)
    outcome = calibrate_and_prove(plain, arm_of(UR10), UR10)
    assert outcome.answer.verdict == "no_mismatch"
    assert outcome.answer.named == ()
    write_files(tmp_path / "out", outcome)
    assert not (tmp_path / "out" / "gears.png").exists()
    report = (tmp_path / "out" / "report.md").read_text()
    assert "no effect earned a name" in report
    assert "gears.png" not in report
    assert "|---|\n\n" not in report


def test_tables_of_a_calibration_name_parameters_and_units_as_people_do(
    outcome, tmp_path
):
    write_files(tmp_path / "out", outcome)
    report = (tmp_path / "out" / "report.md").read_text()
    assert "_rad" not in report
    assert re.search(r"\| encoder_offset \| a2 \| offset -[\d.]+ µrad \|", report)


def test_springs_that_the_model_has_are_no_finding(kr10):
    there = recorded(
        kr10, (PatchEffect("encoder_offset", "a3", {"offset_rad": OFFSET}),), 200, 5
    )
    answer = calibrate_and_prove(there, arm_of(kr10), kr10).answer
    assert "joint_compliance" not in {n.effect for n in answer.named}


def test_an_answer_is_written_whole_with_its_pictures(outcome, tmp_path):
    write_files(tmp_path / "out", outcome)
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert names == {
        *("diagnosis.json", "patch.json", "model.xml", "diagnosis.rrd"),
        *("controller.csv", DECISIONS),
        *("report.html", "report.md"),
        *("before_after.png", "gears.png", "residual_map.png"),
    }


def test_a_viewer_opens_on_what_the_calibrated_arm_leaves(
    outcome, monkeypatch, tmp_path
):
    opened = viewer_into(monkeypatch, tmp_path / "seen.rrd")
    show(outcome)
    assert len(opened) == 1
    assert {"/error/before", "/error/after"} <= entities(tmp_path / "seen.rrd")


def test_differences_alone_are_refused_with_the_reason(recording):
    relative = replace(recording, displacement="relative")
    with pytest.raises(Unusable, match="absolute"):
        readings_of(relative, arm_of(UR10))
    with pytest.raises(Unusable, match="30 or more"):
        readings_of(recording.take(np.arange(20)), arm_of(UR10))


def test_columns_of_the_drawing_are_pinocchio_s_kinematic_regressor():
    arm = arm_of(UR10)
    posture = np.random.default_rng(2).uniform(-2, 2, (5, 6))
    standing = arm.at(posture)
    point = standing.point("flange", PLACE)
    ours = geometry.columns(standing, point, range(6))
    model = arm.file.model
    data = model.createData()
    last = model.njoints - 1
    for row, q in enumerate(posture):
        pinocchio.computeJointJacobians(model, data, q)
        theirs = pinocchio.computeJointKinematicRegressor(
            model, data, last, pinocchio.LOCAL_WORLD_ALIGNED
        )
        away = point[row] - data.oMi[last].translation
        for k in geometry.seats_of(arm.chain):
            turn = model.jointPlacements[k + 1].rotation
            block = theirs[:, 6 * k : 6 * k + 6]
            at_point = block[:3] + np.cross(block[3:], away, axis=0)
            link = 6 + 6 * (k - 1)
            shift, turned = at_point[:, :3] @ turn.T, at_point[:, 3:] @ turn.T
            about = np.hstack([np.zeros((3, 3)), block[3:, 3:] @ turn.T])
            expected = np.vstack([np.hstack([shift, turned]), about])
            own = ours[row, :, link : link + 6]
            np.testing.assert_allclose(own, expected, atol=1e-12)


def test_only_what_shows_is_corrected():
    """The first axis' offset is the frame's turn, the last link's end the target's."""
    readings = readings_of(recorded(UR10, (), 60, 6), arm_of(UR10))
    fit = fitted(readings, redraw=True)
    entries = geometry.entries_of(readings.arm.chain)
    kept = [e for e, k in zip(entries, fit.kept, strict=False) if k]
    assert ("encoder_offset", "a1") not in {(e.effect, e.where) for e in kept}
    a = (
        CalibrationState.of(readings, fit.geometry)
        .nuisance_jacobian()
        .reshape(-1, len(fit.kept))[:, fit.kept]
    )
    scaled = a / np.linalg.norm(a, axis=0)
    assert np.linalg.svd(scaled, compute_uv=False)[-1] > 1e-4


def test_draws_that_share_poses_say_less_than_as_many_that_do_not():
    """By hand: mean 2, s = 1, t(2) = 4.3027, three draws, a third kept back."""
    rows = [
        {"left": float(left), "poses_kept_back": 100, "poses": 400}
        for left in (1, 2, 3)
    ]
    mean, low, high = public_recordings.interval(rows, "left")
    half = 4.30265 * np.sqrt(1 / 3 + 1 / 3)
    assert (mean, low, high) == pytest.approx((2.0, 2.0 - half, 2.0 + half), rel=1e-5)


def test_wild_positions_are_found_and_no_sound_one_is_taken_for_wild(recording):
    off, rows = np.array([5e-3, 0.02, 0.3]), np.array([17, 90, 200])
    points = recording.points.copy()
    points[rows, 0] += off[:, None] * np.array([0.6, 0.0, -0.8])
    seen = readings_of(replace(recording, points=points), arm_of(UR10))
    size = rigid_outlier_distances(seen)
    assert np.flatnonzero(size).tolist() == rows.tolist()
    assert np.allclose(size[rows], off, atol=3e-4)
    assert not rigid_outlier_distances(readings_of(recording, arm_of(UR10))).any()


def test_regions_do_not_depend_on_a_last_digit_of_the_readings(recording):
    nudged = replace(recording, points=recording.points + 1e-13)
    one, other = (
        spatial_folds_of(readings_of(seen, arm_of(UR10)))
        for seen in (recording, nudged)
    )
    np.testing.assert_array_equal(one.region, other.region)
    assert one.held == other.held


def test_wild_positions_in_regions_kept_back_are_found_as_elsewhere(recording):
    """They would count as errors of the calibrated arm; 1 mm, where it leaves less."""
    rows = np.array([17, 60, 90, 150, 200, 240])[: len(recording.time) // 50]
    points = recording.points.copy()
    points[rows, 0, 1] += 1e-3
    seen = readings_of(replace(recording, points=points), arm_of(UR10))
    assert spatial_folds_of(seen).kept_back[rows].any()
    assert not rigid_outlier_distances(seen)[rows].any()
    assert np.flatnonzero(outlier_distances(seen)).tolist() == rows.tolist()
    assert not outlier_distances(readings_of(recording, arm_of(UR10))).any()


def test_calibration_lists_wild_positions_and_is_otherwise_as_without_them(
    recording, outcome
):
    points = recording.points.copy()
    hidden = 1e-3  # beyond what the calibrated arm leaves, not what a rigid one does
    off = [[0.0, 0.0, 4e-3], [0.3, 0.0, 0.0], [0.0, hidden, 0.0]]
    points[[17, 200, 90], 0] += off
    wild = replace(recording, points=points)
    size = rigid_outlier_distances(readings_of(wild, arm_of(UR10)))
    assert np.flatnonzero(size).tolist() == [17, 200]
    found = calibrate_and_prove(wild, arm_of(UR10), UR10)
    assert [o.pose for o in found.answer.outliers] == [17, 90, 200]
    assert found.answer.outliers[1].size_mm == pytest.approx(1e3 * hidden, rel=0.2)
    assert [w.code for w in found.answer.warnings] == ["outliers"]
    names = {(n.effect, n.where) for n in outcome.answer.named}
    assert {(n.effect, n.where) for n in found.answer.named} >= names & {
        ("transmission_error", "a2"),
        ("joint_compliance", "a2"),
    }
    assert found.proof.after.std() < 1.3 * outcome.proof.after.std()


def test_another_draw_keeps_back_other_poses(recording):
    readings = readings_of(recording, arm_of(UR10))
    first, other = (spatial_folds_of(readings, draw).kept_back for draw in (0, 1))
    assert (first != other).any()
    again = spatial_folds_of(readings, 1).kept_back
    np.testing.assert_array_equal(other, again)


WAVE = PatchEffect(
    "transmission_error",
    "a6",
    {"amplitude_rad": 1e-3, "order": 2.0, "phase_rad": 0.7},
)


@pytest.fixture(scope="module")
def turning():
    """An error that no position shows: of the last axis, with the target on it."""
    axes = Rotation.from_rotvec([0.5, -1.0, 0.3]).as_matrix()
    seen = recorded(UR10, (WAVE,), 120, 8, place=ON_AXIS, axes=axes)
    return calibrate_and_prove(seen, arm_of(UR10), UR10)


def test_an_error_of_orientation_alone_is_named_and_proved_in_mrad(turning, tmp_path):
    """A wave of 1 mrad is 0.7 mrad rms; 0.2 mrad about each axis are noise."""
    answer, noise = turning.answer, 1e3 * np.sqrt(3.0) * NOISE / ARM
    assert [(n.effect, n.where) for n in answer.named] == [("transmission_error", "a6")]
    assert answer.verdict == "explained"
    proof = answer.proof
    assert proof.before_rms_mrad > 1.7 * noise
    assert proof.after_rms_mrad < 1.25 * noise
    assert 0.6 < proof.noise_rms_mrad / noise < 1.5  # from some 15 pairs of poses
    assert proof.gain_mrad.low > 0.0
    assert proof.after_rms_mm < 1.3e3 * np.sqrt(3.0) * NOISE
    write_files(tmp_path / "out", turning)
    told = (tmp_path / "out" / "report.md").read_text()
    assert f"{proof.after_rms_mrad:.3g} mrad after" in told
    assert '"after_rms_mrad"' in (tmp_path / "out" / "diagnosis.json").read_text()


def test_the_weight_of_a_stated_tool_is_nothing_that_was_left_out():
    tool = Payload(3.0, np.array([0.02, -0.01, 0.08]))
    bent = recorded(KR10, (), 151, 5, tool=tool)
    o = calibrate_and_prove(bent, arm_of(KR10), KR10)
    truth = arm_of(KR10).stiffness
    assert not o.answer.named
    for axis, tolerance in (("a2", 0.02), ("a3", 0.02), ("a5", 0.05)):
        own = o.found.springs[0][axis].estimate
        assert own == pytest.approx(truth[int(axis[1:]) - 1], rel=tolerance)
        last = o.found.springs[1][axis]
        assert last.low < truth[int(axis[1:]) - 1] < last.high < 1.5 * last.low
    size = np.sqrt(np.mean(np.sum(o.proof.before**2, axis=1)))
    assert size < 1.2 * np.sqrt(3) * NOISE


def test_moments_of_gravity_turn_axes_as_its_torques_do():
    tool = Payload(3.0, np.array([0.02, -0.01, 0.08]))
    bent = recorded(KR10, (), 40, 6, tool=tool)
    readings = readings_of(bent, arm_of(KR10))
    state = CalibrationState.of(readings, fitted(readings, redraw=False).geometry)
    along = np.einsum("krj,krj->rk", state.standing.rotation[..., 2], state.moment)
    np.testing.assert_allclose(along, state.torque, atol=1e-9)


def state_of(arm, posture, body, place, seen) -> CalibrationState:
    """One target, seen once in each posture."""
    rows = np.arange(len(posture))
    readings = geometry.Readings(
        arm=arm,
        posture=posture,
        moves=LastMoves.of(np.zeros_like(posture)),
        seen=seen,
        marker=0 * rows,
        posture_id=rows,
        hours=0.0 * rows,
        names=("m",),
        bodies=(body,),
        places=place[None],
        stated=NOISE,
        tool=Payload(),
        told_lag=np.full(len(arm.axes), np.nan),
        placed=np.zeros(1, dtype=bool),
        drawing=DrawingAccuracy(),
    )
    drawn = np.zeros(len(geometry.entries_of(arm.chain)))
    start = geometry.Geometry(drawn, np.eye(4), place[None])
    return CalibrationState.of(readings, start)


GUIDE = (
    # what is true of the lift, whose guide does not move with its carriage
    BearingTilt("a1", u_rad_per_nm=2e-6, v_rad_per_nm=0.0),
    BearingTilt("a1", u_rad_per_nm=0.0, v_rad_per_nm=2e-6),
    LostMotion("a1", width_rad=1e-3, closing_nm=0.01, across=1),
)


@pytest.mark.parametrize("effect", GUIDE, ids=["u", "v", "play"])
def test_a_slide_s_guide_tips_by_moment_and_height_as_in_the_simulator(
    tmp_path, effect
):
    """A play tips to the side of the moment, a tilt in proportion; both about it."""
    file = tmp_path / "torso.xml"
    file.write_text(TORSO)
    rig = alone(Rig(file, stiffness=np.full(16, RIGID)))
    posture = drawn_postures(rig, 20)
    none, moment = np.zeros((20, 1, 6)), np.ones((20, 1))
    body, place = "left_hand", np.array([0.05, 0.02, 0.01])
    before, after = (
        point_in_base(rig, one.respond(posture, none, moment), body, place)
        for one in (rig, replace(rig, effects=(effect,)))
    )
    state = state_of(arm_of(file), posture, body, place, before)
    name, size = max(effect.parameters().items(), key=lambda one: one[1])
    (candidate,) = (
        c
        for c in candidates_of(state, 3)
        if c.key == (effect.name, "a1") and c.parameters == (name,)
    )
    moved = size * candidate.columns(state)[:, :, 0]
    np.testing.assert_allclose(
        moved, after - before, atol=2e-3 * np.abs(after - before).max()
    )


def test_wrists_as_soft_as_wrists_are_may_give_way(tmp_path):
    """Left out, they bend the compliances that are found beside them."""
    file = tmp_path / "torso.xml"
    light = TORSO.replace("<mujoco>", '<mujoco><option gravity="0 0 -4"/>')
    file.write_text(re.sub(' stiffness="[^"]*"', "", light))
    posture = drawn_postures(Rig(file, hand="left_hand"), 40)
    arm, place = arm_of(file), np.array([0.03, 0.0, 0.0])
    state = state_of(arm, posture, "left_hand", place, np.zeros((40, 3)))
    soft = [c.where for c in candidates_of(state, 3) if c.effect == "joint_compliance"]
    assert soft == [f"a{k}" for k in range(2, 9)]
    (a8,) = (c for c in candidates_of(state, 3) if c.key == ("joint_compliance", "a8"))
    assert 1e-5 * np.sqrt(np.mean(a8.columns(state) ** 2)) < 1e-6
