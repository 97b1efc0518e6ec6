# ruff: noqa: E501 (a table of faults reads best one to a line)
from dataclasses import replace

import numpy as np
import pytest
from lab_table import NAMES, ROWS, UNITS, Lab, faults_of, read_of

from stiffness.experiment.residuals import weight_of

# --- Each rule ------------------------------------------------------------------------


def test_a_row_of_units_is_left_out_by_number_or_by_its_line(tmp_path):
    lab = replace(Lab(), rows=(UNITS, *ROWS))
    for skip in ("1", "[2]"):
        (tmp_path / skip).mkdir()
        read = read_of(
            tmp_path / skip, replace(lab, csv=(*lab.csv, f"skip_rows={skip}"))
        )
        np.testing.assert_allclose(read.time, 20 * np.arange(7))


def test_a_row_of_units_that_nobody_told_of_is_one_fault_with_what_to_say(tmp_path):
    replace(Lab(), rows=(UNITS, *ROWS)).write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert "lab.csv, line 2 (row 1 below the header): words where" in fault
    assert fault.endswith("say so in [csv]: skip_rows = 1.")


def test_faults_below_a_row_of_units_have_the_spreadsheet_s_lines(tmp_path):
    lab = replace(Lab(), rows=(UNITS, *ROWS), above=("Title", ""), skip=(1, 2, 4))
    lab.cell(3, "J1", "ten").write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert fault.startswith("lab.csv, line 7 (row 4 below the header), column 'J1'")


def test_a_row_of_another_length_has_its_line_below_lines_that_are_left_out(tmp_path):
    lab = replace(Lab(), above=("Title",), skip=(1,))
    replace(lab, rows=(*ROWS[:2], (*ROWS[2], "x", "y"), *ROWS[3:])).write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert fault.startswith("lab.csv, line 5 (row 3 below the header): 13 cells")


@pytest.mark.parametrize("encoding", ["cp1252", "latin-1", "utf-16", "mac-roman"])
def test_a_file_in_another_encoding_is_read(tmp_path, encoding):
    lab = replace(Lab(), encoding=encoding)
    read = read_of(tmp_path, replace(lab, csv=(*lab.csv, f"encoding = '{encoding}'")))
    assert len(read.time) == 7


@pytest.mark.parametrize(
    ("encoding", "said", "words"),
    [
        ("cp1252", "", 'encoding = "cp1252", most likely'),
        ("utf-8", 'encoding = "cp1252"', "it is UTF-8, not cp1252"),
        ("utf-8", 'encoding = "ansi"', "'ansi' is not one of: utf-8, utf-16, cp1250"),
        ("utf-16", "", 'lab.csv is UTF-16. Save it as CSV, UTF-8, or say encoding = "'),
    ],
)
def test_a_wrong_encoding_is_one_fault_and_the_rest_is_checked(
    tmp_path, encoding, said, words
):
    lab = replace(Lab(), encoding=encoding, sensors="acuracy_n = 0.5")
    replace(lab, csv=(*lab.csv, said)).cell(2, "J1", "ten").write(tmp_path)
    faults = [f for f in faults_of(tmp_path) if "acuracy_n: nothing" not in f]
    assert sum(words in f for f in faults) == 1
    assert len(faults) == (1 if encoding == "utf-16" else 2)


@pytest.mark.parametrize("rule", ["encoding", "skip_rows", "skip_incomplete"])
def test_a_misspelt_rule_is_one_fault_and_holds_for_the_rest(tmp_path, rule):
    lab = replace(Lab(), encoding="cp1252", rows=(UNITS, *ROWS)).cell(3, "J1", "")
    rules = ("encoding = 'cp1252'", "skip_rows = 1", "skip_incomplete = true")
    misspelt = tuple(r.replace(rule, rule[:-2] + rule[-1]) for r in rules)
    replace(lab, csv=(*lab.csv, *misspelt)).write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert f"nothing is called so. Did you mean '{rule}'?" in fault


def test_rows_that_are_all_cut_short_are_not_said_to_be_none(tmp_path):
    lab = replace(Lab(), rows=tuple(r[:-1] for r in ROWS[:3]))
    lab.write(tmp_path)
    faults = faults_of(tmp_path)
    assert len(faults) == 3 and all("10 cells, but the header" in f for f in faults)
    replace(lab, csv=(*lab.csv, "skip_incomplete = true")).write(tmp_path)
    counted, none = faults_of(tmp_path)
    assert "3 rows were skipped as incomplete (lines 2, 3, 4)" in counted
    assert none == "lab.csv: there are no rows."


def test_a_header_without_rows_is_said_to_have_none(tmp_path):
    replace(Lab(), rows=(), above=("Title",), skip=(1,)).write(tmp_path)
    file = tmp_path / "lab.csv"
    file.write_bytes(file.read_bytes().rstrip())
    assert faults_of(tmp_path) == ("lab.csv: there are no rows.",)


