import json
import re
from functools import partial

import numpy as np
import pytest
from study_material import LAWS

from bench.rig import Rig
from bench.shared.plan import LoadStep
from bench.standard_plans import table_one_plan as table_one
from bench.study_arm import default_truth
from scenarios.benchmark import Settings, main
from scenarios.report import data_files
from scenarios.report.command_line import run as command
from scenarios.studies.benchmarks import tasks
from scenarios.studies.benchmarks.race import Lap, Race, Way, run, runs, show
from scenarios.studies.benchmarks.tasks import damped_stepping, flange
from stiffness.effects import HYPOTHESES

COLUMNS = [
    *("task", "way", "median_s", "least_s", "most_s", "cpu_s"),
    *("ratio", "ratio_low", "ratio_high", "rounds", "share_run"),
    *("differs_from_ours", "bar_s"),
]


# --- The race ------------------------------------------------------------------------


def test_ways_run_in_turn_and_each_once_before():
    """A B A B, so that a slow minute of the machine hits both."""
    order, ticks = [], []
    ways = tuple(Way(n, lambda n=n: order.append(n)) for n in "ab")
    race = Race("t", ways, rounds=2)
    run(race, 3, lambda: ticks.append(1))
    assert "".join(order) == "ab" * 7
    assert len(ticks) == runs(race, 3) == 14


def test_ratio_is_of_the_same_round_and_a_share_is_scaled_up(monkeypatch):
    clock = iter([0, 1, 1, 3, 10, 12, 12, 18])  # ours 1 and 2 s, the other 2 and 6 s
    monkeypatch.setattr("time.perf_counter", lambda: float(next(clock)))
    monkeypatch.setattr("time.process_time", lambda: 0.0)
    ways = (Way("ours", int), Way("other", int, share=0.1))
    ours, other = run(Race("t", ways, lambda *_: "nothing", bar=9.0), 2, int)
    np.testing.assert_allclose(ours.wall, [1, 2])
    np.testing.assert_allclose(other.wall, [20, 60])
    np.testing.assert_allclose(other.ratio, [20, 30])
    assert other.row["ratio"] == 25.0  # the median of the docstring's equation
    assert (other.row["ratio_low"], other.row["ratio_high"]) == (20.0, 30.0)
    assert (ours.bar, other.bar) == (9.0, None)
    assert (ours.difference, other.difference) == ("", "nothing")


@pytest.mark.parametrize(
    ("wall", "cpu", "said"),
    [
        (0.5, 0.9, "bar 1 s: kept"),
        (3.0, 0.9, "over under this load"),
        (3.0, 2.0, "bar 1 s: missed"),
    ],
)
def test_bar_that_is_missed_is_said_to_be_missed(capsys, wall, cpu, said):
    one = np.ones(1)
    show([Lap("t", "ours", 1.0, wall * one, cpu * one, one, "", 1.0)], ["a line"])
    printed = " ".join(re.sub("[│┃\n]", " ", capsys.readouterr().out).split())
    assert said.split()[-1] in printed
    assert "left out: a line" in printed


# --- The ways come to the same answer ------------------------------------------------


@pytest.mark.slow
def test_damped_stepping_comes_to_the_rest_of_the_experiment(kr10):
    """Within 1 µm, with all effects of the default truth and creep by the clock."""
    truth, plan = default_truth(), table_one(2, (LoadStep(0.0), LoadStep(10.0)))
    rig = Rig(kr10, truth.effects, truth.stiffness)
    stepped = damped_stepping(rig, plan, 5e-3)
    np.testing.assert_allclose(stepped, flange(rig, plan), rtol=0, atol=1e-6)
    loaded, unloaded = stepped[:, 1], stepped[:, 0]
    assert np.linalg.norm(loaded - unloaded, axis=1).min() > 1e-4


def test_pinocchios_loop_answers_what_the_source_domain_answers():
    race = tasks.source_race(postures=50)
    ours, other = (way.run() for way in race.ways)
    assert ours.shape == (250, 3)
    assert np.abs(ours).max() > 1e-4
    np.testing.assert_allclose(other, ours, rtol=0, atol=1e-12)


def test_every_optimiser_finds_the_springs_of_the_vjm():
    """Within a third of a sigma: the VJM also weighs the force sensor's noise."""
    race = tasks.springs_race(poses=30)
    fitted, *others = (way.run() for way in race.ways)
    assert len(others) == 3 - len(race.skipped)
    for other in others:
        for parameter, found in zip(fitted.stiffness, other, strict=True):
            assert abs(found - parameter.value) < parameter.sigma / 3


# --- The scenario --------------------------------------------------------------------


@pytest.mark.slow
def test_benchmark_writes_ratios_of_every_task_with_their_range(
    tmp_path, capsys, monkeypatch
):
    short = tasks.diagnosis_race
    monkeypatch.setattr(tasks, "diagnosis_race", lambda _: short(poses=2))
    among_few = partial(tasks.diagnose, hypotheses=LAWS)
    monkeypatch.setattr(tasks, "diagnose", among_few)
    brief = (LoadStep(0.0, 1.0), LoadStep(10.0, 1.0))
    monkeypatch.setattr(tasks, "TWO_READINGS", brief)
    laps = main(Settings(out=tmp_path, repeats=1, poses=6))
    rows = data_files.read_table(tmp_path / "benchmark.csv")
    assert list(rows[0]) == COLUMNS
    assert len(rows) == len(laps)
    named = [row["task"].partition(":")[0] for row in rows]
    begun = ["experiment", "source domain", "fit", "write a recording"]
    every = [*begun, "read a recording", "diagnosis"]
    assert list(dict.fromkeys(named)) == every
    for row in rows:
        low, middle, high = (float(row[f"ratio{e}"]) for e in ("_low", "", "_high"))
        assert 0.0 < low <= middle <= high
        assert row["bar_s"] == ""  # bars are for the whole experiment
    report = (tmp_path / "report.md").read_text()
    assert all(row["way"] in report for row in rows)
    assert (tmp_path / "report.html").read_text().count("data:image/png") == 1
    facts = json.loads((tmp_path / "run.json").read_text())
    assert facts["cores"] >= 1
    assert facts["load"] >= 0.0
    assert "times ours" in capsys.readouterr().out


def test_diagnosis_is_weighed_against_one_simulation_of_each_hypothesis():
    ours, other, longer = tasks.diagnosis_race(poses=2).ways
    assert (ours.share, other.share) == (1.0, 1 / len(HYPOTHESES))
    assert longer.share == tasks.LONGER  # seconds for each of so many are compared
    assert other.run().position.shape[0] == 18  # two postures of nine readings


def test_impossible_flags_end_with_2_and_leave_nothing(tmp_path, monkeypatch, capsys):
    words = ["benchmark", "--out", str(tmp_path / "b"), "--repeats", "0"]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as end:
        command(main, Settings)
    assert end.value.code == 2
    assert "--repeats 0" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
