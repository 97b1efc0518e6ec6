from dataclasses import replace

import numpy as np
import pytest
from small_bench import MODEL, arm, prepared

from bench.effects.parse import parse_all
from bench.equilibrium import GearStates
from bench.experiment import record
from bench.instruments import Instruments, Markers
from bench.patch import Patch, PatchEffect, rig_of
from bench.proof.proof import prove
from bench.proof.setup import replay_simulation_of
from bench.rig import Rig
from bench.shared.errors import BenchError
from bench.standard_plans import table_one_plan
from scenarios.pipelines.patching import memory_of, patch_of_diagnosis
from scenarios.studies.damage import in_another_order
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.nominal_fit import with_noise
from stiffness.diagnosis.result import Name, NamedEffect
from stiffness.effects.jacobian import BodyTwist
from stiffness.effects.residual_map import residual_map
from stiffness.experiment.visits import BEFORE, NOTHING, UNKNOWN


@pytest.mark.parametrize(
    ("said", "parameter", "size"),
    [
        ("hysteresis@a3,width_rad=2e-4", "width_rad", 2e-4),
        ("creep@a2,ratio=0.1,time_s=40", "ratio", 0.1),
    ],
)
def test_effect_whose_state_lasts_from_visit_to_visit_is_named(said, parameter, size):
    """Every visit begins as the one before ended; without that both had no name."""
    rig = Rig(MODEL)
    rig = Rig(MODEL, effects=parse_all((said,), rig.nominal))
    flange, plan = Instruments(markers=Markers("flange")), table_one_plan(poses=24)
    recording = record(rig, plan, flange, seed=1, memory="carried")
    nominal = arm().for_recording(recording)
    found = diagnose(recording, nominal)
    assert found.verdict == "explained"
    (named,) = found.named
    assert f"{named.name.effect}@{named.name.where}" == said.split(",")[0]
    assert round(named.shape[1]) == BEFORE
    np.testing.assert_allclose(named.parameters[parameter].estimate, size, rtol=0.2)
    patch = patch_of_diagnosis(found, recording, nominal)
    assert patch.memory == "carried"
    assert set(patch.fitted) == {f"a{k}" for k in range(1, 7)}


def made_in_another_order(poses, seed):
    """Return what an arm with hysteresis@a2 did, visits told in another order."""
    rig = Rig(MODEL)
    said = "hysteresis@a2,width_rad=2e-4"
    rig = Rig(MODEL, effects=parse_all((said,), rig.nominal))
    flange, plan = Instruments(markers=Markers("flange")), table_one_plan(poses=poses)
    made = record(rig, plan, flange, seed=seed, memory="carried")
    return in_another_order(made, np.random.SeedSequence(seed))


def test_gear_that_arrives_in_a_state_nobody_knows_is_named_and_explained():
    recording = made_in_another_order(poses=24, seed=1)
    nominal = arm().for_recording(recording)
    found = diagnose(recording, nominal)
    assert found.verdict == "explained"
    (named,) = found.named
    assert str(named.name) == "hysteresis at a2"
    assert round(named.shape[1]) == UNKNOWN
    np.testing.assert_allclose(named.parameters["width_rad"].estimate, 2e-4, rtol=0.15)
    assert ("unknown_arrival", "a2") in [(w.code, w.where) for w in found.warnings]
    patch = patch_of_diagnosis(found, recording, nominal)
    assert patch.memories == {"a2": "unknown"}


def test_proof_counts_what_unknown_states_at_arrival_do_as_noise():
    recording = made_in_another_order(poses=60, seed=2)
    held = np.unique(recording.posture_id)[::4].tolist()
    effect = PatchEffect("hysteresis", "a2", {"width_rad": 2e-4})
    found = {}
    for kind in ("forgotten", "unknown"):
        patch = Patch(effects=(effect,), memories={"a2": kind})
        found[kind] = prove(recording, MODEL, patch, held, thorough=False).markers
    assert found["forgotten"].after > 1.3 * found["forgotten"].noise
    assert found["unknown"].after < found["forgotten"].after
    assert 0.9 < found["unknown"].after / found["unknown"].noise < 1.1


def test_one_gear_arrives_as_is_said_and_others_as_they_do():
    said = ("hysteresis@a2,width_rad=2e-4", "hysteresis@a3,width_rad=2e-4")
    both = Rig(MODEL, effects=parse_all(said, Rig(MODEL).nominal))
    posture = np.radians([[0, -90, 90, 0, 0, 0], [20, -60, 60, 0, 30, 0]])
    pull, hold = np.zeros((2, 3, 6)), np.ones((2, 3))
    pull[:, 1, 2] = -100.0
    told, found = both.respond(posture, pull, hold), {}
    for s in (-1, 1):
        initial = GearStates(
            {name: np.full(2, float(s)) for name in both.slipping["a2"]}
        )
        found[s] = both.respond(posture, pull, hold, initial=initial)
    moved = (found[1].axis_angle - found[-1].axis_angle).reshape(2, 3, 6)[:, 0]
    assert np.all(np.abs(moved[:, 1]) > 1e-4)
    assert np.all(np.abs(moved[:, 2]) < 1e-6)
    beside = (found[1].axis_angle - told.axis_angle).reshape(2, 3, 6)[0, 0, 2]
    assert abs(beside) < 1e-6