@pytest.mark.parametrize("cell", ["", " ", "n/a", "-", "#NV"])
def test_incomplete_rows_are_skipped_and_counted(tmp_path, capsys, cell):
    lab = Lab().cell(1, "J2", cell).cell(4, "Fx", cell)
    read = read_of(tmp_path, replace(lab, csv=(*lab.csv, "skip_incomplete = true")))
    np.testing.assert_allclose(read.time, [0, 40, 60, 100, 120])
    said = "lab.csv: 2 rows were skipped as incomplete (lines 3, 6)."
    assert said in capsys.readouterr().out


def test_a_row_cut_short_and_an_empty_line_are_incomplete_too(tmp_path, capsys):
    rows = (*ROWS[:2], ROWS[2][:4], ("",) * len(NAMES), *ROWS[3:])
    lab = replace(Lab(), rows=rows, csv=(*Lab().csv, "skip_incomplete = true"))
    assert len(read_of(tmp_path, lab).time) == 6
    assert "2 rows were skipped as incomplete (lines 4, 5)" in capsys.readouterr().out


@pytest.mark.parametrize("cell", ["", "n/a", "-", "NaN"])
def test_a_marker_that_was_not_seen_makes_no_row_incomplete(tmp_path, cell):
    lab = Lab().cell(1, "Größe X", cell)
    read = read_of(tmp_path, replace(lab, csv=(*lab.csv, "skip_incomplete = true")))
    assert len(read.time) == 7 and read.points is not None
    assert np.isnan(read.points[1, 0, 0])


@pytest.mark.parametrize("inside", [True, False])
def test_rows_are_numbered_and_timed_as_they_were_measured(tmp_path, inside):
    """A row that is left out was measured all the same: it keeps number and time."""
    lab = Lab().without("t", "time_s").without("Nr", "pose").cell(2, "J1", "")
    rules = "number_rows = true\ninterval_s = 20.0"
    lab = replace(lab, csv=(*lab.csv, "skip_incomplete = true"))
    lab = replace(lab, csv=(*lab.csv, rules)) if inside else replace(lab, top=rules)
    read = read_of(tmp_path, replace(lab, rows=(lab.rows[0], *lab.rows)[1:]))
    assert read.posture_id.tolist() == [1, 2, 4, 5, 6, 7]
    np.testing.assert_allclose(read.time, [0, 20, 60, 80, 100, 120])


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ("number_rows = true", "columns.pose: number_rows makes it already"),
        ("interval_s = 20", "columns.time_s: interval_s makes it already"),
        ("interval_s = -20", "interval_s: -20"),
        ("number_rows = 1", "number_rows: 1"),
        ("pulled = true\nrows = 1", "not TOML"),
    ],
)
def test_a_rule_of_rows_that_contradicts_the_columns_is_refused(tmp_path, rule, words):
    replace(Lab(), top=rule).write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert words in fault


def test_numbered_rows_of_differences_ask_whether_they_were_pulled(tmp_path):
    lab = Lab().without("Nr", "pose")
    replace(lab, top='number_rows = true\ndisplacement = "relative"').write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert "map.toml, number_rows: each row is a pose of one reading" in fault
    assert "say pulled = true" in fault


def test_sign_factor_and_sum_of_columns_come_before_the_unit(tmp_path):
    lab = Lab()
    lab.columns["a1_deg"] = '{ from = "J1", factor = -1.0 }'
    lab.columns["a2_deg"] = '{ from = ["J2", "J1"], sum = [-1, 0.5], unit = "rad" }'
    read = read_of(tmp_path, lab)
    j1, j2 = 3.0 * np.arange(7) + 0.5, 0.1 * np.arange(7)
    np.testing.assert_allclose(read.posture[:, 0], -np.radians(j1))
    np.testing.assert_allclose(read.posture[:, 1], 0.5 * j1 - j2)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('{ from = ["J1", "J2"] }', "sum needs one factor for each column, as in sum = [1, 1]"),
        ('{ from = ["J1", "J2"], sum = [1] }', "sum needs one factor for each"),
        ('{ from = ["J1", "J2"], factor = -1.0 }', "give the factors of several columns in sum"),
        ('{ from = "J1", factor = 2.0, sum = [1] }', "give factor or sum, not both"),
        ('{ from = "J1", factor = 0.0 }', "a factor is 0"),
        ('{ from = ["J1", "J9"], sum = [1, 1] }', "column 'J9' is missing"),
        ('{ from = "J1", scale = -1 }', "columns.a1_deg.scale: nothing is called so"),
        ('{ from = "J1", unit = "degrees" }', "unit 'degrees' is not one of: deg, rad"),
    ],
)  # fmt: skip
def test_a_sum_that_cannot_be_meant_is_one_fault(tmp_path, entry, words):
    lab = Lab()
    lab.columns["a1_deg"] = entry
    lab.write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert words in fault


