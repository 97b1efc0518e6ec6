"""Finds where and why a simulation and a recording differ, and proves it.

Reads a recording against the robot's model, fits what is nominal, and asks whether
anything is left that the instruments cannot have made; if so, where it sits, what
physics it is, or that it has no name. What was named goes into the simulator, and the
poses that were kept back decide. Positions without any load that few effects do not
explain are calibrated on, as `python -m scenarios.calibrate` does. In a stream that no
tracker watched, second encoders are compared with the first ones.

Run:    python -m scenarios.diagnose RECORDING --robot MODEL.xml --out DIR
Takes:  20 s for 151 poses, 9 loads and 28 marks on two cores
Expect: the story, and in DIR diagnosis.json, report.html, diagnosis.rrd and, where
        something was named, model.xml, patch.json and controller.csv; exit status 0
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from scenarios.pipelines.schema import Answer


@dataclass(frozen=True)
class Settings:
    """What is compared, and where the answer goes."""

    recording: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording."""
    robot: Path
    """Model of the robot, MJCF or URDF."""
    out: Path
    """Folder for the answer."""
    view: bool = False
    """Open the viewer too."""


def main(settings: Settings) -> Answer:
    """Diagnose a recording, prove what was found, and write the answer."""
    from rich.console import Console

    from scenarios.report.route import diagnose_to_folder

    s = settings
    return diagnose_to_folder(s.recording, s.robot, s.out, Console(), s.view)


if __name__ == "__main__":
    run(main, Settings)
