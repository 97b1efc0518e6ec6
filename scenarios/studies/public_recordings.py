"""Public measurements of a UR10 and a KUKA KR300, read into the recording's format.

`ur10_recording`: a UR10's target, measured by a laser tracker; series A (11,911 poses,
July 2020) and B (1,495 poses, November 2020, newly set up) of
github.com/christianlandgraf/ipa-robot-accuracy (MIT licence).

`kr300_recording`: a KUKA KR300 whose first three axes carry a second encoder, as a
stream; motions A, B and C of github.com/JonasWeigand/Robot_Identification (MIT
licence): 10 s each, every 4 ms, no load but the arm's own weight.
"""

from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from bench.shared.errors import Unusable
from bench.shared.format.assembly import load_times_of
from bench.shared.instrument_specs import TrackerSpec
from bench.shared.recording import UNLOADED, Marker, Recording

# --- A UR10 before a laser tracker ----------------------------------------------------

UR10_FILES = {
    "A": "measurements_grid.csv",
    "B": "measurements_joint_configurations.csv",
}
REPEATABILITY = 1e-5
"""One sigma of a point, in m (the tracker's class), where readings do not say."""
INTERVAL = 20.0
"""Seconds from row to row of series B, whose time stamps are lost; as in series A."""
TETRAHEDRON = 0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
"""Four points that represent the 6D target, in its frame, in m (chosen: 0.01° are
then 10 µm)."""


def ur10_recording(folder: Path, series: Literal["A", "B"] = "A") -> Recording:
    """Read a series, in the order of its time stamps, of its rows where it has none.

    Raises:
        Unusable: Where the file is not there or is another one.
    """
    file = UR10_FILES[series]
    try:
        semicolons = pa_csv.ParseOptions(delimiter=";")
        commas = pa_csv.ConvertOptions(decimal_point=",")
        table = pa_csv.read_csv(folder / file, None, semicolons, commas)
        columns = [table.column(n).to_numpy().astype(float) for n in _columns()]
        values = np.stack(columns, axis=1)
        time = np.arange(len(values)) * INTERVAL
        sigma = np.full(3, REPEATABILITY)
        if series == "A":
            stamps = map(str, table.column("Timestamp").to_pylist())
            when = np.array([datetime.strptime(s, "%Y%m%d%H%M%S") for s in stamps])
            time = (when - when.min()) / timedelta(seconds=1)
        else:
            spread = [table.column(f"measurement_std_{c}").to_numpy() for c in "xyz"]
            sigma = np.sqrt(np.mean(np.square(spread), axis=1)) / 1e3
        if np.size(bad := np.flatnonzero(~np.isfinite(values).all(axis=1)) + 1):
            raise ValueError(f"blanks in rows {bad[:5].tolist()}")
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError) as error:
        raise Unusable(f"Folder {str(folder)!r}", [f"{file}: {error}"]) from error
    order = np.argsort(time, kind="stable")
    time, values = time[order].astype(float), values[order]
    turn = Rotation.from_euler("XYZ", values[:, 10:], degrees=True).as_matrix()
    pose = np.arange(len(time))
    names = ("target_o", "target_x", "target_y", "target_z")
    return Recording(
        name=f"UR10 with laser tracker, series {series}",
        robot="UR10 (CB3)",
        time=time,
        posture_id=pose,
        visit=pose,
        posture=values[:, :6],
        load_time=load_times_of(time, pose, None),
        stage=np.full(len(time), UNLOADED),
        axes=_columns()[:6],
        markers=tuple(Marker(name, "flange", target="t1") for name in names),
        points=values[:, None, 7:10] / 1e3 + TETRAHEDRON @ turn.transpose(0, 2, 1),
        temperature=values[:, 6],
        tracker=TrackerSpec(sigma),
    )


def _columns() -> tuple[str, ...]:
    joints = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    seen = ("temperature", "x", "y", "z", "rx", "ry", "rz")
    return (*(f"{j}_joint" for j in joints), *(f"measurement_{s}" for s in seen))


# --- A KR300 with second encoders -----------------------------------------------------

MOTIONS = ("A", "B", "C")
TWICE = 3
"""Number of axes that have a second encoder, from the base on."""
BETWEEN = 60.0
"""Seconds between motions in the recording; chosen: the series does not say."""


def kr300_recording(folder: Path) -> Recording:
    """Read the three motions, one pose each, one after the other.

    Raises:
        Unusable: Where a file is not there or is another one.
    """
    faults, motions = [], []
    for name in MOTIONS:
        try:
            motions.append(_motion(folder / f"{name}.mat"))
        except (OSError, KeyError, AttributeError, ValueError, TypeError) as error:
            faults.append(f"{name}.mat: {error}.")
    if faults:
        raise Unusable(f"Folder {str(folder)!r}", faults)
    time, posture, after, torque = (
        np.concatenate(parts)
        for parts in zip(*_one_after_the_other(motions), strict=True)
    )
    motion = np.repeat(np.arange(len(MOTIONS)), [len(m[0]) for m in motions])
    link = np.full_like(posture, np.nan)
    link[:, :TWICE] = after[:, :TWICE]
    return Recording(
        name="KR300 with two encoders an axis, motions A, B, C",
        robot="KUKA KR300 R2500",
        time=time,
        posture_id=motion,
        visit=motion,
        posture=posture,
        load_time=time,
        stage=np.full(len(time), UNLOADED),
        link_posture=link,
        axis_torque=torque,
        rows="stream",
    )


def _motion(file: Path) -> tuple[np.ndarray, ...]:
    """Return time in s, angles before and after the gears in rad, torque in N m."""
    content = loadmat(file, squeeze_me=True, struct_as_record=False)
    seen, ratio = content["rec"], np.asarray(content["para"].u, dtype=float)
    return (
        np.asarray(seen.time_cont, dtype=float),
        np.radians(np.asarray(seen.act_pos_mot_deg, dtype=float).T),
        np.radians(np.asarray(seen.act_pos_se_deg, dtype=float).T),
        np.asarray(seen.act_torque_abs_nm, dtype=float).T * ratio,
    )


def _one_after_the_other(motions):
    start = 0.0
    for time, *rest in motions:
        yield (time - time[0] + start, *rest)
        start += time[-1] - time[0] + BETWEEN
