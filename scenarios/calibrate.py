"""Which numbers of a model are wrong, and what does an arm do under its own weight?

A recording of absolute positions, no load needed: many postures, a target that a
tracker sees. Geometry, encoder offsets, compliance under gravity, uneven gears, tilting
bearings, friction's side and drift compete; an effect is believed where regions of
poses that it was not fitted to confirm it. Regions kept back from all of it are then
simulated in MuJoCo, before and after.

Run:    python -m scenarios.calibrate RECORDING --robot MODEL.xml --out DIR
Takes:  1 minute for 12,000 poses, seconds for 300
Expect: what was believed, step by step, and in DIR diagnosis.json, patch.json,
        model.xml, diagnosis.rrd, report.html, report.md and pictures
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from scenarios.pipelines.calibration import CalibrationOutcome


@dataclass(frozen=True)
class Settings:
    """What is calibrated, and where the answer goes."""

    recording: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording."""
    robot: Path
    """Model of the robot, MJCF or URDF."""
    out: Path
    """Folder for the answer."""
    view: bool = False
    """Open the viewer too."""


def main(settings: Settings) -> CalibrationOutcome:
    """Calibrate, prove and write."""
    from rich.console import Console

    from bench.proof.setup import why_not_simulated
    from scenarios.pipelines.calibration import calibrate_and_prove
    from scenarios.pipelines.inputs import arm_of, read_for
    from scenarios.report.data_files import refuse_folder
    from scenarios.report.sections.calibration import show, write_files

    refuse_folder(settings.out, settings.recording, settings.robot)
    recording, arm, notes = read_for(settings.recording, arm_of(settings.robot))
    for note in notes:
        print(note)
    said = Console().print
    if why := why_not_simulated(recording, settings.robot):
        said(f"No proof can be made, only a fit: {why}")
    outcome = calibrate_and_prove(recording, arm, settings.robot, said=said)
    write_files(settings.out, outcome)
    if settings.view:
        show(outcome)
    print(f"{settings.out / 'report.html'}")
    return outcome


if __name__ == "__main__":
    run(main, Settings)
