"""A UR10's target, seen 11,911 times by a laser tracker, becomes a recording.

Series A of github.com/christianlandgraf/ipa-robot-accuracy (MIT licence, July 2020).
"""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from scipy.spatial.transform import Rotation

from bench.errors import Unusable
from bench.format.course import load_times_of
from bench.recording import UNLOADED, Marker, Recording
from bench.stated import TrackerSpec

FILE = "measurements_grid.csv"
REPEATABILITY = 1e-5
"""One sigma of a point, in m (the tracker's class)."""
TETRAHEDRON = 0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
"""Four points that stand for the 6D target, in its frame, in m (chosen: 0.01° are
then 10 µm)."""


def recording_of(folder: Path) -> Recording:
    """Read the series, in the order of its time stamps.

    Raises:
        Unusable: Where the file is not there or is another one.
    """
    try:
        semicolons = pa_csv.ParseOptions(delimiter=";")
        commas = pa_csv.ConvertOptions(decimal_point=",")
        table = pa_csv.read_csv(folder / FILE, None, semicolons, commas)
        stamps = map(str, table.column("Timestamp").to_pylist())
        when = np.array([datetime.strptime(s, "%Y%m%d%H%M%S") for s in stamps])
        time = (when - when.min()) / timedelta(seconds=1)
        columns = [table.column(n).to_numpy().astype(float) for n in _columns()]
        values = np.stack(columns, axis=1)
        if np.size(bad := np.flatnonzero(~np.isfinite(values).all(axis=1)) + 1):
            raise ValueError(f"blanks in rows {bad[:5].tolist()}")
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError) as error:
        raise Unusable(f"Folder {str(folder)!r}", [f"{FILE}: {error}"]) from error
    order = np.argsort(time, kind="stable")
    time, values = time[order].astype(float), values[order]
    turn = Rotation.from_euler("XYZ", values[:, 10:], degrees=True).as_matrix()
    pose = np.arange(len(time))
    names = ("target_o", "target_x", "target_y", "target_z")
    return Recording(
        name="UR10 with laser tracker, series A",
        robot="UR10 (CB3)",
        time=time,
        pose=pose,
        visit=pose,
        posture=values[:, :6],
        load_time=load_times_of(time, pose, None),
        stage=np.full(len(time), UNLOADED),
        axes=_columns()[:6],
        markers=tuple(Marker(name, "flange", target="t1") for name in names),
        points=values[:, None, 7:10] / 1e3 + TETRAHEDRON @ turn.transpose(0, 2, 1),
        temperature=values[:, 6],
        tracker=TrackerSpec(np.full(3, REPEATABILITY)),
    )


def _columns() -> tuple[str, ...]:
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    seen = ("temperature", "x", "y", "z", "rx", "ry", "rz")
    return (*(f"{j}_joint" for j in joints), *(f"measurement_{s}" for s in seen))
