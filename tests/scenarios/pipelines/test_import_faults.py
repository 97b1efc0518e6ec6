# ruff: noqa: E501 (a table of faults reads best one to a line)
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lab_table import NAMES, UNITS, Lab, faults_of, read_of

# --- Faults, one at a time and several together ----------------------------------------

Change = Callable[[Lab], Lab]


def said(csv: str = "", top: str = "", lines: tuple[int, ...] = ()) -> Change:
    """Return a change that adds to what a mapping says."""
    return lambda lab: replace(
        lab,
        csv=(*lab.csv, csv) if csv and csv not in lab.csv else lab.csv,
        top=f"{lab.top}\n{top}",
        skip=(*lab.skip, *lines),
    )


def column(name: str, entry: str | None, other: str = "") -> Change:
    def change(lab: Lab) -> Lab:
        columns = {
            other if other and n == name else n: e for n, e in lab.columns.items()
        }
        return replace(lab, columns={**columns, **({name: entry} if entry else {})})

    return change


def inserted(row: tuple[str, ...], at: int) -> Change:
    return lambda lab: replace(lab, rows=(*lab.rows[:at], row, *lab.rows[at:]))


FORMS: dict[str, tuple[Change, Change, str]] = {
    "cp1252": (
        lambda lab: replace(lab, encoding="cp1252"),
        said('encoding = "cp1252"'),
        "is not UTF-8 text",
    ),
    "no time": (
        lambda lab: lab.without("t", "time_s"),
        said(top="interval_s = 20"),
        "interval_s = N",
    ),
    "no pose": (
        lambda lab: lab.without("Nr", "pose"),
        said(top="number_rows = true"),
        "number_rows = true",
    ),
    "a blank": (
        lambda lab: lab.cell(1, "J2", ""),
        said("skip_incomplete = true"),
        "column 'J2': blank",
    ),
    "no number": (
        lambda lab: lab.cell(3, "Fx", "n/a"),
        said("skip_incomplete = true"),
        "'n/a' is not a number",
    ),
    "cut short": (
        lambda lab: replace(
            lab, rows=(*lab.rows[:4], lab.rows[4][:5], *lab.rows[5:])
        ),
        said("skip_incomplete = true"),
        "5 cells, but the header has",
    ),
    "units": (
        lambda lab: inserted(
            tuple(dict(zip(NAMES, UNITS, strict=True))[n] for n in lab.names), 0
        )(lab),
        lambda lab: replace(lab, skip=(*lab.skip, len(lab.above) + 2)),
        "words where numbers are read",
    ),
    "a title": (
        lambda lab: replace(lab, above=("Measured in Köln", "by K. & L.;;")),
        lambda lab: replace(lab, skip=(1, 2, *(n + 2 * (n < 4) for n in lab.skip))),
        "the names of the columns stand here",
    ),
}  # fmt: skip
"""What a table may look like: how it comes so, the rule that reads it, its fault."""
ORDER = (*[f for f in FORMS if f not in ("units", "a title")], "a title", "units")

SLIPS: dict[str, tuple[Change, str]] = {
    "a key": (
        lambda lab: replace(lab, sensors="acuracy_n = 0.5"),
        "sensors.wrench.acuracy_n: nothing is called so. Did you mean 'accuracy_n'",
    ),
    "a column's key": (
        column("a1_deg", None, "a1_dge"),
        "columns.a1_dge: the format has",
    ),
    "a source": (column("fy_n", '"Fyy"'), "column 'Fyy' is missing"),
    "a unit": (column("a2_deg", '{ from = "J2", unit = "radian" }'), "unit 'radian'"),
    "a word": (lambda lab: lab.cell(-2, "Fz", "ten"), "'ten' is not a number"),
    "a part": (
        lambda lab: replace(lab, below="[tol]\nmass_kg = 1"),
        "tol: nothing is",
    ),
    "a marker's name": (
        lambda lab: replace(lab, marker="q"),
        "columns.p_x_mm: no marker is called 'p' in map.toml.",
    ),
    "a part of three letters": (
        lambda lab: replace(lab, part="cvs"),
        "cvs: nothing is called so. Did you mean 'csv'",
    ),
    "a separator": (
        lambda lab: replace(lab, csv=tuple(c for c in lab.csv if "separator" not in c)),
        "its columns stand apart by ';'",
    ),
    "a number": (lambda lab: replace(lab, top=f"{lab.top}\nname = 7"), "name: 7"),
}
"""Mistakes that no rule reads, each with its fault."""


def spoilt(forms: list[str], ruled: bool, slips: list[str]) -> tuple[Lab, list[str]]:
    lab, words = Lab(), []
    for name in (n for n in ORDER if n in forms):
        change, rule, fault = FORMS[name]
        lab = change(lab)
        lab = rule(lab) if ruled else lab
        words += [] if ruled else [fault]
    for name in slips:
        change, fault = SLIPS[name]
        lab, words = change(lab), [*words, fault]
    return lab, words


def every_fault_and_no_other(folder: Path, words: list[str]) -> None:
    """Each mistake is one fault, and there is no fault beside."""
    faults = faults_of(folder)
    for word in words:
        assert sum(word in f for f in faults) == 1, (word, faults)
    assert len(faults) == len(words), faults


@pytest.mark.parametrize("name", FORMS)
def test_one_fault_of_a_table_is_named_alone_and_read_by_its_rule(tmp_path, name):
    lab, words = spoilt([name], False, [])
    lab.write(tmp_path)
    every_fault_and_no_other(tmp_path, words)
    lab, _ = spoilt([name], True, [])
    assert len(read_of(tmp_path, lab).time) >= 6


@pytest.mark.parametrize("name", SLIPS)
def test_one_mistake_of_a_mapping_is_named_alone(tmp_path, name):
    lab, words = spoilt([], False, [name])
    lab.write(tmp_path)
    every_fault_and_no_other(tmp_path, words)


some_forms = st.lists(st.sampled_from([*FORMS]), unique=True, max_size=5)
some_slips = st.lists(st.sampled_from([*SLIPS]), unique=True, max_size=3)
many = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@many
@given(some_forms)
def test_any_table_of_these_forms_is_read_by_their_rules(tmp_path, forms):
    lab, _ = spoilt(forms, True, [])
    read = read_of(tmp_path, lab)
    for file in (*(tmp_path / "out").iterdir(),):
        file.unlink()
    (tmp_path / "out").rmdir()
    gone = {"a blank": 1, "no number": 3, "cut short": 4}
    kept = [k for k in range(7) if k not in {gone[f] for f in forms if f in gone}]
    np.testing.assert_allclose(read.time, 20.0 * np.array(kept))
    np.testing.assert_array_equal(read.posture_id, np.array(kept) + 1)
    np.testing.assert_allclose(read.posture[:, 1], 0.1 * np.array(kept))


@many
@given(some_forms, some_slips)
def test_all_faults_are_named_at_once_and_none_is_false(tmp_path, forms, slips):
    lab, words = spoilt(forms, False, slips)
    if words:
        lab.write(tmp_path)
        every_fault_and_no_other(tmp_path, words)


@many
@given(some_forms, some_slips)
def test_rules_that_hold_leave_the_other_faults_to_be_named(tmp_path, forms, slips):
    lab, words = spoilt(forms, True, slips)
    if words:
        lab.write(tmp_path)
        every_fault_and_no_other(tmp_path, words)
