"""Published trials are drawn again, whatever was registered since."""

import hashlib
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from bench.effects import EFFECTS, OTHER_LAWS
from bench.effects.drift import Drift
from bench.effects.encoder_offset import EncoderOffset
from bench.effects.lost_motion_smooth import SmoothLostMotion
from bench.experiment import record
from bench.instruments import Markers
from bench.instruments.random_streams import streams
from bench.instruments.tracker import STEADY
from bench.proof.simulation import replay_of
from bench.rig import Rig
from bench.shared.plan import DEFAULT_PATH
from bench.shared.recording import ASSUMED
from bench.standard_plans import table_one_plan, tour
from scenarios.studies.blind_trials import generation, oracle
from scenarios.studies.blind_trials.arms import (
    BUILDS,
    arm_text,
    draw_twins,
    draw_whole_arm,
    with_other_laws,
)
from scenarios.studies.blind_trials.effects import (
    Ground,
    draw_site_and_form,
    knees_of,
    turning,
)
from scenarios.studies.blind_trials.generation import (
    as_stated,
    kinds_of,
    pool_of,
    trial_of,
)
from scenarios.studies.blind_trials.strata import LIBRARY, STRATA, USUAL
from scenarios.studies.damage import (
    PAUSE,
    as_differences,
    in_another_order,
    with_axis_mistaken,
    with_outliers,
)
from stiffness.effects import HYPOTHESES

TRIALS, ATTEMPTS = 10, 5
"""Trials of each stratum, and draws of each: the fifth goes on to the next kind."""
PUBLISHED = {
    "null": "cb5c5bbe3a836d72",
    "null_nuisance": "0efd71658cf94502",
    "one_100": "6831e58f3046eb68",
    "one_400": "4983f797fc93d68f",
    "flange_400": "8c9dfa192f5807b3",
    "two_400": "57d2b8bd7fff0516",
    "outside": "d0b54b972cade575",
    "removed": "83c56fd5e83db7f8",
    "memory": "0f1cd3f2930c4ee3",
    "memory_blind": "e282eb03616176dc",
    "second_law": "9524a7eef64e821f",
    "one_45": "4dffa589b4203ed0",
    "arm_6": "9da8805101a808ec",
    "arm_6_outside": "381e1bd3e8edc45c",
    "arm_12": "1e9342bc4676ce25",
    "arm_12_outside": "11d47e80a51cd38b",
    "arm_all": "31cbae6be2a56df9",
    "arm_all_outside": "10ebdfd69f84ae5d",
    "flange_arm_6": "87d8e90f47c6b1e4",
    "flange_arm_6_outside": "6111e1dce8625fc4",
    "flange_arm_12": "f3108fe0426810de",
    "flange_arm_12_outside": "65e8503efe091c6d",
    "flange_arm_all": "caee68a5eae20352",
    "flange_arm_all_outside": "a3d4c3b60e7c4253",
    "alike_drift": "c819517bd9c673f4",
    "alike_mass": "411695a0c6c91d70",
    "alike_tilt": "82ab133c100e690e",
    "arm_6_other_laws": "427f679de0a63a34",
    "arm_12_other_laws": "d5e919c223b15e27",
    "arm_all_other_laws": "86d9987ddb7c699a",
    "flange_arm_6_other_laws": "f0d5aae012cb7e87",
    "flange_arm_12_other_laws": "390e2fcc18bd22bc",
    "flange_arm_all_other_laws": "05b31e5014558f97",
    "study_arm": "a75bd947d368b725",
}
"""Hash of what trials 0 to 9 of seed 0 draw, as published; never to be changed. Whole
arms with a mechanism outside the vocabulary, or with laws of other forms, have the arms
of the stratum without."""

ADDED = {
    ("Drift", "time_s"): STEADY,
    ("GravityCompensator", "free_length_ratio"): 0.0,
    ("GravityCompensator", "arm_ratio"): 0.5,
}
"""Parameters that effects got since, and their value that changes nothing."""


@dataclass(frozen=True)
class Registered(EncoderOffset):
    """An effect that is registered after the trials were published."""

    name: ClassVar[str] = "registered_later"


@pytest.fixture(scope="module")
def ground(kr10):
    """Sites and forms of the KR10 by the bodies that carry markers."""
    rig = Rig(kr10)
    covered = turning(rig.anatomy, tour(rig, 30, DEFAULT_PATH, 12, 0).posture)

    def of(targets):
        stuck = Markers(targets).stick(rig.nominal, rig.anatomy, streams(0))
        marks = [one.marker.name for one in stuck]
        return Ground(rig.anatomy, marks, 3600.0, knees_of(rig), covered)

    return {targets: of(targets) for targets in ("all", "flange")}


def number(value):
    return value if isinstance(value, str) else f"{value:.9g}"


