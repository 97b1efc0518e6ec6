"""Diagnoses a recording by the engine that fits it; the result states and draws itself.

A stream with second encoders and no tracked target goes to the comparison of encoders;
unloaded positions whose mismatch few effects do not explain go to the calibration; all
others are diagnosed, and proved in the simulator.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from bench.proof.setup import why_not_simulated
from bench.shared.errors import BenchError
from bench.shared.models import RobotModel
from bench.shared.recording import Recording
from scenarios.pipelines import diagnosis as pipeline
from scenarios.pipelines import next_experiments
from scenarios.pipelines.diagnosis import Result, asked, proved
from scenarios.pipelines.inputs import (
    arm_of,
    read_for,
    said_of_one_pose,
    under_known_loads,
)
from scenarios.pipelines.recording_check import replicate_noise
from scenarios.pipelines.schema import Answer, Called
from scenarios.report import summary
from scenarios.report.data_files import refuse_folder, write_folder
from scenarios.report.sections import diagnosis
from stiffness.regression.splits import subsample_poses
from stiffness.robot.arm import Arm

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console

    from bench.patch import Patch
    from scenarios.pipelines.calibration import CalibrationOutcome
    from scenarios.pipelines.compare_encoders import ComparisonOutcome

# --- The result -----------------------------------------------------------------------


@dataclass(frozen=True, repr=False)
class PipelineResult:
    """What was found and proved, by whichever engine the recording calls for.

    It states itself in about five lines, gives a name as `result["creep", "a3"]`, and
    explains, draws and writes itself.

    Attributes:
        found: What the engine found, with its proof.
        section: The section of the report that draws and writes this outcome.
    """

    answer: Answer
    found: Result | CalibrationOutcome | ComparisonOutcome
    notes: tuple[str, ...]
    section: ModuleType

    def __repr__(self):
        """Return the story in about five lines."""
        return "\n".join(summary.narrative(self.answer))

    def __getitem__(self, name: tuple[str, str]) -> Called:
        """Return what was named, by effect and place.

        Raises:
            KeyError: Where it was not named, saying why.
        """
        for one in self.answer.named:
            if (one.effect, one.where) == name:
                return one
        raise KeyError(self.why_not(*name))

    @property
    def patch(self) -> Patch | None:
        """What the simulator was given, as refined there; None: nothing was."""
        return self.found.patch

    def why_not(self, effect: str, where: str) -> str:
        """Say why an effect was not named at a place.

        Args:
            effect: In the vocabulary.
            where: The place.

        Raises:
            UnknownName: Where there is no such effect.
        """
        return self.found.why_not(effect, where)

    def figure(self, where: str = "") -> Figure:
        """Draw what was found.

        Args:
            where: An axis of a diagnosis, whose law is drawn; empty: turn over torque
                of all axes, or the error before and after, by what was measured.

        Raises:
            BenchError: Where nothing was simulated that could be drawn.
            UnknownName: Where there is no such axis.
        """
        return self.section.figure(self.found, where)

    def report(self, folder: Path | str) -> Path:
        """Write what `python -m scenarios.diagnose` writes, and return the report.

        Args:
            folder: Made if it is not there; files of an earlier answer are replaced.

        Raises:
            Unusable: Where nothing can be written; then nothing is.
            Exception: A defect of this tool, after diagnosis.json was written.
        """
        folder = Path(folder)
        try:
            self.section.write_files(folder, self.found)
        except BenchError:
            raise
        except Exception:
            write_folder(folder, lambda f: diagnosis.write_answer(f, self.answer))
            raise
        return folder / "report.html"

    def show(self) -> None:
        """Open the viewer on it, where there is something to see."""
        self.section.show(self.found)


# --- From a recording -----------------------------------------------------------------


def diagnose(
    recording: Recording | Path | str,
    model: RobotModel | Path | str,
    said: Callable[[str], object] = lambda _: None,
) -> PipelineResult:
    """Find where and why a recording and a model differ, and prove it in the simulator.

    Args:
        recording: As `bench.read` returns it, or its folder.
        model: As `bench.load_model` returns it, or its file, MJCF or URDF.
        said: Callback that receives a line on each step of a calibration.

    Raises:
        BenchError: Where recording or model cannot be used, with all reasons.
    """
    started = time.perf_counter()
    if isinstance(model, RobotModel):
        file, arm = model.file, Arm.from_model(model)
    else:
        file, arm = Path(model), arm_of(Path(model))
    if isinstance(recording, Recording):
        recording, less = under_known_loads(recording)
        notes = (*recording.notes, *said_of_one_pose(recording), *less)
        arm = arm.for_recording(recording)
    else:
        recording, arm, notes = read_for(Path(recording), arm)
    defects: list[Exception] = []
    result = _Run(recording, arm, file, notes, started).result(said, _quiet, defects)
    for defect in defects:
        raise defect
    return result


def diagnose_to_folder(
    recording_folder: Path, robot: Path, out: Path, console: Console, view: bool = False
) -> Answer:
    """Diagnose a recording, prove what was found, and write the answer.

    Raises:
        BenchError: Where recording or model cannot be used, or nothing can be written.
        Exception: A defect of this tool, after the results before it are written.
    """
    started = time.perf_counter()
    refuse_folder(out, recording_folder, robot)
    status = console.status if console.is_terminal else _plain_status
    with status("reading"):
        recording, arm, notes = read_for(recording_folder, arm_of(robot))
    said = partial(console.print, markup=False, highlight=False)
    defects: list[Exception] = []
    run = _Run(recording, arm, robot, notes, started)
    result = run.result(said, status, defects)
    with status("writing"):
        report = result.report(out)
    if isinstance(result.found, Result):
        summary.tell(console, result.found, result.notes, out)
    else:
        for line in (*result.notes, report):
            said(f"{line}")
    if view:
        result.show()
    for defect in defects:
        raise defect
    return result.answer


@dataclass(frozen=True)
class _Run:
    """A recording, its nominal arm and the arm's file; when it began."""

    recording: Recording
    arm: Arm
    robot: Path
    notes: tuple[str, ...]
    started: float

    def result(
        self,
        said: Callable[[str], object],
        status: Callable[[str], AbstractContextManager],
        defects: list[Exception],
    ) -> PipelineResult:
        """Ask the engine that the recording calls for.

        `said` receives lines of comparison and calibration, `status` shows what is
        being done, `defects` receives defects of this tool after which something was
        found.
        """
        if pipeline.calls_for_comparison(self.recording):
            return self._compare(said)
        if why := why_not_simulated(self.recording, self.robot):
            said(f"No proof can be made, only a fit: {why}")
        arm, notes = self.arm, self.notes
        with status("comparing with the model"):
            recording, sampled = subsample_poses(self.recording)
            notes = (*notes, sampled) if sampled else notes
            found = asked(recording, arm)
        if pipeline.calls_for_calibration(recording, found):
            with _kept(defects):
                rejected = found.detection.p_value
                if (calibrated := self._calibrate(said, rejected)) is not None:
                    return calibrated
        simulated, unproved, steps = None, "", ()
        with status("proving it in the simulator"), _kept(defects):
            unproved = "this tool has a defect, which is told at the end."
            simulated, unproved = proved(found, recording, arm, self.robot)
            steps = next_experiments.proposed(found, None if unproved else simulated)
        seconds = time.perf_counter() - self.started
        slides = recording.slides
        answer = pipeline.answer_of(
            found, simulated, unproved, steps, seconds, slides=slides
        )
        noise = replicate_noise(recording) if recording.markers else None
        result = Result(recording, found, simulated, unproved, noise, answer)
        return PipelineResult(answer, result, notes, diagnosis)

    def _compare(self, said: Callable[[str], object]) -> PipelineResult:
        from scenarios.pipelines.compare_encoders import compare_encoders
        from scenarios.report.sections import dual_encoder

        compared = compare_encoders(self.recording, self.robot)
        said(dual_encoder.headline(compared))
        return PipelineResult(compared.answer, compared, self.notes, dual_encoder)

    def _calibrate(
        self, said: Callable[[str], object], rejected: float
    ) -> PipelineResult | None:
        outcome = pipeline.try_calibration(
            self.recording, self.arm, self.robot, said, rejected
        )
        if outcome is None:
            return None
        from scenarios.report.sections import calibration

        return PipelineResult(outcome.answer, outcome, self.notes, calibration)


def _plain_status(stage: str) -> AbstractContextManager:
    """Write the stage that begins, where no spinner can be drawn."""
    print(f"{stage} …", file=sys.stderr, flush=True)
    return nullcontext()


def _quiet(_: str) -> AbstractContextManager:
    return nullcontext()


@contextmanager
def _kept(defects: list[Exception]) -> Iterator[None]:
    """Keep a defect of this tool for later, so that results are written first."""
    try:
        yield
    except BenchError:
        raise
    except Exception as defect:
        defects.append(defect)
