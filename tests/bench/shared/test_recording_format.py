"""What is read of a recording's folder: units, visits, stages, columns, markers."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pa_parquet
import pytest
from recordings import (
    ARM,
    added,
    assert_same,
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
from bench.shared.format.columns import UNITS
from bench.shared.format.folder import read
from bench.shared.recording import (
    STAGES,
    Recording,
    last_moves,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_good(tmp_path / "recording")


# --- What a good folder says ---------------------------------------------------------


def test_in_memory_everything_is_in_si_and_radians(folder):
    recording, notes = read(folder, ARM)
    assert notes == ()
    assert recording.time[6] == 70.0
    np.testing.assert_array_equal(
        recording.posture[0], np.radians([6, 7, 8, 9, 10, 11])
    )
    assert recording.points is not None
    np.testing.assert_allclose(
        recording.points[0], [[0.1, 0.107, 0.114], [0.5, 0.507, 0.514]]
    )
    assert recording.tracker is not None
    np.testing.assert_allclose(recording.tracker.repeatability, 1e-5)
    assert recording.base_from_tracker is not None
    np.testing.assert_allclose(recording.base_from_tracker[:3, 3], [0.1, 0, 0])
    first, second = (marker.position for marker in recording.markers)
    assert first is not None and second is None
    np.testing.assert_allclose(first, [0.01, 0.02, 0.03])


def test_a_run_of_equal_pose_is_one_visit_and_the_pose_can_come_again(folder):
    recording, _ = read(folder)
    np.testing.assert_array_equal(recording.visit, np.repeat([0, 1, 2, 3], 5))
    assert recording.posture_id[0] == recording.posture_id[-1]


def test_absent_stages_are_read_from_the_course_of_the_load(folder):
    up_and_down = ["unloaded", "loading", "loaded", "unloading", "unloaded"]
    assert read(folder)[0].stage.tolist() == up_and_down * 4
    without("load_kg")(folder)  # the wrench alone says the same
    assert read(folder)[0].stage.tolist() == up_and_down * 4


def test_a_load_that_turns_back_halfway_is_unloading_then_loading(folder):
    for row, load in zip(range(1, 6), ("5", "2", "8", "2", "0"), strict=True):
        cell(row, "load_kg", load)(folder)
    stages = ["loading", "unloading", "loaded", "unloading", "unloaded"]
    assert read(folder)[0].stage[:5].tolist() == stages


def test_without_load_time_the_load_changed_right_after_the_row_before(folder):
    recording, _ = read(folder)
    before = np.concatenate([recording.time[:1], recording.time[:-1]])
    np.testing.assert_array_equal(recording.load_time, before)


def test_a_second_reading_under_the_same_mass_is_a_dwell(folder):
    cell(4, "load_kg", "10")(folder)
    recording, _ = read(folder)
    assert recording.load_time[2] == recording.load_time[3] == recording.time[1]


def test_a_load_time_that_is_given_is_taken(folder):
    added("load_time_s", "-3.5")(folder)
    assert set(read(folder)[0].load_time) == {-3.5}


def test_unknown_columns_are_reported_and_left_alone(folder):
    added("operator", "who knows, NaN")(folder)
    recording, notes = read(folder)
    assert notes == ("samples.csv: column 'operator' left alone.",)
    assert len(recording.time) == 20


def test_a_blank_marker_or_link_angle_was_not_seen(folder):
    both(added("a2_link_deg", "7"), cell(3, "a2_link_deg", ""))(folder)
    both(cell(3, "p1_x_mm", ""), cell(3, "p1_y_mm", ""), cell(3, "p1_z_mm", " "))(
        folder
    )
    recording, _ = read(folder)
    assert recording.points is not None and recording.link_posture is not None
    assert np.argwhere(np.isnan(recording.points)).tolist() == [
        [2, 0, c] for c in range(3)
    ]
    assert np.isnan(recording.link_posture[2, 1])
    assert np.isnan(recording.link_posture[:, 0]).all()
    assert recording.link_posture[0, 1] == np.radians(7.0)


def test_commanded_angles_are_read_beside_the_reported_ones(folder):
    added("a2_cmd_deg", "7")(folder)
    recording, notes = read(folder)
    assert notes == () and recording.commanded is not None
    assert (recording.commanded[:, 1] == np.radians(7.0)).all()
    assert np.isnan(recording.commanded[:, [0, 2, 3, 4, 5]]).all()


def test_an_axis_moves_on_until_it_has_come_back_by_more_than_noise():
    """Steps of 0.1 mrad add up; a flicker of 0.1 mrad is no way back."""
    angle = np.array([0.0, 1e-4, 2e-4, 3e-4, 2e-4, 4e-4, 1e-4])
    assert last_moves(angle[:, None])[:, 0].tolist() == [0, 0, 0, 1, 1, 1, -1]


@pytest.mark.parametrize(
    ("rows", "shares"),
    [
        ("plateaus", [[0, 0], [1, 0.2], [1, 0.2], [1, 0.2]]),
        ("stream", [[0, 0], [1, 0.2], [0, 1], [0, -1]]),
    ],
)
def test_an_angle_that_follows_the_load_within_a_visit_is_no_move(rows, shares):
    """By 1.5 mrad, and back; each instant of a stream is a stand of its own."""
    posture = np.array([[0.0, 0.0], [0.5, 0.1], [0.5, 0.1015], [0.5, 0.1]])
    visit, time = np.array([0, 1, 1, 1]), np.arange(4.0)
    stage = np.full(4, STAGES[0])
    seen = Recording("droop", time, visit, visit, posture, time, stage, rows=rows)
    np.testing.assert_allclose(seen.moves.share, shares, atol=1e-12)


def test_rows_that_are_taken_out_keep_the_way_they_were_reached(folder):
    recording, _ = read(folder)
    some = np.flatnonzero(recording.visit % 2 == 1)
    np.testing.assert_array_equal(recording.take(some).side, recording.side[some])
    assert np.abs(recording.side).any()


def test_a_slide_axis_is_in_millimetres(folder):
    both(renamed("a1_deg", "a1_mm"), every("a1_mm", lambda _: "250"))(folder)
    arm = replace(ARM, slides=(True, *[False] * 5))
    recording, _ = read(folder, replace(arm, lower=np.r_[0.0, ARM.lower[1:]]))
    assert recording.slides == (True, False, False, False, False, False)
    assert set(recording.posture[:, 0]) == {0.25}
    with pytest.raises(Unusable, match="'a1_mm': 250mm to 250mm, beyond the limits"):
        read(folder, replace(arm, upper=np.r_[0.2, ARM.upper[1:]]))


def test_an_angle_may_exceed_its_limit_by_half_a_degree(folder):
    both(cell(3, "a2_deg", "45.5"), cell(3, "pose", "9"))(folder)
    rows = table(folder)
    save(folder, [rows[0], *rows[3:4], *rows[6:]])  # the second visit, and this row
    read(folder, ARM)
    cell(1, "a2_deg", "45.51")(folder)
    with pytest.raises(Unusable, match="beyond the limits"):
        read(folder, ARM)


def test_an_angle_whose_other_sign_is_within_the_limits_is_said_to_be(folder):
    """Once, not for each of the many angles."""
    every("a3_deg", lambda v: str(-140.0 - float(v) / 100.0))(folder)
    with pytest.raises(Unusable) as caught:
        read(folder, ARM)
    (fault,) = caught.value.faults
    said = "-120 to 156°; all rows are inside with the other sign (factor = -1.0)"
    assert said in fault
    every("a3_deg", lambda v: str(-float(v) * 1.2))(folder)
    cell(3, "a3_deg", "-170")(folder)
    with pytest.raises(Unusable, match="-120 to 156°\\."):
        read(folder, ARM)


def test_an_angle_of_many_turns_is_doubted_for_its_unit_before_its_zero(folder):
    """Degrees that were read as radians."""
    every("a3_deg", lambda v: str(np.degrees(-float(v))))(folder)
    said = "all rows are inside taken for degrees (check the unit)."
    with pytest.raises(Unusable, match=re.escape(said)):
        read(folder, ARM)


def test_what_brings_an_angle_within_the_limits_is_said(folder):
    """Its axis' other zero, or the axis that it is counted against."""
    every("a3_deg", lambda v: str(175.0 + float(v) / 100.0))(folder)
    said = (
        r"-120 to 156°; all rows are inside counted from another zero \(-90°, -180°\)\."
    )
    with pytest.raises(Unusable, match=said):
        read(folder, ARM)
    rows = table(folder)
    a2, a3 = (rows[0].index(name) for name in ("a2_deg", "a3_deg"))
    for k, row in enumerate(rows[1:]):
        row[a2] = str(40.0 - 140.0 * (k // 5 % 2))
        row[a3] = str(150.0 - float(row[a2]))
    save(folder, rows)
    said = "all rows are inside counted from another zero (-180°) or uncoupled (+a2)."
    with pytest.raises(Unusable, match=re.escape(said)):
        read(folder, ARM)


def test_parquet_says_the_same_as_csv(folder):
    both(cell(3, "p1_x_mm", ""), added("stage", "loaded"))(folder)
    plain, _ = read(folder)
    rows = table(folder)
    columns = dict(zip(rows[0], zip(*rows[1:], strict=True), strict=True))
    numbers = {
        n: [float(v) if v else None for v in c]
        for n, c in columns.items()
        if n != "stage"
    }
    content = pa.table(
        {**numbers, "stage": pa.array(columns["stage"]).dictionary_encode()}
    )
    pa_parquet.write_table(content, folder / "samples.parquet")
    (folder / "samples.csv").unlink()
    assert_same(read(folder)[0], plain)


def test_another_order_of_columns_and_blanks_around_cells_change_nothing(
    folder,
):
    plain, _ = read(folder)
    spread = [[f" {text} " for text in reversed(row)] for row in table(folder)]
    save(folder, spread)
    path = folder / "samples.csv"
    path.write_bytes(
        b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n") + b"\r\n\r\n"
    )
    assert_same(read(folder)[0], plain)


def test_a_lab_s_own_csv_is_read_through_a_mapping(folder):
    plain, _ = read(folder)
    every("a1_deg", lambda v: repr(float(np.radians(float(v)))))(folder)
    every("fz_n", lambda v: repr(float(v) / 1e3))(folder)
    every("p1_x_mm", lambda v: repr(float(v) / 1e3))(folder)
    both(renamed("a1_deg", "J1"), renamed("fz_n", "Kraft"), renamed("time_s", "t"))(
        folder
    )
    path = folder / "samples.csv"
    path.write_text(path.read_text().replace(",", ";").replace(".", ","))
    more(
        '[csv]\nseparator = ";"\ndecimal = ","\n[columns]\ntime_s = "t"\n'
        'a1_deg = { from = "J1", unit = "rad" }\n'
        'fz_n = { from = "Kraft", unit = "kN" }\n'
        'p1_x_mm = { unit = "m" }\n'
    )(folder)
    recording, notes = read(folder, ARM)
    assert notes == ()
    for mine, theirs in (
        (recording.posture, plain.posture),
        (recording.wrench, plain.wrench),
        (recording.points, plain.points),
    ):
        assert mine is not None and theirs is not None
        np.testing.assert_allclose(mine, theirs, rtol=1e-14, atol=1e-16)


UNIT_ROWS = [
    ("angle", "deg", 180.0, np.pi),
    ("angle", "rad", 2.0, 2.0),
    ("angle", "mrad", 2.0, 0.002),
    ("angle", "urad", 2.0, 2e-6),
    ("angle", "arcmin", 60.0, np.pi / 180),
    ("angle", "arcsec", 3600.0, np.pi / 180),
    ("length", "mm", 5.0, 0.005),
    ("length", "cm", 5.0, 0.05),
    ("length", "m", 5.0, 5.0),
    ("length", "um", 5.0, 5e-6),
    ("length", "in", 1.0, 0.0254),
    ("force", "N", 3.0, 3.0),
    ("force", "kN", 3.0, 3000.0),
    ("force", "mN", 3.0, 0.003),
    ("force", "kgf", 2.0, 19.6133),
    ("force", "lbf", 1.0, 0.45359237 * 9.80665),
    ("torque", "Nm", 3.0, 3.0),
    ("torque", "kNm", 3.0, 3000.0),
    ("torque", "mNm", 3.0, 0.003),
    ("torque", "Nmm", 3.0, 0.003),
    ("time", "s", 3.0, 3.0),
    ("time", "ms", 3.0, 0.003),
    ("time", "us", 3.0, 3e-6),
    ("time", "ns", 3.0, 3e-9),
    ("time", "min", 3.0, 180.0),
    ("time", "h", 2.0, 7200.0),
    ("mass", "kg", 3.0, 3.0),
    ("mass", "g", 3.0, 0.003),
    ("temperature", "degC", 20.0, 20.0),
    ("temperature", "K", 293.15, 20.0),
    ("temperature", "degF", 68.0, 20.0),
]


@pytest.mark.parametrize(("dimension", "unit", "number", "si"), UNIT_ROWS)
def test_a_unit_turns_a_number_into_si(dimension, unit, number, si):
    found = UNITS[dimension][unit]
    np.testing.assert_allclose(found.inward(np.array([number])), [si], rtol=1e-14)
    np.testing.assert_allclose(found.outward(np.array([si])), [number], rtol=1e-14)


def test_every_unit_that_can_be_named_is_tested_above():
    tested = {(dimension, unit) for dimension, unit, *_ in UNIT_ROWS}
    assert tested == {(d, u) for d, units in UNITS.items() for u in units}


def test_the_model_s_own_names_are_kept_for_the_arm(folder):
    more(
        '[robot]\nname = "kr"\naxes = ["a1", "a2", "a3", "a4", "a5", "a6"]\n'
        'bodies = { flange = "tool" }'
    )(folder)
    recording, _ = read(folder, ARM)
    assert recording.robot == "kr"
    assert recording.axes == ARM.joints and recording.bodies == {"flange": "tool"}


def test_a_target_in_6d_is_four_markers_of_one_body(folder):
    for name in ("p3", "p4"):
        more(f'[markers.{name}]\nbody = "flange"\ntarget = "t"\n')(folder)
        for axis in "xyz":
            added(f"{name}_{axis}_mm", "1")(folder)
    both(
        said('body = "flange"', 'body = "flange"\ntarget = "t"'),
        said('"link_3"', '"flange"\ntarget = "t"'),
    )(folder)
    assert {m.target for m in read(folder)[0].markers} == {"t"}


def test_a_quaternion_that_is_nearly_one_is_made_one(folder):
    said("[1, 0, 0, 0]", "[1.0009, 0, 0, 0]")(folder)
    recording, _ = read(folder)
    assert recording.base_from_tracker is not None
    np.testing.assert_array_equal(recording.base_from_tracker[:3, :3], np.eye(3))
