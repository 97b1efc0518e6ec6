"""Several CSV files, each by a clock of its own, become one recording."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from scenarios import import_recording
from scenarios.import_recording import Settings, main
from scenarios.pipelines.importing.clocks import (
    Channel,
    lag_between,
    on_one_side,
    rows_of,
    shift_of,
)
from scenarios.report.command_line import run

EPOCH = 1_700_000_000.25
"""What the tracker's clock is ahead of the controller's, in s."""
STOPS = np.array([0.0, 0.5, -0.3, 0.7, 0.1, 0.9, -0.6, 0.2])
HOLDS = np.array([2.0, 3.0, 1.6, 2.4, 4.1, 1.9, 2.2, 3.3])
MAPPING = """format = 1
rows = "stream"
[csv]
separator = ";"
decimal = ","
[columns]
time_s = "t"
pose = "n"
a1_deg = "J1"
p_x_mm = { from = "tracker.X", unit = "m" }
p_y_mm = { from = "tracker.Y", unit = "m" }
p_z_mm = { from = "tracker.Z", unit = "m" }
fx_n = { from = "force.Fx", unit = "kN" }
fy_n = "force.Fy"
fz_n = "force.Fz"
tx_nm = "force.Mx"
ty_nm = "force.My"
tz_nm = "force.Mz"
[sensors.tracker]
repeatability_mm = 0.01
[sensors.wrench]
accuracy_n = 0.5
accuracy_nm = 0.05
[markers.p]
body = "link_1"
[files.tracker]
file = "tracker.csv"
time = { from = "stamp", unit = "ms" }
separator = ","
decimal = "."
[files.force]
file = "force.csv"
time = "T"
offset_s = 5.5
"""
RESTS = "[rests]\nspeed_deg_per_s = 0.5\nhold_s = 1.0\n"


def moves(time, stops=STOPS, holds=HOLDS):
    """Hold at each stop, half a second of smooth motion between."""
    starts = np.cumsum([0.0, *(holds[:-1] + 0.5)])
    angle = np.full(np.shape(time), stops[0])
    for k in range(1, len(stops)):
        way = np.clip((time - starts[k] + 0.5) / 0.5, 0, 1)
        smooth = way * way * (3 - 2 * way)
        angle = angle + (stops[k] - stops[k - 1]) * smooth
    return angle


END = float(np.sum(HOLDS) + 0.5 * (len(HOLDS) - 1))


def table(header, rows, separator=";", mark=","):
    cells = ([repr(float(v)).replace(".", mark) for v in row] for row in rows)
    return "\n".join([header, *map(separator.join, cells)]) + "\n"


@cache
def logs() -> dict[str, str]:
    """A controller at 100 Hz, a tracker at 10 Hz since 1970, a force at 25 Hz."""
    random = np.random.default_rng(3)
    time = np.arange(0, END, 0.01)
    axes = [(t, 0, np.degrees(moves(t))) for t in time]
    texts = {"arm.csv": table("t;n;J1", axes)}
    seen = np.arange(0.37, END - 0.2, 0.1)
    angle = moves(seen)
    place = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    place += random.normal(0, 1e-5, place.shape)
    rows = [(1e3 * (t + EPOCH), *p, 1) for t, p in zip(seen, place, strict=True)]
    texts["tracker.csv"] = table("stamp,X,Y,Z,q", rows, ",", ".")
    force = [(t - 5.5, 0.02, 0, 0, 0, 0, 0) for t in np.arange(0, END, 0.04)]
    texts["force.csv"] = table("T;Fx;Fy;Fz;Mx;My;Mz", force)
    return texts | {"map.toml": MAPPING}


@pytest.fixture
def lab(tmp_path) -> Path:
    for name, text in logs().items():
        (tmp_path / name).write_text(text)
    return tmp_path


def change(folder: Path, name: str, old: str, new: str, count: int = 1) -> None:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new, count))


def imported(folder: Path):
    read = main(Settings(folder / "arm.csv", folder / "map.toml", folder / "out"))
    assert read is not None
    return read


def refused(folder: Path) -> str:
    with pytest.raises(Unusable) as caught:
        imported(folder)
    assert not (folder / "out").exists()
    return str(caught.value)


def test_a_clock_since_another_epoch_is_found_from_the_motion_and_said(lab, capsys):
    recording = imported(lab)
    said = capsys.readouterr().out
    offset = float(said.split("tracker.csv: its time ")[1].split(" s is that")[0])
    assert abs(offset + EPOCH) < 0.01
    assert "found from the motion, ±" in said and "ms at 95 %" in said
    assert "force.csv: its time +5.5000 s is that of the axes, as stated" in said
    assert "Lag of force.csv behind the axes: nothing moves enough to tell" in said
    assert "tracker.csv: column 'q' left alone" in said
    assert recording.points is not None and recording.wrench is not None
    angle = np.arctan2(recording.points[:, 0, 1], recording.points[:, 0, 0])
    assert np.abs(angle - recording.posture[:, 0]).max() < 0.05
    np.testing.assert_allclose(recording.wrench[:, 0], 20.0)


def test_a_reading_is_counted_once_however_fast_the_axes_were_read(lab):
    """The tracker read ten times a second, and so many frames its plateaus have."""
    change(lab, "map.toml", "[files.tracker]", RESTS + "[files.tracker]")
    recording = imported(lab)
    np.testing.assert_allclose(recording.posture[:, 0], STOPS, atol=1e-3)
    assert recording.frames is not None and recording.points is not None
    assert np.all(recording.frames <= 10 * HOLDS + 1)
    assert np.all(recording.frames >= 10 * HOLDS - 6)
    angle = np.arctan2(recording.points[:, 0, 1], recording.points[:, 0, 0])
    np.testing.assert_allclose(angle, STOPS, atol=2e-3)


def test_a_stated_offset_is_kept_and_the_lag_beside_it_told(lab, capsys):
    stated = f"offset_s = {-(EPOCH + 0.1)}\nseparator"
    change(lab, "map.toml", 'separator = ","\ndec', stated + ' = ","\ndec')
    imported(lab)
    said = capsys.readouterr().out
    lag = said.split("Lag of tracker.csv behind the axes: ")[1]
    assert abs(float(lag.split(" ms")[0]) + 100.0) < 10.0
    assert "±" in lag.split("\n")[0]


def test_a_file_can_be_by_the_clock_of_another(lab, capsys):
    change(lab, "map.toml", "offset_s = 5.5", 'clock = "tracker"')
    rows = [(t + EPOCH, 0.02, 0, 0, 0, 0, 0) for t in np.arange(0, END, 0.04)]
    (lab / "force.csv").write_text(table("T;Fx;Fy;Fz;Mx;My;Mz", rows))
    imported(lab)
    assert "by the clock of tracker.csv" in capsys.readouterr().out


def test_a_clock_that_no_motion_tells_is_refused_with_what_to_say(lab):
    change(lab, "map.toml", "offset_s = 5.5\n", "")
    said = refused(lab)
    assert "force.csv: its clock cannot be told from the motion" in said
    assert "say offset_s or clock in map.toml, files.force" in said


def test_motions_too_regular_to_tell_a_clock_are_refused(lab):
    """Twenty strokes alike: which of them the other log began with, nobody knows."""
    stops, holds = np.array([0.0, 0.5] * 10), np.full(20, 1.5)
    time, seen = np.arange(0, 35, 0.004), np.arange(3, 30, 0.1)
    axes, other = (moves(t, stops, holds)[:, None] for t in (time, seen))
    reason = shift_of(time, axes, seen + 100.0, other)
    assert isinstance(reason, str) and "fit alike" in reason


def test_noise_is_no_motion(lab):
    random = np.random.default_rng(0)
    time, seen = np.arange(0, END, 0.004), np.arange(0, END, 0.1)
    noise = random.normal(0, 1e-5, (len(seen), 3))
    reason = shift_of(time, moves(time)[:, None], seen + 7.0, noise)
    assert isinstance(reason, str)


def test_a_lag_s_interval_holds_the_truth_and_grows_with_jitter():
    random = np.random.default_rng(1)
    time = np.arange(0, END, 0.004)
    axes = moves(time)[:, None]
    widths = []
    for jitter in (0.0, 0.03):
        held = 0
        for _ in range(20):
            seen = np.arange(0.1 * random.random(), END, 0.1)
            late = seen - 0.04 + random.normal(0, jitter, len(seen))
            lag = lag_between(time, axes, seen, moves(late)[:, None])
            assert lag is not None
            held += abs(lag.seconds - 0.04) <= lag.half_width
            widths.append(lag.half_width)
        assert held >= 17
    assert np.median(widths[20:]) > 2 * np.median(widths[:20])


def test_nothing_is_made_up_between_readings_far_apart(lab):
    """Rows go for which the force was silent, unless the mapping bridges them."""
    lines = (lab / "force.csv").read_text().split("\n")
    (lab / "force.csv").write_text("\n".join([*lines[:150], *lines[250:]]))
    recording = imported(lab)
    assert 4.0 <= np.diff(recording.time).max() <= 4.3
    change(lab, "map.toml", "offset_s = 5.5", "offset_s = 5.5\ngap_s = 5")
    again = main(Settings(lab / "arm.csv", lab / "map.toml", lab / "again"))
    assert again is not None
    assert np.diff(again.time).max() < 0.2


def test_all_faults_of_all_files_are_named_at_once(lab, monkeypatch, capsys):
    change(lab, "arm.csv", "\n0,01;0,0;", "\n0,01;0,0;9;")
    change(lab, "arm.csv", "\n0,02;", "\nlate;")
    change(lab, "tracker.csv", "stamp,X", "stamp,XX")
    change(lab, "force.csv", "\n-5,46;0,02", "\n-5,46;viel")
    change(lab, "force.csv", "\n-5,42;", "\n-6;")
    change(lab, "map.toml", 'pose = "n"', 'pose = "tracker.q"')
    said = refused(lab)
    for words in (
        *(
            "arm.csv, line 3 (row 2 below",
            "4 cells, but the header has 3 columns",
            "'late'",
        ),
        *("tracker.csv: column 'X' is missing"),
        *("force.csv, line 3", "'viel'", "force.csv, line 4", "time runs backwards"),
        *("columns.pose: 'tracker.q' cannot come from [files.tracker]",),
    ):
        assert words in said, words
    assert "samples.csv" not in said and "recording.toml" not in said
    words = ["import_recording", lab / "arm.csv", "--mapping", lab / "map.toml"]
    monkeypatch.setattr("sys.argv", [str(w) for w in (*words, "--out", lab / "out")])
    with pytest.raises(SystemExit) as end:
        run(import_recording.main, Settings)
    assert end.value.code == 2 and "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("offset_s = 5.5", 'offset_s = 5.5\nclock = "tracker"', "not both"),
        ("offset_s = 5.5", 'clock = "robot"', "there are: tracker"),
        ("offset_s = 5.5", 'clock = "force"', "there are: tracker"),
        ("offset_s = 5.5", "offset_s = nan", "not a finite number"),
        ("offset_s = 5.5", "offset_s = 500.0", "force.csv covers no row of arm.csv"),
        ('file = "force.csv"', 'file = "../force.csv"', "outside the folder"),
        ('file = "force.csv"', 'file = "/etc/hosts"', "outside the folder"),
        ('file = "force.csv"', 'file = "none.csv"', "there is no such file"),
        ('unit = "ms" }\nsep', 'unit = "days" }\nsep', "'days' is not one of: s"),
        ('rows = "stream"', 'rows = "plateaus"', "joined instant by instant"),
        ("[files.force]", '[files."a.b"]', "a name with no dot"),
        ("offset_s = 5.5", "offset = 5.5", "files.force.offset"),
        (
            "[files.force]",
            '[files.more]\nfile = "force.csv"\ntime = "T"\n[files.force]',
            "files.more: no column is taken from it",
        ),
    ],
)
def test_files_that_cannot_be_meant_are_refused(lab, old, new, words):
    change(lab, "map.toml", old, new)
    assert words in refused(lab)


@pytest.mark.parametrize("kind", ["quaternion_wxyz", "rotation"])
def test_turns_are_joined_through_their_jumps(lab, kind):
    """Angles beyond 180 degrees jump by 360, quaternions change their sign."""
    seen = np.arange(0.37, END - 0.2, 0.1)
    turns = Rotation.from_euler("z", moves(seen)[:, None] + np.pi)
    if kind == "rotation":
        cells = np.degrees(
            [[np.angle(np.exp(1j * (a + np.pi))), 0, 0] for a in moves(seen)]
        )
    else:
        cells = (
            turns.as_quat(scalar_first=True) * np.where(seen % 1 < 0.5, 1, -1)[:, None]
        )
    names = ["A", "B", "C", "D"][: cells.shape[1]]
    place = np.stack([np.cos(moves(seen)), np.sin(moves(seen)), 0 * seen], axis=1)
    rows = np.hstack([1e3 * (seen + EPOCH)[:, None], place, cells])
    header = ",".join(["stamp", "X", "Y", "Z", *names])
    (lab / "tracker.csv").write_text(table(header, rows, ",", "."))
    columns = [f"tracker.{n}" for n in names]
    target = (
        f'[targets.t]\nbody = "link_1"\nposition = {[f"tracker.{c}" for c in "XYZ"]}\n'
    )
    target += f'{kind} = {columns}\nlength_unit = "m"\n[files.tracker]'
    change(lab, "map.toml", "[files.tracker]", target)
    recording = imported(lab)
    assert recording.points is not None
    arms = recording.points[:, 2] - recording.points[:, 1]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), 0.1, atol=1e-4)
    angle = np.arctan2(-arms[:, 1], -arms[:, 0])
    assert np.abs(angle - recording.posture[:, 0]).max() < 0.05


def test_values_are_taken_between_near_readings_alone():
    channel = Channel(np.array([0.0, 0.1, 2.0, 2.1]), np.arange(4.0)[:, None])
    time = np.array([-0.1, 0.0, 0.05, 0.1, 1.0, 2.0, 2.1, 2.2])
    covered = [False, True, True, True, False, True, True, False]
    np.testing.assert_array_equal(channel.covers(time, 0.5), covered)
    np.testing.assert_allclose(channel.at(time)[2], 0.5)
    np.testing.assert_array_equal(
        rows_of(time, [np.array([0.06, 0.09, 2.09])]), [2, 3, 6]
    )


def test_a_quaternion_and_its_negative_are_one_turn():
    turn = Rotation.from_euler("z", [[0.0], [0.1], [0.2]]).as_quat(scalar_first=True)
    flipped = turn * np.array([[1.0], [-1.0], [1.0]])
    np.testing.assert_allclose(on_one_side(flipped), turn)
