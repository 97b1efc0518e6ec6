"""Runs blind trials: recordings out, truths committed by hash, answers, truths last.

A worker generates a trial and keeps its truth in memory. `method_under_test` answers in
a process of its own, which is given recording, model and the hash of the truth, and
puts this hash into its answer. So the answer cannot depend on the truth, and the truth
was fixed before the answer. Only then both go to the process that runs the sweep, which
alone writes: a row of JSON with answer, truth and the hashes of both, that `opened`
compares. Finished trials are kept, and a sweep that was stopped goes on.
"""

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

import msgspec
import numpy as np

from bench.shared.errors import BenchError, Unusable, refuse
from bench.shared.format.folder import write
from bench.shared.recording import Recording
from scenarios.studies.blind_trials.arms import arm_of
from scenarios.studies.blind_trials.generation import generate_trial, name_of, trial_of
from scenarios.studies.blind_trials.method_under_test import ANSWERED, Question
from scenarios.studies.blind_trials.oracle import oracle_gain_mm
from scenarios.studies.blind_trials.score import (
    TrialScore,
    score_answer,
    trial_label,
)
from scenarios.studies.blind_trials.strata import STRATA
from scenarios.studies.sweep import (
    KEY,
    ONE_THREAD,
    ROOT,
    SECONDS,
    Rows,
    Task,
    compact,
    digest_of_code,
    run,
)

# --- Commitments ----------------------------------------------------------------------

SEALED = "truth_sha256"
"""Field of an answer: the hash that its process was given before it answered."""


def opened(row: Mapping[str, Any]) -> tuple[dict, dict, str]:
    """Return answer and truth of a finished trial, and the hash of the method's code.

    Raises:
        Unusable: Where one differs from its published hash, or the answer was given
            before the truth was fixed.
    """
    if not all(isinstance(row.get(part), dict) for part in ("answer", "truth", "seal")):
        refuse("The sweep", [f"row {row[KEY]} is no result of a blind trial."])
    faults = [
        f"the {kind} of trial {row[KEY]} is not the one that was sealed."
        for kind in ("answer", "truth")
        if digest(row[kind]) != row["seal"].get(f"{kind}_sha256")
    ]
    if row["answer"].get(SEALED) != row["seal"].get("truth_sha256"):
        faults.append(f"the answer of trial {row[KEY]} does not seal its truth.")
    refuse("The sweep", faults)
    answer = {**row["answer"], "seconds": row[SECONDS]}
    return answer, row["truth"], row["seal"]["code_sha256"]


