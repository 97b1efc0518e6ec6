"""The UR10's error before calibration, and calibrations with other regions held out.

The result of a calibration depends on the regions that are held out, so `rows`
calibrates with several draws of them.

Interval over draws (`interval`):

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
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.stats import t as student

from bench.shared.recording import Recording
from scenarios.pipelines.calibration import calibrate_and_prove
from scenarios.pipelines.calibration_proof import rms
from scenarios.pipelines.inputs import arm_of
from scenarios.report.page import Block, Heading, Paragraph, Table
from stiffness.robot.arm import Arm
from stiffness.robot.tracker_frame import kabsch

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
MM = 1e3


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
    lines: list[Block] = [Heading("With other regions kept back")]
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
    lines.append(
        Paragraph(
            f"{said}Each draw cuts regions anew, keeps back others, and chooses and "
            "fits everything again on the rest."
        )
    )
    lines.append(
        Table(
            "Rms on poses kept back, draw by draw.",
            (
                *("draw", "poses", "as drawn [mm]", "calibrated [mm]"),
                *("at new angles [%]", "there [mm]", "elsewhere [mm]", "named"),
            ),
            [
                (
                    str(r["draw"]),
                    str(r["poses_kept_back"]),
                    f"{r['before_rms_mm']:.3f}",
                    f"{r['after_rms_mm']:.3f}",
                    f"{100 * float(str(r['at_new_angles'])):.0f}",
                    f"{r['after_rms_mm_new_angles']:.3f}",
                    f"{r['after_rms_mm_elsewhere']:.3f}",
                    str(len(str(r["named"]).split())),
                )
                for r in found
            ],
        )
    )
    return lines
