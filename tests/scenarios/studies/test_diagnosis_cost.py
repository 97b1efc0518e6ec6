"""What is promised of the cost of many poses: it is measured on what is asked about."""

import numpy as np
import pytest

from bench.shared.errors import BenchError
from scenarios import many_poses
from scenarios.studies import diagnosis_cost
from scenarios.studies.diagnosis_cost import answered


def test_under_its_own_weight_an_arm_has_one_target_on_its_flange_and_no_load():
    recording = diagnosis_cost.recorded("weight", 5)
    assert recording.wrench is None and recording.load_mass is None
    assert [marker.body for marker in recording.markers] == ["flange"]
    assert len(recording.time) == 5


def test_with_loads_the_load_rises_and_falls_in_each_of_so_many_poses():
    recording = diagnosis_cost.recorded("loads", 3)
    assert recording.wrench is not None and recording.load_mass is not None
    np.testing.assert_array_equal(recording.load_mass[:4], [0.0, 5.0, 10.0, 5.0])
    assert len(np.unique(recording.posture_id)) == 3


def test_a_small_measurement_answers_its_question_and_says_whether_bars_are_kept(
    tmp_path, monkeypatch
):
    cost = {"3": (9.0, 2.0, 0.5), "6": (9.0, 3.0, 0.5)}
    monkeypatch.setattr(
        diagnosis_cost, "spent", lambda recording, _: cost[recording.name]
    )
    settings = many_poses.Settings(tmp_path / "out", poses=(3, 6), kinds=("loads",))
    rows = many_poses.main(settings)
    assert [(r["poses"], r["rows"], r["core_s"]) for r in rows] == [
        (3, 12, 2.0),
        (6, 24, 3.0),
    ]
    text = (tmp_path / "out" / "report.md").read_text()
    assert "within the bars of 60 core seconds and 4 GB" in text
    assert "grows by less than the poses: 2 times the poses cost 1.50 times" in text


@pytest.mark.parametrize(
    ("cost", "gb", "says"),
    [
        ((30.0, 30.0), 1.0, ("does not grow", ": within the bars")),
        ((20.0, 30.0), 1.0, ("grows by less than the poses", ": within the bars")),
        ((20.0, 50.0), 1.0, ("grows as the poses or faster", ": within the bars")),
        ((20.0, 61.0), 1.0, ("grows as the poses or faster", "NOT within the bars")),
        ((20.0, 20.0), 4.1, ("does not grow", "NOT within the bars")),
    ],
)
def test_the_answer_is_what_the_rows_say(cost, gb, says):
    rows = [
        {"kind": "loads", "poses": n, "core_s": c, "peak_gb": gb}
        for n, c in zip((3000, 6000), cost, strict=True)
    ]
    for words in says:
        assert words in answered(rows)


def test_a_diagnosis_that_fails_is_no_measurement(tmp_path):
    with pytest.raises(BenchError, match="ended with status 2"):
        diagnosis_cost.spent(tmp_path / "none", tmp_path / "out")
