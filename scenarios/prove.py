"""Does what one recording taught hold on another one?

The patch that `diagnose` or `calibrate` left in a folder is put into the simulator.
The arm with it and the arm as drawn do again what the other recording did, months later
or with another set-up: the tracker's frame and the targets' places are fitted there,
and nothing else. A reading is covered where every angle and torque that the patch
depends on lies in the range that it was fitted to.

Run:    python -m scenarios.prove PATCH_DIR RECORDING --robot MODEL.xml --out DIR
Takes:  20 s for 1,500 poses without a load
Expect: whether it holds: surely better, and within 1.5 times the noise; parts that do
        harm, error before and after with its interval, the share that is covered, and
        in DIR proof.json, report.html, report.md and pictures; exit status 0 also where
        the patch does not hold
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from scenarios.pipelines.judgement import Judgement


@dataclass(frozen=True)
class Settings:
    """What is judged, on what, and where the proof goes."""

    patch: Annotated[Path, tyro.conf.Positional]
    """Folder that holds patch.json."""
    recording: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording that judges."""
    robot: Path
    """Model of the robot as drawn, MJCF or URDF."""
    out: Path
    """Folder for the proof."""


def main(settings: Settings) -> Judgement:
    """Judge a patch on another recording, and write the proof."""
    from bench.patch import FILE, read
    from bench.shared.errors import collect
    from scenarios.pipelines.inputs import arm_of, read_for
    from scenarios.pipelines.judgement import judge
    from scenarios.report.data_files import refuse_folder
    from scenarios.report.sections.proof import first_sentence, write_judgement

    s = settings
    _, patch, (recording, arm, notes) = collect(
        lambda: refuse_folder(s.out, s.recording, s.robot, s.patch),
        lambda: read(s.patch / FILE),
        lambda: read_for(s.recording, arm_of(s.robot)),
    )
    for note in notes:
        print(note)
    judgement = judge(recording, arm, s.robot, patch)
    write_judgement(s.out, judgement)
    print(f"{first_sentence(judgement)}\n{s.out / 'report.html'}")
    return judgement


if __name__ == "__main__":
    run(main, Settings)
