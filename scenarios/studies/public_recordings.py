"""Public recordings of a UR10 and a KUKA KR300, and the UR10's error under calibration.

`ur10_recording`: a UR10's target, measured by a laser tracker; series A (11,911 poses,
July 2020) and B (1,495 poses, November 2020, newly set up) of
github.com/christianlandgraf/ipa-robot-accuracy (MIT licence).

`kr300_recording`: a KUKA KR300 whose first three axes carry a second encoder, as a
stream; motions A, B and C of github.com/JonasWeigand/Robot_Identification (MIT
licence): 10 s each, every 4 ms, no load but the arm's own weight.

The result of a calibration depends on the regions that are held out, so `rows`
calibrates the UR10 with several draws of them. Interval over draws (`interval`):

==========  ==========================================================================
Equation    mean ± t(n − 1) s sqrt(1 / n + r), s over n draws, r = poses kept back over
            poses fitted: draws share poses, so they say less than n apart would
Source      Nadeau, Bengio 2003, "Inference for the generalization error", Machine
            Learning 52, 239
Valid       draws of like size; everything is chosen anew inside each fitted part
Ignores     that the arm is the same one
==========  ==========================================================================
"""

import json
from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from jaxtyping import Float
from scipy.io import loadmat
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from bench.shared.errors import Unusable, refuse
from bench.shared.format.assembly import load_times_of
from bench.shared.recording import UNLOADED, Marker, Recording, TrackerSpec
from bench.shared.settings import MM
from scenarios.pipelines.calibration import calibrate_and_prove
from scenarios.pipelines.calibration_proof import rms
from scenarios.pipelines.inputs import arm_of
from scenarios.report.page import Block, Heading, Paragraph, table_of
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import kabsch

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
    refuse(f"Folder {str(folder)!r}", faults)
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


# --- The nominal arm ------------------------------------------------------------------

MODEL = Path(__file__).parents[2] / "mjcf" / "ur10" / "ur10.xml"
NOMINAL_TARGET = np.array([0.0, 0.0, 0.109])
"""Position of the target in the flange's frame, in m (the series' own description; its
flange's y is this model's z)."""


def nominal(recording: Recording, out: Path) -> dict[str, object]:
    """Write the nominal arm's error to nominal.json; returns its content."""
    arm = arm_of(MODEL).for_recording(recording)
    held = errors(arm, recording, NOMINAL_TARGET)
    place = fitted_target(arm, recording)
    scores = {
        "source": "github.com/christianlandgraf/ipa-robot-accuracy, series A",
        "poses": len(recording.time),
        "fitted": "the frame, or frame and target's place, to positions alone",
        "frame_fitted": summary(held),
        "frame_and_target_fitted": summary(errors(arm, recording, place)),
        "target_in_flange_mm": [round(x, 4) for x in (1e3 * place).tolist()],
    }
    text = json.dumps(scores, indent=2)
    out.mkdir(parents=True, exist_ok=True)
    partial = out / ".nominal.json"
    partial.write_text(text + "\n", encoding="utf-8")
    partial.replace(out / "nominal.json")
    return scores


def errors(
    arm: Arm, recording: Recording, target: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "rows 3"]:
    """Return the target's measured less its nominal position, in m, frame fitted."""
    said = arm.point_in_base(recording.posture, "flange", target)
    assert recording.points is not None
    seen = recording.points[:, 0]
    base_from_tracker = kabsch(seen, said)
    return seen @ base_from_tracker[:3, :3].T + base_from_tracker[:3, 3] - said


def fitted_target(arm: Arm, recording: Recording) -> Float[np.ndarray, "3"]:
    """Return the best-fitting position of the target in the flange's frame, in m.

    The frame is eliminated in closed form, so three unknowns are left.
    """
    left = lambda place: errors(arm, recording, place).ravel()  # noqa: E731
    return least_squares(left, NOMINAL_TARGET).x


def summary(error: Float[np.ndarray, "rows 3"]) -> dict[str, float]:
    """Return rms, median and maximum of the distance, in mm."""
    size = 1e3 * np.linalg.norm(error, axis=1)
    rms, median, largest = np.sqrt(np.mean(size**2)), np.median(size), size.max()
    values = {"rms_mm": rms, "median_mm": median, "max_mm": largest}
    return {k: round(float(v), 4) for k, v in values.items()}


# --- Repeated held-out regions --------------------------------------------------------

Row = dict[str, object]


def rows(
    recording: Recording, arm: Arm, model: Path, draws: Sequence[int]
) -> Iterator[Row]:
    """Calibrate with other regions held out; yield a row of the table for each."""
    for draw in draws:
        o = calibrate_and_prove(recording, arm, model, draw)
        new, after = o.residual.new_angle, o.proof.after
        here, there = after[~new], after[new]
        yield {
            "draw": draw,
            "regions_kept_back": len(o.found.spatial_folds.held),
            "poses_kept_back": o.proof.poses,
            "poses": len(np.unique(o.found.readings.posture_id)),
            "before_rms_mm": MM * rms(o.proof.before),
            "after_rms_mm": MM * rms(after),
            "at_new_angles": float(new.mean()),
            "after_rms_mm_new_angles": MM * rms(there) if len(there) else np.nan,
            "after_rms_mm_elsewhere": MM * rms(here) if len(here) else np.nan,
            "neighbours_differ_mm": MM * o.found.at_last.noise,
            "named": " ".join("@".join(key) for key in o.found.named),
        }


def interval(found: Sequence[Row], column: str) -> tuple[float, float, float]:
    """Return mean and 95 % interval of a column over draws."""
    values = np.array([row[column] for row in found], dtype=float)
    held = np.array([row["poses_kept_back"] for row in found], dtype=float)
    share = float(np.mean(held / (np.array([r["poses"] for r in found]) - held)))
    count = len(values)
    half = student.ppf(0.975, count - 1) * values.std(ddof=1)
    half *= np.sqrt(1.0 / count + share)
    mean = float(values.mean())
    return mean, mean - float(half), mean + float(half)


def blocks_of(found: Sequence[Row]) -> list[Block]:
    """Return the report's section on calibrations with other regions held out."""
    said = ""
    if len(found) > 1:
        mean, low, high = interval(found, "after_rms_mm")
        inside = interval(found, "after_rms_mm_elsewhere")
        said = (
            f"{mean:.3f} mm on the mean of {len(found)} draws ({low:.3f} to "
            f"{high:.3f}, 95 % over draws that share poses); where every axis stands "
            f"at an angle that was fitted, {inside[0]:.3f} mm ({inside[1]:.3f} to "
            f"{inside[2]:.3f}). "
        )
    text = (
        f"{said}Each draw cuts regions anew, keeps back others, and chooses and fits "
        "everything again on the rest."
    )
    table = table_of(
        "Rms on poses kept back, draw by draw.",
        found,
        {
            "draw": lambda r: str(r["draw"]),
            "poses": lambda r: str(r["poses_kept_back"]),
            "as drawn [mm]": lambda r: f"{r['before_rms_mm']:.3f}",
            "calibrated [mm]": lambda r: f"{r['after_rms_mm']:.3f}",
            "at new angles [%]": lambda r: (
                f"{100 * float(str(r['at_new_angles'])):.0f}"
            ),
            "there [mm]": lambda r: f"{r['after_rms_mm_new_angles']:.3f}",
            "elsewhere [mm]": lambda r: f"{r['after_rms_mm_elsewhere']:.3f}",
            "named": lambda r: str(len(str(r["named"]).split())),
        },
    )
    return [Heading("With other regions kept back"), Paragraph(text), table]
