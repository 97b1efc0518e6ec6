"""How wrong is a rigid UR10 with data-sheet geometry?

A UR10 (CB3) stood in 11,911 poses under its own weight while a laser tracker measured
a target on its flange in 6D (series A of github.com/christianlandgraf/
ipa-robot-accuracy, MIT licence, July 2020; the data are not part of this project).
Nothing of the arm is fitted: once only the tracker's frame, the target held at its
nominal 109 mm along the flange's axis; once the target's place as well, which by itself
takes up most of the error. Positions alone are fitted and judged, not orientations.

Run:    python -m scenarios.real_ur10 --data FOLDER
Takes:  3 s
Expect: 3.01 mm rms with the tracker's frame fitted, 0.84 mm with the target's place too
"""

import json
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from bench.errors import Unusable
from bench.files import write
from bench.format.course import load_times_of
from bench.recording import UNLOADED, Marker, Recording, TrackerSpec
from scenarios.command import run
from scenarios.nominal import arm_of
from stiffness.arm import Arm
from stiffness.frames import kabsch

FILE = "measurements_grid.csv"
MODEL = Path(__file__).parents[1] / "mjcf" / "ur10" / "ur10.xml"
NOMINAL_TARGET = np.array([0.0, 0.0, 0.109])
"""Of the target in the flange's frame, in m (the series'; its y is our flange's z)."""
REPEATABILITY = 1e-5
"""One sigma of a point, in m (the tracker's class)."""
TETRAHEDRON = 0.05 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
"""Four points that stand for the 6D target, in its frame, in m (chosen: 0.01° are
then 10 µm)."""


@dataclass(frozen=True)
class Settings:
    """What to read, and where results go."""

    data: Path
    """Folder that holds measurements_grid.csv of the series."""
    out: Path = Path("results/real_ur10")
    """Folder for nominal.json."""
    recording: Path | None = None
    """Folder for the data in this project's recording format."""


def main(settings: Settings) -> dict[str, object]:
    """State the error of the nominal arm; returns what nominal.json holds."""
    recording = recording_of(settings.data)
    if settings.recording is not None:
        write(settings.recording, recording)
    arm = arm_of(MODEL).for_recording(recording)
    held = errors(arm, recording, NOMINAL_TARGET)
    place = fitted_target(arm, recording)
    scores = {
        "source": "github.com/christianlandgraf/ipa-robot-accuracy, series A",
        "poses": len(recording.time),
        "fitted": "positions alone; orientations are not used",
        "frame_fitted": summary(held),
        "frame_and_target_fitted": summary(errors(arm, recording, place)),
        "target_in_flange_mm": [round(x, 4) for x in (1e3 * place).tolist()],
    }
    text = json.dumps(scores, indent=2)
    settings.out.mkdir(parents=True, exist_ok=True)
    partial = settings.out / ".nominal.json"
    partial.write_text(text + "\n", encoding="utf-8")
    partial.replace(settings.out / "nominal.json")
    print(text)
    return scores


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


def errors(
    arm: Arm, recording: Recording, target: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "rows 3"]:
    """Return where the target is beside where the arm says, in m, frame fitted."""
    said = arm.point_in_base(recording.posture, "flange", target)
    assert recording.points is not None
    seen = recording.points[:, 0]
    base_from_tracker = kabsch(seen, said)
    return seen @ base_from_tracker[:3, :3].T + base_from_tracker[:3, 3] - said


def fitted_target(arm: Arm, recording: Recording) -> Float[np.ndarray, "3"]:
    """Return the place of the target in the flange's frame that fits best, in m.

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


if __name__ == "__main__":
    run(main, Settings)
