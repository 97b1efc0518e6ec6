"""What is written of a recording reads back the same, whole or not at all."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from recordings import (
    ARM,
    assert_same,
    said,
    table,
    write_good,
)
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.format import assembly
from bench.shared.format.assembly import matrix_of, quaternion_of, unit_quaternion
from bench.shared.format.folder import read, write
from bench.shared.recording import (
    ASSUMED,
    STAGES,
    Marker,
    Payload,
    Recording,
    TrackerSpec,
    WrenchSpec,
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_good(tmp_path / "recording")


# --- Out and in again ----------------------------------------------------------------


CHANCE = np.random.default_rng(0)
TURNS = [
    quaternion_of(turn.as_matrix())
    for turn in (Rotation.identity(), *Rotation.random(30, rng=CHANCE))
]
"""Made beforehand: type checks draw at random, which no strategy may."""


def numbers(low: float, high: float):
    return st.floats(low, high, allow_subnormal=False, width=64)


@st.composite
def parts(draw) -> dict:
    """Draw a recording with or without each of its parts."""
    rows, axes = draw(st.integers(1, 6)), draw(st.integers(1, 8))

    def array(low, high, *shape):
        return draw(hnp.arrays(float, (rows, *shape), elements=numbers(low, high)))

    def perhaps(value):
        return draw(st.sampled_from([None, value]))

    def gaps(values):
        return np.where(draw(hnp.arrays(bool, values.shape)), np.nan, values)

    word = st.text("ab_ é,;\"'#.\\π🦾", min_size=1, max_size=4)
    word = word.filter(lambda text: text == text.strip())
    names = draw(st.lists(word, unique=True, max_size=3))
    turn = draw(st.sampled_from(TURNS))
    frame = np.eye(4)
    frame[:3, :3], frame[:3, 3] = matrix_of(turn), array(-5, 5, 3)[0]
    time = np.sort(array(0, 1e6))
    wrench = perhaps(array(-1e3, 1e3, 6))
    slides = tuple(draw(st.lists(st.booleans(), min_size=axes, max_size=axes)))
    return dict(
        name=draw(
            st.text(min_size=1, alphabet=st.characters(exclude_categories=["Cs"]))
        ),
        robot=draw(st.text('kr 10\\"\x7f', max_size=5)),
        time=time,
        posture_id=np.arange(rows),
        visit=np.cumsum(draw(hnp.arrays(np.int64, rows, elements=st.integers(1, 3)))),
        posture=array(-3, 3, axes),
        load_time=time - array(0, 10),
        stage=np.array(
            draw(st.lists(st.sampled_from(STAGES), min_size=rows, max_size=rows))
        ),
        axes=draw(st.sampled_from([(), tuple(f"joint {k}" for k in range(axes))])),
        bodies=draw(st.sampled_from([{}, {"flange": "wrist 3"}])),
        slides=slides if any(slides) else (),
        wrench=wrench,
        load_mass=perhaps(array(0, 50)),
        markers=tuple(Marker(n, "flange", perhaps(array(-1, 1, 3)[0])) for n in names),
        points=gaps(array(-9, 9, len(names), 3)) if names else None,
        commanded=None
        if all(slides)
        else perhaps(np.where(slides, np.nan, array(-3, 3, axes))),
        axis_torque=perhaps(array(-9, 9, axes)),
        temperature=perhaps(array(10, 40)),
        frames=perhaps(draw(hnp.arrays(np.int64, rows, elements=st.integers(1, 99)))),
        base_from_tracker=perhaps(frame),
        tracker=TrackerSpec(
            abs(array(1e-9, 1e-3, 3)[0]), perhaps(draw(numbers(0, 1e-3)))
        ),
        wrench_sensor=None
        if wrench is None
        else WrenchSpec(
            0.04,
            0.002,
            "flange",
            array(-1, 1, 3)[0],
            turn,
            draw(st.sampled_from(["sensor", "base"])),
            draw(st.booleans()),
        ),
        encoder_repeatability=perhaps(draw(numbers(0, 1e-3))),
        torque_accuracy=perhaps(draw(numbers(0, 1))),
        tool=perhaps(Payload(draw(numbers(0, 9)), array(-1, 1, 3)[0])),
        rows=draw(st.sampled_from(["plateaus", "stream"])),
    )


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(parts=parts())
def test_what_is_written_reads_back_the_same_and_is_written_the_same(
    tmp_path_factory, parts
):
    """To 1e-15 of each number the first time, and to the last bit from then on."""
    recording, place = Recording(**parts), tmp_path_factory.mktemp("trip")
    write(place / "a", recording)
    again, notes = read(place / "a")
    assert notes == ()
    frame, told = again.base_from_tracker, recording.base_from_tracker
    assert (frame is None) == (told is None)
    if frame is not None and told is not None:
        np.testing.assert_allclose(frame, told, rtol=1e-15, atol=1e-15)
    assert_same(
        replace(again, base_from_tracker=None),
        replace(recording, base_from_tracker=None),
        1e-15,
    )
    write(place / "b", again)
    for file in ("recording.toml", "samples.csv"):
        assert (place / "a" / file).read_bytes() == (place / "b" / file).read_bytes()
    assert_same(read(place / "b")[0], again)


@settings(max_examples=100, deadline=None)
@given(hnp.arrays(float, 3, elements=numbers(-3, 3)))
def test_a_quaternion_that_was_read_is_written_as_it_stood(vector):
    turn = Rotation.from_rotvec(vector).as_matrix()
    written = quaternion_of(turn)
    np.testing.assert_array_equal(written, quaternion_of(matrix_of(written)))
    np.testing.assert_array_equal(written, unit_quaternion(written))
    np.testing.assert_allclose(matrix_of(written), turn, rtol=0, atol=2e-15)


@pytest.mark.parametrize("vector", [(0, 0, 1e-3), (-1e-10, -1e-10, 1e-3), (0, -3, 0)])
def test_a_turn_that_drifts_with_each_rounding_is_written_at_once(vector, monkeypatch):
    rounds = []
    own = assembly.matrix_of
    monkeypatch.setattr(assembly, "matrix_of", lambda q: rounds.append(1) or own(q))
    written = quaternion_of(Rotation.from_rotvec(vector).as_matrix())
    assert len(rounds) < 50
    np.testing.assert_array_equal(written, quaternion_of(own(written)))


def test_only_columns_that_exist_are_written_and_truth_has_none(folder, tmp_path):
    recording, _ = read(folder)
    write(
        tmp_path / "out",
        replace(recording, wrench=None, wrench_sensor=None, load_mass=None),
    )
    names = table(tmp_path / "out")[0]
    axes = [f"a{k}_deg" for k in range(1, 7)]
    points = [f"{m}_{c}_mm" for m in ("p1", "p2") for c in "xyz"]
    assert names == ["time_s", "load_time_s", "pose", "visit", "stage", *axes, *points]


# --- All or nothing ------------------------------------------------------------------


def test_writing_over_a_recording_replaces_it_whole(folder, tmp_path):
    recording, _ = read(folder)
    write(folder, replace(recording, name="newer"))
    assert read(folder)[0].name == "newer"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["recording"]


@pytest.mark.parametrize("other", ["notes.txt", "truth.json", ".git"])
def test_a_folder_that_holds_anything_else_is_left_alone(folder, other):
    recording, _ = read(folder)
    (folder / other).write_text("mine")
    before = {p: p.read_bytes() for p in folder.iterdir()}
    with pytest.raises(Unusable, match="holds more than a recording"):
        write(folder, recording)
    assert {p: p.read_bytes() for p in folder.iterdir()} == before


def test_a_recording_that_would_not_read_back_is_not_written(folder, tmp_path):
    recording, _ = read(folder)
    good = (folder / "samples.csv").read_bytes()
    time = recording.time.copy()
    time[3] = np.nan
    for place in (folder, tmp_path / "new"):
        with pytest.raises(Unusable, match="'time_s'"):
            write(place, replace(recording, time=time))
    assert (folder / "samples.csv").read_bytes() == good
    assert sorted(p.name for p in tmp_path.iterdir()) == ["recording"]


def test_a_write_that_is_interrupted_leaves_what_was_there(
    folder, tmp_path, monkeypatch
):
    recording, _ = read(folder)
    good = (folder / "samples.csv").read_bytes()

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("bench.shared.format.folder.samples_table", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write(folder, recording)
    assert (folder / "samples.csv").read_bytes() == good
    assert sorted(p.name for p in tmp_path.iterdir()) == ["recording"]


def test_what_cannot_be_put_in_its_place_leaves_what_was_there(
    folder, tmp_path, monkeypatch
):
    recording, _ = read(folder)
    rename = os.rename

    def failing(source, target):
        if str(target) == str(folder) and Path(source).name == "new":
            raise OSError("disk full")
        rename(source, target)

    monkeypatch.setattr("bench.shared.format.folder.os.rename", failing)
    with pytest.raises(Unusable, match="disk full"):
        write(folder, replace(recording, name="newer"))
    assert read(folder)[0].name == "a small one"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["recording"]


def test_a_file_in_the_place_of_the_folder_is_refused(folder, tmp_path):
    recording, _ = read(folder)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(Unusable, match="not a folder"):
        write(tmp_path / "file", recording)
    with pytest.raises(Unusable, match="cannot be written"):
        write(tmp_path / "file" / "inside", recording)


def test_noise_of_a_tracker_may_be_left_out_and_stays_out(folder, tmp_path):
    said("repeatability_mm = 0.010\n", "")(folder)
    recording, _ = read(folder, ARM)
    assert recording.tracker is not None and not recording.tracker.is_stated
    np.testing.assert_allclose(recording.tracker.repeatability, ASSUMED)
    write(tmp_path / "again", recording)
    assert "repeatability_mm" not in (tmp_path / "again" / "recording.toml").read_text()
    again, _ = read(tmp_path / "again")
    assert again.tracker is not None and not again.tracker.is_stated
