import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.shared.errors import BenchError, Unusable
from bench.shared.format import folder as files
from scenarios import import_recording
from scenarios.import_recording import Settings, main
from scenarios.pipelines.importing import ros_bag
from scenarios.pipelines.importing.clocks import lag_of
from scenarios.pipelines.importing.mapping import Topics
from scenarios.report.command_line import run

MAPPING = """format = 1
name = "from a spreadsheet"
rows = "plateaus"

[csv]
separator = ";"
decimal = ","

[columns]
time_s = { from = "Zeit [min]", unit = "min" }
pose = "Nr"
a1_deg = "J1"
a2_deg = { from = "J2", unit = "rad" }
fx_n = { from = "F x", unit = "kN" }
fy_n = "F y"
fz_n = "F z"
tx_nm = "M x"
ty_nm = "M y"
tz_nm = "M z"
p_x_mm = { from = "X", unit = "m" }
p_y_mm = { from = "Y", unit = "m" }
p_z_mm = { from = "Z", unit = "m" }

[sensors.tracker]
repeatability_mm = 0.02
[sensors.wrench]
accuracy_n = 0.5
accuracy_nm = 0.05
[markers.p]
body = "link_2"
"""
TARGET = """
[targets.t]
body = "link_2"
position = ["X", "Y", "Z"]
rotation = ["A", "B", "C"]
length_unit = "m"
arm_mm = 50
"""
HEADER = "Zeit [min];Nr;J1;J2;F x;F y;F z;M x;M y;M z;X;Y;Z;A;B;C;Bemerkung"
ROWS = (
    "0,0;1;10,5;0,25;0;0;0;0;0;0;1,25;0;0,5;90;0;0;start",
    "0,5;1;10,5;0,25;0,125;0;0;0;0;0;1,250125;0;0,5;90;0;0;",
    "1,0;2;20;-0,25;0;0;0;0;0;0;;;;;;;nicht gesehen",
    "1,5;2;20;-0,25;0,125;0;0;0;0;0;1,5;0;0,25;0;90;0;",
)


@pytest.fixture
def lab(tmp_path) -> Callable[..., Path]:
    def write(rows=ROWS, mapping=MAPPING, start="\ufeff") -> Path:
        text = start + "\r\n".join([HEADER, *rows]) + "\r\n;;;;;;;;;;;;;;;;\r\n"
        (tmp_path / "lab.csv").write_text(text, encoding="utf-8")
        (tmp_path / "map.toml").write_text(mapping, encoding="utf-8")
        return tmp_path

    return write


def imported(folder: Path):
    settings = Settings(folder / "lab.csv", folder / "map.toml", folder / "out")
    read = main(settings)
    assert read is not None
    return read


def refused(folder: Path) -> str:
    with pytest.raises(Unusable) as caught:
        imported(folder)
    assert not (folder / "out").exists()
    return str(caught.value)


@pytest.mark.parametrize("start", ["\ufeff", "", "sep=;\r\n", "\ufeffsep=;\r\n"])
def test_a_spreadsheet_s_own_numbers_arrive_in_si(lab, start, capsys):
    folder = lab(start=start)
    imported(folder)
    recording, _ = files.read(folder / "out")
    np.testing.assert_allclose(recording.time, [0, 30, 60, 90])
    np.testing.assert_allclose(recording.posture[2], [np.radians(20), -0.25])
    assert recording.wrench is not None and recording.points is not None
    np.testing.assert_allclose(recording.wrench[1, 0], 125.0)
    np.testing.assert_allclose(recording.points[1, 0], [1.250125, 0, 0.5])
    assert np.isnan(recording.points[2, 0]).all()
    said = capsys.readouterr().out
    assert "lab.csv: 4 columns left alone: 'A', 'B', 'C', 'Bemerkung'." in said


