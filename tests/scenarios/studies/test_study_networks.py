import importlib
import os
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from study_material import (
    POSES,
    Careless,
    Mean,
    Misshapen,
    small_experiment,
)
from typing_extensions import override

from bench import standard_plans
from bench.postures import Room
from bench.shared.errors import Unusable
from scenarios.studies.paper import imitation, transfer
from scenarios.studies.paper.budget import budget
from scenarios.studies.paper.cells import (
    Cell,
    CellResult,
    Spread,
    _Shared,
    _worked,
    results,
)
from scenarios.studies.paper.comparison import MEASURES, p99, pooled
from scenarios.studies.paper.experiment import GRID, fresh_postures
from scenarios.studies.paper.imitation import of_doubling
from scenarios.studies.paper.playback import curves, worst_poses
from scenarios.studies.paper.transfer import OwnMethod, checked
from stiffness.methods.method import faults
from stiffness.methods.vjm import Vjm
from stiffness.networks.model import Mlp

TINY = budget("tiny", 0)


@pytest.fixture(scope="module")
def small():
    return small_experiment()


@pytest.fixture(scope="module")
def experiment(small):
    return small[0]


@pytest.fixture(scope="module")
def material(small):
    return small[1]


# --- Steps of training ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("test_mae_mm", "said"),
    [
        ((0.5, 0.3, 0.1), "not even 10 are enough: 20 move the test MAE by -0.2000 mm"),
        ((0.5, 0.3, 0.295), "10 are enough: 20 move the test MAE by -0.0050 mm"),
        ((0.3, 0.3, 0.3), "5 are enough: 10 move the test MAE by +0.0000 mm"),
        ((0.3, 0.3, 0.1), "not even 10 are enough"),
    ],
)
def test_steps_are_enough_where_no_later_doubling_moves_more_than_the_seeds(
    test_mae_mm, said
):
    longer = {
        steps: [imitation.Imitation(Mlp(4, 8), "table 5", steps, s) for s in (0, 1)]
        for steps in (5, 10, 20)
    }
    found: dict[Cell, CellResult] = {
        cell: {"errors": np.full((2, 3, 3), mae + 0.01 * cell.seed)}
        for cells, mae in zip(longer.values(), test_mae_mm, strict=True)
        for cell in cells
    }
    assert of_doubling(longer, found).startswith(said)


# --- Cells ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Counted(Cell):
    """Notes in a file that it was worked, and may be interrupted."""

    number: int
    log: str

    @property
    @override
    def cost(self) -> float:
        return 1.0

    @override
    def work(self, material, scratch):
        with Path(self.log).open("a") as log:
            log.write(f"{self.number}\n")
        if Path(self.log).with_suffix(f".stop{self.number}").exists():
            raise KeyboardInterrupt
        return {"square": np.array(self.number**2)}


@dataclass(frozen=True)
class Beside(Cell):
    """Reads a file beside its scratch, and says where and by whom it was worked."""

    name: str
    home: str

    @property
    @override
    def cost(self) -> float:
        return 1.0

    @override
    def work(self, material, scratch):
        scratch.touch()
        content = int((scratch.parent / self.name).read_text())
        at_home = scratch.parent == Path(self.home)
        found = {"content": content, "at_home": at_home, "process": os.getpid()}
        return {name: np.array(value) for name, value in found.items()}


def test_interrupted_sweep_goes_on_and_ends_with_the_same_numbers(material, tmp_path):
    log, stop = tmp_path / "log", tmp_path / "log.stop2"
    cells = [Counted(k, str(log)) for k in range(4)]
    stop.touch()
    with pytest.raises(KeyboardInterrupt):
        results(cells, material, Spread(tmp_path / "cells", jobs=0))
    stop.unlink()
    found = results(cells, material, Spread(tmp_path / "cells", jobs=0))
    assert [int(r["square"]) for r in found] == [0, 1, 4, 9]
    assert log.read_text().split() == ["0", "1", "2", "2", "3"]


