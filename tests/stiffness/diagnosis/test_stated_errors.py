"""What is promised where a recording states errors beyond a tracker's plain noise."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis_truth import BY_NAME
from hypothesis_truth import situation as truth_situation
from numpy.testing import assert_allclose

from bench.effects.encoder_offset import EncoderOffset as ZeroOff
from bench.effects.gravity_load import GravityLoad as AddedMass
from bench.effects.hysteresis import Hysteresis as Loop
from bench.experiment import record
from bench.instruments import Instruments
from bench.instruments.markers import Markers
from bench.model_file import load, plain_mjcf
from bench.rig import Rig
from bench.shared.recording import ASSUMED, Marker, Recording, TrackerSpec
from bench.shared.settings import Interval
from bench.standard_plans import table_one_plan
from scenarios.studies.blind_trials.arms import arm_of
from stiffness.diagnosis.detection import MEASURED, MISSTATED
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.gate import as_held, cost_of_limits, refused_by_sizes
from stiffness.diagnosis.model_evaluation import _mean_square_of
from stiffness.diagnosis.model_fit import (
    ModelFit,
    ModelTerm,
    SelectionProblem,
    with_priors,
)
from stiffness.diagnosis.nominal_fit import prepare, rest_of, smooth_basis
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.result import Diagnosis
from stiffness.diagnosis.unknown_noise import rms_summary
from stiffness.effects.base_compliance import BaseCompliance
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.gravity_load import MOST_TAKEN, GravityLoad, mass_at
from stiffness.effects.hardening import Hardening
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.link_bending import LinkBending
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.stretched_spring import StretchedSpring
from stiffness.effects.transmission_error import TransmissionError
from stiffness.experiment.residuals import weight_of
from stiffness.experiment.sensor_noise import (
    average_encoders,
    left_of_encoders,
    with_measured_noise,
)
from stiffness.regression.intervals import FittedParameters
from stiffness.robot.arm import Arm

FEW = (Hysteresis(), EncoderOffset())
ENCODER = np.deg2rad(0.002)
CORNERS = np.array([[60, 60, 110], [60, -60, -10], [-60, 60, -10], [-60, -60, 110]])


@pytest.fixture(scope="module")
def arm(kr10) -> Arm:
    return Arm.from_mjcf_text(plain_mjcf(load(kr10)))


@pytest.fixture(scope="module")
def plain(kr10) -> Recording:
    return plain_of(kr10)


def plain_of(kr10, frames: int = 1) -> Recording:
    watched = Instruments(markers=Markers("flange"))
    watched = replace(watched, tracker=replace(watched.tracker, frames=frames))
    return record(Rig(kr10), table_one_plan(poses=40), watched, seed=3)


def jittered(seen: Recording, seed: int = 0) -> Recording:
    """Let a controller report angles with the noise of its encoders, row by row."""
    noise = np.random.default_rng(seed).normal(0.0, ENCODER, seen.posture.shape)
    return replace(
        seen, posture=seen.posture + noise, encoder_repeatability=float(ENCODER)
    )


# --- Encoders ------------------------------------------------------------------------


def test_stated_noise_of_encoders_is_no_mismatch(plain, arm):
    """Row by row it moves a marker by three times the tracker's noise."""
    assert diagnose(jittered(plain), arm, FEW).verdict == "no_mismatch"


def test_axes_stand_still_within_a_visit_where_only_their_encoders_differ(plain):
    quiet = average_encoders(jittered(plain))
    assert np.all(np.ptp(quiet.posture[quiet.visit == 4], axis=0) == 0.0)
    rows = np.bincount(plain.visit)[0]
    assert_allclose(left_of_encoders(jittered(plain)), ENCODER / np.sqrt(rows))
    off = quiet.posture - plain.posture
    assert_allclose(np.std(off), ENCODER / np.sqrt(rows), rtol=0.2)


def test_axis_that_moves_by_more_than_its_encoder_errs_is_left_as_it_was_read(plain):
    seen = jittered(plain)
    moved = seen.posture.copy()
    moved[:, 1] += 10 * ENCODER * (np.arange(len(moved)) % 2)
    quiet = average_encoders(replace(seen, posture=moved))
    assert np.array_equal(quiet.posture[:, 1], moved[:, 1])
    assert not np.array_equal(quiet.posture[:, 0], moved[:, 0])


