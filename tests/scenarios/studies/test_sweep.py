import importlib
import os
import re
import signal
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from bench.shared.errors import BenchError, Unusable
from scenarios.studies import sweep
from scenarios.studies.sweep import DEATHS, Rows, Task, run

TASKS = [Task(f"task-{k}", k) for k in range(6)]


def solved(k, matrix):
    """Return numbers whose last bits tell how they were computed."""
    draw = np.random.default_rng(k)
    left = np.linalg.solve(matrix + np.diag(draw.uniform(size=len(matrix))), matrix)
    return (left @ left.T).sum(axis=0).tobytes()


def dies_once(mark, _shared):
    """End the worker at the first try, return at the second."""
    if not os.path.exists(mark):
        Path(mark).touch()
        os._exit(1)
    return f"{Path(mark).name} at the second try"


def dies(_argument, _shared):
    os._exit(1)


def noted(mark, seconds):
    """Say which worker begins a task, and take some time."""
    with open(mark, "a", encoding="utf-8") as file:
        file.write(f"{os.getpid()}\n")
    time.sleep(seconds)
    return Path(mark).name


def refuses(_argument, _shared):
    """Raise an error that does not go through a pipe as it is."""
    raise Unusable("This task", ["it cannot be done."])


@pytest.fixture(scope="module")
def matrix():
    return np.random.default_rng(0).normal(size=(150, 150)) + 30.0 * np.eye(150)


@pytest.fixture(scope="module")
def expected(matrix):
    """Results of one process."""
    return dict(run(solved, TASKS, matrix, jobs=1))


# --- This machine ---------------------------------------------------------------------


def test_results_of_two_processes_are_those_of_one_to_the_last_bit(expected, matrix):
    assert dict(run(solved, TASKS, matrix, jobs=2)) == expected
    assert list(expected) == [task.key for task in TASKS]  # one begins in order


def test_task_of_a_worker_that_died_is_worked_again(tmp_path):
    marks = [Task(name, str(tmp_path / name)) for name in ("a", "b")]
    (tmp_path / "b").touch()
    assert dict(run(dies_once, marks, jobs=2)) == {
        name: f"{name} at the second try" for name in ("a", "b")
    }


def test_task_that_ends_worker_after_worker_ends_the_sweep():
    with pytest.raises(BenchError, match=f"task-0 ended {DEATHS} workers"):
        list(run(dies, TASKS[:1], jobs=1))


def test_error_that_is_for_people_comes_back_with_its_words():
    with pytest.raises(BenchError, match="it cannot be done"):
        list(run(refuses, TASKS[:1], jobs=1))


@pytest.mark.parametrize("scheduler", ["", "dask", "dask:", "slurm:x", "local:x"])
def test_scheduler_that_there_is_not_is_refused_with_those_that_are(scheduler):
    with pytest.raises(Unusable, match=r"expected local, dask:ADDRESS or ray:ADDRESS"):
        list(run(solved, TASKS, scheduler=scheduler))


@pytest.mark.parametrize(
    ("threads", "code", "said"),
    [("2", None, "OMP_NUM_THREADS=1"), ("1", "other", "other code")],
)
def test_worker_that_would_give_other_bits_refuses(threads, code, said, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", threads)
    code = code or sweep.fingerprint()
    assert said in sweep._worked(refuses, 0, None, code).refusal


# --- Clusters -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def cluster():
    """A Dask cluster of two processes, each on one core."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as made:
        yield made


@pytest.mark.slow
def test_results_of_a_dask_cluster_are_those_of_one_process(expected, matrix, cluster):
    found = run(solved, TASKS, matrix, f"dask:{cluster.scheduler_address}")
    assert dict(found) == expected


@pytest.mark.slow
def test_killed_dask_worker_loses_one_task(cluster, tmp_path):
    tasks = [Task(f"t{k}", str(tmp_path / f"t{k}")) for k in range(6)]
    found = {}
    for key, result in run(noted, tasks, 0.3, f"dask:{cluster.scheduler_address}"):
        if not found:  # the first is done: another is being worked
            begun = [f for f in tmp_path.iterdir() if f.name != key]
            os.kill(int(begun[0].read_text()), signal.SIGKILL)
        found[key] = result
    assert found == {task.key: task.key for task in tasks}
    tries = [len(re.findall("\n", f.read_text())) for f in tmp_path.iterdir()]
    assert sum(tries) == len(tasks) + 1


@pytest.mark.slow
def test_results_of_ray_are_those_of_one_process(expected, matrix, monkeypatch):
    ray = pytest.importorskip("ray")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))  # workers find us
    made = importlib.import_module("ray.cluster_utils").Cluster(
        initialize_head=True, head_node_args={"num_cpus": 2}
    )
    try:
        assert dict(run(solved, TASKS, matrix, f"ray:{made.address}")) == expected
        assert not ray.is_initialized()
    finally:
        made.shutdown()


# --- Kept rows ------------------------------------------------------------------------


def test_rows_of_two_machines_merge_by_copying_their_files(tmp_path):
    one, other = Rows(tmp_path / "one"), Rows(tmp_path / "other")
    one.writer(["a", "b"])({"key": "a", "x": [1.5, float("nan")], "seconds": 1.0})
    append = other.writer(["b", "c"])
    append({"key": "b", "x": []})
    append({"key": "a", "x": [1.5, float("nan")], "seconds": 2.0})  # took longer
    for file in other.folder.iterdir():
        file.rename(one.folder / file.name)
    assert sorted(one.read()) == ["a", "b"]


def test_rows_that_differ_are_refused_with_their_places(tmp_path):
    rows = Rows(tmp_path)
    rows.writer(["a"])({"key": "a", "x": 1.0})
    rows.writer(["a", "b"])({"key": "a", "x": 1.0 + 1e-15})
    with pytest.raises(Unusable, match=r"jsonl, line 1: results of a differ"):
        rows.read()


def test_row_that_was_cut_off_is_left_out_and_written_again(tmp_path):
    rows = Rows(tmp_path)
    rows.writer(["a"])({"key": "a"})
    (file,) = tmp_path.iterdir()
    with file.open("a", encoding="utf-8") as out:
        out.write('{"key":"b"')
    assert list(rows.read()) == ["a"]
    rows.writer(["a"])({"key": "b"})
    assert sorted(rows.read()) == ["a", "b"]


def test_line_that_is_no_row_is_named(tmp_path):
    lines = '{"key":"a"}', "{}", "[" * 100_000, "7", ""
    (tmp_path / "x.jsonl").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(Unusable, match=r"line 2: .*\n.*line 3: .*\n.*line 4:"):
        Rows(tmp_path).read()