def test_a_target_in_6d_becomes_four_markers_of_one_name(lab):
    """ZYX angles of 90, 0, 0 turn x to y; of 0, 90, 0 turn z to x."""
    folder = lab(mapping=MAPPING + TARGET)
    imported(folder)
    recording, _ = files.read(folder / "out")
    names = ["p", "t_o", "t_x", "t_y", "t_z"]
    assert [m.name for m in recording.markers] == names
    assert {m.target for m in recording.markers[1:]} == {"t"}
    assert recording.points is not None
    arms = recording.points[:, 2:] - recording.points[:, 1:2]
    np.testing.assert_allclose(arms[0, 0], [0, 0.05, 0], atol=1e-12)
    np.testing.assert_allclose(arms[3, 2], [0.05, 0, 0], atol=1e-12)
    assert np.isnan(recording.points[2]).all()


@pytest.mark.parametrize("last", ["t", "u"])
def test_two_targets_keep_their_rows_where_one_of_them_is_not_seen(tmp_path, last):
    header = HEADER.removesuffix(";Bemerkung") + ";X2;Y2;Z2;A2;B2;C2"
    rows = [
        f"{row.rpartition(';')[0]};{k},5;0;0,25;0;0;0" for k, row in enumerate(ROWS)
    ]
    other = re.sub(
        r'"([XYZABC])"', r'"\g<1>2"', TARGET.replace("targets.t", "targets.u")
    )
    targets = (other, TARGET) if last == "t" else (TARGET, other)
    (tmp_path / "lab.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    mapping = MAPPING + "".join(targets)
    (tmp_path / "map.toml").write_text(mapping, encoding="utf-8")
    recording = imported(tmp_path)
    assert recording.points is not None
    names = [m.name for m in recording.markers]
    always, sometimes = (recording.points[:, names.index(n)] for n in ("u_o", "t_o"))
    np.testing.assert_allclose(always[:, 0], [0.5, 1.5, 2.5, 3.5])
    np.testing.assert_allclose(sometimes[:, 0], [1.25, 1.250125, np.nan, 1.5])


def test_a_target_s_quaternion_means_the_same(lab):
    quaternion = Rotation.from_euler("ZYX", [90, 0, 0], degrees=True).as_quat(
        scalar_first=True
    )
    cells = [f"{v:.12f}".replace(".", ",") for v in quaternion]
    changed = TARGET.replace(
        'rotation = ["A", "B", "C"]', 'quaternion_wxyz = ["A", "B", "C", "Bemerkung"]'
    )
    row = ROWS[0].rsplit(";", 4)[0] + ";" + ";".join(cells)
    folder = lab(rows=[row], mapping=MAPPING + changed)
    recording = imported(folder)
    assert recording.points is not None
    arm = recording.points[0, 2] - recording.points[0, 1]
    np.testing.assert_allclose(arm, [0, 0.05, 0], atol=1e-9)


def test_all_faults_are_named_at_once_in_the_user_s_own_names(lab):
    rows = (
        ROWS[0].replace("10,5", "zehn"),
        *ROWS[1:3],
        ROWS[3].replace("1,5;2", "x;2"),
    )
    mapping = MAPPING.replace('"J2"', '"J3"') + TARGET.replace('"C"', '"D"')
    said = refused(lab(rows=rows, mapping=mapping))
    for words in (
        "lab.csv, line 2 (row 1 below the header)",
        "'zehn'",
        "'x'",
        "'J3'",
        "targets.t",
        "'D'",
    ):
        assert words in said
    assert "samples.csv" not in said and "recording.toml" not in said


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("[rests]\nspeed_deg_per_s = 0.5\nhold_s = 1\n", 'say rows = "stream"'),
        ("[rests]\nspeed = 1\n", "rests.speed: nothing is called so"),
        (TARGET.replace("50", "-1"), "targets.t.arm_mm"),
        (TARGET.replace("rotation", "quaternion"), "targets.t.quaternion"),
        (TARGET.replace('rotation = ["A", "B", "C"]', ""), "either rotation"),
        ("[markers.p]\n", "not TOML"),
        ('[x]\nrobot = "a"\n[robot]\n[robot]\n', "Inside [robot]"),
    ],
)
def test_a_mapping_that_cannot_be_meant_is_refused(lab, more, words):
    assert words in refused(lab(mapping=MAPPING + more))


