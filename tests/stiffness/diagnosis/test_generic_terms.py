"""Generic terms of a place take what has no name, and leave names to what has one."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import (
    FEW,
    MECHANICS,
    MODEL,
    arm,
    moved_by,
    nameless,
    names,
    prepared,
    recording,
    select_model,
)

from bench.effects.out_of_library.axis_crosstalk import AxisCrosstalk
from bench.effects.out_of_library.foot_lift_off import FootLiftOff
from bench.effects.out_of_library.thrust_turn import ThrustTurn
from bench.effects.parse import parse_all
from bench.experiment import record
from bench.instruments import Instruments
from bench.rig import Rig
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.detection import ResidualEquations
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.gate import is_local
from stiffness.diagnosis.joint_fit import Layout, OperatingPoint
from stiffness.diagnosis.localisation import joined_places
from stiffness.diagnosis.model_fit import ModelTerm, fit_model
from stiffness.diagnosis.nominal_fit import Prepared, prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.result import Name, UnexplainedPlace
from stiffness.diagnosis.search import (
    Search,
    _without_slight_terms,
    beyond_present_names,
    generic_term,
)
from stiffness.diagnosis.selection import (
    SelectedModel,
    _better_without_generic_terms,
    _judged,
)
from stiffness.diagnosis.verdict import (
    RESIDUAL_SHARE_LIMIT,
    _beside_generic,
    _of_slight_share,
    judge,
)
from stiffness.effects import HYPOTHESES
from stiffness.effects.asymmetric_stiffness import AsymmetricStiffness
from stiffness.effects.base import Hypothesis
from stiffness.effects.base_compliance import BaseCompliance
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.creep import Creep
from stiffness.effects.drift import Drift
from stiffness.effects.encoder_offset import EncoderOffset
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.hardening import Hardening
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.jacobian import (
    BodyTwist,
    EffectJacobian,
    JointRotation,
    orthogonal_to,
    rotate,
    values,
)
from stiffness.effects.lost_motion import LostMotion
from stiffness.effects.marker_slip import MarkerSlip
from stiffness.effects.residual_map import (
    KNOTS,
    TOLD_APART,
    GenericTerm,
    _from_zero,
    _told_apart,
    residual_map,
)
from stiffness.effects.transmission_error import TransmissionError
from stiffness.regression.testing import SIGNIFICANCE

GEAR = (Hardening(), LostMotion(), AsymmetricStiffness())
OFFERED = {("a2", "torque"), ("a4", "direction")}


def test_compliance_of_a_place_is_symmetric_along_the_moving_side():
    """Forces at the origin of axis 3 move it by a full symmetric compliance."""
    here = prepared().situation
    block = next(
        b for b in residual_map(here) if (b.where, b.kind) == ("a3", "compliance")
    )
    (part,) = block.jacobian.parts
    assert isinstance(part, BodyTwist)
    size = np.random.default_rng(0).normal(size=block.jacobian.columns)
    compliance = np.zeros((6, 6))
    compliance[np.triu_indices(6)] = [*size, 0.0]
    compliance += np.triu(compliance, 1).T
    frame, origin = here.frame[:, 3], here.origin[:, 3]
    load = np.concatenate(
        [
            np.einsum("rij,ri->rj", frame, here.force[:, 3]),
            np.einsum("rij,ri->rj", frame, here.moment[:, 3]),
        ],
        axis=1,
    )
    motion = load @ compliance
    turned = np.einsum("rij,rj->ri", frame, motion[:, 3:])
    shifted = np.einsum("rij,rj->ri", frame, motion[:, :3])
    own = part.twist @ size
    assert_allclose(own[:, 3:], turned, atol=1e-12 * np.abs(turned).max())
    moved = own[:, :3] + np.cross(own[:, 3:], origin)
    assert_allclose(moved, shifted, atol=1e-9 * np.abs(shifted).max())


def test_rows_of_one_time_have_no_course_in_time():
    here = prepared().situation
    still = np.zeros_like(here.recording.time)
    at_once = replace(here.recording, time=still, load_time=still)
    blocks = residual_map(replace(here, recording=at_once))
    kinds = {(b.where, b.kind) for b in residual_map(here)}
    lost = kinds - {(b.where, b.kind) for b in blocks}
    links = {(f"link_{k}", "warming") for k in range(1, 6)}
    assert lost == {
        *(("base", "time"), ("wrench_sensor", "zero"), ("wrench_sensor", "scale")),
        *((f"a{k}", "time") for k in range(1, 7)),
        *links,
    }


@pytest.mark.parametrize(
    ("unknown", "places"),
    [
        (ThrustTurn(where="a3", compliance_rad_per_nm=1e-5), {"a3"}),
        (AxisCrosstalk(where="a2", with_axis="a1"), {"a1", "a2"}),
    ],
)
def test_a_linear_mechanism_without_a_name_takes_no_names_of_its_neighbours(
    unknown, places
):
    """A thread and a shared casting: no bearing tilts and no link bends there."""
    rig = Rig(MODEL)
    known = parse_all(("hysteresis@a2", "bearing_tilt@a5"), rig.nominal)
    rig = replace(rig, effects=(*known, unknown))
    made = record(rig, table_one_plan(poses=40), Instruments(), seed=4)
    found = diagnose(made, arm(), MECHANICS)
    assert set(names(found)) <= {("hysteresis", "a2"), ("bearing_tilt", "a5")}
    assert ("hysteresis", "a2") in names(found)
    assert found.verdict == "partly_explained"
    assert {one.where for one in found.unexplained_places} <= places
    assert found.unexplained_places[0].depends_on[0] == "load"


def test_no_name_stands_where_most_of_the_mismatch_has_none():
    """A tilted tracker that nobody may name looks like errors of three links."""
    rig = Rig(MODEL)
    tilt = "tracker_misalignment@tracker,rx_rad=8e-6,ry_rad=4e-6,rz_rad=-1e-5"
    rig = replace(rig, effects=parse_all((tilt,), rig.nominal))
    made = record(rig, table_one_plan(poses=60), Instruments(), seed=1)
    known = [law for law in HYPOTHESES if law.effect != "tracker_misalignment"]
    found = diagnose(made, arm(), known)
    assert found.verdict == "unexplained"
    assert not found.named
    assert found.unexplained_places  # which are said all the same
    gate = [d for d in found.decisions if d.gate == "named_share"]
    assert gate and all(not d.accepted and d.statistic < d.threshold for d in gate)


def test_a_weak_name_stands_beside_a_strong_mechanism_that_a_generic_term_explains():
    """Nothing stays for the name to imitate, though it explains far less."""
    rig, loop = Rig(MODEL), "hysteresis@a1,width_rad=3e-5"
    thread = ThrustTurn(where="a4", compliance_rad_per_nm=1e-4)
    rig = replace(rig, effects=(*parse_all((loop,), rig.nominal), thread))
    made = record(rig, table_one_plan(poses=60), Instruments(), seed=4)
    found = diagnose(made, arm(), FEW)
    assert names(found) == [("hysteresis", "a1")]
    assert found.verdict == "partly_explained"
    (place,) = found.unexplained_places
    assert place.where == "a4"
    assert place.share > 0.6


def test_names_far_from_a_strong_mechanism_stand_though_no_generic_law_fits_it():
    """A foot that lifts shows at the base and the first axis, never at the wrist."""
    rig, loop = Rig(MODEL), "hysteresis@a4,width_rad=3e-4"
    foot = FootLiftOff("base", edge_rad_per_nm=4e-6, angle_rad=0.6, preload_nm=20.0)
    rig = replace(rig, effects=(*parse_all((loop,), rig.nominal), foot))
    made = record(rig, table_one_plan(poses=60), Instruments(), seed=4)
    found = diagnose(made, arm(), FEW)
    assert names(found) == [("hysteresis", "a4")]
    assert found.verdict == "partly_explained"
    assert found.unexplained_places[0].where == "base"
    assert "a4" not in {one.where for one in found.unexplained_places}


@cache
def beside_a_thread() -> SelectedModel:
    """Select from a recording of two gears, one beside a mechanism without a name."""
    rig = Rig(MODEL)
    known = parse_all(("hysteresis@a2", "hysteresis@a3"), rig.nominal)
    thread = ThrustTurn(where="a3", compliance_rad_per_nm=1e-5)
    rig = replace(rig, effects=(*known, thread))
    made = record(rig, table_one_plan(poses=60), Instruments(), seed=4)
    given = prepare(made, arm())
    return select_model(build_problem(given, FEW), Layout(given, FEW))


def beside_a_generic_law(ready: Prepared, law: Hypothesis, kind: str) -> OperatingPoint:
    """Fit a law of a gear and a generic term at one place."""
    case = build_problem(ready, GEAR)
    generic = GenericTerm(f"generic_{kind}", kind, kind)
    shape = law.shapes(case.situation, "a4")[0]
    terms = (
        ModelTerm(law, "a4", shape),
        ModelTerm(generic, "a4", np.zeros(0)),
    )
    return Layout(ready, GEAR).fitted_jointly(case, fit_model(case, terms))


def test_two_true_laws_of_a_gear_come_for_a_wrong_one_beside_a_generic_term():
    ready = prepared(
        "lost_motion@a4,width_rad=1e-3",
        "hardening@a4,stiffness_ratio=1.6,torque_nm=3.4",
    )
    held = beside_a_generic_law(ready, AsymmetricStiffness(), "torque")
    found = _better_without_generic_terms(Layout(ready, GEAR), held, ())
    assert found.fit.names == {("lost_motion", "a4"), ("hardening", "a4")}


def test_a_generic_term_stays_where_names_alone_do_less():
    thread = ThrustTurn(where="a4", compliance_rad_per_nm=1e-4)
    rig = Rig(MODEL)
    rig = replace(rig, effects=(*rig.effects, thread))
    ready = prepare(record(rig, table_one_plan(poses=40), Instruments(), seed=4), arm())
    held = beside_a_generic_law(ready, LostMotion(), "load")
    assert _better_without_generic_terms(Layout(ready, GEAR), held, ()) is held


def test_of_names_that_go_against_each_other_the_sizes_count_beside_an_unknown_one():
    """One part is below zero: they explain little together, and yet most."""
    judged = judge(beside_a_thread())
    members = judged.model.fit.members
    stands = [not m.is_generic for m in members]

    def withheld(a2: float, a3: float, unknown: float) -> list[tuple[str, str]]:
        part = {("hysteresis", "a2"): a2, ("hysteresis", "a3"): a3}
        parts = [part.get(m.name, unknown * m.is_generic) for m in members]
        return [d.candidate for d in _of_slight_share(judged, parts, stands)]

    assert withheld(-0.5, 0.9, 0.3) == []
    assert withheld(0.2, 0.3, 0.5) == [("hysteresis", "a3")]  # its place; a2 is another
    # no more than what the law of the generic term may err by
    fortyfold = 40.0 * max(judged.model.drop_one_gains)
    gains = [
        fortyfold if m.is_generic else g
        for m, g in zip(members, judged.model.drop_one_gains, strict=True)
    ]
    judged = replace(judged, model=replace(judged.model, drop_one_gains=tuple(gains)))
    assert set(withheld(0.2, 0.3, 0.5)) == {("hysteresis", "a2"), ("hysteresis", "a3")}


@pytest.mark.parametrize(
    ("depends_on", "axes"), [("load", ["a3"]), ("history", ["a2", "a3"])]
)
def test_what_remembers_may_be_what_remembers_otherwise_next_to_it(depends_on, axes):
    """No column of a place knows for how long a mechanism without a name remembers."""
    judged, sizes = judge(beside_a_thread()), {"a2": 0.2, "a3": 0.3}
    fit, terms = judged.model.fit, list(judged.model.fit.members)
    [k] = (k for k, term in enumerate(terms) if term.is_generic)
    law = terms[k].hypothesis
    assert isinstance(law, GenericTerm) and terms[k].where == "a3"
    other = replace(law, depends_on=depends_on)
    terms[k] = replace(terms[k], hypothesis=other)
    model = replace(judged.model, fit=replace(fit, members=tuple(terms)))
    parts = [0.5 if term.is_generic else sizes[term.where] for term in terms]
    stands = [not term.is_generic for term in terms]
    found = _of_slight_share(replace(judged, model=model), parts, stands)
    assert sorted(d.candidate[1] for d in found) == axes


@pytest.mark.parametrize("law", HYPOTHESES, ids=lambda law: type(law).__name__)
def test_no_mechanism_far_away_imitates_what_shows_at_its_place_alone(law):
    """A tilted tracker looks like errors of links and offsets, and of no gear."""
    seen_everywhere = {
        *("gravity_load", "mass_scale", "gravity_compensator", "pulley_friction"),
        *("transmission_error", "encoder_offset", "geometry_error", "tracker_scale"),
        *("tracker_misalignment", "wrench_bias", "wrench_gain", "wrench_misalignment"),
        "deflection_compensation",
    }
    found = is_local(ModelTerm(law, "a2", np.zeros(0)))
    assert found == (law.effect not in seen_everywhere)


def test_a_name_half_as_strong_as_an_unknown_mechanism_at_its_place_is_withheld():
    """The law of a generic term is no exact one; what it leaves may imitate a name."""
    model = beside_a_thread()
    members = {m.name: k for k, m in enumerate(model.fit.members)}
    (generic,) = (k for n, k in members.items() if n == ("generic_compliance", "a3"))
    beside, elsewhere = members["hysteresis", "a3"], members["hysteresis", "a2"]

    def withheld(ratio: float, depends_on: str) -> list[bool]:
        gains, terms = list(model.drop_one_gains), list(model.fit.members)
        gains[beside] = gains[elsewhere] = ratio * gains[generic]
        law = terms[generic].hypothesis
        assert isinstance(law, GenericTerm)
        other = replace(law, depends_on=depends_on)
        terms[generic] = replace(terms[generic], hypothesis=other)
        fit = replace(model.fit, members=tuple(terms))
        judged = judge(replace(model, fit=fit, drop_one_gains=tuple(gains)))
        reasons = {d.candidate: d.reason for d in judged.decisions}
        if judged.withheld[beside]:
            assert "unknown mechanism" in reasons["hysteresis", "a3"]
        return [judged.withheld[beside], judged.withheld[elsewhere]]

    assert withheld(0.55, "history") == [False, False]
    assert withheld(0.45, "history") == [True, False]
    assert withheld(0.45, "direction") == [True, False]
    # what depends on loads of the moment alone leaves nothing that a loop imitates
    assert withheld(0.45, "load") == [False, False]


@pytest.mark.parametrize(
    ("where", "gains", "stands"),
    [
        # the generic term explains more than twice as much
        ("tool", (1.0, 3.0), True),
        ("link_2", (1.0, 3.0), False),
        # twenty times as much: what the axis cannot do is seen alone, or is too little
        ("tool", (200.0, 4000.0), True),
        ("tool", (20.0, 400.0), False),
        ("link_2", (200.0, 4000.0), False),
    ],
)
def test_a_weight_goes_where_an_unknown_mechanism_before_it_could_do_what_it_does(
    where, gains, stands
):
    """What hangs on the flange pulls at all axes, an axis turns alone."""
    ready, laws = prepared(f"gravity_load@{where},mass_kg=2"), (GravityLoad(),)
    case = build_problem(ready, laws)
    weight = ModelTerm(laws[0], where, np.zeros(0))
    terms = weight, nameless(case, "load", "a2")
    model = _judged(case, (weight,), (), ())
    fit = fit_model(case, terms)
    assert fit.names == {term.name for term in terms}
    beyond = ResidualEquations.of(case, fit)
    both = replace(model, fit=fit, drop_one_gains=gains)
    assert (_beside_generic(0, both, beyond) < RESIDUAL_SHARE_LIMIT) == stands


def test_teeth_of_a_gear_take_no_name_of_another_axis():
    """An error of a hundred periods in a turn follows no law that forty poses show."""
    teeth = "transmission_error@a3,amplitude_rad=2e-4,order=97.3"
    found = diagnose(recording("hysteresis@a2", teeth), arm(), FEW)
    assert names(found) == [("hysteresis", "a2")]
    assert found.verdict == "partly_explained"
    (place,) = found.unexplained_places
    assert place.where == "a3" and not place.depends_on
    scatter = float(place.law.split()[0]) * 1e-6
    assert scatter == pytest.approx(2e-4 / np.sqrt(2.0), rel=0.2)


def test_axes_that_scatter_alone_are_places_and_no_names():
    teeth = "transmission_error@a3,amplitude_rad=2e-4,order=97.3"
    found = diagnose(recording(teeth), arm(), FEW)
    assert found.verdict == "unexplained" and not found.named
    assert found.detection.p_value < SIGNIFICANCE
    assert [place.where for place in found.located] == ["a3"]
    assert found.unexplained is not None and found.unexplained.where == "a3"


def waved(made: Recording, turns: float, size_m: float) -> Recording:
    """Let all marks move to and fro over a recording, as a day makes a tracker do."""
    assert made.points is not None
    hours = made.time / np.ptp(made.time)
    wave = size_m * (np.sin(2.0 * np.pi * turns * hours) + np.sqrt(hours))
    moved = made.points + wave[:, None, None] * np.array([0.7, 0.2, -0.7])
    return replace(made, points=moved)


@pytest.mark.parametrize(("turns", "poses"), [(2.0, 40), (3.0, 90)])
def test_a_wave_of_the_tracker_is_no_slip_of_many_marks(turns, poses):
    """All marks move together, as no slip does: to and fro over the recording."""
    made = recording("hysteresis@a2", poses=poses)
    assert made.points is not None
    made = replace(made, markers=made.markers[:12], points=made.points[:, :12])
    made = waved(made, turns, 3e-5)
    found = diagnose(made, arm(), (*FEW, Drift(), MarkerSlip()))
    assert names(found) == [("hysteresis", "a2")]
    (course,) = (one for one in found.unexplained_places if one.where == "base")
    assert course.depends_on == ("time",)


def test_a_mark_that_sags_is_named_as_one_that_slips():
    """Glue that gives way: 80 um in all, three quarters of them in a third of it."""
    made = recording("hysteresis@a3")
    assert made.points is not None
    hours = made.time / np.ptp(made.time)
    sag = -8e-5 * (1.0 - np.exp(-np.maximum(hours - 0.3, 0.0) / 0.25))
    points = made.points.copy()
    points[:, 5] += sag[:, None] * np.array([0.6, 0.0, 0.8])
    found = diagnose(replace(made, points=points), arm(), (*FEW, MarkerSlip()))
    slip = ("marker_slip", f"marker:{made.markers[5].name}")
    assert set(names(found)) == {("hysteresis", "a3"), slip}


@pytest.mark.parametrize("low", [-60.0, 20.0, -90.0])
def test_generic_law_of_torque_holds_the_spring_and_no_constant_turn(low):
    """A constant turn is an offset, which has a name; also where no torque is small."""
    torque = np.random.default_rng(0).uniform(low, low + 80.0, 300)
    law = _from_zero(torque, KNOTS)

    def left(of: np.ndarray, by: np.ndarray) -> float:
        rest = of - by @ np.linalg.lstsq(by, of)[0]
        return float(np.linalg.norm(rest) / np.linalg.norm(of))

    assert np.linalg.matrix_rank(law) == law.shape[1]
    assert left(torque, law) < 1e-9
    assert left(np.ones(300), law) > 0.01


@pytest.mark.parametrize("reach", [0.5, 1.5, 3.0])
def test_generic_stiffness_with_waves_of_an_angle_does_not_hold_the_spring(reach):
    """Over a small range of angles waves make up a constant: a spring."""
    angle = np.linspace(-reach, reach, 200)
    torque = np.cos(5.0 * angle) + 0.3
    waves = np.column_stack([f(n * angle) for n in (1, 2, 3) for f in (np.cos, np.sin)])
    known = np.column_stack([np.ones(200), torque])
    law = _told_apart(np.concatenate([waves, waves * torque[:, None]], axis=1), known)
    assert_allclose(known.T @ law, 0.0, atol=1e-9)
    size = np.linalg.svd(law, compute_uv=False)
    assert 0 < law.shape[1] <= 12
    assert size[-1] > TOLD_APART * size[0]
    assert (law.shape[1] == 12) == (reach == 3.0)


def test_generic_term_competes_only_with_more_than_laws_at_its_place_may_err_by():
    """A gear of two stiffnesses leaves nothing of torque; another place is asked."""
    case = build_problem(prepared("asymmetric_stiffness@a2", "hysteresis@a4"), FEW)
    gear = ModelTerm(AsymmetricStiffness(), "a2", np.full(1, 1e-9))
    blocks = [b for b in case.library.map.blocks if (b.where, b.kind) in OFFERED]
    search = Search.of(case, [gear, *map(generic_term, blocks)])
    kept = _without_slight_terms(search, 1)
    assert {t.where for t in search.terms if t.is_generic} == {"a2", "a4"}
    assert {t.where for t in kept.terms if t.is_generic} == {"a4"}
    assert len(kept.terms) == len(kept.problem.groups) == len(search.terms) - 1


def test_a_course_in_time_takes_no_name_that_depends_on_no_time():
    """A strong wave of the tracker stands at the base; a base that gives way, too."""
    soft = "base_compliance@base,rx_rad_per_nm=2e-7,ry_rad_per_nm=2e-7"
    made = recording(soft, poses=60)
    assert made.points is not None
    made = replace(made, markers=made.markers[:12], points=made.points[:, :12])
    found = diagnose(waved(made, 1.0, 2e-4), arm(), (*FEW, BaseCompliance()))
    assert names(found) == [("base_compliance", "base")]
    assert found.unexplained_places[0].depends_on == ("time",)


@pytest.mark.parametrize(("where", "compliance"), [("base", 1e-6), ("a4", 1e-5)])
def test_friction_in_a_foot_or_bearing_is_no_hysteresis_of_a_gear(where, compliance):
    """By Dahl's law 1968, dz = (1 - z sign(dm)) dm / r, of which no column is."""
    here, true = prepared().situation, "hardening@a3,stiffness_ratio=1.5,torque_nm=40"
    place = 0 if where == "base" else here.axis(where) + 1
    across = here.seat[:, place, :, :2]
    moment = np.einsum("rij,ri->rj", across, here.moment[:, place])
    held = np.zeros_like(moment)
    for j in range(2):
        path = moment[:, j][here.steps]
        slip, z = 0.2 * np.ptp(path, axis=1).max(), np.zeros(len(path))
        states = [z]
        for change in np.diff(path, axis=1).T:
            end = np.sign(change)
            z = end + (z - end) * np.exp(-np.abs(change) / slip)
            states.append(z)
        held[:, j] = here.from_steps(slip * np.stack(states, axis=1))
    lags = np.einsum("rij,rj->ri", across, compliance * (moment - held))
    law = rotate(place, lags[:, :, None], here.origin[:, place])
    laws = (*GEAR, Hysteresis(), Creep(), BaseCompliance(), BearingTilt())
    made = moved_by(EffectJacobian(1, (law,)), np.ones(1), true)
    found = diagnose(made, arm(), laws)
    local = {"base": "base_compliance"}.get(where, "bearing_tilt")
    assert {("hardening", "a3")} <= set(names(found))
    assert set(names(found)) <= {("hardening", "a3"), (local, where)}
    assert found.unexplained_places[0].where == where
    assert "history" in found.unexplained_places[0].depends_on


