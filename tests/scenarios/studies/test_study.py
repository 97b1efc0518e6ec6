import csv
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from saved_view import entities, identity, still, timeline
from study_material import few_effects

from bench.shared.errors import Unusable
from scenarios.studies.paper import (
    TABLE_02_MM,
    TABLE_03_NM_PER_RAD,
    TABLE_10_MM,
)
from scenarios.studies.paper.budget import PLANS
from scenarios.study import Settings, main

COLUMNS_02 = [
    *("method", "direction", "metric", "value_mm", "low_mm", "high_mm"),
    *("paper_mm", "floor_mm", "n", "seeds", "plan"),
]
COLUMNS_03 = ["axis", "stiffness_nm_per_rad", "low", "high", "truth_secant", "paper"]
POSES = 40
OWN = "study_material:Mean"
LARGEST = 5_000_000
"""Bytes of a recording that is committed."""
TABLES = ("table_02.csv", "table_03.csv")


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """A small study, and the same again, killed and gone on; and what it found."""
    whole, resumed = (tmp_path_factory.mktemp("study") / n for n in ("one", "two"))
    kill_halfway(resumed)
    with mpl.rc_context({"savefig.dpi": 20}), few_effects():
        found = main(small(whole))
        main(small(resumed))
    return (whole, resumed), found


@pytest.fixture(scope="module")
def study(studied):
    """The folders of both."""
    return studied[0]


def kill_halfway(out: Path) -> None:
    """Begin the small study from the command line and end it by force."""
    words = f"--budget tiny --jobs 0 --seed 4 --method {OWN}".split()
    words += ["--poses", str(POSES), "--out", str(out)]
    root = Path(__file__).parents[3]
    paths = os.pathsep.join([str(root), str(root / "tests")])
    begun = subprocess.Popen(
        [sys.executable, "-m", "study_material", *words],
        cwd=root,
        env={**os.environ, "PYTHONPATH": paths},
    )
    while len(finished(out)) < 3 and begun.poll() is None:
        time.sleep(0.02)
    begun.kill()
    begun.wait()
    assert not (out / "report.md").exists()
    assert len(finished(out)) >= 3


def finished(out: Path) -> list[Path]:
    """Return the cells that are whole."""
    cells = (out / "cells").glob("*.npz")
    return [cell for cell in cells if ".training" not in cell.name]


def small(out: Path) -> Settings:
    """As many postures as training folds need to show six axes, and few steps."""
    return Settings(out=out, budget="tiny", jobs=0, poses=POSES, seed=4, method=OWN)


def rerun(*words):
    """Run the viewer's command line on recordings."""
    program = Path(sys.executable).parent / "rerun"
    return subprocess.run(
        [program, "rrd", *words], capture_output=True, text=True, check=False
    )


def read(file):
    """Return a table's columns and rows."""
    with file.open(newline="") as source:
        reader = csv.DictReader(source)
        return reader.fieldnames, list(reader)


@pytest.mark.slow
def test_table_2_has_its_columns_and_an_interval_around_every_value(study):
    columns, rows = read(study[0] / "table_02.csv")
    assert columns == COLUMNS_02
    metrics = {"MAE", "STDE_absolute", "STDE_signed", "ME"}
    asked = {(m, d, s) for m in ("rigid", "vjm") for d in "xyz" for s in metrics}
    assert {(r["method"], r["direction"], r["metric"]) for r in rows} == asked
    for row in rows:
        if row["metric"] == "ME":  # postures drawn anew can never exceed it
            assert row["low_mm"] == row["high_mm"] == ""
        else:
            assert float(row["low_mm"]) <= float(row["value_mm"])
            assert float(row["value_mm"]) <= float(row["high_mm"])
        assert 0.0 < float(row["floor_mm"]) < 0.05  # of instruments, some 10 µm
        assert (int(row["n"]), row["seeds"], row["plan"]) == (POSES, "4", "table_01")


@pytest.mark.slow
def test_papers_numbers_stand_beside_ours_where_it_prints_them(study):
    _, rows = read(study[0] / "table_02.csv")
    name = {"MAE": "MAE", "STDE_signed": "STDE", "ME": "ME"}
    for row in rows:
        printed = row["method"] == "vjm" and row["metric"] in name
        assert bool(row["paper_mm"]) == printed
        if printed:
            paper = TABLE_02_MM[row["direction"], name[row["metric"]]]
            assert float(row["paper_mm"]) == paper


@pytest.mark.slow
def test_table_3_has_its_columns_and_six_axes(study):
    columns, rows = read(study[0] / "table_03.csv")
    assert columns == COLUMNS_03
    assert [row["axis"] for row in rows] == [f"a{k}" for k in range(1, 7)]
    for row, paper in zip(rows, TABLE_03_NM_PER_RAD, strict=True):
        assert float(row["low"]) <= float(row["stiffness_nm_per_rad"])
        assert float(row["stiffness_nm_per_rad"]) <= float(row["high"])
        assert float(row["truth_secant"]) > 0.0
        assert float(row["paper"]) == paper


@pytest.mark.slow
def test_every_table_and_figure_of_the_networks_is_written(study):
    names = {file.name for file in study[0].iterdir()}
    assert names >= {f"table_{n:02}.csv" for n in (6, 7, 8, 9, 10)}
    assert names >= {f"figure_{n:02}.png" for n in (5, 6, 7, 8, 9)}