@pytest.mark.parametrize("name", ["markers", "csv", "columns"])
@pytest.mark.parametrize("value", ["'x'", "5", "[1]"])
def test_a_part_of_the_mapping_that_is_no_table_is_refused_beside_targets(
    lab, name, value
):
    head, *parts = MAPPING.split("\n[")
    kept = [p for p in parts if not p.startswith((f"{name}]", f"{name}."))]
    mapping = "\n[".join([f"{head}{name} = {value}\n", *kept])
    assert f"{name}: expected a table" in refused(lab(mapping=mapping + TARGET))


def faults_of(folder: Path) -> tuple[str, ...]:
    with pytest.raises(Unusable) as caught:
        imported(folder)
    return caught.value.faults


def test_a_word_nobody_knows_in_csv_is_named_and_the_rest_of_it_still_holds(lab):
    mapping = MAPPING.replace("[csv]", '[csv]\nquotes = "single"')
    known = "Known here: separator, decimal, decimal_mark, encoding, skip_rows, "
    (fault,) = faults_of(lab(mapping=mapping))
    assert "csv.quotes: nothing is called so" in fault and known in fault
    both = faults_of(lab(mapping=mapping.replace('"J1"', '"J9"')))
    assert len(both) == 2 and "column 'J9' is missing" in both[1]


@pytest.mark.parametrize("wrong", ["seperator", "decimalmark"])
def test_a_word_of_csv_that_is_misspelt_costs_a_line_and_hides_no_other_fault(
    lab, wrong
):
    right = "separator" if wrong == "seperator" else "decimal"
    mapping = MAPPING.replace(f"{right} =", f"{wrong} =")
    named, cell = faults_of(lab([*ROWS[:3], "x" + ROWS[3]], mapping))
    assert f"csv.{wrong}: nothing is called so. Did you mean '{right}" in named
    assert "'x1,5' is not a number" in cell


@pytest.mark.parametrize("remark", ["", "again"])
@pytest.mark.parametrize("row", range(4))
def test_a_line_that_is_there_twice_is_refused_by_its_number(lab, row, remark):
    """Whatever stands in a column that nothing reads."""
    twice = [
        *ROWS[: row + 1],
        ROWS[row].rsplit(";", 1)[0] + f";{remark}",
        *ROWS[row + 1 :],
    ]
    (fault,) = faults_of(lab(twice, mapping=MAPPING + TARGET))
    assert fault.startswith(f"lab.csv, line {row + 3} (row {row + 2} below the header)")
    assert "the row above once more" in fault and "Delete one" in fault


@pytest.mark.parametrize("change", [("0,5;1", "0,6;1"), ("1,250125", "1,250126")])
def test_a_reading_taken_again_is_no_line_that_is_there_twice(lab, change):
    """Another time, or the noise of the instrument."""
    recording = imported(lab([*ROWS[:2], ROWS[1].replace(*change), *ROWS[2:]]))
    assert len(recording.time) == 5


def test_an_instant_of_a_stream_may_look_like_the_one_before(lab):
    rows = [*ROWS[:2], ROWS[1], *ROWS[2:]]
    recording = imported(lab(rows, MAPPING.replace("plateaus", "stream")))
    assert len(recording.time) == 5