@pytest.mark.slow
def test_cell_of_a_worker_is_the_same_and_is_written_by_the_sweep_alone(
    material, tmp_path
):
    """A worker of a cluster has files it needs beside it, not those of the sweep."""
    cells = [Beside("known", str(tmp_path))]
    (tmp_path / "known").write_text("7")
    spread = Spread(tmp_path, jobs=1, attached=("known",))
    (here,) = results(cells, material, spread)
    shared = _Shared(material, None, {"known": b"7"})
    there = _worked((cells[0], "name"), shared)
    assert (here["content"], there["content"]) == (7, 7)
    assert (here["at_home"], there["at_home"]) == (1, 0)
    assert here["process"] != there["process"] == os.getpid()
    names = {file.name.partition("-")[0] for file in tmp_path.iterdir()}
    assert names == {"known", "beside"}


def test_damaged_cell_is_worked_again(material, tmp_path):
    cells = [Counted(3, str(tmp_path / "log"))]
    results(cells, material, Spread(tmp_path / "cells", jobs=0))
    next((tmp_path / "cells").glob("counted-*.npz")).write_bytes(b"PK\x03\x04 cut")
    assert (
        int(results(cells, material, Spread(tmp_path / "cells", jobs=0))[0]["square"])
        == 9
    )


def test_cells_of_other_data_are_not_taken(material, tmp_path):
    log = tmp_path / "log"
    cells = [Counted(1, str(log))]
    results(cells, material, Spread(tmp_path / "cells", jobs=0))
    wrench = material.recording.wrench * (1.0 + 1e-15)
    other = replace(material, recording=replace(material.recording, wrench=wrench))
    results(cells, other, Spread(tmp_path / "cells", jobs=0))
    assert len(log.read_text().split()) == 2


def test_every_cell_of_a_budget_is_worked_once():
    for name in ("tiny", "quick", "full"):
        spent = budget(name, 3)
        cells = [*transfer.cells(spent, None), *imitation.cells(spent, 3)]
        assert len(set(cells)) == len(cells)
    full = budget("full", 0)
    assert len(full.transfer.seeds) == 5
    assert len(full.sweep.seeds) == full.transfer.unfreezing_seeds == 3
    assert full.sweep.widths == tuple(range(40, 401, 20))


# --- Judges ---------------------------------------------------------------------------


def test_poses_are_held_out_whole(material):
    out = material.held_out(0)
    kept = np.unique(material.training(0).posture_id)
    assert not set(out) & set(kept)
    assert set(out) | set(kept) == set(np.unique(material.recording.posture_id))
    assert len(out) == round(0.2 * POSES)
    assert set(out) != set(material.held_out(1))


def test_fresh_postures_lie_in_the_experiments_region_and_in_none_of_its_poses(
    experiment,
):
    posture = fresh_postures(experiment.rig, 40, 5)
    table_1 = standard_plans.table_one_postures()
    slack = 1e-9 + np.deg2rad([0.0, 0.0, 3.0, 0.0, 0.5, 0.0])  # inside the grid's box
    assert np.all(posture >= table_1.min(axis=0) - slack)
    assert np.all(posture <= table_1.max(axis=0) + slack)
    apart = np.abs(posture[:, None] - table_1).max(axis=2)
    assert apart.min() > 1e-4
    rig = experiment.rig
    assert Room(rig.nominal, rig.anatomy, rig.mounted)(posture).all()
    place = experiment.arm.placements(posture, ["flange"])[-24:, 0, :3, 3]
    assert np.all((place > GRID[:, 0] - 1e-6) & (place < GRID[:, 1] + 1e-6))


def test_what_is_right_on_fresh_poses_holds_no_noise(experiment, material):
    """Springs alone: springs fitted without noise predict silent readings exactly."""
    moved = np.linalg.norm(material.unseen.deflection, axis=1)
    assert np.all(moved > 1e-5)
    again = material.unseen.cases.wrench_in_base[:, :3]
    np.testing.assert_allclose(np.linalg.norm(again, axis=1), 98.1, rtol=2e-3)


# --- Intervals ------------------------------------------------------------------------