def digest(content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of a mapping, as JSON in one line with sorted keys."""
    return sha256(compact(content).encode()).hexdigest()


# --- The sweep ------------------------------------------------------------------------


@dataclass(frozen=True)
class Sweep:
    """Folder and settings of a sweep of blind trials."""

    folder: Path
    seed: int = 0
    arm: str = "kr10"
    poses: int = 151
    proof: bool = False
    keep: bool = False
    nudge_mm: float = 0.0
    jobs: int = 2
    scheduler: str = "local"

    @property
    def rows(self) -> Rows:
        """Its finished trials."""
        return Rows(self.folder / "rows")

    @property
    def drawn_with(self) -> str:
        """What decides which its trials are, in a line."""
        nudge = f", readings nudged by {self.nudge_mm:g} mm" if self.nudge_mm else ""
        proof = "with" if self.proof else "without"
        text = f"{self.arm}, seed {self.seed}, {self.poses} poses{nudge}"
        return f"{text}, {proof} proof\n"

    def request(self, stratum: str, number: int) -> "Request":
        """Return all that is sent to the worker of a trial."""
        drawn = (self.seed, stratum, number, self.arm)
        return Request(*drawn, self.poses, self.proof, self.keep, self.nudge_mm)


@dataclass(frozen=True)
class Request:
    """One trial that is asked for: all that a worker is sent."""

    seed: int
    stratum: str
    number: int
    arm: str
    poses: int
    proof: bool
    keep: bool
    nudge_mm: float = 0.0


@dataclass(frozen=True)
class Tried:
    """What comes back of a trial.

    Attributes:
        row: Its row: `key`, `answer`, `truth`, `seal` and `seconds`.
        files: Contents of files that are kept, by path within the sweep's folder.
    """

    row: dict[str, Any]
    files: dict[str, bytes] = field(default_factory=dict)


def run_trials(
    sweep: Sweep, strata: Sequence[str], first: int, trials: int
) -> Iterator[int]:
    """Run the unfinished trials; yield the number newly done, first the finished."""
    asked = {
        name_of(sweep.seed, stratum, number): sweep.request(stratum, number)
        for number in range(first, first + trials)
        for stratum in strata
    }
    done = sweep.rows.read().keys() & asked.keys()
    yield len(done)
    append = sweep.rows.writer(list(asked))
    tasks = [Task(key, request) for key, request in asked.items() if key not in done]
    for _, made in run(tried, tasks, None, sweep.scheduler, sweep.jobs):
        for name, content in made.files.items():
            file = sweep.folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content)
        append(made.row)
        yield 1


def tried(request: Request, _shared: object = None) -> Tried:
    """Generate one trial, have it answered and commit both; the work of a worker."""
    with TemporaryDirectory(prefix="blind-trial-") as name:
        folder = Path(name)
        arm = arm_of(request.arm, request.seed, folder / "models")
        trial = trial_of(request.seed, request.stratum, request.number, arm)
        made = generate_trial(trial, folder / "models", request.poses)
        place = folder / "recordings" / trial.name
        place.parent.mkdir()
        write(place, nudged(made.recording, request.nudge_mm))
        truth = made.truth
        if request.proof:
            truth |= {"oracle_gain_mm": oracle_gain_mm(place, made.model, made.rig)}
        truth = json.loads(compact(truth))  # as it is read: lists, no tuples
        seal = {"truth_sha256": digest(truth)}
        question = Question(
            recording=str(place),
            model=str(made.model),
            answer=str(folder / "answer.json"),
            truth_sha256=seal["truth_sha256"],
            without=made.left_out,
            proof=request.proof,
            share=bool(trial.stratum.effects),
        )
        ask(question)
        text = Path(question.answer).read_text(encoding="utf-8")
        answer = json.loads(text.replace(name, ""))
        seconds = answer.pop("seconds", 0.0)
        code = digest_of_code("stiffness")
        seal |= {"answer_sha256": digest(answer), "code_sha256": code}
        row = {"answer": answer, "truth": truth, "seal": seal, SECONDS: seconds}
        kept = [*place.iterdir(), made.model] if request.keep else []
        files = {
            file.relative_to(folder).as_posix(): file.read_bytes()
            for file in kept
            if file.is_relative_to(folder)
        }
        return Tried({KEY: trial.name, **row}, files)


def nudged(recording: Recording, size_mm: float) -> Recording:
    """Move every reading at random by up to so much: no answer should change."""
    if size_mm == 0.0 or recording.points is None:
        return recording
    shape = recording.points.shape
    moved = np.random.default_rng(0).uniform(-size_mm, size_mm, shape) * 1e-3
    return replace(recording, points=recording.points + moved)


def scored(sweep: Sweep) -> tuple[list[TrialScore], set[str]]:
    """Return the marks of all finished trials, and the hashes of the codes they had."""
    found, codes, order = [], set(), list(STRATA)
    for name, row in sweep.rows.read().items():
        answer, truth, code = opened(row)
        place = truth["number"], order.index(truth["stratum"])
        label = trial_label(truth)
        found.append((place, score_answer(label, name, answer, truth)))
        codes.add(code)
    return [score for _, score in sorted(found, key=lambda one: one[0])], codes


# --- The process that answers ---------------------------------------------------------

_asked: list[tuple[subprocess.Popen, Any]] = []
"""The process of this worker that answers, and its error output: its start takes
seconds, so it goes on with the next trial."""


def ask(question: Question) -> None:
    """Have a question answered by a process that is given nothing else.

    Raises:
        BenchError: Where the process stops.
    """
    if not _asked:
        errors = TemporaryFile("w+", encoding="utf-8", errors="replace")
        command = [sys.executable, "-m", Question.__module__]
        asked = subprocess.Popen(
            command,
            cwd=ROOT,
            env={**os.environ, **ONE_THREAD},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
        )
        _asked.append((asked, errors))
    asked, errors = _asked[0]
    assert asked.stdin and asked.stdout
    try:
        asked.stdin.write(msgspec.json.encode(question) + b"\n")
        asked.stdin.flush()
        ended = any(line == ANSWERED for line in asked.stdout)
    except BrokenPipeError:
        ended = False
    if not ended:
        _asked.clear()
        asked.wait()
        errors.seek(0)
        raise BenchError(f"The diagnosis stopped: {errors.read().strip()[-2000:]}")


def refuse_other_trials(sweep: Sweep) -> None:
    """Refuse a folder whose trials were drawn with other settings; else record these.

    Raises:
        Unusable: Where the folder holds trials of other settings.
    """
    sweep.folder.mkdir(parents=True, exist_ok=True)
    file = sweep.folder / "sweep.txt"
    if not file.exists():
        file.write_text(sweep.drawn_with, encoding="utf-8")
    elif (theirs := file.read_text(encoding="utf-8")) != sweep.drawn_with:
        fault = f"it holds trials of {theirs.strip()}; give another name."
        raise Unusable(f"Folder {str(sweep.folder)!r}", [fault])