def test_two_axes_are_not_read_from_one_column_alike(tmp_path):
    """But what was commanded and reported of one may be, and one linked to another."""
    lab = Lab()
    lab.columns["a1_cmd_deg"] = '"J1"'
    lab.columns["a2_deg"] = '"J1"'
    lab.write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert "'a1_deg' and 'a2_deg' are read from the same column, 'J1'" in fault
    lab.columns["a2_deg"] = '{ from = "J1", factor = -1.0 }'
    read_of(tmp_path, lab)


def test_a_count_has_no_factor(tmp_path):
    lab = Lab()
    lab.columns["pose"] = '{ from = "Nr", factor = 2 }'
    lab.write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert "columns.pose: it counts or names" in fault


def test_a_force_without_torque_columns_is_a_pure_force(tmp_path, capsys):
    read = read_of(tmp_path, Lab())
    assert read.wrench is not None
    np.testing.assert_allclose(read.wrench[:, 0], np.arange(7))
    np.testing.assert_array_equal(read.wrench[:, 3:], 0.0)
    assert "pure force" in capsys.readouterr().out


def test_a_pulled_pose_gets_its_unloaded_reading_of_zero(tmp_path):
    read = read_of(tmp_path, replace(Lab(), top="pulled = true"))
    assert read.displacement == "relative" and read.points is not None
    assert read.wrench is not None
    assert read.stage.tolist() == ["unloaded", "loaded"] * 7
    assert read.visit.tolist() == np.repeat(np.arange(7), 2).tolist()
    np.testing.assert_array_equal(read.points[::2], 0.0)
    np.testing.assert_array_equal(read.wrench[::2], 0.0)
    np.testing.assert_allclose(read.points[3, 0], [1.25e-3, -1.5e-3, 0.125e-3])


def test_two_pulls_of_one_pose_are_two_visits(tmp_path):
    lab = Lab().cell(1, "Nr", "1").cell(1, "J1", "0,5").cell(1, "J2", "0,0")
    read = read_of(tmp_path, replace(lab, top="pulled = true"))
    assert read.posture_id[:4].tolist() == [1, 1, 1, 1]
    assert read.visit[:4].tolist() == [0, 0, 1, 1]


def test_a_pulled_pose_has_no_stages_of_its_own(tmp_path):
    lab = replace(Lab(), top="pulled = true")
    lab.columns["visit"] = '"Nr"'
    lab.write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert "pulled: each row is a pulled pose, a visit of its own" in fault


def spread_lab(more: dict[int, str] | None = None) -> Lab:
    lab = Lab()
    rows = tuple(
        (*r, "10", "10", (more or {}).get(k, "20")) for k, r in enumerate(ROWS)
    )
    names = (*NAMES, "sx", "sy", "sz")
    for c in "xyz":
        lab.columns[f"p_std_{c}_mm"] = f'{{ from = "s{c}", unit = "um" }}'
    return replace(lab, names=names, rows=rows)


def test_the_readings_own_spread_takes_the_place_of_the_stated_noise(tmp_path, capsys):
    read = read_of(tmp_path, spread_lab({3: "30"}))
    assert read.tracker is not None
    expected = [1e-5, 1e-5, 1e-6 * np.sqrt((6 * 20**2 + 30**2) / 7)]
    np.testing.assert_allclose(read.tracker.repeatability, expected)
    assert "readings' own spreads" in capsys.readouterr().out
    weight = weight_of(read)[:, 0]
    own = np.array([[10.0, 10.0, 30.0 if k == 3 else 20.0] for k in range(7)])
    np.testing.assert_allclose(weight / weight[0], 600.0 / np.sum(own**2, axis=1))
    sure = weight_of(read_of(tmp_path, spread_lab({3: ""})))[:, 0]
    assert sure[3] == 1.0


def test_a_negative_spread_and_one_without_its_coordinates_are_refused(tmp_path):
    lab = spread_lab({3: "-20"})
    lab.columns.pop("p_std_y_mm")
    lab.write(tmp_path)
    missing, spread = faults_of(tmp_path)
    assert "line 5 (row 4 below the header), column 'sz': a spread of -0.02" in spread
    assert "column 'p_std_y_mm' is missing, and nothing in [columns]" in missing


