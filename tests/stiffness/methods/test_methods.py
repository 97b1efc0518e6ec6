from dataclasses import fields, replace

import numpy as np
import pytest
from small_truth import HOOK, PLACES, permuted, postures, pulls, record

from bench.shared.errors import Unusable
from bench.shared.recording import Payload
from stiffness.experiment.deflections import every_plateau
from stiffness.methods import METHODS, Rigid
from stiffness.robot.arm import Arm

METHOD = pytest.mark.parametrize("method", METHODS, ids=lambda m: m.__name__)
IN_MM = 1000.0


@pytest.fixture(scope="module")
def arm(kr10):
    return Arm.from_mjcf(kr10)


def experiment(arm, seed, poses=30):
    """Springs of Table 3, a tool, noise."""
    return record(
        arm,
        postures(arm, poses, seed),
        pulls(poses, 2, seed + 1),
        noise=np.random.default_rng(seed + 2),
        tool=Payload(1.0, np.array([0.0, 0.01, 0.05])),
    )


@pytest.fixture(scope="module")
def recording(arm):
    return experiment(arm, seed=0)


def rms(error):
    return np.sqrt(np.mean(error**2))


@METHOD
def test_prediction_at_the_training_cases_is_finite(method, arm, recording):
    cases = every_plateau(arm, recording).cases
    predicted = method(arm).fit(recording).predict(cases)
    assert predicted.shape == (len(cases), 3)
    assert np.isfinite(predicted).all()


@METHOD
def test_method_beats_the_rigid_arm_on_poses_it_has_not_seen(method, arm, recording):
    unseen = every_plateau(arm, experiment(arm, seed=10))
    left = unseen.deflection - method(arm).fit(recording).predict(unseen.cases)
    if method is Rigid:
        np.testing.assert_array_equal(left, unseen.deflection)
    else:
        # springs are its own kind of truth: only the tracker's noise is left
        assert rms(left) < 0.02 * rms(unseen.deflection)


@METHOD
def test_fit_leaves_the_method_as_it_was(method, arm, recording):
    learner = method(arm)
    before = {f.name: getattr(learner, f.name) for f in fields(learner)}
    first = learner.fit(recording)
    assert {f.name: getattr(learner, f.name) for f in fields(learner)} == before
    assert learner.fit(recording).parameters == first.parameters


@METHOD
def test_order_of_visits_changes_nothing(method, arm, recording):
    cases = every_plateau(arm, recording).cases
    order = np.random.default_rng(3).permutation(30)
    shuffled = permuted(recording, order)
    predicted = method(arm).fit(recording).predict(cases)
    # sums in another order
    np.testing.assert_allclose(
        method(arm).fit(shuffled).predict(cases), predicted, rtol=1e-7, atol=1e-15
    )


def arm_in_mm(arm):
    """The same arm with lengths in mm and torques in N mm."""
    chain = arm.chain
    longer = np.ones((4, 4))
    longer[:3, 3] = IN_MM
    places = {
        name: replace(place, placement=place.placement * longer)
        for name, place in chain.places.items()
    }
    chain = replace(
        chain,
        before=chain.before * longer,
        centre=chain.centre * IN_MM,
        places=places,
    )
    return replace(arm, chain=chain, stiffness=arm.stiffness * IN_MM)


def recording_in_mm(recording):
    """The same recording with lengths in mm and torques in N mm."""
    longer = np.ones((4, 4))
    longer[:3, 3] = IN_MM
    sensor, tool = recording.wrench_sensor, recording.tool
    return replace(
        recording,
        points=recording.points * IN_MM,
        wrench=recording.wrench * np.repeat([1.0, IN_MM], 3),
        markers=tuple(
            replace(m, position=m.position * IN_MM) for m in recording.markers
        ),
        base_from_tracker=recording.base_from_tracker * longer,
        tracker=replace(
            recording.tracker, repeatability=recording.tracker.repeatability * IN_MM
        ),
        wrench_sensor=replace(
            sensor,
            position=sensor.position * IN_MM,
            accuracy_torque=sensor.accuracy_torque * IN_MM,
        ),
        tool=replace(tool, com=tool.com * IN_MM),
    )


@METHOD
def test_no_unit_of_length_is_hidden_in_a_method(method, arm, recording):
    cases = every_plateau(arm, recording).cases
    predicted = method(arm).fit(recording).predict(cases)
    other, longer = arm_in_mm(arm), recording_in_mm(recording)
    learnt = method(other).fit(longer)
    in_mm = learnt.predict(every_plateau(other, longer).cases)
    # the fit stops at 1e-4 of sigma
    np.testing.assert_allclose(in_mm, IN_MM * predicted, rtol=1e-5, atol=1e-7)


@METHOD
def test_posture_that_is_no_number_is_refused_by_name(method, arm, recording):
    posture = recording.posture.copy()
    posture[7, 2] = np.nan
    with pytest.raises(Unusable, match=r"'small truth'(?s:.*)axis a3.*row 7"):
        method(arm).fit(replace(recording, posture=posture))


@METHOD
def test_recording_of_another_arm_is_refused(method, arm, recording):
    other = replace(recording, posture=recording.posture[:, :5])
    with pytest.raises(Unusable, match="5 axes, the arm has 6"):
        method(arm).fit(other)


def test_every_method_says_its_equation_source_needs_and_assumptions():
    for method in METHODS:
        manual = __import__(method.__module__, fromlist=["x"]).__doc__
        rows = [line.split()[0] for line in manual.splitlines() if line[:1].isupper()]
        assert [r for r in rows if r in ("Equation", "Source", "Needs", "Assumes")] == [
            "Equation",
            "Source",
            "Needs",
            "Assumes",
        ]


def test_rigid_arm_has_nothing_to_tell(arm, recording):
    assert Rigid(arm).fit(recording).parameters == ()


def test_small_truth_pulls_and_watches_beside_the_last_axis():
    """Else axis 6 would not show in any test."""
    assert np.hypot(*HOOK[:2]) > 0.02
    assert np.hypot(*PLACES.mean(axis=0)[:2]) > 0.02
