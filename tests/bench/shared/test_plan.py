"""A plan says when each row is read, what hangs on the hook and since when."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.shared.errors import Unusable
from bench.shared.plan import (
    DEFAULT_PATH,
    LoadStep,
    Plan,
    evenly_spaced,
    mixed_pulleys,
    parse_path,
    repeated,
)
from bench.shared.recording import STAGES

masses = st.sampled_from((0.0, 1.0, 2.5, 10.0)) | st.floats(0, 50)
steps = st.builds(LoadStep, masses, st.floats(0, 1000))
paths = st.lists(steps, max_size=9).map(lambda rest: (LoadStep(0.0, 1.0), *rest))


def plan_of(visits=3, **changes):
    """Return a plan over made-up postures of a two-axis arm."""
    parts = {
        "name": "test",
        "posture": np.arange(2.0 * visits).reshape(visits, 2),
        "posture_id": np.arange(visits),
        "pulley": mixed_pulleys(visits),
    }
    return Plan(**(parts | changes))


def test_the_default_path_is_read_at_the_times_that_a_clock_would_show():
    plan = plan_of(2, move_time=10.0)
    first = np.array([20, 40, 60, 80, 100, 220, 240, 260, 280], dtype=float)
    changed = np.array([0, 20, 40, 60, 80, 80, 220, 240, 260], dtype=float)
    np.testing.assert_allclose(plan.time, [*first, *(first + 290)], rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        plan.load_time, [*changed, *(changed + 290)], rtol=0, atol=1e-9
    )


def test_the_default_path_goes_up_waits_and_comes_down():
    plan = plan_of(2)
    once = ["unloaded", "loading", "loading", "loading", "loaded", "loaded"]
    once += ["unloading", "unloading", "unloaded"]
    assert plan.stage.tolist() == once * 2
    assert plan.row_mass.tolist() == [0, 2.5, 5, 7.5, 10, 10, 5, 2.5, 0] * 2
    assert plan.row_visit.tolist() == [0] * 9 + [1] * 9


def test_the_stage_follows_the_last_change_of_mass():
    plan = plan_of(1, path=parse_path("0,4,4,2,2,3,5,5,3,4,0,1"))
    assert plan.stage.tolist() == [
        "unloaded", "loading", "loading", "unloading", "unloading", "loading",
        "loaded", "loaded", "unloading", "loading", "unloaded", "loading",
    ]  # fmt: skip


def test_a_path_without_any_mass_is_unloaded_throughout():
    assert set(plan_of(2, path=parse_path("0,0,0")).stage) == {"unloaded"}


@given(paths, st.integers(1, 5), st.floats(0, 100))
def test_time_never_decreases_and_no_load_changes_after_it_is_read(path, visits, move):
    plan = plan_of(visits, path=path, move_time=move)
    assert (np.diff(plan.time) >= 0).all()
    assert (plan.load_time <= plan.time).all()
    assert (np.diff(plan.load_time) >= 0).all()
    shape = (plan.rows,)
    rows = (plan.time, plan.load_time, plan.stage, plan.row_mass, plan.row_visit)
    assert {row.shape for row in rows} == {shape}
    assert set(plan.stage) <= set(STAGES)


@given(paths)
def test_equal_masses_in_succession_do_not_change_the_load(path):
    plan = plan_of(1, path=path)
    same = np.diff(plan.row_mass) == 0
    np.testing.assert_array_equal(np.diff(plan.load_time)[same], 0.0)
    np.testing.assert_array_equal(plan.load_time[1:][~same], plan.time[:-1][~same])


@given(st.integers(1, 30), st.data())
def test_repeated_visits_are_appended_and_differ_in_nothing_but_time(visits, data):
    count = data.draw(st.integers(0, visits))
    plan = plan_of(visits)
    again = repeated(plan, count)
    assert again.visits == visits + count
    np.testing.assert_array_equal(again.posture[:visits], plan.posture)
    extra = again.posture_id[visits:]
    assert len(set(extra.tolist())) == count
    np.testing.assert_array_equal(again.posture[visits:], plan.posture[extra])
    np.testing.assert_array_equal(again.pulley[visits:], plan.pulley[extra])


def test_more_repeats_than_visits_are_refused():
    with pytest.raises(Unusable, match="4 visits to repeat, expected 0 to 3"):
        repeated(plan_of(3), 4)


@given(st.integers(1, 400), st.data())
def test_evenly_spaced_indices_differ_and_keep_to_the_total(total, data):
    count = data.draw(st.integers(1, total))
    indices = evenly_spaced(total, count)
    assert len(set(indices.tolist())) == count
    assert indices.min() == 0 and indices.max() <= total - 1
    assert count == 1 or indices.max() == total - 1


def test_the_pulley_place_is_the_golden_ratio_of_the_docstring():
    assert mixed_pulleys(6, 6).tolist() == [
        int(6 * ((visit * 0.6180339887498949) % 1.0)) for visit in range(6)
    ]
    with pytest.raises(Unusable, match="at least 1"):
        mixed_pulleys(5, 0)


def test_a_path_is_read_with_its_own_holds():
    assert parse_path(" 0, 5,10@120 ,0", hold=8.0) == (
        LoadStep(0.0, 8.0),
        LoadStep(5.0, 8.0),
        LoadStep(10.0, 120.0),
        LoadStep(0.0, 8.0),
    )


def test_a_written_default_path_is_the_default_path():
    assert parse_path("0,2.5,5,7.5,10,10@120,5,2.5,0") == DEFAULT_PATH


def test_a_faulty_path_names_every_faulty_step_and_shows_a_right_one():
    with pytest.raises(Unusable, match="5 or 10@120") as refused:
        parse_path("0,five,,10@soon,-3,nan")
    assert len(refused.value.faults) == 5
    assert "step 2 is 'five'" in str(refused.value)
    assert "step 5: mass is -3.0 kg" in str(refused.value)


@pytest.mark.parametrize("text", ["5,10,0", "10"])
def test_a_path_that_starts_loaded_is_refused_with_advice(text):
    with pytest.raises(Unusable, match="start with 0 kg"):
        parse_path(text)


FAULTY_PLAN = """
import numpy as np
from bench.shared.plan import Plan
posture = np.array([[0.0, 1.0], [np.nan, 0.0], [0.0, 0.0]])
Plan("p", posture, np.arange(2), np.array([0, -1, 0]), path=(), move_time=-1.0)
"""


def test_a_faulty_plan_names_all_its_faults():
    """In a fresh process, for in the tests jaxtyping refuses the shapes first."""
    run = subprocess.run(
        [sys.executable, "-c", FAULTY_PLAN], check=False, capture_output=True, text=True
    )
    assert "Unusable: Plan 'p' cannot be used, 5 faults" in run.stderr
    for words in (
        "no step",
        "visits [1]",
        "posture_id has shape",
        "pulley",
        "move_time",
    ):
        assert words in run.stderr


def test_two_postures_under_one_pose_id_are_refused():
    with pytest.raises(Unusable, match="pose 1 names two different postures"):
        plan_of(3, posture_id=np.array([0, 1, 1]))


def test_the_plan_does_not_load_the_simulator():
    code = "import sys, bench.shared.plan; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