@pytest.mark.slow
def test_every_number_of_table_10_stands_beside_the_papers(study):
    _, rows = read(study[0] / "table_10.csv")
    for method, directions in TABLE_10_MM.items():
        for direction, measures in directions.items():
            for ours, theirs in (("MAE", "MAE"), ("STDE_signed", "STDE"), ("ME", "ME")):
                shown = {
                    float(r["paper_mm"])
                    for r in rows
                    if (r["method"], r["direction"], r["metric"])
                    == (method, direction, ours)
                }
                assert shown == {measures[theirs]}
    assert {r["plan"] for r in rows if r["method"] == "ft_mlp"} == set(PLANS)
    for row in rows:
        if row["metric"] == "ME":
            assert row["low_mm"] == row["high_mm"] == ""
        else:
            assert float(row["low_mm"]) <= float(row["high_mm"])


@pytest.mark.slow
def test_own_method_runs_through_the_same_protocol(studied):
    """It answers as the springs do, and so stands beside them with their numbers."""
    by_method = {c.method: c for c in studied[1].methods}
    for judged in ("unseen", "held_out", "experiment"):
        own, springs = (getattr(by_method[name], judged) for name in ("Mean", "vjm"))
        np.testing.assert_array_equal(own, springs)


@pytest.mark.slow
def test_report_shows_its_pictures(study):
    markdown = (study[0] / "report.md").read_text()
    page = (study[0] / "report.html").read_text()
    pictures = sorted(p.name for p in study[0].glob("*.png"))
    assert pictures
    for picture in pictures:
        assert f"]({picture})" in markdown
    assert page.count("data:image/png;base64,") == len(pictures)
    assert "| A6 |" in markdown


@pytest.mark.slow
def test_run_file_says_how_to_run_it_again(study):
    run = json.loads((study[0] / "run.json").read_text())
    assert run["command"].startswith("python -m scenarios.study --budget tiny --seed 4")
    assert run["settings"]["poses"] == POSES
    assert run["libraries"]["mujoco"]


@pytest.mark.slow
def test_recording_is_whole_and_opens_on_the_readings(study):
    file = study[0] / "study.rrd"
    assert file.stat().st_size <= LARGEST
    assert rerun("verify", file).returncode == 0
    assert timeline(file) == "reading"
    assert identity(file) == ("stiffness_bench", "study-4")
    assert entities(file) >= {
        "/cell/arm/flange", "/cell/ghost/flange", "/cell/rope", "/cell/force",
        "/cell/markers", "/error/x/vjm", "/cell/errors/ft_mlp", "/worst",
        "/training/loss/dt_cnn/spanning/seed_4",
    }  # fmt: skip


@pytest.mark.slow
def test_worst_ten_poses_hang_beside_each_other_with_every_methods_error(study):
    file = study[0] / "study.rrd"
    for method in ("vjm", "ft_mlp", "dt_cnn", "gp_residual"):
        path = f"/worst_ten/errors/{method}"
        assert len(still(file, path, "Arrows3D:vectors")) == 10


@pytest.mark.slow
def test_killed_study_ends_with_the_same_numbers_to_the_last_digit(study):
    tables = [{p.name for p in folder.glob("*.csv")} for folder in study]
    assert tables[0] == tables[1] >= set(TABLES)
    for name in tables[0]:
        one, two = ((folder / name).read_bytes() for folder in study)
        assert one == two, name


@pytest.mark.slow
def test_same_seed_gives_the_same_recording(study):
    """The order in which threads hand pieces over is no difference."""
    compared = rerun(
        "compare", "--unordered", *(folder / "study.rrd" for folder in study)
    )
    assert compared.returncode == 0, compared.stderr[-500:]


def test_too_few_postures_are_refused_before_anything_is_written(tmp_path):
    """What is said is true: one axis negative is no wrong sign of the wrench."""
    out = tmp_path / "out"
    with pytest.raises(
        Unusable, match=r"(?s)26 postures.*'a4'.*55 postures or"
    ) as error:
        main(Settings(out=out, budget="tiny", jobs=0, poses=26))
    assert "Check the wrench" not in str(error.value)
    assert not out.exists()


# --- What is committed ---------------------------------------------------------------


@pytest.fixture(scope="module")
def committed(root):
    """The study's result in the checkout."""
    return root / "results" / "study"


@pytest.mark.parametrize("direction", ["x", "y", "z"])
@pytest.mark.parametrize(
    ("metric", "papers"), [("MAE", "MAE"), ("STDE_signed", "STDE")]
)
def test_committed_fit_errs_as_the_papers_within_a_quarter(
    committed, direction, metric, papers
):
    columns, rows = read(committed / "table_02.csv")
    assert columns == COLUMNS_02
    (row,) = (
        r
        for r in rows
        if (r["method"], r["direction"], r["metric"]) == ("vjm", direction, metric)
    )
    paper = TABLE_02_MM[direction, papers]
    assert int(row["n"]) == 151
    assert 0.75 * paper <= float(row["value_mm"]) <= 1.25 * paper


def test_committed_study_is_whole(committed):
    names = {path.name for path in committed.iterdir()}
    assert names >= {*TABLES, "report.md", "report.html", "run.json", "study.rrd"}
    file = committed / "study.rrd"
    assert file.stat().st_size <= LARGEST
    assert rerun("verify", file).returncode == 0
    assert timeline(file) == "reading"
    run = json.loads((committed / "run.json").read_text())
    assert (run["settings"]["poses"], run["settings"]["view"]) == (151, False)