def drawing(trial, ground):
    """Return in words all that a trial draws before any simulation."""
    chance = np.random.default_rng(trial.chance)
    lines = [trial.name, str(trial.seed), *map(number, trial.stiffness)]
    tracker, sensor = trial.instruments.tracker, trial.instruments.force_sensor
    lines += [repr(v) for v in (tracker.repeatability, tracker.field)]
    lines += [repr(v) for v in (tracker.occlusions, sensor.turn, sensor.size)]
    markers = trial.instruments.markers
    lines += [repr(v) for v in (trial.instruments.encoders.arrival, markers.targets)]
    lines.append(repr(markers.placement))
    here = ground[markers.targets]
    for attempt in range(ATTEMPTS):
        if trial.stratum.effects:
            effects = draw_whole_arm(trial.stratum, chance, here)
        elif trial.stratum.has_twin:
            (kind,) = kinds_of(trial, chance, attempt)
            effect, twin = draw_twins(kind, chance, here)
            effects = [effect]
            lines.append(twin)
        else:
            kinds = kinds_of(trial, chance, attempt)
            effects = [draw_site_and_form(kind, chance, here) for kind in kinds]
        for effect in effects:
            kind, sizes = type(effect).__name__, dict(effect.parameters())
            for name in [name for owner, name in ADDED if owner == kind]:
                assert sizes.pop(name) == ADDED[kind, name]
            said = " ".join(f"{k}={number(sizes[k])}" for k in sorted(sizes))
            lines.append(f"{kind}@{effect.where} {said}")
    return "\n".join(lines)


def drawn_again(stratum, ground):
    trials = [drawing(trial_of(0, stratum, k), ground) for k in range(TRIALS)]
    return hashlib.sha256("\n".join(trials).encode()).hexdigest()[:16]


@pytest.mark.parametrize("stratum", PUBLISHED)
def test_first_trials_of_a_stratum_are_the_published_ones(stratum, ground):
    assert drawn_again(stratum, ground) == PUBLISHED[stratum]


def test_noise_that_is_stated_changes_nothing_else_of_a_trial(kr10):
    true = trial_of(0, "one_mark", 3)
    seen = record(Rig(kr10), table_one_plan(poses=2), true.instruments, 0)
    sigma = {"": 1e-5, "_small": 1e-5 / 3, "_large": 3e-5, "_unstated": ASSUMED}
    for end, size in sigma.items():
        trial = trial_of(0, f"one_mark{end}", 3)
        assert trial.seed == true.seed
        assert np.array_equal(trial.stiffness, true.stiffness)
        assert trial.chance.spawn_key == true.chance.spawn_key
        made = as_stated(seen, trial.stratum)
        assert made.points is not None and made.tracker is not None
        assert len(made.markers) == 1 and made.points.shape[1] == 1
        np.testing.assert_allclose(made.tracker.repeatability, size)
        assert made.tracker.is_stated == (end != "_unstated")


def test_outliers_are_of_the_same_trials_and_one_in_a_thousand(kr10):
    true, trial = trial_of(0, "one_400", 3), trial_of(0, "outliers", 3)
    assert (trial.seed, trial.chance.spawn_key) == (true.seed, true.chance.spawn_key)
    seen = record(Rig(kr10), table_one_plan(poses=4), true.instruments, 0)
    assert seen.points is not None
    made, facts = with_outliers(seen, 0.01, np.random.SeedSequence(1))
    assert made.points is not None
    away = np.linalg.norm(made.points - seen.points, axis=2)
    rows, marks = np.nonzero(away > 0.0)
    sound = np.isfinite(seen.points).all(axis=2).sum()
    assert len(rows) == len(facts["outliers"]) == round(0.01 * sound)
    for row, mark, one in zip(rows, marks, facts["outliers"], strict=True):
        assert one["pose"] == seen.posture_id[row]
        assert one["marker"] == seen.markers[mark].name
        assert one["size_mm"] == pytest.approx(1e3 * away[row, mark])
        assert 1.0 <= one["size_mm"] <= 300.0


def test_an_axis_is_coupled_reversed_or_of_another_zero_and_said_which(kr10):
    watch, codes = trial_of(0, "null", 0).instruments, set()
    seen = record(Rig(kr10), table_one_plan(poses=4), watch, 0)
    for k in range(12):
        made, facts = with_axis_mistaken(
            seen, ("a2", "a3", "a5", "a6"), np.random.SeedSequence(k)
        )
        ((code, where),) = facts["mistake"].items()
        changed = np.any(made.posture != seen.posture, axis=0)
        assert np.flatnonzero(changed).tolist() == [int(where[1:]) - 1]
        codes.add(code)
    assert codes == {"axis_coupled", "axis_reversed", "axis_zero"}
    apart = as_differences(seen)
    assert apart.displacement == "relative" and apart.points is not None
    first = np.unique(apart.visit, return_index=True)[1]
    assert np.nanmax(np.abs(apart.points[first])) == 0.0


