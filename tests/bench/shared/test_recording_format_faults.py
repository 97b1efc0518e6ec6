# ruff: noqa: E501 (a table of damages reads best one to a line)
import os
import shutil
from itertools import count
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pa_parquet
import pytest
from recordings import (
    ARM,
    Damage,
    added,
    both,
    cell,
    every,
    more,
    renamed,
    said,
    save,
    table,
    without,
    write_good,
)

from bench.shared.errors import Unusable
from bench.shared.format.folder import read
from scenarios import check
from scenarios.report.command_line import run

CSV, TOML, PARQUET = "samples.csv", "recording.toml", "samples.parquet"


def overwritten(file: str, content: bytes) -> Damage:
    return lambda folder: (folder / file).write_bytes(content)


def removed(file: str) -> Damage:
    return lambda folder: (folder / file).unlink()


def made_a_folder(file: str) -> Damage:
    return both(removed(file), lambda folder: (folder / file).mkdir())


def bytes_replaced(old: bytes, new: bytes, file: str = CSV) -> Damage:
    def damage(folder: Path) -> None:
        content = (folder / file).read_bytes()
        assert old in content
        (folder / file).write_bytes(content.replace(old, new, 1))

    return damage


def linked_away(file: str) -> Damage:
    def damage(folder: Path) -> None:
        elsewhere = folder.parent / f"elsewhere-{file}"
        shutil.move(folder / file, elsewhere)
        (folder / file).symlink_to(elsewhere)

    return damage


def linked_to_itself(folder: Path) -> None:
    (folder / CSV).unlink()
    (folder / CSV).symlink_to(CSV)


def made_a_pipe(folder: Path) -> None:
    (folder / CSV).unlink()
    os.mkfifo(folder / CSV)


def made_parquet(spoil) -> Damage:
    def damage(folder: Path) -> None:
        rows = table(folder)
        columns = zip(*rows[1:], strict=True)
        content = {
            n: [float(v) for v in c] for n, c in zip(rows[0], columns, strict=True)
        }
        spoil(folder, content)
        (folder / CSV).unlink()

    return damage


def saved(folder: Path, content: dict) -> None:
    pa_parquet.write_table(pa.table(content), folder / PARQUET)


