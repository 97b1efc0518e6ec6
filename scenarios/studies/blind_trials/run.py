"""Runs blind trials: recordings out, answers committed by hash, truth written last.

A hash that was published binds whoever published it.

The accused has answered before anybody can read the truth.

For every trial: the recording is written, the truth stays in memory and only its hash
is published; another process answers; the answer is hashed; then the truth is written.
What is finished is kept, and a sweep that was interrupted goes on with the rest.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from joblib import Parallel, delayed

from bench.shared.errors import BenchError, Unusable
from bench.shared.format.folder import write
from scenarios.studies.blind_trials.draw import BlindTrial
from scenarios.studies.blind_trials.generation import generate_trial
from scenarios.studies.blind_trials.method_under_test import Question
from scenarios.studies.blind_trials.oracle import oracle_gain_mm

# --- Commitments ----------------------------------------------------------------------

ROOT = Path(__file__).parents[3]


def opened(folder: Path, name: str) -> tuple[dict, dict, str]:
    """Return answer and truth of a finished trial, and the hash of the code that spoke.

    Args:
        folder: Of the sweep.
        name: Of the trial.

    Raises:
        Unusable: Where either was changed since it was sealed.
    """
    answer = (folder / "answers" / f"{name}.json").read_bytes()
    truth = (folder / "truth" / f"{name}.json").read_bytes()
    seal = json.loads((folder / "seals" / f"{name}.json").read_text(encoding="utf-8"))
    faults = [
        f"the {kind} of trial {name} is not the one that was sealed."
        for kind, content in (("answer", answer), ("truth", truth))
        if digest(content) != seal[f"{kind}_sha256"]
    ]
    if faults:
        raise Unusable(f"Sweep {str(folder)!r}", faults)
    return json.loads(answer), json.loads(truth), seal["code_sha256"]


def digest(content: bytes) -> str:
    """Return the SHA-256 of some bytes."""
    return hashlib.sha256(content).hexdigest()


def digest_of_code() -> str:
    """Return the SHA-256 of all that claims anything."""
    total = hashlib.sha256()
    for file in sorted((ROOT / "stiffness").rglob("*.py")):
        total.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return total.hexdigest()


def publish_hashes(file: Path, hashes: Mapping[str, str]) -> None:
    """Publish hashes."""
    write_whole(file, json.dumps(hashes, indent=2) + "\n")


def write_whole(file: Path, text: str) -> None:
    """Write a file whole or not at all."""
    waiting = file.with_suffix(".part")
    waiting.write_text(text, encoding="utf-8")
    waiting.replace(file)


# --- The sweep ------------------------------------------------------------------------

AT_ONCE = 12
"""Trials that one answering process is asked; chosen: its start takes seconds."""


@dataclass(frozen=True)
class Sweep:
    """Where a sweep's files are, and how it is done.

    Attributes:
        folder: For everything.
        poses: How many postures each recording has.
        proof: Whether names are proved in the simulator.
        keep: Whether recordings stay after they were answered.
        jobs: How many trials run side by side.
    """

    folder: Path
    poses: int = 151
    proof: bool = False
    keep: bool = False
    jobs: int = 2

    def file(self, kind: str, trial: BlindTrial) -> Path:
        """Return the file of a trial: its `answers`, `truth` or `seals`."""
        return self.folder / kind / f"{trial.name}.json"

    def done(self, trial: BlindTrial) -> bool:
        """Return whether a trial is finished; the truth is written last."""
        return self.file("truth", trial).is_file()


def run_trials(sweep: Sweep, trials: Sequence[BlindTrial]) -> Iterator[int]:
    """Carry out what is not finished, and yield how many more are, time after time.

    Raises:
        BenchError: Where a trial cannot be made, or the answering process fails.
    """
    for kind in ("recordings", "answers", "truth", "seals", "models"):
        (sweep.folder / kind).mkdir(parents=True, exist_ok=True)
    left = [trial for trial in trials if not sweep.done(trial)]
    yield len(trials) - len(left)
    chunks = [left[at : at + AT_ONCE] for at in range(0, len(left), AT_ONCE)]
    pool = Parallel(n_jobs=sweep.jobs, return_as="generator_unordered")
    for done in pool(delayed(tried)(sweep, chunk) for chunk in chunks):
        yield int(done or 0)


def tried(sweep: Sweep, trials: Sequence[BlindTrial]) -> int:
    """Carry out a few trials and return how many they were."""
    truths, questions = {}, []
    for trial in trials:
        made = generate_trial(trial, sweep.folder / "models", sweep.poses)
        place = sweep.folder / "recordings" / trial.name
        write(place, made.recording)
        truth = made.truth
        if sweep.proof:
            gain = oracle_gain_mm(place, made.model, made.rig)
            truth = truth | {"oracle_gain_mm": gain}
        truths[trial.name] = json.dumps(truth, indent=2) + "\n"
        publish_hashes(
            sweep.file("seals", trial),
            {"truth_sha256": digest(truths[trial.name].encode())},
        )
        answer = sweep.file("answers", trial)
        answer.unlink(missing_ok=True)
        questions.append(
            Question(
                recording=str(place.resolve()),
                model=str(made.model.resolve()),
                answer=str(answer.resolve()),
                without=made.left_out,
                proof=sweep.proof,
            )
        )
    _asked(sweep, questions, trials[0].name)
    for trial in trials:
        answer = sweep.file("answers", trial).read_bytes()
        hashes = {
            "truth_sha256": digest(truths[trial.name].encode()),
            "answer_sha256": digest(answer),
            "code_sha256": digest_of_code(),
        }
        publish_hashes(sweep.file("seals", trial), hashes)
        write_whole(sweep.file("truth", trial), truths[trial.name])
        if not sweep.keep:
            shutil.rmtree(sweep.folder / "recordings" / trial.name)
    return len(trials)


def _asked(sweep: Sweep, questions: Sequence[Question], label: str) -> None:
    """Put questions to a process that is given nothing else."""
    file = sweep.folder / f".questions-{label}.json"
    file.write_bytes(msgspec.json.encode(questions))
    try:
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "scenarios.studies.blind_trials.method_under_test",
                str(file.resolve()),
            ],
            cwd=ROOT,
            env={**os.environ, "OMP_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
    finally:
        file.unlink()
    if done.returncode:
        raise BenchError(f"The diagnosis stopped: {done.stderr.strip()[-2000:]}")


def refuse_other_trials(folder: Path, mine: str) -> None:
    """Refuse a folder whose trials were drawn otherwise; remember how these are.

    Args:
        folder: Of the sweep; made if it is not there.
        mine: How these trials are drawn, one line.

    Raises:
        Unusable: Where it holds others.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "sweep.txt"
    if not file.exists():
        file.write_text(mine, encoding="utf-8")
    elif (theirs := file.read_text(encoding="utf-8")) != mine:
        fault = f"it holds trials of {theirs.strip()}; give another name."
        raise Unusable(f"Folder {str(folder)!r}", [fault])