@given(st.integers(0, 1000))
def test_interval_over_seeds_and_poses_holds_the_value(seed):
    error = np.random.default_rng(seed).standard_normal((3, 60))
    for name in ("MAE", "STDE_signed", "STDE_absolute"):
        interval = pooled(error, MEASURES[name], resamples=200).interval
        assert interval.low < interval.estimate < interval.high


def test_pooled_value_is_the_mean_over_seeds():
    error = np.array([[1.0, -1.0], [3.0, -3.0]])
    draws = pooled(error, MEASURES["MAE"])
    assert draws.value == 2.0
    assert draws.interval.low == 1.0
    assert draws.interval.high == 3.0
    assert draws.change_from(draws).interval.high == 0.0


def test_way_from_top_to_bottom_is_one_at_the_bottom():
    top, middle, bottom = (
        pooled(size * np.ones((1, 5)), MEASURES["MAE"]) for size in (3.0, 2.0, 1.0)
    )
    assert [d.way(top, bottom).value for d in (top, middle, bottom)] == [0.0, 0.5, 1.0]


@given(st.integers(2, 300))
def test_99th_percentile_leaves_at_most_one_in_a_hundred_above(count):
    error = np.random.default_rng(count).standard_normal(count)
    found = float(p99(error, np.ones(count)))
    assert np.mean(np.abs(error) > found) <= 0.01
    assert np.mean(np.abs(error) >= found) >= 0.01


def test_worst_poses_come_in_the_order_of_the_methods_largest_error():
    error = np.zeros((12, 3))
    error[:4, 1] = [0.1, -0.4, 0.2, 0.3]
    shown = {"vjm": 9.0 * error[::-1], "ft_mlp": error, "dt_cnn": 0.5 * error}
    np.testing.assert_array_equal(worst_poses(shown), [1, 3, 2, 0, *range(4, 10)])


def test_only_networks_have_training_curves():
    cell = transfer.cells(TINY, None)[0]
    assert curves(cell, {}) == []


# --- A method of one's own ------------------------------------------------------------


def test_springs_keep_to_the_contract(experiment):
    arm, recording = experiment.arm, experiment.recording
    assert faults(Vjm(arm), arm, recording) == []


def test_careless_method_is_told_every_fault(experiment):
    arm, recording = experiment.arm, experiment.recording
    told = " ".join(faults(Careless(arm), arm, recording))
    for fault in ("changes the method", "what else is asked", "fix the seed"):
        assert fault in told
    misshapen = faults(Misshapen(arm), arm, recording)
    assert "expected (" in misshapen[0]


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("study_material", "names no class"),
        ("no_such_module:A", "cannot be imported"),
        ("study_material:Missing", "has no class 'Missing'"),
        ("study_material:NOT_A_CLASS", "has no class"),
        ("study_material:Experiment", "does not derive"),
    ],
)
def test_method_that_cannot_be_taken_is_refused_with_what_is_expected(name, what):
    with pytest.raises(Unusable, match=what) as refused:
        OwnMethod.named(name)
    assert "package.module:Class" in str(refused.value)


def test_method_that_breaks_the_contract_is_refused_before_the_study_runs(experiment):
    own = OwnMethod.named("study_material:Misshapen")
    with pytest.raises(Unusable, match="shape"):
        checked(own, experiment.arm, experiment.recording)
    checked(
        OwnMethod.named(f"study_material:{Mean.__name__}"),
        experiment.arm,
        experiment.recording,
    )


def test_readmes_method_and_its_check_run_as_they_stand(
    experiment, root, tmp_path, monkeypatch
):
    manual = (root / "stiffness" / "README.md").read_text("utf-8")
    blocks = re.findall(r"```python\n(.*?)```", manual, re.S)
    method, check = (
        next(b for b in blocks if word in b)
        for word in ("class Scaled(Method)", "import faults")
    )
    (tmp_path / "my_method.py").write_text(method)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(
        "scenarios.studies.paper.experiment.carry_out", lambda **_: experiment
    )
    (tmp_path / "check_it.py").write_text(check)
    importlib.import_module("check_it")  # ends with an assertion
    own = OwnMethod.named("my_method:Scaled")
    checked(own, experiment.arm, experiment.recording)