def cut_short(folder: Path, content: dict) -> None:
    saved(folder, content)
    whole = (folder / PARQUET).read_bytes()
    (folder / PARQUET).write_bytes(whole[: len(whole) // 2])


def with_text(folder: Path, content: dict) -> None:
    text = [str(v) for v in content["a2_deg"]]
    saved(folder, {**content, "a2_deg": [*text[:3], "left", *text[4:]]})


def with_null(folder: Path, content: dict) -> None:
    angles = content["a2_deg"]
    saved(folder, {**content, "a2_deg": [*angles[:3], None, *angles[4:]]})


def with_lists(folder: Path, content: dict) -> None:
    saved(folder, {**content, "a2_deg": [[v] for v in content["a2_deg"]]})


def unfolding(folder: Path, content: dict) -> None:
    """A few kilobytes that would unfold to more cells than are read."""
    zeros = pa.nulls(8_000_000)
    saved(folder, {n: zeros for n in [*content, *(f"x{k}" for k in range(20))]})


def shuffled(folder: Path) -> None:
    rows = table(folder)
    save(folder, [rows[0], *rows[11:], *rows[1:11]])


def row_with_more_cells(folder: Path) -> None:
    rows = table(folder)
    rows[4].append("7")
    rows[9][2] = "text"
    save(folder, rows)


A2_ROW_3 = (CSV, "row 3", "line 4", "'a2_deg'")

DAMAGES: list[tuple[str, Damage, tuple[str, ...]]] = [
    # samples: cells
    ("text in a number", cell(3, "a2_deg", "up"), (*A2_ROW_3, "'up' is not a number")),
    ("NaN in a number", cell(3, "a2_deg", "NaN"), (*A2_ROW_3, "'NaN' is not a number")),
    ("infinity", cell(3, "a2_deg", "inf"), (*A2_ROW_3, "not a number")),
    ("overflow", cell(3, "a2_deg", "1e999"), (*A2_ROW_3, "not a finite number")),
    ("blank angle", cell(3, "a2_deg", ""), (*A2_ROW_3, "blank")),
    ("NaN in a marker", cell(3, "p1_y_mm", "nan"), ("row 3", "'p1_y_mm'", "'nan'")),
    ("hexadecimal", cell(3, "a2_deg", "0x1F"), (*A2_ROW_3, "not a number")),
    ("decimal comma", cell(3, "a2_deg", "7,5"), (*A2_ROW_3, "decimal comma")),
    ("units in a cell", cell(3, "fx_n", "12 N"), ("row 3", "'fx_n'", "'12 N'")),
    ("pose not an integer", cell(3, "pose", "1.5"), ("row 3", "'pose'", "1.5 is not an")),
    ("time backwards", cell(3, "time_s", "1"), ("row 3", "'time_s'", "backwards")),
    ("rows shuffled", shuffled, ("row 11", "'time_s'", "backwards")),
    ("beyond a limit", cell(3, "a2_deg", "45.6"), (*A2_ROW_3, "-190 to 45°")),
    ("radians for degrees", every("a1_deg", lambda v: str(float(v) * 57.3)), ("'a1_deg'", "beyond the limits", "The same in lines 3, 4, 5, 6, 7 and 14 more")),
    ("force above 20 kN", cell(3, "fz_n", "-20001"), ("row 3", "'fz_n'", "20 kN")),
    ("torque above 5 kNm", cell(3, "ty_nm", "5001"), ("row 3", "'ty_nm'", "5 kNm")),
    ("negative mass on the hook", cell(3, "load_kg", "-1"), ("row 3", "'load_kg'", "less than 0")),
    ("a stage nobody knows", added("stage", "resting"), ("row 1", "'stage'", "'resting'", "unloading")),
    ("no frames averaged", added("frames", "0"), ("row 1", "'frames'", "less than 1")),
    ("a visit of two poses", both(added("visit", "0")), ("row 6", "'pose'", "visit 0")),
    ("visits count down", both(added("visit", "0"), cell(6, "visit", "-1")), ("row 6", "'visit'", "-1 after 0")),
    ("load changed after the reading", added("load_time_s", "1e6"), ("row 1", "'load_time_s'", "later")),
    ("one row in a relative visit", both(said('"absolute"', '"relative"'), cell(20, "pose", "9")), ("row 20", "'pose'", "one row in its visit")),
    # samples: columns and rows
    ("no time", without("time_s"), (CSV, "'time_s' is missing")),
    ("no pose", without("pose"), (CSV, "'pose' is missing")),
    ("an axis missing", without("a4_deg"), (CSV, "'a4_deg' is missing")),
    ("last axis missing", without("a6_deg"), (CSV, "'a6_deg' is missing")),
    ("half a wrench", without("ty_nm"), (CSV, "'ty_nm' is missing")),
    ("a marker's column missing", without("p2_z_mm"), (CSV, "'p2_z_mm' is missing")),
    ("a column misspelt", renamed("a2_deg", "A2_deg"), ("'a2_deg' is missing", "Did you mean 'A2_deg'?")),
    ("a column twice", renamed("a3_deg", "a2_deg"), ("'a2_deg' is there twice", "'a3_deg' is missing")),
    ("a marker of nobody", added("q7_x_mm", "1"), ("'q7_x_mm'", "no marker is called 'q7'", "p1, p2")),
    ("an axis too many", added("a7_deg", "1"), ("a7", "6 axes", "recorded on 7 axes", "1 fault")),
    ("slide and turn at once", added("a2_mm", "1"), ("'a2_deg' and 'a2_mm'",)),
    ("a row with more cells", row_with_more_cells, ("line 5 (row 4 below the header): 22 cells", "21 columns", "line 10 (row 9 ", "'text'")),
    ("header alone", lambda f: save(f, table(f)[:1]), (CSV, "no rows")),
    ("empty samples", overwritten(CSV, b""), (CSV, "empty")),
    ("only blanks", overwritten(CSV, b"\n \n"), (CSV, "empty")),
    ("no samples", removed(CSV), (CSV, "missing")),
    ("binary garbage", overwritten(CSV, bytes(range(256)) * 9), (CSV, "not UTF-8")),
    ("Latin-1", bytes_replaced(b"\n0.0,1", b"\n0.\xb0,1"), (CSV, "row 1", "0xb0", "not UTF-8")),
    ("a name in two lines", bytes_replaced(b"time_s,", b'"time\n[s]",'), (CSV, "line 1", "goes on in the next line")),
    ("UTF-16", overwritten(CSV, "time_s,pose\n0,1\n".encode("utf-16")), (CSV, "UTF-16")),
    ("an Excel file", overwritten(CSV, b"PK\x03\x04rest"), (CSV, "Excel")),
    ("another separator", bytes_replaced(b",", b";"), (CSV, "missing")),
    ("samples are a folder", made_a_folder(CSV), (CSV, "not a file")),
    ("samples are a pipe", made_a_pipe, (CSV, "not a file")),
    ("samples lie elsewhere", linked_away(CSV), (CSV, "leaves the folder")),
    ("a link to itself", linked_to_itself, (CSV, "cannot be opened")),
    ("both samples files", overwritten(PARQUET, b"PAR1"), (CSV, PARQUET, "both there")),
    # parquet
    ("truncated parquet", made_parquet(cut_short), (PARQUET, "cannot be read")),
    ("no parquet at all", both(removed(CSV), overwritten(PARQUET, b"x" * 99)), (PARQUET, "cannot be read")),
    ("text in parquet", made_parquet(with_text), (PARQUET, "row 4", "'a2_deg'", "'left'")),
    ("blank in parquet", made_parquet(with_null), (PARQUET, "row 4", "'a2_deg'", "blank")),
    ("lists in parquet", made_parquet(with_lists), (PARQUET, "'a2_deg'", "expected numbers")),
    ("parquet that unfolds", made_parquet(unfolding), (PARQUET, "cells; the most is")),
    # manifest
    ("no manifest", removed(TOML), (TOML, "missing")),
    ("manifest is a folder", made_a_folder(TOML), (TOML, "not a file")),
    ("manifest lies elsewhere", linked_away(TOML), (TOML, "leaves the folder")),
    ("manifest not TOML", more("= ="), (TOML, "not TOML")),
    ("manifest not UTF-8", bytes_replaced(b"small", b"sm\xe4ll", TOML), (TOML, "line 2", "UTF-8")),
    ("manifest too large", overwritten(TOML, b"#" * (2**20 + 1)), (TOML, "the most is")),
    ("arrays without end", overwritten(TOML, b"a = " + b"[\n" * 100_000), (TOML, "not TOML")),
    ("keys without end", overwritten(TOML, b".".join([b"a"] * 9_000) + b" = 1"), (TOML, "line 1: 18003 characters")),
    ("tables without end", overwritten(TOML, b"[" + b".".join([b"a"] * 900) + b"]"), (TOML, "nothing is called so")),
    ("a number without end", more("position_mm = [" + "9" * 1_900 + ", 0, 0]"), (TOML, "markers.p2.position_mm")),
    ("empty manifest", overwritten(TOML, b""), (TOML, "format: missing", "rows: missing")),
    ("another version", said("format = 1", "format = 2"), (TOML, "format", "2")),
    ("rows nobody knows", said('"plateaus"', '"plateau"'), (TOML, "rows", "'plateau'")),
    ("a key misspelt", said("accuracy_nm", "acuracy_nm"), ("1 fault:", "sensors.wrench.acuracy_nm", "Did you mean 'accuracy_nm'?")),
    ("text for a number", said("0.04", '"small"'), ("sensors.wrench.accuracy_n", "'small'")),
    ("NaN in the manifest", said("0.04", "nan"), ("sensors.wrench.accuracy_n", "finite")),
    ("negative accuracy", said("0.04", "-0.04"), ("sensors.wrench.accuracy_n", "-0.04")),
    ("negative repeatability", said("0.010", "-0.010"), ("sensors.tracker.repeatability_mm", "-0.01 is none; a standard deviation is above 0")),
    ("no noise at all", said("0.010", "0"), ("sensors.tracker.repeatability_mm", "above 0")),
    ("two coordinates", said("[10, 20, 30]", "[10, 20]"), ("markers.p1.position_mm", "length 3")),
    ("not a quaternion", said("[1, 0, 0, 0]", "[1, 0.1, 0, 0]"), ("frames.tracker.quaternion_wxyz", "1.00499")),
    ("a body nobody knows", said('"link_3"', '"link_33"'), ("markers.p2.body", "'link_33'", "Did you mean 'link_3'?")),
    ("a wrench on no body", said("accuracy_nm = 0.002", 'accuracy_nm = 0.002\nbody = "hand"'), ("sensors.wrench.body", "'hand'")),
    ("a joint nobody knows", more('[robot]\naxes = ["a1", "a2", "a3", "a4", "a5", "b6"]'), ("robot.axes", "'b6'", "Known: a1")),
    ("a joint twice", more('[robot]\naxes = ["a1", "a2", "a3", "a4", "a5", "a5"]'), ("robot.axes", "twice")),
    ("a model's body nobody knows", more('[robot]\nbodies = { flange = "wrist" }'), ("robot.bodies.flange", "'wrist'")),
    ("no tracker stated", said("[sensors.tracker]\nrepeatability_mm = 0.010\n", ""), ("no [sensors.tracker]",)),
    ("no force sensor stated", said("[sensors.wrench]\naccuracy_n = 0.04\naccuracy_nm = 0.002\n", ""), ("no [sensors.wrench]",)),
    ("a target of two markers", more('target = "t"\n[markers.p3]\nbody = "flange"\ntarget = "t"'), ("'t' has 2 markers", "flange, link_3")),
    ("a mapping of no column", more('[columns]\na2_degg = { from = "a2_deg" }'), ("columns.a2_degg", "Did you mean 'a2_deg'?")),
    ("a mapping from nothing", more('[columns]\na2_deg = { from = "J2" }'), ("'J2' is missing", "columns.a2_deg")),
    ("a unit of nothing", more('[columns]\na2_deg = { from = "a2_deg", unit = "mm" }'), ("columns.a2_deg", "'mm'", "deg, rad")),
    ("two columns for one", both(added("J2", "1"), more('[columns]\na2_deg = { from = "J2" }')), ("'a2_deg' and 'J2'", "both stand for")),
    ("a separator of two", more('[csv]\nseparator = ";;"'), ("csv.separator", "';;'")),
    ("a separator that is the mark", more('[csv]\ndecimal = ","'), ("csv: ',' is both separator and decimal mark",)),
    ("robot twice", both(said("rows", 'robot = "kr10"\nrows'), more("[robot]\n")), ("not TOML", "Inside [robot]")),
    ("no header", lambda folder: save(folder, table(folder)[1:]), ("'time_s' is missing",)),
    ("cells apart by ;", lambda folder: save(folder, [[";".join(row)] for row in table(folder)]), ("apart by ';'", 'separator = ";"')),
    ("an angle after a slide", both(renamed("a6_deg", "a6_mm"), added("a6_link_deg", "1")), ("'a6_link_deg' is an angle, but a6 slides",)),
    ("a commanded angle of a slide", both(renamed("a6_deg", "a6_mm"), added("a6_cmd_deg", "1")), ("'a6_cmd_deg' is an angle, but a6 slides",)),
    ("two postures of one pose", cell(8, "a4_deg", "14.06"), (CSV, "row 8", "'a4_deg'", "0.06° from where pose 2 stood first")),
    ("a mass without end", more("[tool]\nmass_kg = 1e308"), ("tool.mass_kg", "1000000")),
    ("a drawing without an error", more("[model]\nlength_mm = 0"), ("model.length_mm",)),
    ("an angle without end", cell(3, "a2_deg", "1e300"), (*A2_ROW_3, "is its unit right?")),
    ("a place without end", cell(3, "p1_x_mm", "1e300"), ("p1_x_mm", "is its unit right?")),
    ("time in nanoseconds", cell(5, "time_s", "1.7e18"), ("time_s", "is its unit right?")),
    ("more rows left out than there are", more("[csv]\nskip_rows = 99999999999999999999"), ("csv.skip_rows: say how many rows",)),
    ("a factor without end", more('[columns]\na2_deg = { from = "a2_deg", factor = 1e308 }'), ("columns.a2_deg.factor", "1000000")),
    # several at once
    ("many at once", both(cell(3, "a2_deg", "up"), cell(7, "time_s", "-5"), without("pose"), added("q7_x_mm", "1"), said("[1, 0, 0, 0]", "[1, 1, 0, 0]"), said('"link_3"', '"link_9"')), (*A2_ROW_3, "row 7", "backwards", "'pose' is missing", "'q7'", "frames.tracker", "'link_9'")),
]  # fmt: skip


def test_a_small_parquet_file_that_unfolds_to_gigabytes_is_refused(tmp_path):
    """One long word in many rows; the file itself has two kilobytes."""
    folder = write_good(tmp_path / "recording")
    (folder / CSV).unlink()
    word = pa.DictionaryArray.from_arrays(
        pa.array([0] * 300_000, pa.int32()), pa.array(["x" * 5_000])
    )
    file = folder / "samples.parquet"
    pa_parquet.write_table(pa.table({"stage": word}), file, store_schema=False)
    assert file.stat().st_size < 10_000
    with pytest.raises(Unusable, match=r"'stage' unfolds to over 1200000000 B"):
        read(folder, ARM)


@pytest.mark.parametrize(
    ("damage", "words"), [d[1:] for d in DAMAGES], ids=[d[0] for d in DAMAGES]
)
def test_a_damaged_recording_is_refused_with_its_place_named(tmp_path, damage, words):
    folder = write_good(tmp_path / "recording")
    read(folder, ARM)
    damage(folder)
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(Unusable) as caught:
        read(folder, ARM)
    for word in words:
        assert word in str(caught.value)
    assert all("\n" not in fault for fault in caught.value.faults)
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("column", ["a2_deg", "pose"])
def test_a_single_damage_is_reported_as_a_single_fault(tmp_path, column):
    folder = write_good(tmp_path / "recording")
    both(said('"absolute"', '"relative"'), cell(3, column, "up"))(folder)
    with pytest.raises(Unusable) as caught:
        read(folder, ARM)
    place = f"samples.csv, line 4 (row 3 below the header), column {column!r}"
    assert caught.value.faults == (f"{place}: 'up' is not a number.",)


def test_one_fault_of_many_rows_is_named_once_with_their_lines(tmp_path):
    folder = write_good(tmp_path / "recording")
    every("a2_deg", lambda _: "up")(folder)
    with pytest.raises(Unusable) as caught:
        read(folder, ARM)
    (fault,) = caught.value.faults
    assert "line 2 (row 1" in fault
    assert fault.endswith("The same in lines 3, 4, 5, 6, 7 and 14 more.")


def test_different_faults_of_a_column_are_named_five_times_and_counted(tmp_path):
    folder, words = write_good(tmp_path / "recording"), count()
    every("a2_deg", lambda _: f"up{next(words)}")(folder)
    with pytest.raises(Unusable) as caught:
        read(folder, ARM)
    assert len(caught.value.faults) == 6
    assert "and 15 more rows" in caught.value.faults[-1]


def test_a_wrong_id_of_a_pose_is_one_fault_though_every_axis_stands_elsewhere(tmp_path):
    folder = write_good(tmp_path / "recording")
    header, *rows = table(folder)
    ids = [row[header.index("pose")] for row in rows]
    other = next(n for n, pose in enumerate(ids) if pose != ids[0])
    cell(other + 1, "pose", ids[0])(folder)
    with pytest.raises(Unusable) as caught:
        read(folder, ARM)
    told = [fault for fault in caught.value.faults if "stood first" in fault]
    assert len(told) == 1
    assert "column 'pose'" in told[0]
    assert "axes stand elsewhere" in told[0]


def test_no_folder_and_a_file_for_a_folder_are_refused(tmp_path):
    (tmp_path / "file").write_text("")
    said = {"nothing": "no such folder", "file": "becomes one first: .*import_rec"}
    for name, match in said.items():
        with pytest.raises(Unusable, match=match):
            read(tmp_path / name)


def test_a_samples_file_that_is_too_large_is_refused_unread(tmp_path):
    folder = write_good(tmp_path / "recording")
    with (folder / CSV).open("ab") as file:
        file.truncate(2**40)  # sparse: takes no room
    with pytest.raises(Unusable, match="the most is"):
        read(folder, ARM)


@pytest.mark.parametrize(
    "damage",
    [
        cell(3, "a2_deg", "up"),
        overwritten(CSV, bytes(range(256))),
        overwritten(TOML, b"a = " + b"[\n" * 100_000),
        said("[1, 0, 0, 0]", "[1, 1, 0, 0]"),
    ],
    ids=["text", "garbage", "arrays without end", "not a quaternion"],
)
def test_the_command_line_ends_with_2_and_one_message(
    tmp_path, damage, kr10, monkeypatch, capsys
):
    folder = write_good(tmp_path / "recording")
    damage(folder)
    before = sorted(tmp_path.rglob("*"))
    words = ["check", str(folder), "--robot", str(kr10)]
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as ended:
        run(check.main, check.Settings)
    assert ended.value.code == 2
    assert capsys.readouterr().err.count("cannot be used") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_a_model_of_another_arm_is_said_in_one_sentence(tmp_path):
    """Not by its missing columns and by each angle beyond another joint's limits."""
    folder = write_good(tmp_path / "recording")
    for name in ("a5_deg", "a6_deg"):
        without(name)(folder)
    every("a2_deg", lambda _: "-250")(folder)
    with pytest.raises(Unusable, match="recorded on 4 axes, but this model has 6 axes"):
        read(folder, ARM)
    with pytest.raises(Unusable, match=r"1 fault[^s](.|\n)*'a5_deg' to 'a6_deg' is"):
        read(folder, ARM)
