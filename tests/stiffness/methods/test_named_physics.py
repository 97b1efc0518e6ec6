"""Named physics predicts what it named, and no more than the recording supports."""

from functools import cache

import numpy as np
import pytest
from small_bench import arm, recording
from small_truth import postures, pulls, record

from bench.shared.errors import NotIdentifiable
from stiffness.diagnosis.result import Diagnosis
from stiffness.experiment.deflections import every_plateau, one_per_pose
from stiffness.methods import named_physics
from stiffness.methods.method import faults
from stiffness.methods.named_physics import NamedPhysics, path_of, shrunken_fit
from stiffness.methods.vjm import Vjm

POSES = 20
TRUTH = ("hardening@a2,stiffness_ratio=1.8", "hysteresis@a3,width_rad=2e-4")


def part_of(made, poses):
    return made.take(np.flatnonzero(np.isin(made.posture_id, poses)))


@cache
def learnt():
    made = recording(*TRUTH)
    return NamedPhysics(arm()).fit(part_of(made, np.unique(made.posture_id)[:POSES]))


def errors(fitted):
    """Errors on poses that were not learnt from, first loads, in m."""
    made = recording(*TRUTH)
    unseen = one_per_pose(
        arm(), part_of(made, np.unique(made.posture_id)[POSES:]), None
    )
    return fitted.predict(unseen.cases) - unseen.deflection


def test_poses_not_learnt_from_are_predicted_far_better_than_by_springs():
    fitted = learnt()
    assert {e.name.effect for e in fitted.diagnosis.named} >= {"hardening"}
    named, springs = errors(fitted), errors(fitted.springs)
    assert np.sqrt(np.mean(named**2)) < 0.5 * np.sqrt(np.mean(springs**2))


def test_parameters_are_those_of_the_names_with_their_units():
    found = {p.name: p for p in learnt().parameters}
    width = found["hysteresis@a3 width_rad"]
    assert width.unit == "rad"
    assert width.low < width.value < width.high


def test_the_contract_of_methods_is_kept(monkeypatch):
    """Its diagnosis, which costs nine tenths of a fit, is made once."""
    made = recording(*TRUTH)
    few = part_of(made, np.unique(made.posture_id)[:POSES])
    monkeypatch.setattr(named_physics, "diagnose", lambda *_: learnt().diagnosis)
    assert faults(NamedPhysics(arm()), arm(), few) == []


def test_springs_predict_alone_where_nothing_differs_from_them():
    nominal = arm()
    made = record(
        nominal,
        postures(nominal, 12, 0),
        pulls(12, 2, 1),
        noise=np.random.default_rng(2),
    )
    fitted, springs = NamedPhysics(nominal).fit(made), Vjm(nominal).fit(made)
    assert fitted.diagnosis.verdict == "no_mismatch"
    assert fitted.mechanics is None
    cases = every_plateau(nominal, made).cases
    np.testing.assert_array_equal(fitted.predict(cases), springs.predict(cases))
    assert fitted.parameters == springs.parameters


def test_springs_predict_alone_where_the_set_up_is_mistaken(monkeypatch):
    stopped = Diagnosis("", "unexplained", learnt().diagnosis.detection)
    monkeypatch.setattr(named_physics, "diagnose", lambda *_: stopped)
    assert NamedPhysics(arm()).fit(recording(*TRUTH)).mechanics is None


def test_an_axis_that_no_load_turns_is_refused_by_name():
    nominal = arm()
    on_axis = np.array([0.0, 0.0, 0.06])
    made = record(nominal, postures(nominal, 20, 0), pulls(20, 2, 1), hook=on_axis)
    with pytest.raises(NotIdentifiable, match="'a6'"):
        NamedPhysics(nominal).fit(made)


def test_laws_without_a_name_go_where_poses_left_out_do_not_gain_by_them():
    made = recording(*TRUTH)
    few = part_of(made, np.unique(made.posture_id)[:POSES])
    names = learnt().diagnosis.named
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(named_physics, "diagnose", lambda *_: learnt().diagnosis)
        patch.setattr(named_physics, "_is_better", lambda *_: False)
        alone = NamedPhysics(arm()).fit(few)
    assert alone.mechanics is not None
    assert {t.name for t in alone.mechanics.terms} == {
        (e.name.effect, e.name.where) for e in names
    }


def test_a_load_is_put_on_in_the_recordings_own_steps_and_waits():
    path = path_of(recording(*TRUTH))
    np.testing.assert_allclose(path.share, [0.0, 0.25, 0.5, 0.75, 1.0], atol=2e-3)
    np.testing.assert_allclose(path.read - path.changed, 20.0)


# --- The shrunken fit -----------------------------------------------------------------


def normal(design, readings):
    return design.T @ design, design.T @ readings, float(readings @ readings)


def test_a_law_that_is_not_there_vanishes_and_one_that_is_stays():
    draw = np.random.default_rng(0)
    design = draw.standard_normal((400, 5))
    readings = design @ [3.0, 2.0, -1.0, 0.0, 0.0] + draw.standard_normal(400)
    gram, score, square = normal(design, readings)
    found = shrunken_fit(gram, score, np.array([-1, 0, 0, 1, 1]), square)
    np.testing.assert_allclose(found[:3], [3.0, 2.0, -1.0], atol=0.2)
    np.testing.assert_allclose(found[3:], 0.0, atol=1e-5)


def test_a_column_that_readings_hardly_see_stays_at_its_prior():
    """Scaled by itself it would be fitted to rounding: one gave 1e8 m."""
    draw = np.random.default_rng(1)
    design = draw.standard_normal((200, 3))
    design[:, 2] *= 1e-12
    readings = design @ [1.0, 1.0, 0.0] + draw.standard_normal(200)
    gram, score, square = normal(design, readings)
    found = shrunken_fit(gram, score, np.array([-1, 0, 0]), square)
    assert abs(found[2]) < 1e-6
