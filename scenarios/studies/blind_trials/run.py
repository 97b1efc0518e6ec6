"""Runs blind trials: recordings out, answers committed by hash, truth written last.

For every trial the recording is written and the hash of its truth published, while the
truth stays in memory; `method_under_test` answers in another process; the answer's hash
is published; then the truth is written. So the answer cannot depend on the truth, and
neither can be changed later: `opened` compares both with their hashes. Finished trials
are kept, and an interrupted sweep goes on with the others.
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
    """Return answer and truth of a finished trial, and the hash of the method's code.

    Args:
        folder: Folder of the sweep.
        name: Name of the trial.

    Raises:
        Unusable: Where either differs from its published hash.
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
    """Return the SHA-256 of paths and contents of all Python files of `stiffness`."""
    total = hashlib.sha256()
    for file in sorted((ROOT / "stiffness").rglob("*.py")):
        total.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return total.hexdigest()


def publish_hashes(file: Path, hashes: Mapping[str, str]) -> None:
    """Write hashes to a file in JSON, whole or not at all."""
    write_whole(file, json.dumps(hashes, indent=2) + "\n")


def write_whole(file: Path, text: str) -> None:
    """Write a file whole or not at all."""
    waiting = file.with_suffix(".part")
    waiting.write_text(text, encoding="utf-8")
    waiting.replace(file)


# --- The sweep ------------------------------------------------------------------------

AT_ONCE = 12
"""Trials that one process answers; chosen: its start takes seconds."""


@dataclass(frozen=True)
class Sweep:
    """Folder and settings of a sweep of blind trials.

    Attributes:
        folder: Folder of all its files.
        poses: Number of postures of each recording.
        proof: Whether names are proved in the simulator.
        keep: Whether recordings are kept after they were answered.
        jobs: Number of processes.
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
    """Run the unfinished trials; yields the number newly done, first the finished ones.

    Raises:
        BenchError: Where a trial cannot be generated, or the answering process fails.
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
    """Generate, answer and commit a few trials; returns their number."""
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
                share=bool(trial.stratum.effects),
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
    """Have questions answered by a process that is given nothing else."""
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
    """Refuse a folder whose trials were drawn with other settings; else record these.

    Args:
        folder: Folder of the sweep; made if it is not there.
        mine: Settings of the draws, one line.

    Raises:
        Unusable: Where the folder holds trials of other settings.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "sweep.txt"
    if not file.exists():
        file.write_text(mine, encoding="utf-8")
    elif (theirs := file.read_text(encoding="utf-8")) != mine:
        fault = f"it holds trials of {theirs.strip()}; give another name."
        raise Unusable(f"Folder {str(folder)!r}", [fault])