def test_visits_are_told_in_another_order_and_each_as_it_was(kr10):
    watch = trial_of(0, "null", 0).instruments
    seen = record(Rig(kr10), table_one_plan(poses=6), watch, 0)
    made = in_another_order(seen, np.random.SeedSequence(2))
    assert made.points is not None
    assert seen.points is not None
    assert np.unique(made.visit).tolist() == np.unique(seen.visit).tolist()
    came_from, end = [], -PAUSE
    for visit in np.unique(made.visit):
        now = np.flatnonzero(made.visit == visit)
        own = np.flatnonzero(
            (seen.posture == made.posture[now[0]]).all(axis=1)
            & (seen.posture_id == made.posture_id[now[0]])
        )
        came_from.append(int(seen.visit[own[0]]))
        np.testing.assert_array_equal(made.points[now], seen.points[own])
        later = made.time[now] - seen.time[own]
        np.testing.assert_allclose(later, later[0], atol=1e-9)
        np.testing.assert_allclose(
            made.load_time[now] - seen.load_time[own], later, atol=1e-9
        )
        assert made.load_time[now[0]] - end == pytest.approx(PAUSE)
        end = made.time[now[-1]]
    way = replay_of(made).way
    np.testing.assert_allclose(way[1:], PAUSE)
    assert sorted(came_from) == np.unique(seen.visit).tolist() != came_from
    assert not np.array_equal(made.moves.side, seen.moves.take(made.visit).side)


def test_strata_keep_their_order_and_new_ones_come_last():
    published = list(PUBLISHED)
    assert [name for name in STRATA if name in PUBLISHED] == published
    first = published.index("alike_tilt") + 1
    assert list(STRATA)[:first] == published[:first]


def test_every_stratum_that_is_not_tried_unless_asked_for_comes_after_the_usual():
    assert tuple(STRATA)[: len(USUAL)] == USUAL


def test_effect_that_is_registered_later_changes_no_published_trial(
    ground, monkeypatch
):
    for registry in ("EFFECTS", "OTHER_LAWS", "OUT_OF_LIBRARY_EFFECTS"):
        monkeypatch.setattr(
            generation, registry, (Registered, *getattr(generation, registry))
        )
    assert {s: drawn_again(s, ground) for s in PUBLISHED} == PUBLISHED


def test_hypothesis_that_is_registered_later_changes_no_size_outside_the_library(
    monkeypatch,
):
    """Sizes there follow from what the library's hypotheses leave unexplained."""
    later = SimpleNamespace(effect="registered_later")
    monkeypatch.setattr(oracle, "HYPOTHESES", (later, *HYPOTHESES))
    others = [h for h in HYPOTHESES if h.effect in LIBRARY and h.effect != "creep"]
    assert oracle.library(("creep",)) == others


def test_every_name_of_a_pool_has_a_mechanism_and_its_turn():
    known = {h.effect for h in HYPOTHESES}
    assert set(LIBRARY) <= known
    for stratum in STRATA.values():
        if stratum.least:
            assert [kind.name for kind in pool_of(stratum)] == list(stratum.pool)
    trials = [trial_of(0, "one_100", k) for k in range(len(EFFECTS))]
    turns = [kinds_of(t, np.random.default_rng(0), 0)[0].name for t in trials]
    assert set(turns) == set(STRATA["one_100"].pool)


@pytest.mark.parametrize(
    ("build", "published"),
    [
        ("six", "ae9fd5c6401f9a72"),
        ("seven", "6c422b1b077049c4"),
        ("column", "65ae4874f555817f"),
    ],
)
def test_arm_of_a_seed_is_the_published_one(build, published):
    text = arm_text(BUILDS[build], build, 0)
    assert hashlib.sha256(text.encode()).hexdigest()[:16] == published


def test_arms_with_laws_of_other_forms_have_the_same_names_and_sizes(ground):
    draw = np.random.default_rng(3)
    own = draw_whole_arm(STRATA["arm_all"], draw, ground["all"])
    own.append(Drift("tracker", 3e-5))
    other = with_other_laws(own, 1e3)
    assert [(e.name, e.where) for e in other] == [(e.name, e.where) for e in own]
    changed = {(type(a), type(b)) for a, b in zip(own, other, strict=True) if a != b}
    assert {type(e) for e in other} >= {*OTHER_LAWS} - {SmoothLostMotion}
    assert (Drift, Drift) in changed
    for one, its in zip(own, other, strict=True):
        if type(one) is not type(its):
            assert its.parameters() == one.parameters()
