from collections import Counter
from dataclasses import replace

import pytest

from bench.shared.format.folder import read
from scenarios.damaged import Settings, main, outcome_of
from scenarios.pipelines.schema import Remark
from scenarios.pipelines.synthetic_recording import KR10
from scenarios.report import route
from scenarios.studies.damage import (
    MISTAKES,
    damages,
    good_recording,
    in_set_up,
    own_names,
    rewritten,
)
from stiffness.robot.arm import Arm
from stiffness.setup.loads import load_setup_errors


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return good_recording(tmp_path_factory.mktemp("good") / "recording", 12)


def test_the_unit_of_forces_that_fits_best_is_said(tmp_path):
    """The other one fits better than what is written too, by nine tenths."""
    for damage in in_set_up(good_recording(tmp_path / "good", 20)):
        if damage.code == "units":
            folder = tmp_path / damage.word
            folder.mkdir()
            damage.write(folder)
            recording = read(folder)[0]
            arm = Arm.from_mjcf(KR10).for_recording(recording)
            (warned,) = load_setup_errors(recording, arm)
            assert f"look as if given in {damage.word}" in warned.text


@pytest.mark.slow
def test_damaged_recordings_are_refused_or_said_to_be_set_up_wrongly(capsys):
    outcomes = main(Settings(variants=40, seed=1, poses=12))
    assert [(o.damage.name, o.said) for o in outcomes if not o.right] == []
    assert Counter(o.what for o in outcomes)["warned"] >= 3
    assert "40 of 40" in capsys.readouterr().out


def test_there_are_two_hundred_damages_and_no_two_alike(good):
    every = damages(good, 10**6, seed=0)
    assert len(every) >= 200
    assert len({damage.name for damage in every}) == len(every)


def test_a_damage_that_is_none_is_counted_as_diagnosed(good, tmp_path, monkeypatch):
    """The judge can fail: a whole recording is neither refused nor warned of."""

    class Told:
        warnings, named, verdict = (), (), "no_mismatch"

    monkeypatch.setattr(route, "diagnose_to_folder", lambda *_: Told)
    outcome = outcome_of(rewritten("nothing", "file", good), tmp_path / "0")
    assert outcome.what == "diagnosed" and not outcome.right


def test_a_mistake_said_by_another_name_is_not_recognised(good, tmp_path, monkeypatch):
    class Told:
        named, verdict = (), "set_up"
        warnings = (Remark("units", "wrench_sensor", "forces look given in lbf."),)

    monkeypatch.setattr(route, "diagnose_to_folder", lambda *_: Told)
    kgf = replace(rewritten("kgf", "physics", good), code="units", word="kgf")
    outcomes = [
        outcome_of(damage, tmp_path / str(number))
        for number, damage in enumerate(
            (kgf, replace(kgf, word="lbf"), replace(kgf, code="wrench_rows"))
        )
    ]
    assert [o.what for o in outcomes] == ["misnamed", "warned", "misnamed"]
    assert [o.right for o in outcomes] == [False, True, False]
    counts = ["units: 1 of 2 said.", "wrench_rows: 0 of 1 said."]
    assert own_names(outcomes) == counts


def test_each_mistake_of_the_set_up_is_planted(good):
    codes = {damage.code for damage in damages(good, 10**6, seed=0)}
    wanted = {"marker_names", "wrench_columns", "wrench_rows", "units"}
    assert wanted <= codes <= {*MISTAKES, ""}


def test_a_crash_is_counted_as_one(good, tmp_path, monkeypatch):
    def crash(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(route, "diagnose_to_folder", crash)
    outcome = outcome_of(rewritten("nothing", "physics", good), tmp_path / "0")
    assert outcome.what == "crashed" and not outcome.right
