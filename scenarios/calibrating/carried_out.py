"""A calibration is carried out, proved and written, all or nothing."""

import os
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import mkdtemp

from rich.console import Console

from bench.errors import Unusable
from bench.patch import FILE, MODEL_FILE, rig_of, text_of, with_arm
from bench.patch_model import mjcf_of
from bench.recording import Recording
from scenarios.calibrating import playback, report
from scenarios.calibrating.answer import answer_of
from scenarios.calibrating.proof import Proof, proved
from scenarios.calibrating.remains import Remains, remains_of
from scenarios.diagnosing import answer as form
from scenarios.diagnosing.schema import Answer
from scenarios.reporting import page
from scenarios.reporting.page import Block
from stiffness.arm import Arm
from stiffness.calibration.calibrated import Calibrated, calibrated
from stiffness.calibration.readings import readings_of
from stiffness.calibration.regions import regions_of


@dataclass(frozen=True)
class Outcome:
    """All that came out."""

    found: Calibrated
    proof: Proof
    remains: Remains
    answer: Answer
    model: Path


def carried_out(
    recording: Recording,
    arm: Arm,
    model: Path,
    draw: int = 0,
    quiet: bool = False,
    rejected: float = 1.0,
) -> Outcome:
    """Calibrate and prove.

    Args:
        recording: Absolute positions, of which the unloaded rows count.
        arm: The nominal arm, with the recording's names.
        model: Its file, for the simulator.
        draw: Which regions are kept back; see `regions_of`.
        quiet: Whether to say nothing on the way.
        rejected: p-value of the nominal arm, where another test has looked at it.

    Raises:
        Unusable: Where the recording cannot be calibrated on.
    """
    started = time.perf_counter()
    console = Console(quiet=quiet)
    readings = readings_of(recording, arm)
    found = calibrated(readings, regions_of(readings, draw), console.print)
    proof = proved(found, recording, model)
    remains = remains_of(found, proof)
    seconds = time.perf_counter() - started
    answer = answer_of(recording.name, found, proof, remains, seconds, rejected)
    console.print(report.first_sentence(answer, proof))
    return Outcome(found, proof, remains, answer, model)


def written(folder: Path, outcome: Outcome, more: Sequence[Block] = ()) -> None:
    """Write diagnosis.json, patch.json, model.xml, pictures and the report.

    Args:
        folder: Where to.
        outcome: All that came out.
        more: What the report goes on with.

    Raises:
        Unusable: Where nothing can be written; then nothing is.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        waiting = Path(mkdtemp(prefix=".calibration-", dir=folder.parent))
    except OSError as error:
        fault = f"it cannot be written: {error}."
        raise Unusable(f"Folder {str(folder)!r}", [fault]) from error
    try:
        o = outcome
        blocks = report.blocks_of(o.found, o.proof, o.remains, o.answer, waiting)
        first = report.first_sentence(o.answer, o.proof)
        title = f"Calibration: {o.answer.recording}"
        page.write(waiting, title, first, [*blocks, *more])
        text = form.text_of(o.answer)
        (waiting / "diagnosis.json").write_text(text, encoding="utf-8")
        rig = rig_of(o.proof.patch, o.model)
        patch = with_arm(o.proof.patch, rig)
        (waiting / FILE).write_text(text_of(patch), encoding="utf-8")
        (waiting / MODEL_FILE).write_text(mjcf_of(rig), encoding="utf-8")
        playback.save(o.found, o.proof, first, waiting / "diagnosis.rrd")
        folder.mkdir(exist_ok=True)
        for file in sorted(waiting.iterdir()):
            os.replace(file, folder / file.name)
    finally:
        shutil.rmtree(waiting, ignore_errors=True)
