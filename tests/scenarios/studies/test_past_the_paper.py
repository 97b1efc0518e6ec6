from dataclasses import replace

import numpy as np
import pytest
from study_material import POSES, few_effects, few_laws, small_experiment

from bench.shared.errors import NotIdentifiable
from bench.study_arm import default_truth
from scenarios import floor, how_many_poses, wrench_plan
from scenarios.report import data_files
from scenarios.studies.paper import experiment as paper_experiment
from scenarios.studies.paper import wrench_plan as paper_wrench_plan
from scenarios.studies.paper.budget import Effort, budget
from scenarios.studies.paper.comparison import BARS
from scenarios.studies.paper.experiment import Material, carry_out
from scenarios.studies.paper.few_poses import few_of, springs_of
from scenarios.studies.paper.floor import (
    NUDGE,
    NudgeCell,
    magnitudes,
    nudged,
    oracle_error,
)
from scenarios.studies.paper.wrench_plan import APART, both, nearest, pulled_elsewhere
from stiffness.experiment.deflections import every_plateau
from stiffness.methods.vjm import Vjm
from stiffness.networks.training import Training

TRANSFER = budget("tiny", 0).transfer
EFFORT = Effort(TRANSFER.shape, 10, 5, Training(steps=5), 4, every=80)


@pytest.fixture(scope="module", autouse=True)
def _laws():
    with few_laws():
        yield


@pytest.fixture(scope="module")
def small():
    return small_experiment()


@pytest.fixture(scope="module")
def experiment(small):
    return small[0]


@pytest.fixture(scope="module")
def material(small):
    return small[1]


@pytest.mark.slow
def test_how_many_poses_runs_small(experiment, tmp_path, monkeypatch):
    monkeypatch.setattr(paper_experiment, "carry_out", lambda *_: experiment)
    settings = how_many_poses.Settings(
        tmp_path, (8, 16), 2, 1, 10, jobs=0, poses=POSES, effort=EFFORT
    )
    rows = how_many_poses.main(settings)
    draws = {r["method"]: r["draws"] for r in rows}
    assert draws == {
        "vjm": 2, "gp_residual": 2, "named_physics": 2,
        "ft_mlp": 1, "dt_cnn": 1, "named_physics_all": 1,
    }  # fmt: skip
    mae = {
        r["method"]: float(str(r["value_mm"]))
        for r in rows
        if (r["poses"], r["metric"]) == (16, "MAE")
    }
    assert mae["named_physics"] < 0.5 * mae["vjm"]
    assert (tmp_path / "how_many_poses.png").exists()
    assert (tmp_path / "report.html").exists()


@pytest.mark.slow
def test_wrench_plan_runs_small(experiment, tmp_path, monkeypatch):
    monkeypatch.setattr(paper_experiment, "carry_out", lambda *_: experiment)
    settings = wrench_plan.Settings(
        tmp_path,
        unseen=12,
        seeds=(0, 2),
        seeds_of_table_5=(0,),
        jobs=0,
        poses=POSES,
        effort=replace(TRANSFER, epochs=3),
    )
    monkeypatch.setattr(
        Material,
        "held_out",
        lambda material, _: np.unique(material.recording.posture_id)[:8],
    )  # whose other 32 show every spring
    rows = wrench_plan.main(settings)
    assert {r["loads"] for r in rows} == set(paper_wrench_plan.LOADS)
    assert {"named physics", "named physics, all markers"} < {r["method"] for r in rows}
    assert (tmp_path / "wrench_plan.png").exists()
    gains = data_files.read_table(tmp_path / "gains.csv")
    seeds = {(r["plan"], r["seeds"]) for r in gains}
    assert seeds == {("table 5", "0"), ("spanning", "0 2")}
    assert {r["metric"] for r in gains if r["bar_percent"]} == set(BARS)
    assert "of these 12 gains" in (tmp_path / "report.md").read_text()


MEASURES = ("share_of_the_way", "ME_mm", "P99_mm")


@pytest.mark.slow
def test_floor_runs_small(experiment, tmp_path, monkeypatch):
    monkeypatch.setattr(paper_experiment, "carry_out", lambda *_: experiment)
    settings = floor.Settings(
        tmp_path, 10, jobs=0, poses=POSES, known=1, effort=TRANSFER
    )
    with few_effects():
        rows = {r["method"]: r for r in floor.main(settings)}
    assert rows["oracle"]["share_of_the_way"] == 1.0
    assert rows["VJM"]["share_of_the_way"] == 0.0
    named = {key: float(str(rows["named physics"][key])) for key in MEASURES}
    assert named["share_of_the_way"] > 0.5
    assert named["ME_mm"] >= named["P99_mm"]
    assert (tmp_path / "floor.png").exists()


