"""Where and why do a simulation and a recording differ, and is that proved?

Reads a recording against the robot's model, fits what is nominal, and asks whether
anything is left that the instruments cannot have made; if so, where it sits, what
physics it is, or that it has no name. What was named goes into the simulator, and the
poses that were kept back decide. Positions without any load that few effects do not
explain are calibrated on, as `python -m scenarios.calibrate` does. In a stream that no
tracker watched, second encoders are compared with the first ones.

Run:    python -m scenarios.diagnose RECORDING --robot MODEL.xml --out DIR
Takes:  20 s for 151 poses, 9 loads and 28 marks on two cores
Expect: the story, and in DIR diagnosis.json, report.html, diagnosis.rrd and, where
        something was named, model.xml and patch.json; exit status 0 whatever is found
"""

import shutil
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from bench.patch import FILE, MODEL_FILE, text_of
from bench.patch_model import mjcf_of
from scenarios.calibrating import carried_out
from scenarios.command import run
from scenarios.diagnosing import (
    answer,
    calibrating,
    next_experiments,
    playback,
    report,
    story,
)
from scenarios.diagnosing.finding import Finding
from scenarios.diagnosing.steps import asked, proved
from scenarios.diagnosing.telling import tell
from scenarios.diagnosing.writing import refuse, written
from scenarios.nominal import arm_of, read_for
from scenarios.replicates import replicate_noise
from scenarios.reporting import page
from scenarios.two_encoders import carried_out as two_encoders
from stiffness.diagnosis.sample import sample_of


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


def main(settings: Settings) -> answer.Answer:
    """Diagnose a recording, prove what was found, and write the answer."""
    started = time.perf_counter()
    refuse(settings.out, settings.recording)
    console = Console()
    with console.status("reading"):
        recording, arm, notes = read_for(settings.recording, arm_of(settings.robot))
    if two_encoders.is_called_for(recording):
        told, first = two_encoders.carried_out(recording, settings.robot, settings.out)
        for line in (first, *notes, settings.out / "report.html"):
            console.print(f"{line}", markup=False, highlight=False)
        return told
    with console.status("comparing with the model"):
        whole = recording
        recording, sampled = sample_of(whole)
        notes = (*notes, sampled) if sampled else notes
        found = asked(recording, arm)
    if calibrating.is_called_for(recording, found):
        rejected = found.detection.p_value
        outcome = calibrating.tried(whole, arm, settings.robot, console, rejected)
        if outcome is not None:
            carried_out.written(settings.out, outcome)
            console.print(f"{settings.out / 'report.html'}", markup=False)
            return outcome.answer
    with console.status("proving it in the simulator"):
        simulated, unproved = proved(found, recording, arm, settings.robot)
        steps = next_experiments.proposed(found, simulated if not unproved else None)
    told = answer.answer_of(
        found, simulated, unproved, steps, time.perf_counter() - started
    )
    noise = replicate_noise(recording) if recording.markers else None
    finding = Finding(recording, found, simulated, unproved, noise, told)
    with console.status("writing"):
        written(settings.out, lambda folder: _write(folder, finding))
    tell(console, finding, notes, settings.out)
    if settings.view:
        playback.show(finding, None)
    return told


def _write(folder: Path, finding: Finding) -> None:
    text = answer.text_of(finding.answer)
    (folder / "diagnosis.json").write_text(text, encoding="utf-8")
    simulated = finding.simulated
    if simulated is not None and (simulated.patch.effects or simulated.patch.laws):
        patch, rig = simulated.patch, simulated.patched.rig
        (folder / FILE).write_text(text_of(patch), encoding="utf-8")
        (folder / MODEL_FILE).write_text(mjcf_of(rig), encoding="utf-8")
    blocks = report.blocks_of(finding, folder)
    first = next(story.sentences(finding))
    page.write(folder, report.title_of(finding), first, blocks)
    for picture in (*sorted(folder.glob("law_*.png")), folder / "axes.png"):
        if picture.exists():
            shutil.copy(picture, folder / "picture.png")
            break
    playback.show(finding, folder / "diagnosis.rrd")


if __name__ == "__main__":
    run(main, Settings)
