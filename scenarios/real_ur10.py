"""How wrong is a rigid UR10 with data-sheet geometry?

A UR10 (CB3) stood in 11,911 poses under its own weight while a laser tracker measured
a target on its flange in 6D (series A of github.com/christianlandgraf/
ipa-robot-accuracy, MIT licence, July 2020; the data are not part of this project).
First nothing of the arm is fitted: once only the tracker's frame, the target held at
its nominal 109 mm along the flange's axis; once the target's place as well, which by
itself takes up most of the error. Then the arm is calibrated as any other would be, by
`scenarios.calibrate`. Positions alone are fitted and judged, not orientations.

Run:    python -m scenarios.real_ur10 --data FOLDER
Takes:  a minute for each draw of regions on two cores, six of them unless --draws 0
Expect: over all poses 3.01 mm rms with the tracker's frame fitted, 0.84 mm with the
        target's place too; on 8 of 30 regions that nothing was fitted to 0.88 mm as
        drawn, about 0.1 mm calibrated, 0.07 mm where every axis stands at an angle
        that was fitted
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from bench.files import write
from bench.recording import Recording
from scenarios.calibrating import redrawn
from scenarios.calibrating.carried_out import Outcome, carried_out, written
from scenarios.command import run
from scenarios.nominal import arm_of
from scenarios.reading.ur10_leica import FILE, recording_of
from scenarios.reporting import table
from scenarios.reporting.bar import bar
from scenarios.reporting.page import Block
from stiffness.arm import Arm
from stiffness.frames import kabsch

__all__ = ["FILE", "recording_of"]

MODEL = Path(__file__).parents[1] / "mjcf" / "ur10" / "ur10.xml"
NOMINAL_TARGET = np.array([0.0, 0.0, 0.109])
"""Place of the target in the flange's frame, in m (the series' own description; its
flange's y is this model's z)."""


@dataclass(frozen=True)
class Settings:
    """What to read, and where results go."""

    data: Path
    """Folder that holds measurements_grid.csv of the series."""
    out: Path = Path("results/real_ur10")
    """Folder for nominal.json, diagnosis.json, patch.json, report and pictures."""
    recording: Path | None = None
    """Folder for the data in this project's recording format."""
    draws: int = 5
    """How often other regions are kept back and everything is fitted anew."""


def main(settings: Settings) -> Outcome:
    """State the error of the nominal arm, then calibrate it."""
    recording = recording_of(settings.data)
    if settings.recording is not None:
        write(settings.recording, recording)
    nominal(recording, settings.out)
    arm = arm_of(MODEL).for_recording(recording)
    outcome = carried_out(recording, arm, MODEL)
    more: list[Block] = []
    if settings.draws > 0:
        others = range(1, settings.draws + 1)
        rows = redrawn.rows(recording, arm, MODEL, others)
        with bar() as progress:
            drawn = list(
                progress.track(rows, settings.draws, description="other regions")
            )
        table.write(settings.out / "draws.csv", drawn)
        more += redrawn.blocks_of(drawn)
    written(settings.out, outcome, more)
    return outcome


def nominal(recording: Recording, out: Path) -> dict[str, object]:
    """State the error of the nominal arm; returns what nominal.json holds."""
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
    out.mkdir(parents=True, exist_ok=True)
    partial = out / ".nominal.json"
    partial.write_text(text + "\n", encoding="utf-8")
    partial.replace(out / "nominal.json")
    print(text)
    return scores


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
