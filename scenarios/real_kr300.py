"""Is the difference between a KR300's two encoders wind-up under torque?

Three motions of a KUKA KR300 R2500, 10 s each every 4 ms, with a second encoder after
the gears of axes 1 to 3 (github.com/JonasWeigand/Robot_Identification, MIT licence; the
data are not part of this project). The nominal simulation has rigid gears: the second
encoder reads the first one's angle and a constant. The difference follows the torque
and so looks like wind-up. Candidates are fitted on the first two motions and believed
only where each of those confirms what was fitted to the other; the third motion judges.

Run:    python -m scenarios.real_kr300 --data FOLDER
Takes:  20 s
Expect: 3 ms of delay on all three axes, compliance refused with the reason; on the
        third motion 638 / 504 / 511 µrad become about 40 / 46 / 63, and 38 / 40 / 60
        on means over 0.1 s
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scenarios.report.command_line import run

if TYPE_CHECKING:
    from scenarios.pipelines.schema import Answer

MODEL = Path(__file__).parents[1] / "mjcf" / "six_hinges" / "six_hinges.xml"


@dataclass(frozen=True)
class Settings:
    """What to read, and where results go."""

    data: Path
    """Folder that holds A.mat, B.mat and C.mat of the series."""
    out: Path = Path("results/real_kr300")
    """Folder for diagnosis.json, report and pictures."""
    recording: Path | None = None
    """Folder for the data in this project's recording format."""


def main(settings: Settings) -> Answer:
    """Compare the encoders, and write what was found."""
    from bench.shared.format.folder import write
    from scenarios.pipelines.compare_encoders import compare_encoders
    from scenarios.report.sections.dual_encoder import headline, write_files
    from scenarios.studies.public_recordings import kr300_recording

    recording = kr300_recording(settings.data)
    if settings.recording is not None:
        write(settings.recording, recording)
    outcome = compare_encoders(recording, MODEL)
    write_files(settings.out, outcome)
    print(headline(outcome))
    return outcome.answer


if __name__ == "__main__":
    run(main, Settings)
