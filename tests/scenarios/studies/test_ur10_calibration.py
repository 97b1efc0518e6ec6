import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.format.folder import read, write
from scenarios.pipelines.inputs import arm_of, facts_of
from scenarios.studies import public_recordings

HEADER = (
    "Timestamp;Goal x;shoulder_pan_joint;shoulder_lift_joint;elbow_joint;wrist_1_joint;"
    "wrist_2_joint;wrist_3_joint;measurement_temperature;measurement_x;measurement_y;"
    "measurement_z;measurement_rx;measurement_ry;measurement_rz"
)
FRAME = Rotation.from_rotvec([0.3, -0.2, 2.0])
AWAY = np.array([-3.0, 0.1, 1.3])
PLACE = np.array([0.001, -0.002, 0.105])


@pytest.fixture
def series(tmp_path: Path) -> Path:
    """A series of a rigid UR10 whose target and tracker stand where we say."""
    arm, random = arm_of(public_recordings.MODEL), np.random.default_rng(1)
    posture = random.uniform(-1.5, 1.5, (40, 6))
    target = arm.point_in_base(posture, "flange", PLACE)
    seen = 1e3 * FRAME.inv().apply(target - AWAY)
    turn = FRAME.inv() * Rotation.from_matrix(arm.at(posture).turn("flange"))
    angles = turn.as_euler("XYZ", degrees=True)
    lines = [HEADER]
    for row, place in enumerate(seen):
        when = f"202007142359{59 - row:02d}"  # the latest first
        numbers = [0.0, *posture[row], 23.5, *place, *angles[row]]
        lines.append(
            ";".join([when, *(f"{n:.12f}".replace(".", ",") for n in numbers)])
        )
    (tmp_path / public_recordings.UR10_FILES["A"]).write_text("\n".join(lines) + "\n")
    return tmp_path


def test_a_rigid_arm_s_own_series_leaves_no_error_and_gives_the_target_s_place(series):
    recording = public_recordings.ur10_recording(series)
    arm = arm_of(public_recordings.MODEL).for_recording(recording)
    place = public_recordings.fitted_target(arm, recording)
    np.testing.assert_allclose(place, PLACE, atol=1e-9)
    assert np.abs(public_recordings.errors(arm, recording, place)).max() < 1e-9


def test_four_markers_of_the_target_keep_their_distances_and_its_turn(series):
    recording = public_recordings.ur10_recording(series)
    assert recording.points is not None
    arms = recording.points[:, 1:] - recording.points[:, :1]  # (rows, 3, xyz)
    gram = arms @ arms.transpose(0, 2, 1)
    np.testing.assert_allclose(
        gram, np.tile(0.05**2 * np.eye(3), (40, 1, 1)), atol=1e-12
    )
    arm = arm_of(public_recordings.MODEL)
    turn = FRAME.inv().as_matrix() @ arm.at(recording.posture).turn("flange")
    np.testing.assert_allclose(arms.transpose(0, 2, 1) / 0.05, turn, atol=1e-9)


def test_rows_come_in_the_order_of_time(series):
    recording = public_recordings.ur10_recording(series)
    np.testing.assert_array_equal(recording.time, np.arange(40.0))


def test_the_series_becomes_a_recording_of_the_format(series, tmp_path):
    written = public_recordings.ur10_recording(series)
    write(tmp_path / "recording", written)
    scores = public_recordings.nominal(written, tmp_path / "out")
    facts = facts_of(arm_of(public_recordings.MODEL))
    recording, notes = read(tmp_path / "recording", facts)
    assert notes == ()
    assert [m.target for m in recording.markers] == ["t1"] * 4
    assert json.loads((tmp_path / "out" / "nominal.json").read_text()) == scores


def test_another_file_is_refused_by_name(tmp_path):
    with pytest.raises(Unusable, match=r"measurements_grid\.csv"):
        public_recordings.ur10_recording(tmp_path)
    (tmp_path / public_recordings.UR10_FILES["A"]).write_text("a;b\n1;2\n")
    with pytest.raises(Unusable, match="shoulder_pan_joint"):
        public_recordings.ur10_recording(tmp_path)


@pytest.mark.parametrize(
    ("cell", "says"), [("no stamp", "does not match"), ("", "blanks in rows")]
)
def test_a_stamp_or_a_reading_that_is_none_is_refused(series, cell, says):
    file = series / public_recordings.UR10_FILES["A"]
    lines = file.read_text().splitlines()
    cells = lines[3].split(";")
    cells[0 if cell else 5] = cell
    lines[3] = ";".join(cells)
    file.write_text("\n".join(lines) + "\n")
    with pytest.raises(Unusable, match=says):
        public_recordings.ur10_recording(series)


@pytest.mark.skipif("REAL_RECORDINGS" not in os.environ, reason="no REAL_RECORDINGS")
def test_the_nominal_ur10_errs_by_3_01_mm_with_only_the_frame_fitted(tmp_path):
    """The figure was reached by hand before; 0.84 mm with the target's place fitted."""
    folder = Path(os.environ["REAL_RECORDINGS"]) / "ur10-leica"
    recording = public_recordings.ur10_recording(folder)
    scores = public_recordings.nominal(recording, tmp_path)
    assert scores["poses"] == 11911
    frame, both = scores["frame_fitted"], scores["frame_and_target_fitted"]
    assert isinstance(frame, dict) and isinstance(both, dict)
    assert frame["rms_mm"] == pytest.approx(3.01, abs=0.005)
    assert both["rms_mm"] == pytest.approx(0.838, abs=0.0005)