# --- Few poses ------------------------------------------------------------------------


def test_poses_of_fewer_are_the_first_of_more(material):
    few, more = (few_of(material.recording, n, 3) for n in (5, 12))
    assert len(np.unique(few.posture_id)) == 5
    assert set(few.posture_id) < set(more.posture_id)


def test_only_axes_that_few_poses_do_not_show_are_held():
    """Of the arm with all its effects."""
    experiment = carry_out(0, POSES)
    few = few_of(experiment.recording, 5, 0)
    _springs, held = springs_of(experiment.arm, few)
    assert held
    with pytest.raises(NotIdentifiable) as refusal:
        Vjm(experiment.arm, held[1:]).fit(few)
    assert held[0] in refusal.value.axes
    all_poses = springs_of(experiment.arm, experiment.recording)
    assert all_poses[1] == ()
    free = Vjm(experiment.arm).fit(experiment.recording)
    np.testing.assert_array_equal(all_poses[0].compliance, free.compliance)


# --- Other directions -----------------------------------------------------------------


def test_loads_elsewhere_pull_in_no_direction_of_the_experiment(experiment, material):
    other = pulled_elsewhere(experiment, material.unseen, 0)
    used = experiment.measured.cases.wrench_in_base[:, :3]
    force = other.cases.wrench_in_base[:, :3]
    assert nearest(force, used).min() > APART
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), 98.1, rtol=1e-12)
    joined = both(material.unseen, other)
    assert len(joined.cases) == 2 * len(other.cases)
    np.testing.assert_array_equal(
        joined.deflection[len(other.cases) :], other.deflection
    )


def test_springs_know_what_loads_elsewhere_do(experiment, material):
    """Truth and springs agree within a third: wrench, point and sign are right."""
    other = pulled_elsewhere(experiment, material.unseen, 0)
    springs = Vjm(experiment.arm).fit(experiment.recording)
    left = springs.predict(other.cases) - other.deflection
    assert np.abs(left).mean() < 0.33 * np.abs(other.deflection).mean()


# --- The oracle -----------------------------------------------------------------------


def test_nudge_changes_one_size_and_nothing_else():
    still = default_truth()
    known = magnitudes(still)
    assert len(known) == 48
    stiffer = nudged(2)
    np.testing.assert_allclose(
        stiffer.stiffness / still.stiffness, [1, 1, 1 + NUDGE, 1, 1, 1]
    )
    assert stiffer.effects == still.effects
    more = nudged(len(known) - 1)
    changed = [a != b for a, b in zip(more.effects, still.effects, strict=True)]
    assert sum(changed) == 1


def test_oracle_without_noise_makes_no_error():
    draw = np.random.default_rng(0)
    still = {"experiment": draw.random((9, 3)), "unseen": draw.random((4, 3))}
    moved = [{k: v + NUDGE * draw.random(v.shape) for k, v in still.items()}] * 2
    np.testing.assert_array_equal(oracle_error(still, moved, np.zeros((9, 3))), 0.0)


def test_oracle_that_measures_one_size_wrong_errs_by_what_that_size_does():
    draw = np.random.default_rng(1)
    still = {"experiment": draw.random((9, 3)), "unseen": draw.random((4, 3))}
    slope = {k: draw.random(v.shape) for k, v in still.items()}
    moved = [{k: still[k] + NUDGE * slope[k] for k in still}]
    error = oracle_error(still, moved, 0.3 * slope["experiment"])
    np.testing.assert_allclose(error, 0.3 * slope["unseen"], rtol=1e-9)


@pytest.mark.slow
def test_truth_without_noise_is_what_the_instruments_scatter_about(material, tmp_path):
    with few_effects():
        still = NudgeCell(-1, POSES, 0).work(material, tmp_path)
    data = every_plateau(material.arm, material.recording)
    noise = 1e3 * data.deflection - still["experiment"]
    assert np.abs(noise).mean() < 0.012
    np.testing.assert_allclose(
        still["unseen"], 1e3 * material.unseen.deflection, atol=1e-6
    )
