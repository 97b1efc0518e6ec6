"""Measures how wrong a rigid UR10 with data-sheet geometry is, and calibrates it.

A UR10 (CB3) stood in 11,911 poses under its own weight while a laser tracker measured
a target on its flange in 6D (series A of github.com/christianlandgraf/
ipa-robot-accuracy, MIT licence, July 2020; the data are not part of this project).
First nothing of the arm is fitted: once only the tracker's frame, the target held at
its nominal 109 mm along the flange's axis; once the target's place as well, which by
itself takes up most of the error. Then the arm is calibrated as any other would be, by
`scenarios.calibrate`, on positions and orientations. Series B
of the same arm (1,495 poses four months later, newly set up) judges the patch, as by
`scenarios.prove`, where its file is in the folder too.

Run:    python -m scenarios.real_ur10 --data FOLDER
Takes:  a minute for each draw of regions on two cores, six of them unless --draws 0
Expect: over all poses 3.01 mm rms with the tracker's frame fitted, 0.84 mm with the
        target's place too; on 8 of 30 regions that nothing was fitted to 0.74 mm as
        drawn, 0.08 mm calibrated, 0.06 mm where every axis stands at an angle that was
        fitted; on series B 1.08 mm as drawn, 0.28 mm with the patch of A
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.report.command_line import progress_bar, run

if TYPE_CHECKING:
    from scenarios.pipelines.calibration import CalibrationOutcome


@dataclass(frozen=True)
class Settings:
    """What to read, and where results go."""

    data: Path
    """Folder with measurements_grid.csv, and measurements_joint_configurations.csv."""
    out: Path = Path("results/real_ur10")
    """Folder for nominal.json, diagnosis.json, patch.json, report and pictures; its
    folder series_b for the proof on series B."""
    recording: Path | None = None
    """Folder for the data in this project's recording format."""
    draws: int = 5
    """How often other regions are kept back and everything is fitted anew."""


def main(settings: Settings) -> CalibrationOutcome:
    """State the error of the nominal arm, then calibrate it."""
    from rich.console import Console

    from bench.shared.format.folder import write
    from scenarios.pipelines.calibration import calibrate_and_prove
    from scenarios.pipelines.inputs import arm_of
    from scenarios.pipelines.judgement import judge
    from scenarios.report import data_files
    from scenarios.report.page import Block
    from scenarios.report.sections.calibration import write_files
    from scenarios.report.sections.proof import first_sentence, write_judgement
    from scenarios.studies import public_recordings
    from scenarios.studies.public_recordings import (
        MODEL,
        UR10_FILES,
        nominal,
        ur10_recording,
    )

    recording = ur10_recording(settings.data)
    if settings.recording is not None:
        write(settings.recording, recording)
    print(json.dumps(nominal(recording, settings.out), indent=2))
    arm = arm_of(MODEL).for_recording(recording)
    outcome = calibrate_and_prove(recording, arm, MODEL, said=Console().print)
    more: list[Block] = []
    if settings.draws > 0:
        others = range(1, settings.draws + 1)
        rows = public_recordings.rows(recording, arm, MODEL, others)
        with progress_bar() as progress:
            drawn = list(
                progress.track(rows, settings.draws, description="other regions")
            )
        data_files.write_table(settings.out / "draws.csv", drawn)
        more += public_recordings.blocks_of(drawn)
    write_files(settings.out, outcome, more)
    if (settings.data / UR10_FILES["B"]).is_file():
        later = ur10_recording(settings.data, "B")
        judgement = judge(later, arm, MODEL, outcome.proof.patch)
        write_judgement(settings.out / "series_b", judgement)
        print(first_sentence(judgement))
    return outcome


if __name__ == "__main__":
    run(main, Settings)