@pytest.mark.parametrize("start", ["", "sep=;\r\n"])
def test_a_fault_names_the_line_by_the_number_that_a_spreadsheet_shows(lab, start):
    """The header is line 1; Excel takes `sep=` in and does not show it as a line."""
    rows = [*ROWS[:2], ROWS[2].replace("20;", "x;"), ROWS[3] + ";more"]
    cells, cell = faults_of(lab(rows, start=start))
    assert cells.startswith("lab.csv, line 5 (row 4 below the header): 18 cells")
    assert cell.startswith("lab.csv, line 4 (row 3 below the header), column 'J1'")


def test_a_decimal_mark_that_no_number_has_is_one_fault_of_the_file(lab):
    mapping = MAPPING.replace('","', '"."') + TARGET
    (fault,) = faults_of(lab(mapping=mapping))
    assert "decimal comma" in fault and 'decimal = ","' in fault
    points = [row.replace(",", ".") for row in ROWS]
    (fault,) = faults_of(lab(points))
    assert "decimal point" in fault and 'decimal = "."' in fault


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda t: t.replace("10,5", "10.5"), "not a number with a decimal comma"),
        (lambda t: t.replace("1,25;", "1.000,25;"), "not a number with a decimal"),
        (lambda t: t + "1;2\r\n", "2 cells"),
    ],
)
def test_a_spreadsheet_s_own_slips_are_named(lab, spoil, words):
    folder = lab()
    file = folder / "lab.csv"
    text = file.read_bytes().decode().replace(";" * 16 + "\r\n", "")
    file.write_bytes(spoil(text).encode())
    assert words in refused(folder)


def test_names_that_look_like_paths_stay_names(lab, tmp_path):
    """Nothing is written beside the recording, whatever a target is called."""
    before = {p for p in tmp_path.parent.iterdir()}
    mapping = MAPPING + TARGET.replace("targets.t", 'targets."../../t"')
    recording = imported(lab(mapping=mapping))
    assert recording.markers[1].name == "../../t_o"
    assert {p for p in tmp_path.parent.iterdir()} == before


def test_missing_empty_and_binary_files_end_with_2(lab, monkeypatch, capsys):
    folder = lab()
    for content in (None, b"", b"PK\x03\x04zip", bytes(range(256))):
        (folder / "lab.csv").unlink(missing_ok=True)
        if content is not None:
            (folder / "lab.csv").write_bytes(content)
        words = [folder / "lab.csv", "--mapping", folder / "map.toml"]
        words = ["import_recording", *words, "--out", folder / "out"]
        monkeypatch.setattr("sys.argv", [str(w) for w in words])
        with pytest.raises(SystemExit) as end:
            run(import_recording.main, Settings)
        assert end.value.code == 2
        assert not (folder / "out").exists()
        assert "Traceback" not in capsys.readouterr().err


# --- Streams -------------------------------------------------------------------------


def moves(time):
    """Three places, each held for two seconds, a second of motion between them."""
    return np.interp(time, [0, 2, 3, 5, 6, 8], [0, 0, 0.4, 0.4, 0.1, 0.1])


def test_a_stream_becomes_plateaus_where_it_rests(lab):
    time = np.arange(0, 8, 0.02)
    rows = [
        f"{t / 60};0;{np.degrees(moves(t))};0;0;0;0;0;0;0;{np.cos(moves(t))};0;0;;;;"
        for t in time
    ]
    mapping = MAPPING.replace("plateaus", "stream")
    mapping += "[rests]\nspeed_deg_per_s = 0.5\nhold_s = 1.0\n"
    recording = imported(lab(rows=[r.replace(".", ",") for r in rows], mapping=mapping))
    assert recording.rows == "plateaus" and len(recording.time) == 3
    np.testing.assert_allclose(recording.posture[:, 0], [0, 0.4, 0.1], atol=1e-9)
    assert recording.frames is not None
    assert np.all(np.abs(recording.frames - 100) <= 2)


