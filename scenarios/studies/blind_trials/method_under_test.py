"""Answers the questions of blind trials, in a process that has recordings alone.

This is the method under test, in a process of its own. It is given recordings, the
robot's model and names to be taken out of the library; the truth is on no disk yet.
Each answer is diagnosis.json.

Run:    python -m scenarios.studies.blind_trials.method_under_test QUESTIONS.json
Takes:  5 to 20 s for each recording of 151 poses
Expect: one answer for each question, where the question says
"""

import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import tyro

from bench.shared.errors import BenchError, Unusable
from scenarios.pipelines.diagnosis import answer_of, proved
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.pipelines.schema import text_of
from scenarios.report.command_line import run
from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects import HYPOTHESES


class Question(msgspec.Struct, frozen=True):
    """One recording, the model to compare it with, and the answer's file.

    Attributes:
        recording: Folder of the recording.
        model: The robot's model file.
        answer: File of the answer.
        without: Names that are taken out of the library.
        proof: Whether named effects are proved in the simulator.
    """

    recording: str
    model: str
    answer: str
    without: tuple[str, ...] = ()
    proof: bool = False


@dataclass(frozen=True)
class Settings:
    """Flags of the method under test."""

    questions: Annotated[Path, tyro.conf.Positional]
    """JSON file with a list of questions."""


def main(settings: Settings) -> None:
    """Answer every question."""
    try:
        text = settings.questions.read_bytes()
        questions = msgspec.json.decode(text, type=list[Question])
    except (OSError, msgspec.MsgspecError) as error:
        raise Unusable(f"Questions {str(settings.questions)!r}", [str(error)]) from None
    for question in questions:
        waiting = Path(f"{question.answer}.part")
        waiting.write_text(answered(question), encoding="utf-8")
        waiting.replace(question.answer)


def answered(question: Question) -> str:
    """Return diagnosis.json, or the error as `{"failed": …}`."""
    started = time.perf_counter()
    names = [h for h in HYPOTHESES if h.effect not in question.without]
    try:
        nominal = arm_of(Path(question.model))
        recording, arm, _ = read_for(Path(question.recording), nominal)
        found = diagnose(recording, arm, names)
        simulated, why = None, ""
        if question.proof:
            simulated, why = proved(found, recording, arm, Path(question.model))
    except (BenchError, ArithmeticError, LookupError, ValueError) as error:
        print(f"{question.recording}: {error}", file=sys.stderr)
        told = {"failed": f"{type(error).__name__}: {error}"}
        return msgspec.json.encode(told).decode() + "\n"
    seconds = time.perf_counter() - started if question.proof else found.seconds
    return text_of(answer_of(found, simulated, why, (), seconds, question.proof))


if __name__ == "__main__":
    run(main, Settings)