def test_axis_of_a_patch_that_the_arm_lacks_is_refused():
    with pytest.raises(BenchError, match="no axis is called 'a9'"):
        rig_of(Patch(memories={"a9": "unknown"}), MODEL)


@pytest.mark.parametrize("said", [("carried", {}), ("forgotten", {"a2": "carried"})])
def test_proof_lets_each_gear_remember_what_the_patch_says(said):
    """Of two gears one remembers, and both do."""
    effects = (
        PatchEffect("hysteresis", "a2", {"width_rad": 2e-4}),
        PatchEffect("hysteresis", "a3", {"width_rad": 2e-4}),
    )
    patch = Patch(effects=effects, memory=said[0], memories=said[1])
    flange, plan = Instruments(markers=Markers("flange")), table_one_plan(poses=12)
    recording = record(Rig(MODEL), plan, flange, seed=3)
    rig = rig_of(patch, MODEL)
    simulation = replay_simulation_of(recording, rig).remembering(patch)
    both = simulation.states(rig)
    in_turn = simulation.responded(rig, in_turn=True)
    fresh = simulation.responded(rig)
    angle = {k: (1, 2)[k == "a3"] for k in ("a2", "a3")}
    for axis, k in angle.items():
        carries = said[1].get(axis, said[0]) == "carried"
        like = (in_turn if carries else fresh).axis_angle[:, k]
        other = (fresh if carries else in_turn).axis_angle[:, k]
        np.testing.assert_allclose(both.axis_angle[:, k], like, rtol=0, atol=2e-6)
        assert np.abs(both.axis_angle[:, k] - other).max() > 2e-5


def test_unknown_states_at_arrival_are_asked_for_by_how_likely_readings_become():
    """Against the square once their turns are among the errors of the wrench."""
    ready = prepared()
    at, random = ready.situation, np.random.default_rng(2)
    turns = 1e-5 * random.normal(size=(at.rows, 2))
    about = replace(ready, situation=at.with_unknown({1: turns}))
    without, more = (with_noise(one, 1.0).data.within for one in (ready, about))
    laid = ready.data.visits.gather(turns)
    rows = laid.shape[1]
    on = without.rotation_information[:, rows : 2 * rows, rows : 2 * rows]
    inner = np.eye(2) + laid.swapaxes(1, 2) @ on @ laid
    each = (without.square - more.square - np.linalg.slogdet(inner)[1]) / 2.0
    for asked in (np.arange(len(laid)), np.arange(0, len(laid), 3)):
        found = without.log_bayes_of(1, laid, asked)
        np.testing.assert_allclose(found, np.sum(each[asked]), rtol=1e-6)


@pytest.mark.parametrize(
    ("shares", "memory"),
    [((0.2, 0.001), "forgotten"), ((0.001, 0.2), "carried"), ((), "forgotten")],
)
def test_one_memory_of_all_gears_is_that_of_what_explains_most(shares, memory):
    named = [
        NamedEffect(Name("hysteresis", "a2"), 1.0, (), {}, (10.0, float(NOTHING))),
        NamedEffect(Name("creep", "a1"), 1.0, (), {}, (30.0, float(BEFORE))),
        NamedEffect(Name("hardening", "a1"), 1.0, (), {}, (30.0,)),
    ]
    of = [replace(one, share=share) for one, share in zip(named, shares, strict=False)]
    assert memory_of(of or named)[0] == memory
    assert memory_of(named[1:]) == ("carried", {})
    kinds = {"a2": "forgotten", "a1": "carried"}
    others = {axis: kind for axis, kind in kinds.items() if kind != memory}
    assert memory_of(of or named)[1] == others


@pytest.mark.parametrize("carries", [True, False])
def test_foot_that_slips_is_one_of_the_maps_own_states(carries):
    """Where each visit begins as the one before ended, or at rest."""
    here = prepared().situation
    path = here.moment[here.steps, 0]
    limit, state, last = 0.15 * np.ptp(path[..., 1]), np.zeros(3), path[0, 0]
    held = np.zeros_like(path)
    for visit, row in np.ndindex(path.shape[:2]):
        if row == 0 and not carries:
            state, last = np.zeros(3), path[visit, 0]
        state, last = state + path[visit, row] - last, path[visit, row]
        state = state * min(1.0, limit / max(np.linalg.norm(state), 1e-12))
        held[visit, row] = state
    turned = np.stack([here.from_steps(one) for one in np.moveaxis(held, 2, 0)])
    left = {}
    for block in residual_map(here):
        if block.where == "base" and block.depends_on == "history":
            (part,) = block.jacobian.parts
            assert isinstance(part, BodyTwist)
            columns = part.twist[:, 3:].reshape(-1, block.jacobian.columns)
            told = columns @ np.linalg.lstsq(columns, turned.T.ravel())[0]
            left[block.kind] = np.sum((turned.T.ravel() - told) ** 2)
    own, other = ("memory", "friction") if carries else ("friction", "memory")
    assert left[own] < 0.2 * np.sum(turned**2)
    assert left[own] < 0.4 * left[other]


def test_foot_carries_nothing_over_visits_that_are_missing():
    here = prepared().situation
    apart = replace(here.recording, visit=2 * here.recording.visit)
    blocks = residual_map(replace(here, recording=apart))
    lost = {b.kind for b in residual_map(here)} - {b.kind for b in blocks}
    assert lost == {"memory"}