def test_angles_without_a_stated_noise_are_taken_as_read(plain):
    assert average_encoders(plain) is plain
    assert np.all(left_of_encoders(plain) == 0.0)


# --- Targets in 6D -------------------------------------------------------------------


def in_6d(seen: Recording, seed: int = 0) -> Recording:
    """Watch one target whose place and turn err, written as four markers."""
    body, place = seen.markers[0].body, seen.markers[0].position
    assert seen.points is not None and seen.tracker is not None and place is not None
    random, sigma = np.random.default_rng(seed), float(seen.tracker.repeatability[0])
    rows, lever = len(seen.time), 1e-3 * CORNERS
    size = np.sqrt(np.mean(np.sum(lever**2, axis=1)))
    turn = random.normal(0.0, sigma / size, (rows, 1, 3))
    moved = random.normal(0.0, sigma, (rows, 1, 3)) + np.cross(turn, lever[None])
    silent = np.stack([_exact(seen, at) for at in lever], axis=1)
    markers = tuple(Marker(f"t_{k}", body, at, "t") for k, at in enumerate(lever))
    return replace(seen, markers=markers, points=silent + moved)


def _exact(seen: Recording, at: np.ndarray) -> np.ndarray:
    """Return where a point of the flange is by three of its marks, in the tracker's."""
    assert seen.points is not None
    known = np.array([m.position for m in seen.markers[:3]])
    frames = [_triad(known)] + [_triad(p) for p in seen.points[:, :3]]
    origin, axes = frames[0]
    inner = (at - origin) @ axes
    return np.array([o + a @ inner for o, a in frames[1:]])


