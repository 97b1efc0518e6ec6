"""Arms that give way at their joints, read against files that state no stiffness."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import unstated_springs
from numpy.testing import assert_allclose
from small_bench import MODEL, arm, recording, relative

from bench.model_file import load, plain_mjcf
from bench.proof.proof import Proof, prove
from bench.shared.recording import Recording
from scenarios.pipelines.patching import patch_of_diagnosis
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.nominal_fit import Prepared, prepare
from stiffness.diagnosis.result import Diagnosis
from stiffness.effects.bearing_tilt import BearingTilt
from stiffness.effects.hysteresis import Hysteresis
from stiffness.effects.joint_compliance import JointCompliance
from stiffness.robot.arm import Arm

EFFECTS = ("hysteresis@a2", "bearing_tilt@a3")
LAWS = (Hysteresis(), BearingTilt(), JointCompliance())
SOFT = np.array([1.5, 0.7, 1.2, 0.8, 2.0, 0.5])
FORMATS = {"mjcf": unstated_springs.as_mjcf, "urdf": unstated_springs.as_urdf}


def read(file: Path) -> Arm:
    return Arm.from_mjcf_text(plain_mjcf(load(file)))


def named(found: Diagnosis) -> list[str]:
    return [f"{one.name.effect}@{one.name.where}" for one in found.named]


@cache
def loaded(*effects: str) -> Recording:
    return recording(*effects, poses=24, softness=tuple(SOFT))


@cache
def stated() -> Diagnosis:
    return diagnose(loaded(*EFFECTS), arm(), LAWS)


@cache
def proof_stated() -> Proof:
    patch = patch_of_diagnosis(stated(), loaded(*EFFECTS), arm())
    return prove(loaded(*EFFECTS), MODEL, patch, stated().held_out, thorough=False)


@pytest.fixture(scope="module", params=FORMATS)
def file(request: pytest.FixtureRequest, tmp_path_factory) -> Path:
    return FORMATS[request.param](MODEL, tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def rigid(tmp_path_factory) -> Arm:
    return read(unstated_springs.as_mjcf(MODEL, tmp_path_factory.mktemp("rigid")))


@pytest.fixture(scope="module")
def found(file: Path) -> Diagnosis:
    return diagnose(loaded(*EFFECTS), read(file), LAWS)


def test_names_and_sizes_are_those_of_a_model_with_springs(found):
    assert found.verdict == stated().verdict == "explained"
    assert named(found) == named(stated()) == list(EFFECTS)
    for one, other in zip(found.named, stated().named, strict=True):
        for name, size in one.parameters.items():
            assert_allclose(size.estimate, other.parameters[name].estimate, rtol=1e-4)


def test_proof_has_the_fitted_springs_in_both_arms(found, file):
    """The nominal arm too gives way: it misses by the effects alone."""
    patch = patch_of_diagnosis(found, loaded(*EFFECTS), read(file))
    proof = prove(loaded(*EFFECTS), file, patch, found.held_out, thorough=False)
    markers, other = proof.markers, proof_stated().markers
    assert markers is not None and other is not None
    assert markers.after < 1.1 * markers.noise < markers.before
    assert_allclose(markers.before, other.before, rtol=1e-3)
    springs = np.array(list(proof.patch.stiffness_nm_per_rad.values()))
    assert_allclose(springs / load(MODEL).jnt_stiffness, SOFT, rtol=0.04)


def within_errors(ready: Prepared) -> bool:
    true = 1.0 / (load(MODEL).jnt_stiffness * SOFT)
    assert np.all(ready.sigma < 0.02 * true)
    error = ready.situation.compliance - true
    return bool(np.all(np.abs(error) < 3.0 * ready.sigma))


def test_compliances_are_fitted_from_rigid_to_within_their_errors(file):
    ready = prepare(loaded(), read(file))
    assert within_errors(ready)
    assert ready.springs == (0, 1, 2, 3, 4, 5) and ready.blind == ()
    assert not ready.modelled.any()


def test_displacements_alone_give_the_same_compliances(rigid):
    assert within_errors(prepare(relative(loaded()), rigid))


def test_displacements_alone_give_the_same_names(rigid):
    moved = relative(loaded(*EFFECTS))
    assert named(diagnose(moved, rigid, LAWS)) == list(EFFECTS)


def test_it_is_said_which_compliances_are_nominal(rigid):
    [remark] = prepare(loaded(), rigid).warnings
    assert remark.code == "springs_fitted"
    assert remark.text == (
        "the model states no joint stiffness; a diagnosis fits compliances of all "
        "axes as nominal: a1, a2, a3, a4, a5, a6."
    )
    assert prepare(loaded(), arm()).warnings == ()


def test_axes_that_no_marker_shows_stay_rigid(rigid):
    """Markers up to link_3 alone: a4 to a6 turn none."""
    made = loaded()
    assert made.points is not None
    near = [m.body in ("base", "link_1", "link_2", "link_3") for m in made.markers]
    markers = tuple(m for m, keep in zip(made.markers, near, strict=True) if keep)
    made = replace(made, markers=markers, points=made.points[:, near])
    ready = prepare(made, rigid)
    assert ready.springs == (0, 1, 2) and ready.blind == (3, 4, 5)
    assert not ready.situation.compliance[3:].any()
    assert ready.warnings[0].text.endswith("3 of 6 axes as nominal: a1, a2, a3.")


def test_axis_that_is_stiff_is_seen_to_be(rigid):
    """A thousandth of the compliance of the others is within the error of none."""
    stiff = recording(poses=20, softness=(*SOFT[:2], 1e3, *SOFT[3:]))
    ready = prepare(stiff, rigid)
    assert ready.blind == ()
    assert abs(ready.situation.compliance[2]) < 5.0 * ready.sigma[2]


def test_where_some_springs_are_stated_a_zero_claims_rigidity():
    stiffness = arm().stiffness.copy()
    stiffness[1] = 0.0
    ready = prepare(loaded(), replace(arm(), stiffness=stiffness))
    assert ready.springs == (0, 2, 3, 4, 5) and ready.warnings == ()
    assert JointCompliance().places(ready.situation) == ("a2",)


def test_without_a_measured_load_a_rigid_model_stays_rigid(rigid):
    made = loaded()
    first = np.unique(made.visit, return_index=True)[1]
    ready = prepare(replace(made.take(first), wrench=None), rigid)
    assert ready.springs == ready.warnings == ()
    assert not ready.situation.compliance.any()


def test_load_that_turns_no_axis_leaves_all_rigid_and_says_so(rigid):
    ready = prepare(recording(poses=8, softness=(1e6,)), rigid)
    assert ready.springs == ready.blind == ()
    assert "all stay rigid" in ready.warnings[0].text


def test_diagnosis_says_what_is_nominal_and_calls_the_model_rigid(found):
    said = [(warned.code, warned.where) for warned in found.warnings]
    assert said == [("springs_fitted", "arm")]
    assert found.nominal is not None and not found.nominal.modelled.any()


def test_error_of_a_compliance_counts_what_was_named_beside_it(found):
    """The tilt of a3 moves markers nearly as a1 does."""
    assert found.nominal is not None
    true = 1.0 / (load(MODEL).jnt_stiffness * SOFT)
    error = np.abs(found.nominal.compliance - true)
    assert np.all(error < 2.5 * found.nominal.sigma)
    assert np.all(found.nominal.sigma < 0.03 * true)
    alone = prepare(loaded(*EFFECTS), arm()).sigma
    assert found.nominal.sigma[0] > 1.3 * alone[0]
