"""Diagnoses a recording by the engine that fits it, and writes the answer to a folder.

A stream with second encoders and no tracked target goes to the comparison of encoders;
unloaded positions whose mismatch few effects do not explain go to the calibration; all
others are diagnosed, and proved in the simulator.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from bench.shared.errors import BenchError
from scenarios.pipelines import diagnose, next_experiments
from scenarios.pipelines.compare_encoders import calls_for_comparison, compare_encoders
from scenarios.pipelines.diagnosis import Result, asked, proved
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.pipelines.recording_check import replicate_noise
from scenarios.pipelines.schema import Answer
from scenarios.report import playback
from scenarios.report.output_folder import DECISIONS, FILES, refuse_folder, write_folder
from scenarios.report.sections import calibration
from scenarios.report.sections.diagnosis import write_answer, write_diagnosis
from scenarios.report.sections.dual_encoder import write_outcome
from scenarios.report.summary import tell
from stiffness.regression.splits import subsample_poses


def diagnose_to_folder(
    recording_folder: Path, robot: Path, out: Path, console: Console, view: bool = False
) -> Answer:
    """Diagnose a recording, prove what was found, and write the answer.

    Args:
        recording_folder: Where the recording is.
        robot: Model of the robot, MJCF or URDF.
        out: Folder for the answer.
        console: Where progress and the summary are printed.
        view: Whether to open the viewer too.

    Raises:
        BenchError: Where recording or model cannot be used, or nothing can be written.
        Exception: A defect of this tool, after the results before it are written.
    """
    started = time.perf_counter()
    refuse_folder(out, recording_folder)
    with console.status("reading"):
        recording, arm, notes = read_for(recording_folder, arm_of(robot))
    if calls_for_comparison(recording):
        compared = compare_encoders(recording, robot)
        first = write_outcome(out, compared)
        if view and compared.axes:
            playback.show_comparison(compared.axes, None)
        for line in (first, *notes, out / "report.html"):
            console.print(f"{line}", markup=False, highlight=False)
        return compared.answer
    with console.status("comparing with the model"):
        whole = recording
        recording, sampled = subsample_poses(whole)
        notes = (*notes, sampled) if sampled else notes
        found = asked(recording, arm)
    defects: list[Exception] = []
    if diagnose.calls_for_calibration(recording, found):
        rejected = found.detection.p_value
        with _kept(defects):
            outcome = diagnose.try_calibration(whole, arm, robot, console, rejected)
            if outcome is not None:
                calibration.write_calibration(out, outcome)
                if view:
                    calibration.show(outcome)
                console.print(f"{out / 'report.html'}", markup=False)
                return outcome.answer
    simulated, unproved, steps = None, "", ()
    with console.status("proving it in the simulator"), _kept(defects):
        unproved = "this tool has a defect, which is told at the end."
        simulated, unproved = proved(found, recording, arm, robot)
        steps = next_experiments.proposed(found, None if unproved else simulated)
    told = diagnose.answer_of(
        found, simulated, unproved, steps, time.perf_counter() - started
    )
    noise = replicate_noise(recording) if recording.markers else None
    result = Result(recording, found, simulated, unproved, noise, told)
    kept = (*FILES, DECISIONS)
    with console.status("writing"):
        try:
            write_folder(out, lambda folder: write_diagnosis(folder, result), kept)
        except BenchError:
            raise
        except Exception:
            write_folder(out, lambda folder: write_answer(folder, told))
            raise
    tell(console, result, notes, out)
    if view:
        playback.show_diagnosis(result, None)
    for defect in defects:
        raise defect
    return told


@contextmanager
def _kept(defects: list[Exception]) -> Iterator[None]:
    """Keep a defect of this tool for later, so that results are written first."""
    try:
        yield
    except BenchError:
        raise
    except Exception as defect:
        defects.append(defect)