def _triad(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = points[1] - points[0]
    z = np.cross(x, points[2] - points[0])
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    return points[0], axes / np.linalg.norm(axes, axis=0)


def test_points_of_a_6d_target_count_as_one_reading(plain):
    weight = weight_of(in_6d(plain))
    assert_allclose(weight.sum(axis=1), 1.0)


def test_target_in_6d_on_a_nominal_arm_is_no_mismatch(kr10, arm):
    """Its points never move against each other: that is no sign of a better tracker."""
    quiet = Instruments(markers=Markers("flange"))
    quiet = replace(quiet, tracker=replace(quiet.tracker, noise=0.0))
    seen = record(Rig(kr10), table_one_plan(poses=40), quiet, seed=3)
    found = diagnose(in_6d(seen), arm, FEW)
    assert found.verdict == "no_mismatch"
    assert "noise_statement" not in [warned.code for warned in found.warnings]


# --- The tracker's smooth error ------------------------------------------------------


def test_what_anchors_leave_of_a_smooth_error_is_kept_as_noise():
    point = np.random.default_rng(0).uniform(-3.0, 3.0, (2000, 3))
    basis = smooth_basis(point, 5e-5)
    rest = rest_of(basis, 5e-5)
    assert_allclose(np.sum(basis**2, axis=1) + rest, 5e-5**2)
    assert np.median(rest) > (1e-5) ** 2  # six metres are too far for so few anchors


# --- How far errors may be misstated -------------------------------------------------


def laid_out(seen: Recording, arm: Arm) -> SelectionProblem:
    return build_problem(prepare(seen, arm), FEW)


def test_less_may_be_put_down_to_misstated_noise_where_noise_is_measured(plain, arm):
    """Three marks of a body measure it; one cannot."""
    assert plain.points is not None
    alone = replace(plain, markers=plain.markers[:1], points=plain.points[:, :1])
    assert laid_out(plain, arm).dispersion_limit == MEASURED
    assert laid_out(alone, arm).dispersion_limit == MISSTATED


@pytest.mark.parametrize("factor", [1 / 3, 3.0])
def test_noise_that_cannot_be_true_is_said_with_the_measured_one(factor, plain, arm):
    assert plain.tracker is not None
    stated = replace(plain.tracker, repeatability=factor * plain.tracker.repeatability)
    found = diagnose(replace(plain, tracker=stated), arm, FEW)
    (told,) = [w for w in found.warnings if w.code == "noise_statement"]
    measured = float(told.text.partition(" mm ")[0].split()[-1])
    assert measured == pytest.approx(0.01, rel=0.1)
    assert found.verdict == "no_mismatch"


def test_noise_may_be_left_out_and_is_then_measured(plain, arm):
    unknown = TrackerSpec(np.full(3, ASSUMED), is_stated=False)
    found = diagnose(replace(plain, tracker=unknown), arm, FEW)
    (told,) = [w for w in found.warnings if w.code == "noise_statement"]
    assert "not stated" in told.text and found.verdict == "no_mismatch"
    recording, _ = with_measured_noise(replace(plain, tracker=unknown))
    assert recording.tracker is not None
    assert_allclose(recording.tracker.repeatability, 1e-5, rtol=0.15)


def with_one_mark(seen: Recording, stated: float) -> Recording:
    """Return a recording that does not measure its noise, stated so many times over."""
    assert seen.points is not None and seen.tracker is not None
    tracker = replace(seen.tracker, repeatability=stated * seen.tracker.repeatability)
    if not stated:
        tracker = TrackerSpec(np.full(3, ASSUMED), is_stated=False)
    kept = {"markers": seen.markers[:1], "points": seen.points[:, :1]}
    return replace(seen, **kept, tracker=tracker)


def noise_of(found: Diagnosis) -> str:
    (told,) = [w.text for w in found.warnings if w.code == "noise_statement"]
    return told


def test_scatter_of_one_mark_beyond_the_stated_noise_is_noise_and_is_said(plain, arm):
    """Stated three times too small: 0.01 mm a coordinate are 0.0163 mm rms too much."""
    found = diagnose(with_one_mark(plain, 1 / 3), arm, FEW)
    assert found.verdict == "no_mismatch"
    assert found.scatter == pytest.approx(1e-5 * np.sqrt(3.0 * 8.0 / 9.0), rel=0.1)
    assert "fit no law and were taken for noise" in noise_of(found)


def test_noise_of_one_mark_that_is_not_stated_is_that_of_its_scatter(plain, arm):
    found = diagnose(with_one_mark(plain, 0.0), arm, FEW)
    assert found.verdict == "no_mismatch" and found.scatter is None
    assert found.reading_noise == pytest.approx(1e-5, rel=0.1)


def test_stated_noise_of_one_mark_bounds_it_from_below(plain, arm):
    found = diagnose(with_one_mark(plain, 3.0), arm, FEW)
    assert found.verdict == "no_mismatch" and found.scatter is None
    assert found.detection.noise_rms > 2.5 * 1e-5 * np.sqrt(3.0)
    told = noise_of(found)
    assert "cannot be true" in told
    assert float(told.partition(" mm")[0].split()[-1]) == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("stated", [1 / 3, 0.0, 1.0])
def test_name_is_the_same_whatever_noise_is_stated(stated, kr10, arm):
    """One mark does not measure it."""
    watched = Instruments(markers=Markers("flange"))
    rig = Rig(kr10, (Loop("a2", width_rad=2e-4),))
    seen = with_one_mark(record(rig, table_one_plan(poses=40), watched, seed=3), stated)
    found = diagnose(seen, arm, FEW)
    assert [str(one.name) for one in found.named] == ["hysteresis at a2"]
    assert found["hysteresis", "a2"].split_share == 1.0
    assert found.verdict == "explained"


def test_noise_that_no_body_shows_is_assumed_and_said(plain):
    assert plain.points is not None
    unknown = TrackerSpec(np.full(3, ASSUMED), is_stated=False)
    one = replace(plain, markers=plain.markers[:1], points=plain.points[:, :1])
    _, text = with_measured_noise(replace(one, tracker=unknown))
    assert "0.03 mm was assumed" in text


# --- What a link can lose ------------------------------------------------------------


def test_no_more_mass_is_taken_from_a_link_than_it_can_lack(plain, arm):
    """The simulator cannot be given a body without mass."""
    situation = prepare(plain, arm).situation
    whole = MOST_TAKEN * mass_at(situation, "link_3")
    assert plain.tool is not None
    assert mass_at(situation, "link_3") == arm.chain.mass[2]
    at_hand = arm.chain.mass[-1] + plain.tool.mass
    assert mass_at(situation, "tool") == pytest.approx(at_hand)

    def withdrawn(mass: float) -> bool:
        found = {"mass_kg": Interval(mass, mass - 0.1, mass + 0.1)}
        law = ModelTerm(GravityLoad(), "link_3", np.zeros(0))
        return cost_of_limits(situation, law, found) > 0.0

    assert not withdrawn(-whole + 0.05)
    assert withdrawn(-whole - 0.2)


@pytest.mark.parametrize(("u", "v"), [(-2e-6, 3e-6), (-2e-6, -3e-6)])
def test_an_effect_with_no_possible_size_costs_all_within_its_limits(plain, arm, u, v):
    """Of two sizes one may be small and impossible beside the other."""
    situation = prepare(plain, arm).situation
    law = ModelTerm(BY_NAME["bearing_tilt"], "a3", np.zeros(1))
    sizes = {"u_rad_per_nm": u, "v_rad_per_nm": v}
    found = {name: Interval(x, x - 5e-7, x + 5e-7) for name, x in sizes.items()}
    cost = cost_of_limits(situation, law, found)
    assert cost > 0.0
    assert np.isinf(cost) == (v < 0.0)


def test_what_is_known_before_any_reading_enters_the_normal_equations(plain, arm):
    """1/σ² for each gain, length, angle and zero; nothing for what is not known."""
    situation = prepare(plain, arm).situation
    laws = (
        ("geometry_error", "link_2"),
        ("marker_slip", "marker:flange_a"),
        ("encoder_offset", "a3"),
    )
    terms = [
        ModelTerm(BY_NAME[e], w, BY_NAME[e].shapes(situation, w)[0]) for e, w in laws
    ]
    drawing = plain.drawing
    of_link = [drawing.length] * 3 + [drawing.angle] * 3
    found = with_priors(np.eye(10), 2, terms, [6, 1, 1], situation)
    want = np.ones(10)
    want[2:8] += np.array(of_link) ** -2.0
    want[9] += drawing.offset**-2.0
    assert_allclose(found, np.diag(want))
    wave = BY_NAME["angle_dependent_stiffness"]  # of two orders, one sigma for all
    sigma = wave.prior_sigma(situation, "a2")
    assert sigma is not None
    found = with_priors(
        np.eye(5), 1, [ModelTerm(wave, "a2", np.array([1.0, 2.0]))], [4], situation
    )
    assert_allclose(found, np.diag([1.0, *np.full(4, 1.0 + sigma[0] ** -2.0)]))
    gains = BY_NAME["wrench_gain"].prior_sigma(situation, "wrench_sensor")
    assert gains is not None
    assert_allclose(gains, 0.02)


def test_mass_on_a_tool_hangs_on_the_flange_where_the_model_has_no_tool(
    tmp_path,
):
    rig = Rig(arm_of("six", 1, tmp_path).file)
    arm = rig.anatomy
    assert "tool" not in [body.name for body in rig.spec.bodies]
    on_tool, on_flange = (rig.spec.copy() for _ in range(2))
    AddedMass("tool", 0.5).build(on_tool, arm)
    before = on_flange.body(arm.flange).mass
    assert on_tool.body(arm.flange).mass == pytest.approx(before + 0.5)


# --- What is missed ------------------------------------------------------------------


def missed(seen: Recording, arm: Arm) -> float:
    """Return the rms that the fitted nominal arm leaves over that of the noise."""
    ready = prepare(seen, arm)
    found = rms_summary(ready, build_problem(ready, FEW))
    return found.rms / found.noise


def test_nominal_arm_misses_by_the_noise_however_many_frames_a_row_has(kr10, arm):
    assert missed(plain_of(kr10), arm) == pytest.approx(1.0, abs=0.05)
    assert missed(plain_of(kr10, frames=16), arm) == pytest.approx(1.0, abs=0.05)


def test_noise_is_that_of_one_reading_and_within_visits_that_of_its_difference(
    kr10, arm
):
    """As measured; each visit's mean takes one of its readings' squares."""
    seen = plain_of(kr10)
    ready = prepare(seen, arm)
    found = rms_summary(ready, build_problem(ready, FEW))
    of_one = ready.noise * 1e-5 * np.sqrt(3.0)
    each = len(seen.time) / len(np.unique(seen.visit))
    assert found.noise == pytest.approx(of_one, rel=1e-3)
    assert found.noise_within == pytest.approx(of_one * np.sqrt(1.0 - 1.0 / each))
    assert found.within == pytest.approx(found.noise_within, rel=0.05)


def test_what_shows_between_visits_alone_is_missed_all_the_same(kr10, arm):
    """An axis whose zero is off moves no marker within a visit."""
    off = Rig(kr10, effects=(ZeroOff("a3", 5e-4),))
    seen = record(
        off, table_one_plan(poses=40), Instruments(markers=Markers("flange")), seed=3
    )
    assert missed(seen, arm) > 3.0


# --- Physical limits ------------------------------------------------------------------


def test_law_of_one_size_with_a_wrong_sign_is_none_whatever_its_interval(plain, arm):
    """A play has a width; of a foot's six springs one may come out below zero."""
    case = build_problem(prepare(plain, arm), (LostMotion(),))
    play = ModelTerm(LostMotion(), "a2", np.array([1.0]))
    foot = ModelTerm(BaseCompliance(), "base", np.zeros(0))
    width = {"width_rad": Interval(-1e-4, -1.9e-4, -1e-5)}
    springs = {f"r{axis}_rad_per_nm": Interval(3e-7, 2e-7, 4e-7) for axis in "xy"}
    springs["z_m_per_n"] = Interval(-3e-9, -5e-9, -1e-9)
    fitted = [FittedParameters(own, 9.0, 3.0) for own in (width, springs)]
    told = refused_by_sizes(case, [play, foot], fitted, [1e4, 1e4], [1, 6])
    assert [(d.candidate, d.gate) for d in told] == [(play.name, "physical")]


def test_spring_that_would_push_is_none_however_little_its_sign_explains(plain, arm):
    """Its free length is a share of a torque that it cannot have."""
    case = build_problem(prepare(plain, arm), (StretchedSpring(),))
    spring = ModelTerm(StretchedSpring(), "a2", np.array([2.2, 0.6]))
    own = {
        "torque_nm": Interval(-12.0, -15.5, -8.2),
        "free_length_ratio": Interval(0.6, 0.03, 1.1),
    }
    fitted = FittedParameters(own, 9.0, 3.0)
    told = refused_by_sizes(case, [spring], [fitted], [1e5], [2])
    assert [d.gate for d in told] == ["physical"]
    pulls = own | {"torque_nm": Interval(12.0, 8.2, 15.5)}
    fitted = FittedParameters(pulls, 9.0, 3.0)
    assert not refused_by_sizes(case, [spring], [fitted], [1e5], [2])


@pytest.mark.parametrize(("half", "held"), [(0.4, True), (19.0, False)])
def test_interval_of_a_shape_that_may_be_any_is_not_told(plain, arm, half, held):
    """Of a wave of order 1 ± 19; its estimate stays, for the patch needs one."""
    situation = prepare(plain, arm).situation
    wave = ModelTerm(TransmissionError(), "a2", np.ones(1))
    found = {
        "amplitude_rad": Interval(5e-5, 3e-5, 7e-5),
        "order": Interval(1.0, 1.0 - half, 1.0 + half),
    }
    told = as_held(situation, wave, found)
    assert told["amplitude_rad"] == found["amplitude_rad"]
    assert told["order"].estimate == 1.0
    assert np.isfinite([told["order"].low, told["order"].high]).all() == held


@pytest.mark.parametrize(("gain", "refused"), [(5e2, True), (1e5, False)])
def test_law_of_one_size_a_little_beyond_its_far_limit_stands(
    plain, arm, gain, refused
):
    """A gear that hardens 10.5 times, of 10 at most, loses what the limit costs."""
    case = build_problem(prepare(plain, arm), (Hardening(),))
    gear = ModelTerm(Hardening(), "a2", np.array([20.0, 0.0]))
    own = {
        "stiffness_ratio": Interval(10.5, 10.4, 10.6),
        "torque_nm": Interval(20.0, 19.0, 21.0),
    }
    fitted = FittedParameters(own, 9.0, 3.0)
    assert bool(refused_by_sizes(case, [gear], [fitted], [gain], [1])) == refused


def test_one_size_that_may_be_nothing_is_withheld_however_it_is_tested(plain, arm):
    """Of a foot's springs that may each be nothing all can still not be so at once."""
    case = build_problem(prepare(plain, arm), (LostMotion(),))
    play = ModelTerm(LostMotion(), "a2", np.array([1.0]))
    foot = ModelTerm(BaseCompliance(), "base", np.zeros(0))
    width = {"width_rad": Interval(1e-5, -1e-5, 3e-5)}
    springs = {f"r{axis}_rad_per_nm": Interval(1e-7, -2e-7, 4e-7) for axis in "xy"}
    fitted = [FittedParameters(own, 9.0, 3.0) for own in (width, springs)]
    told = refused_by_sizes(case, [play, foot], fitted, [1e4, 1e4], [1, 6])
    assert {d.candidate: d.accepted for d in told} == {
        play.name: False,
        foot.name: True,
    }


def test_sizes_that_hold_each_other_up_are_still_possible_or_refused(plain, arm):
    """A bearing that tilts about a point 0.7 m off its axis' origin is none."""
    case = build_problem(prepare(plain, arm), (BearingTilt(),))
    bearing = ModelTerm(BearingTilt(), "a1", np.zeros(1))
    own = {f"{axis}_rad_per_nm": Interval(1e-6, -1e-6, 3e-6) for axis in "uv"}
    own["centre_m"] = Interval(0.7, 0.65, 0.75)
    fitted = FittedParameters(own, 9.0, 3.0)
    told = refused_by_sizes(case, [bearing], [fitted], [10.0], [2])
    assert [(d.gate, d.accepted) for d in told] == [
        ("magnitude", True),
        ("physical", False),
    ]


def test_effect_none_of_whose_sizes_is_surely_possible_has_no_name(plain, arm):
    """One stiffness of a link may be nothing, the other lies below."""
    case = build_problem(prepare(plain, arm), (LinkBending(),))
    link = ModelTerm(LinkBending(), "link_2", np.zeros(1))
    own = {
        "bending_nm2": Interval(-1.9e8, -4e8, 2e7),
        "torsion_nm2": Interval(-1.7e4, -3e4, -4e3),
    }
    fitted = FittedParameters(own, 9.0, 3.0)
    told = refused_by_sizes(case, [link], [fitted], [1e4], [2])
    assert [d.gate for d in told] == ["magnitude"]


def test_masses_at_other_links_are_as_large_beside_their_priors_as_those_named():
    """Of a link on which other moments are seen than on those that were named."""
    here = truth_situation()
    named = ModelTerm(GravityLoad(), "link_3", np.zeros(0))
    other = ModelTerm(GravityLoad(), "link_2", np.zeros(0))
    size = 0.1 * GravityLoad().prior_sigma(here, "link_3")
    fit = ModelFit((named,), 0.0, np.zeros(6), (size,), len(size))
    want = 0.1 * GravityLoad().prior_sigma(here, "link_2")
    found = _mean_square_of(here, other, fit, len(want))
    assert len(want) != len(size)
    assert found is not None
    assert_allclose(np.sqrt(found), want)


def test_a_force_sensor_that_is_stated_too_noisy_is_said(plain, arm):
    """Marks of one body measure the tracker's noise, and all scatter the rest."""
    sensor = replace(plain.wrench_sensor, accuracy_force=3.0, accuracy_torque=0.3)
    for recording, count in ((plain, 0), (replace(plain, wrench_sensor=sensor), 1)):
        found = diagnose(recording, arm, FEW)
        told = [w.text for w in found.warnings if w.where == "wrench_sensor"]
        assert len(told) == count
        assert all("the force sensor cannot be true" in text for text in told)


def test_a_force_sensor_whose_noise_is_true_is_not_doubted_by_few_poses(kr10, arm):
    """Of fewer than twenty, what laws fitted to them leave scatters too little."""
    seen = record(Rig(kr10), table_one_plan(poses=18), Instruments(), seed=4)
    told = [w.text for w in diagnose(seen, arm).warnings if w.where == "wrench_sensor"]
    assert not told