@pytest.mark.parametrize(
    ("true", "block", "share"),
    [
        ("transmission_error@a2,amplitude_rad=4e-4,order=1.5", ("a2", "angle"), 0.2),
        ("drift@base,x_m_per_h=2e-4,rz_rad_per_h=5e-5", ("base", "time"), 0.02),
    ],
)
def test_a_name_stands_before_a_generic_term_that_does_a_little_more(
    true, block, share
):
    """Many columns took the place of the law that is there, for a tenth more."""
    blocks = residual_map(prepared(true).situation)
    (more,) = (b.jacobian for b in blocks if (b.where, b.kind) == block)
    size = np.random.default_rng(1).normal(size=more.columns)
    made = moved_by(more, share * 4e-4 * size / np.linalg.norm(size), true)
    laws = (TransmissionError(), Hardening(), EncoderOffset(), Drift())
    found = diagnose(made, arm(), laws)
    effect, where = true.split(",")[0].split("@")
    (only,) = found.named
    alike = {only.name, *only.equivalents}
    assert Name(effect, where) in alike
    assert only.share is not None
    assert only.share > 0.8
    assert {one.where for one in found.unexplained_places} <= {where}


def test_a_generic_term_beyond_a_name_displaces_nothing_as_the_name_does():
    """Equation: A - B B^+ A, B the columns of a wave and their slopes by its order."""
    here, order, step = prepared().situation, 1.5, 1e-5

    def wave(order: float) -> ModelTerm:
        return ModelTerm(TransmissionError(), "a2", np.array([order]))

    def turns(law: EffectJacobian) -> np.ndarray:
        (part,) = (p for p in law.parts if isinstance(p, JointRotation))
        return part.law

    term = ModelTerm(GenericTerm("generic_angle", "angle", "angle"), "a2", np.zeros(0))
    high, low = (turns(wave(o).jacobian(here)) for o in (order + step, order - step))
    known = np.concatenate([(high + low) / 2, (high - low) / (2 * step)], axis=1)
    whole = turns(term.jacobian(here))
    left = turns(replace(term, beyond=(wave(order),)).jacobian(here))
    want = whole - known @ np.linalg.lstsq(known, whole)[0]
    assert_allclose(left, want, atol=1e-4)