@pytest.mark.parametrize(
    ("poses", "more", "says"),
    [
        ("1", "", "where the arm stopped, add [rests] to the mapping"),
        ("1", "a1_link_deg", "give each motion a number of its own"),
        ("12", "", ""),
        ("1", "[rests]", ""),
    ],
)
def test_a_stream_that_is_one_pose_says_what_to_do(lab, capsys, poses, more, says):
    """A diagnosis counts poses; motions that have their numbers stay a stream."""
    time = np.arange(0, 8, 0.02)
    rows = [
        f"{t / 60};{poses[k * len(poses) // len(time)]};{np.degrees(moves(t))};"
        f"0;0;0;0;0;0;0;{np.cos(moves(t))};0;0;{np.degrees(moves(t))};;;"
        for k, t in enumerate(time)
    ]
    mapping = MAPPING.replace("plateaus", "stream")
    if more == "[rests]":
        mapping += "[rests]\nspeed_deg_per_s = 0.5\nhold_s = 1.0\n"
    elif more:
        mapping = mapping.replace("[columns]", f'[columns]\n{more} = "A"')
        mapping = mapping.replace("p_x_mm", "#").replace("p_y_mm", "#")
        mapping = mapping.replace("p_z_mm", "#").split("[markers.p]")[0]
    recording = imported(lab([r.replace(".", ",") for r in rows], mapping))
    assert len(np.unique(recording.posture_id)) == (
        3 if more == "[rests]" else len(poses)
    )
    said = [s for s in capsys.readouterr().out.splitlines() if "one pose" in s]
    assert [s.startswith("Note: all 400 instants") for s in said] == [True] * bool(says)
    assert says in "".join(said)


def test_a_lag_between_clocks_is_found_to_a_part_of_a_sample():
    fast, slow = np.arange(0, 20, 0.004), np.arange(0.3, 19, 0.01)
    angle = np.sin(2 * fast) * np.sin(0.7 * fast) ** 2
    delayed = slow - 0.137
    seen = np.sin(2 * delayed) * np.sin(0.7 * delayed) ** 2
    lag = lag_of(fast, angle[:, None], slow, 0.8 * seen[:, None])
    assert lag is not None
    np.testing.assert_allclose(lag, 0.137, atol=0.003)


def test_a_channel_in_which_nothing_moves_has_no_lag():
    time = np.arange(0, 20, 0.01)
    still = np.ones((len(time), 1))
    assert lag_of(time, np.sin(time)[:, None], time, still) is None


def test_a_bag_without_rosbags_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "rosbags", None)
    monkeypatch.setitem(__import__("sys").modules, "rosbags.rosbag2", None)
    with pytest.raises(BenchError, match="pip install"):
        ros_bag.columns_of(tmp_path, Topics(), ())


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
@pytest.mark.parametrize("name", ["log.mcap", "log.db3", "missing.mcap", "folder"])
def test_a_bag_that_is_none_is_refused(tmp_path, name, content):
    pytest.importorskip("rosbags.rosbag2")
    (tmp_path / "map.toml").write_text(BAG)
    if name == "folder":
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").write_bytes(content)
    elif name != "missing.mcap":
        (tmp_path / name).write_bytes(content)
    with pytest.raises(Unusable, match="it cannot be read"):
        main(Settings(tmp_path / name, tmp_path / "map.toml", tmp_path / "out"))
    assert not (tmp_path / "out").exists()


