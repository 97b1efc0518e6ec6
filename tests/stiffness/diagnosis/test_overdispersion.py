"""What no law of an axis explains still shows, and where it is one mark's, is its."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_bench import FEW, MODEL, arm, prepared, recording

from bench.effects.hysteresis import Hysteresis as Loop
from bench.experiment import record
from bench.instruments import ForceSensor, Instruments, Markers, Tracker
from bench.rig import Rig
from bench.shared.recording import Recording
from bench.standard_plans import table_one_plan
from stiffness.diagnosis.detection import MEASURED, SCATTERED, scatter_of
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.relinearisation import build_problem
from stiffness.diagnosis.result import Diagnosis
from stiffness.effects.marker_slip import MarkerSlip

SAG = 8e-5
"""Of a mark under its own weight, in m."""


def sagging(made: Recording, name: str) -> Recording:
    """Let a mark sit on a soft stalk: it sags along gravity, softest along its x."""
    k = [marker.name for marker in made.markers].index(name)
    turn = arm().at(made.posture).turn(made.markers[k].body)
    down = np.einsum("rji,j->ri", turn, [0.0, 0.0, -1.0])
    moved = np.einsum("rij,rj->ri", turn, down * [SAG, SAG / 2, 0.0])
    assert made.points is not None
    points = made.points.copy()
    points[:, k] += moved @ prepared().frames.transform[:3, :3]
    return replace(made, points=points)


@cache
def unloaded() -> Recording:
    """Four marks on the flange, one row in each of 80 poses."""
    watch = Instruments(markers=Markers("flange"))
    whole = record(Rig(MODEL), table_one_plan(poses=80), watch, seed=2)
    rest = whole.take(np.unique(whole.visit, return_index=True)[1])
    return replace(rest, wrench=None, wrench_sensor=None, load_mass=None)


@cache
def diagnosed() -> Diagnosis:
    return diagnose(sagging(recording(), "flange_b"), arm(), FEW)


def test_readings_of_a_nominal_arm_scatter_by_their_errors():
    case = build_problem(prepared(), FEW)
    found = scatter_of(case.data, case.dispersion_limit)
    assert abs(found.dispersion - 1.0) < 0.1
    assert found.p_value(SCATTERED) > 0.5


def test_a_mark_that_sags_is_a_mismatch_at_that_mark_and_has_no_name():
    found = diagnosed()
    assert found.verdict == "unexplained"
    assert found.named == ()
    assert found.unexplained is not None
    assert found.unexplained.where == "marker:flange_b"
    assert "against its body" in found.unexplained.signature
    assert found.located[0].where == "marker:flange_b"


def test_a_marker_alone_goes_where_its_body_goes():
    """What is left of it is the arm's, or the tracker's."""
    made = sagging(recording(), "flange_b")
    k = [marker.name for marker in made.markers].index("flange_b")
    assert made.points is not None
    alone = replace(made, markers=(made.markers[k],), points=made.points[:, [k]])
    case = build_problem(prepare(alone, arm()), FEW)
    found = scatter_of(case.data, case.dispersion_limit)
    assert found.markers[0].excess > 0.0
    assert found.marker is None


def test_few_poses_do_not_tell_scatter_from_chance():
    made = recording()
    some = made.take(np.flatnonzero(made.posture_id < np.unique(made.posture_id)[15]))
    case = build_problem(prepare(some, arm()), FEW)
    assert scatter_of(case.data, case.dispersion_limit).p_value(SCATTERED) > 0.5


@pytest.mark.parametrize("factor", [1.0, 2.0])
def test_marks_of_one_body_measure_the_noise_where_each_pose_has_one_row(factor):
    made = unloaded()
    assert made.points is not None and made.tracker is not None
    noise = np.random.default_rng(5).normal(size=made.points.shape)
    sigma = made.tracker.repeatability * np.sqrt(factor**2 - 1.0)
    ready = prepare(replace(made, points=made.points + sigma * noise), arm())
    assert_allclose(ready.noise, factor, rtol=0.1)
    assert build_problem(ready, FEW).dispersion_limit == MEASURED


def test_a_mark_that_sags_is_not_taken_for_noise_of_the_tracker():
    ready = prepare(sagging(unloaded(), "flange_b"), arm())
    assert_allclose(ready.noise, 1.0, rtol=0.15)


@pytest.mark.parametrize(("stated", "frames"), [(True, 1), (False, 1), (True, 100)])
def test_readings_without_any_noise_are_named_to_what_a_tracker_resolves(
    stated, frames
):
    """As of another simulator; what lever arms leave out is no finding."""
    rig = Rig(MODEL, (Loop("a2"),))
    exact = Instruments(
        Tracker(noise=0.0, field=0.0, occlusions=0.0, frames=frames),
        ForceSensor(noise=0.0, turn=0.0, size=0.0, resolution=(0.0, 0.0)),
        markers=Markers(placement=5e-4),
    )
    seen = record(rig, table_one_plan(poses=20), exact, seed=1)
    assert seen.tracker is not None
    seen = replace(seen, tracker=replace(seen.tracker, is_stated=stated))
    found = diagnose(seen, arm(), FEW)
    assert [(n.name.effect, n.name.where) for n in found.named] == [
        ("hysteresis", "a2")
    ]
    assert found.verdict == "explained"
    text = f"{1e-4 * frames**0.5:.3g} mm or less"
    assert (text in found.warnings[0].text) == stated


# --- Marks that wander ----------------------------------------------------------------

WANDER = 1e-5
"""One sigma of a coordinate, in m."""


def wandering(made: Recording) -> Recording:
    """Let all marks wander each by itself, alike for a quarter of all the time."""
    rng = np.random.default_rng(3)
    assert made.points is not None
    _, first, visit = np.unique(made.visit, return_index=True, return_inverse=True)
    time = made.time[first]
    like = np.exp(-np.abs(time[:, None] - time) / (0.25 * np.ptp(time)))
    root = WANDER * np.linalg.cholesky(like + 1e-9 * np.eye(len(time)))
    points = made.points.copy()
    for m in range(len(made.markers)):
        points[:, m] += (root @ rng.normal(size=(len(time), 3)))[visit]
    return replace(made, points=points)


def slipped(made: Recording, mark: int, sag: float = 0.0) -> Recording:
    """Let a mark slip after a third of the time, at once or over a share of it."""
    assert made.points is not None
    points = made.points.copy()
    span = np.ptp(made.time)
    since = np.maximum(made.time - made.time.min() - span / 3.0, 0.0)
    law = 1.0 - np.exp(-since / (sag * span)) if sag else (since > 0.0).astype(float)
    points[:, mark] += law[:, None] * [4e-5, -3e-5, 2e-5]
    return replace(made, points=points)


def wander(made: Recording) -> np.ndarray:
    return np.sqrt(np.array(prepare(made, arm()).frames.wander))


def test_marks_of_a_nominal_arm_do_not_wander():
    assert not np.any(wander(recording()))


@pytest.mark.parametrize("sag", [0.0, 0.1, 0.4])
def test_a_mark_that_slips_or_sags_does_not_wander(sag):
    assert not np.any(wander(slipped(recording(), 1, sag)))


def test_no_course_is_asked_for_where_all_is_read_at_one_time():
    made = wandering(recording())
    assert not np.any(wander(replace(made, time=np.zeros_like(made.time))))


def test_marks_that_wander_are_found_with_the_size_of_it():
    found = wander(wandering(recording()))
    assert np.all(found > 0.0)
    assert 0.4 < np.median(found) / WANDER < 1.6


def test_no_slip_is_told_of_marks_that_wander():
    found = diagnose(wandering(recording()), arm(), (*FEW, MarkerSlip()))
    every = len(recording().markers)
    assert "marker_slip" not in {n.name.effect for n in found.named}
    told = [w for w in found.warnings if w.code == "wandering_marks"]
    assert len(told) == 1
    assert f"{every} of {every} marks" in told[0].text


def test_slip_of_a_mark_that_stays_where_it_is_after_it_is_told():
    found = diagnose(slipped(recording(), 1), arm(), (*FEW, MarkerSlip()))
    name = recording().markers[1].name
    assert [(n.name.effect, n.name.where) for n in found.named] == [
        ("marker_slip", f"marker:{name}")
    ]
