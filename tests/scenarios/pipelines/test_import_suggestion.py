# ruff: noqa: E501 (a table is as wide as it is)
from pathlib import Path

import numpy as np
import pytest

from bench.shared.errors import Unusable
from bench.shared.models import ModelFacts
from scenarios.import_recording import Settings, main
from scenarios.pipelines.importing.suggestion import guess_of, sheet_of, suggested

SHEET = """Cell 4;;;;;;;;;;;;;;
Time;Axis 1 [rad];Axis 2 [rad];Fx;Fy;Fz;TCP X;TCP Y;TCP Z;TCP std X;TCP std Y;TCP std Z;Temp [°C];Pose;Größe
min;;;kN;kN;kN;m;m;m;µm;µm;µm;;;
0,0;0,5;0,25;0,1;0;0;1,5;0,25;0,5;10;10;20;21,5;1;a
0,5;0,5;0,25;0,2;0;0;1,6;0,25;0,5;10;10;20;21,5;1;b
1,0;0,7;;0,1;0;0;1,7;0,25;0,5;10;10;20;21,5;2;c
1,5;0,9;0,35;0,2;0;0;1,8;0,25;0,5;10;10;20;21,5;3;d
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16"])
def test_what_is_suggested_reads_the_file_it_is_for(tmp_path, encoding, capsys):
    file, mapping = tmp_path / "cell.csv", tmp_path / "cell.toml"
    file.write_bytes(SHEET.encode(encoding))
    with pytest.raises(SystemExit, match="0"):
        main(Settings(suggest=file))
    assert "a mapping to correct" in capsys.readouterr().out
    read = main(Settings(file, mapping, tmp_path / "out"))
    assert read is not None and read.points is not None and read.wrench is not None
    assert read.tracker is not None and read.temperature is not None
    np.testing.assert_allclose(read.time, [0, 30, 90])
    np.testing.assert_allclose(read.posture[:, 1], [0.25, 0.25, 0.35])
    np.testing.assert_allclose(read.wrench[:, 0], [100, 200, 200])
    np.testing.assert_allclose(read.points[:, 0, 0], [1.5, 1.6, 1.8])
    np.testing.assert_allclose(read.tracker.repeatability, [1e-5, 1e-5, 2e-5])
    assert read.posture_id.tolist() == [1, 1, 3]


def test_columns_called_after_joints_of_the_robot_are_its_axes():
    model = ModelFacts(
        ("rail", "shoulder_pan_joint", "shoulder_lift_joint", "finger"),
        (True, False, False, True),
        np.zeros(4),
        np.ones(4),
        ("base",),
        ("finger",),
    )
    columns = "rail (m);pan (deg);shoulder_lift_joint [rad];shoulder;finger;x"
    sheet = sheet_of(f"{columns}\n1;2;3;4;5;6\n1;2;3;4;5;7\n".encode())
    assert guess_of(sheet, model).columns == {
        "a1_mm": ("rail (m)", "m"),
        "a2_deg": ("pan (deg)", None),
        "a3_deg": ("shoulder_lift_joint [rad]", "rad"),
    }


@pytest.mark.parametrize(
    ("name", "factors", "asked", "truth"),
    [
        ("J2+J3", [1, -1], "a3_deg", 30.0),
        ("J3 - J2", [1, 1], "a3_deg", 30.0),
        ("J2-J3", [-1, 1], "a3_deg", 30.0),
        ("A1+A2 [°]", [1, -1], "a1_deg", 10.0),
    ],
)
def test_a_column_of_two_axes_is_what_it_holds_beside_the_known_one(
    tmp_path, name, factors, asked, truth
):
    """Of angles 10, 20 and 30 degrees."""
    held = {"J2+J3": 50, "J3 - J2": 10, "J2-J3": -10, "A1+A2 [°]": 30}[name]
    other = ("J1", 10) if asked == "a3_deg" else ("J3", 30)
    file = tmp_path / "cell.csv"
    file.write_text(
        f"Time;{other[0]};J2;{name};X;Y;Z\n"
        f"0;{other[1]};20;{held};0,1;0;0\n9;{other[1]};20;{held};0,2;0;0\n"
    )
    text = suggested(file)
    assert f'{asked} = {{ from = ["{name}", "J2"], sum = {factors} }}' in text
    assert "not understood" not in text
    text = text.replace('# body = "?"', 'body = "flange"')
    (tmp_path / "m.toml").write_text(text)
    read = main(Settings(file, tmp_path / "m.toml", tmp_path / "out"))
    assert read is not None
    k = int(asked[1]) - 1
    np.testing.assert_allclose(np.degrees(read.posture[:, k]), truth)


def test_a_suggestion_is_never_written_over_a_mapping(tmp_path):
    (tmp_path / "cell.csv").write_text(SHEET)
    (tmp_path / "mine.toml").write_text("mine")
    settings = Settings(suggest=tmp_path / "cell.csv", mapping=tmp_path / "mine.toml")
    with pytest.raises(Unusable, match="it is there already"):
        main(settings)
    assert (tmp_path / "mine.toml").read_text() == "mine"


@pytest.mark.parametrize(
    ("name", "below", "said", "unit"),
    [
        ("J3", "", "a3_deg", None),
        ("q_3 (rad)", "", "a3_deg", "rad"),
        ("Achse 3 [°]", "", "a3_deg", None),
        ("Ax3 (rad)", "", "a3_deg", "rad"),
        ("F_x", "kN", "fx_n", "kN"),
        ("Force Y [N]", "", "fy_n", None),
        ("Mz", "Nmm", "tz_nm", "Nmm"),
        ("t_ms", "", None, None),
        ("Zeit [s]", "", "time_s", None),
        ("timestamp", "ms", "time_s", "ms"),
        ("load_kg", "", "load_kg", None),
        ("Temp Halle", "°C", "temperature_c", None),
        ("Ambient [°F]", "", "temperature_c", "degF"),
        ("Zusatzlast [g]", "", "load_kg", "g"),
        ("Gewicht", "kg", "load_kg", None),
        ("Zuggewicht", "g", "load_kg", "g"),
        ("Messpunkt Nr.", "", "pose", None),
        ("Point no", "", "pose", None),
        ("Temp", "°F", "temperature_c", "degF"),
        ("Remark", "", None, None),
    ],
)
def test_a_column_is_known_by_its_name_and_its_unit(name, below, said, unit):
    sheet = sheet_of(f"{name};other\n{below};\n1;2\n".encode())
    columns = dict(guess_of(sheet).columns)
    assert columns == ({} if said is None else {said: (name, unit)})


def test_what_nobody_understood_is_listed_and_what_is_guessed_is_asked(tmp_path):
    file = tmp_path / "lab.csv"
    file.write_text("J1,X,Y,Z,who\n1.5,1,2,3,me\n")
    text = suggested(file)
    assert '# not understood: "who"' in text
    assert "number_rows = true  # each row is a pose of its own: is it so?" in text
    assert "interval_s = 20  # nothing tells the time" in text
    assert "repeatability_mm = 0.02  # one sigma of one reading: say yours" in text


def test_a_unit_that_nobody_knows_is_not_passed_over(tmp_path):
    file = tmp_path / "lab.csv"
    file.write_text("J1;Fx;Fy [kp];X;Y;Z\n°;lbs;;mm;mm;mm\n1;2;3;4;5;6\n1;2;3;4;5;7\n")
    text = suggested(file)
    assert 'fx_n = "Fx"  # "lbs" is none of N, kN, mN, kgf, lbf: if it is a' in text
    assert 'fy_n = { from = "Fy [kp]", unit = "kgf" }\n' in text
    assert text.count("is none of") == 1


@pytest.mark.parametrize(
    ("marker", "robot", "body"),
    [
        ("base_a", (), "base"),
        ("Link2-a", (), "link_2"),
        ("link_12", (), "link_12"),
        ("TCP", (), "flange"),
        ("baseline", (), ""),
        ("linked", (), ""),
        ("l2_a", (), ""),
        ("l2_a", ("l2", "l21", "flange"), "l2"),
        ("l21", ("l2", "l21", "flange"), "l21"),
    ],
)
def test_a_marker_is_on_the_body_that_its_name_begins_with(
    tmp_path, marker, robot, body
):
    file = tmp_path / "lab.csv"
    file.write_text(f"J1,{marker}_X,{marker}_Y,{marker}_Z,Fx\n1.5,1,2,3,4\n")
    model = ModelFacts((), (), np.zeros(0), np.zeros(0), robot)
    text = suggested(file, model)
    assert (f'\nbody = "{body}"  # by' if body else '\n# body = "?"') in text
    assert "# what the world exerts on the robot" in text


def test_a_body_that_was_not_said_is_refused(tmp_path):
    file, mapping = tmp_path / "lab.csv", tmp_path / "lab.toml"
    file.write_text("J1,X,Y,Z\n1.5,1,2,3\n1.6,1,2,3\n")
    mapping.write_text(suggested(file))
    with pytest.raises(Unusable, match=r"markers\.p.*body"):
        main(Settings(file, mapping, tmp_path / "out"))


@pytest.mark.parametrize(
    "content", ["", "1,2,3\n4,5,6\n", "just words\n", "a;b\nc;d\n"]
)
def test_a_file_that_is_no_table_gets_no_suggestion(tmp_path: Path, content):
    (tmp_path / "lab.csv").write_text(content)
    with pytest.raises(Unusable, match=r"it is empty|no line looks like names"):
        suggested(tmp_path / "lab.csv")


def test_neither_a_file_nor_a_suggestion_says_what_to_give():
    with pytest.raises(Unusable, match=r"or --suggest FILE\.csv"):
        main(Settings())