BAG = """format = 1
rows = "stream"
[robot]
axes = ["j1", "j2"]
[sensors.tracker]
repeatability_mm = 0.02
[sensors.wrench]
accuracy_n = 0.5
accuracy_nm = 0.05
[topics]
joints = "/joint_states"
wrench = "/wrench"
poses = { t = "/tracker" }
[targets.t]
body = "link_2"
position = ["t.x", "t.y", "t.z"]
quaternion_wxyz = ["t.qw", "t.qx", "t.qy", "t.qz"]
length_unit = "m"
[rests]
speed_deg_per_s = 0.5
hold_s = 1.0
"""


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_a_bag_s_channels_meet_on_the_joints_clock(tmp_path, plugin, whole, capsys):
    bag_at = bag_of(tmp_path, plugin, ["j2", "j1"])
    (tmp_path / "map.toml").write_text(BAG)
    if not whole:
        (bag_at,) = (*bag_at.glob("*.mcap"), *bag_at.glob("*.db3"))
    recording = main(Settings(bag_at, tmp_path / "map.toml", tmp_path / "out"))
    assert recording is not None
    np.testing.assert_allclose(recording.posture[:, 0], [0, 0.4, 0.1], atol=1e-6)
    np.testing.assert_allclose(recording.posture[:, 1], 0.0)
    assert recording.wrench is not None
    np.testing.assert_allclose(recording.wrench[:, 0], 3.0)
    assert recording.frames is not None and recording.frames.min() > 100
    said = capsys.readouterr().out
    lag = float(said.split("Lag of pose t behind the axes: ")[1].split(" ms")[0])
    assert abs(lag - 50.0) < 8.0


def test_joints_of_a_bag_with_names_of_their_own_are_said_by_name(tmp_path):
    """Their order in the messages is no order of the axes: nothing is guessed."""
    bag_at, mapping = bag_of(tmp_path, "MCAP", ["elbow", "waist"]), tmp_path / "m.toml"
    mapping.write_text(BAG)
    with pytest.raises(Unusable) as refusal:
        main(Settings(bag_at, mapping, tmp_path / "out"))
    (fault,) = refusal.value.faults
    assert "'j1', 'j2'" in fault and "there are: elbow, waist" in fault
    topics = '[topics]\njoint_names = ["waist", "elbow"]'
    mapping.write_text(BAG.replace("[topics]", topics))
    recording = main(Settings(bag_at, mapping, tmp_path / "out"))
    assert recording is not None
    np.testing.assert_allclose(recording.posture[:, 0], [0, 0.4, 0.1], atol=1e-6)


def bag_of(folder, plugin, names):
    """Write a bag of two joints, a tracker and a force sensor."""
    bags = pytest.importorskip("rosbags.rosbag2")
    types = pytest.importorskip("rosbags.typesys")
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    kind = store.types
    stamp, header = kind["builtin_interfaces/msg/Time"], kind["std_msgs/msg/Header"]
    vector, point = kind["geometry_msgs/msg/Vector3"], kind["geometry_msgs/msg/Point"]
    quaternion = kind["geometry_msgs/msg/Quaternion"]

    def at(t):
        return header(stamp(int(t), round(1e9 * (t % 1))), "")

    def joints(t):
        empty, angle = np.zeros(0), moves(t - 10)
        return names, np.array([0.0, angle]), empty, empty

    def pose(t):
        angle = moves(t - 10 - 0.05)
        turn = quaternion(0.0, 0.0, np.sin(angle / 2), np.cos(angle / 2))
        place = point(np.cos(angle), np.sin(angle), 0.5)
        return (kind["geometry_msgs/msg/Pose"](place, turn),)

    def wrench(t):
        zero = vector(0.0, 0.0, 0.0)
        return (kind["geometry_msgs/msg/Wrench"](vector(t * 0 + 3.0, 0.0, 0.0), zero),)

    channels = {
        "/joint_states": ("sensor_msgs/msg/JointState", joints, 0.008),
        "/tracker": ("geometry_msgs/msg/PoseStamped", pose, 0.01),
        "/wrench": ("geometry_msgs/msg/WrenchStamped", wrench, 0.05),
    }
    storage = bags.StoragePlugin[plugin]
    with bags.Writer(folder / "bag", version=9, storage_plugin=storage) as writer:
        for topic, (name, content, step) in channels.items():
            link = writer.add_connection(topic, name, typestore=store)
            for t in np.arange(10, 18, step):
                message = kind[name](at(t), *content(t))
                raw = store.serialize_cdr(message, name)
                writer.write(link, int(1e9 * t), raw)
    return folder / "bag"