def test_columns_that_a_name_spans_are_nothing_and_not_rounding():
    here = prepared().situation
    foot = ModelTerm(BaseCompliance(), "base", np.array([0.1])).jacobian(here)
    load = next(
        b for b in residual_map(here) if (b.where, b.kind) == ("base", "load")
    ).jacobian
    (part,) = orthogonal_to(load, foot).parts
    left = np.linalg.norm(values(part), axis=(0, 1))
    whole = np.linalg.norm(values(load.parts[0]), axis=(0, 1))
    share = left / whole
    assert np.any(share == 0.0)
    assert np.all((share == 0.0) | (share > 1e-6))


def test_the_set_comes_first_whatever_else_is_offered():
    """Of a generic term that is in the set whole, what a name leaves is no rival."""
    ready = prepared("transmission_error@a2")
    case = build_problem(ready, (TransmissionError(),))
    wave = ModelTerm(TransmissionError(), "a2", np.array([1.5]))
    term = ModelTerm(GenericTerm("generic_angle", "angle", "angle"), "a2", np.zeros(0))
    less = replace(term, beyond=(wave,))
    for own, other in ((term, less), (less, term)):
        found = Search.of(case, [own, wave, other]).terms[:3]
        assert found[0] is own
        assert found[1] is wave
        assert found[2] is not other


def test_a_generic_term_does_all_again_once_the_name_before_it_has_gone():
    wave = ModelTerm(TransmissionError(), "a2", np.array([1.5]))
    term = GenericTerm("generic_angle", "angle", "angle")
    rest = ModelTerm(term, "a2", np.zeros(0), (wave,))
    other = replace(wave, shape=np.array([1.6]))
    assert beyond_present_names([rest])[0].beyond == ()
    assert beyond_present_names([rest, other])[0].beyond == (other,)


def test_shares_of_open_places_are_together_no_more_than_all():
    def open_at(where: str, share: float) -> UnexplainedPlace:
        return UnexplainedPlace(where, 1e-3, share, ("time",))

    found = joined_places([open_at("a2", 0.8), open_at("a1", 0.6), open_at("a1", 0.6)])
    assert [place.where for place in found] == ["a1", "a2"]
    assert sum(place.share for place in found) == pytest.approx(1.0)
    few = joined_places([open_at("a2", 0.1), open_at("a1", 0.3)])
    assert [place.share for place in few] == [0.3, 0.1]
