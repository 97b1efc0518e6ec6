"""Answers the questions of blind trials, in a process that has recordings alone.

This is the method under test, in a process of its own. It is given recordings, the
robot's model, names to be taken out of the library and the hash of the truth, which is
on no disk yet. Each answer is diagnosis.json with this hash.

Run:    python -m scenarios.studies.blind_trials.method_under_test < QUESTIONS
Takes:  5 to 20 s for each recording of 151 poses
Expect: for each line, a question in JSON, an answer where the question says, and a line
        that it is there
"""

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from bench.shared.errors import BenchError, Unusable
from bench.shared.recording import Recording
from scenarios.pipelines.diagnosis import answer_of, proved
from scenarios.pipelines.inputs import arm_of, read_for
from scenarios.pipelines.schema import text_of
from scenarios.report.command_line import run
from scenarios.studies.blind_trials.linear_model import (
    explained_share,
    linear_model_of,
    with_its_columns,
)
from stiffness.diagnosis.diagnose import diagnose
from stiffness.diagnosis.model_fit import ModelTerm
from stiffness.diagnosis.nominal_fit import prepare
from stiffness.diagnosis.result import Diagnosis
from stiffness.effects import HYPOTHESES
from stiffness.experiment.sensor_noise import average_encoders
from stiffness.robot.arm import Arm


class Question(msgspec.Struct, frozen=True):
    """One recording, the model to compare it with, and the answer's file.

    Attributes:
        truth_sha256: Hash of the truth, which goes into the answer unseen.
        without: Names that are taken out of the library.
        proof: Whether named effects are proved in the simulator.
        share: Whether the answer also says what share of the mismatch on the poses kept
            back its names explain in the linear model, as `linear_share`.
    """

    recording: str
    model: str
    answer: str
    truth_sha256: str
    without: tuple[str, ...] = ()
    proof: bool = False
    share: bool = False


ANSWERED = b"answered\n"
"""What is said on standard output after each answer."""


@dataclass(frozen=True)
class Settings:
    """No flags: questions come by standard input."""


def main(_: Settings) -> None:
    """Answer every question, until there are no more."""
    for line in sys.stdin.buffer:
        try:
            question = msgspec.json.decode(line, type=Question)
        except msgspec.MsgspecError as error:
            raise Unusable("A question", [str(error)]) from None
        answer = json.loads(answered(question))
        sealed = answer | {"truth_sha256": question.truth_sha256}
        Path(question.answer).write_text(json.dumps(sealed), encoding="utf-8")
        sys.stdout.buffer.write(ANSWERED)
        sys.stdout.flush()


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
        print(f"{question.recording}: {error}", file=sys.stderr, flush=True)
        told = {"failed": f"{type(error).__name__}: {error}"}
        return msgspec.json.encode(told).decode() + "\n"
    seconds = time.perf_counter() - started if question.proof else found.seconds
    text = text_of(answer_of(found, simulated, why, (), seconds, question.proof))
    if not question.share:
        return text
    share = linear_share_of(found, recording, arm)
    return json.dumps(json.loads(text) | {"linear_share": share}, indent=2) + "\n"


def linear_share_of(found: Diagnosis, recording: Recording, arm: Arm) -> float:
    """Return the share that an answer's names explain on the poses kept back."""
    choices = []
    for one in found.named:
        shape = np.array(one.shape)
        laws = [
            law
            for law in HYPOTHESES
            if law.effect == one.name.effect
            and (len(law.shape_names) == len(shape) or law.is_sum)
        ]
        choices.append([ModelTerm(law, one.name.where, shape) for law in laws])
    arm = arm.for_recording(recording)
    prepared = prepare(average_encoders(recording), arm)
    model = linear_model_of(prepared, choices, with_shapes=False)
    return explained_share(with_its_columns(prepared, model))


if __name__ == "__main__":
    run(main, Settings)