def test_a_weight_is_a_force_whose_other_parts_are_nothing(tmp_path):
    lab = replace(Lab(), sensors='accuracy_n = 0.5\nframe = "base"')
    nothing = '{ from = "Fx", factor = 0 }'
    hung = {"fx_n": nothing, "fy_n": nothing, "fz_n": '{ from = "Fx", factor = -9.81 }'}
    read = read_of(tmp_path, replace(lab, columns={**lab.columns, **hung}))
    pulled = np.outer(np.arange(7), [0.0, 0.0, -9.81, 0.0, 0.0, 0.0])
    assert read.wrench is not None
    np.testing.assert_allclose(read.wrench, pulled, atol=1e-12)
    (tmp_path / "less").mkdir()
    less = {n: c for n, c in lab.columns.items() if n != "fx_n"}
    replace(lab, columns=less).write(tmp_path / "less")
    (fault,) = faults_of(tmp_path / "less")
    assert "'fx_n' is missing, and nothing in [columns] is mapped to it." in fault
    assert "as beside a weight: fx_n = { from = a column, factor = 0 }" in fault


def test_what_is_allowed_is_said_in_words(tmp_path):
    lab = replace(Lab(), top="interval_s = [1]").cell(2, "J1", "NaN")
    lab.write(tmp_path)
    text = (tmp_path / "map.toml").read_text()
    (tmp_path / "map.toml").write_text(text.replace('"plateaus"', '"points"'))
    told = "\n".join(faults_of(tmp_path))
    assert "rows: 'points' — not one of: plateaus, stream" in told
    assert "interval_s: [1] — Expected a number" in told
    assert "'NaN' is not a number with a decimal comma. Rows like this are" in told


# --- Several files, row by row ---------------------------------------------------------

TRACKER = """
[files.tracker]
file = "tracker.csv"
join = "rows"
separator = ","
decimal = "."
"""


def two_files(rows=range(7), above="", more: str = "") -> tuple[Lab, str]:
    lab = replace(Lab(), below=TRACKER + more)
    for c in "xyz":
        lab.columns[f"p_{c}_mm"] = f'"tracker.{c}"'
    return lab, above + "x,y,z,q\n" + "".join(f"{k}.5,1,2,3\n" for k in rows)


def test_files_are_joined_row_by_row(tmp_path, capsys):
    lab, tracker = two_files(above="", more="skip_rows = 1")
    tracker = tracker.replace("q\n", "q\nmm,mm,mm,\n", 1)
    (tmp_path / "tracker.csv").write_text(tracker)
    lab = replace(lab, rows=(UNITS, *ROWS), skip=(2,))
    lab = replace(lab.cell(3, "J1", ""), csv=(*lab.csv, "skip_incomplete = true"))
    read = read_of(tmp_path, lab)
    assert read.points is not None
    expected = [0.5, 1.5, 3.5, 4.5, 5.5, 6.5]
    np.testing.assert_allclose(1e3 * read.points[:, 0, 0], expected)
    said = capsys.readouterr().out
    assert "tracker.csv: column 'q' left alone." in said


def test_faults_of_joined_files_are_named_in_their_own_lines(tmp_path):
    lab, tracker = two_files(more="skip_rows = [1, 2]", above="Tracker\nof today\n")
    tracker = tracker.replace("4.5,1", "up,1").replace("2.5,1", "9e9,1")
    (tmp_path / "tracker.csv").write_text(tracker)
    lab.cell(5, "J1", "ten").write(tmp_path)
    own, cell, large = faults_of(tmp_path)
    assert "tracker.csv, line 8 (row 5 below the header), column 'x': 'up'" in own
    assert "lab.csv, line 7 (row 6 below the header), column 'J1': 'ten'" in cell
    assert (
        "tracker.csv, line 6 (row 3 below the header), column 'x': up to 9e+06 m"
        in large
    )


def test_a_file_that_nothing_is_taken_from_is_one_fault(tmp_path):
    (tmp_path / "tracker.csv").write_text(two_files()[1])
    replace(Lab().without("B", ""), below=TRACKER).write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert "files.tracker: no column is taken from it" in fault


@pytest.mark.parametrize(
    ("rows", "old", "new", "words"),
    [
        (range(6), "", "", "tracker.csv has 6 readings and FILE 7 readings"),
        (range(7), 'join = "rows"', 'join = "rows"\noffset_s = 1', "it needs no clock; leave out offset_s"),
        (range(7), 'join = "rows"', 'join = "row"', "files.tracker.join: 'row'"),
        (range(7), 'join = "rows"', "", "files.tracker.time: missing; or join"),
        (range(7), '"tracker.csv"', '"../t.csv"', "outside the folder"),
        (range(7), "decimal", 'encoding = "ansi"\ndecimal', "files.tracker.encoding: 'ansi'"),
    ],
)  # fmt: skip
def test_files_that_cannot_be_joined_row_by_row_are_refused(
    tmp_path, rows, old, new, words
):
    lab, tracker = two_files(rows)
    (tmp_path / "tracker.csv").write_text(tracker)
    replace(lab, below=lab.below.replace(old, new)).write(tmp_path)
    (fault,) = faults_of(tmp_path)
    assert words in fault
