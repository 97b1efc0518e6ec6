"""Works many independent tasks, here or on a cluster, and keeps what is finished.

`run` spreads tasks over processes of this machine (`local`), over a Dask cluster
(`dask:ADDRESS`) or a Ray cluster (`ray:ADDRESS`), and yields results as they come. A
worker returns its result and writes none of the sweep's files; the caller does. Where a
worker dies, its task alone is worked again elsewhere; a task that ends three workers
ends the sweep. Every worker computes with one thread and has the code and the libraries
of the caller, or refuses: so results are the same to the last bit wherever they were
worked, on processors of one kind.

`Rows` keeps small results as lines of JSON, which merge by copying files together.
"""

import json
import os
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, wait
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

from joblib.externals.loky import process_executor

from bench.shared.errors import BenchError, Unusable, refuse

# --- Tasks ----------------------------------------------------------------------------

SCHEDULERS = "local, dask:ADDRESS or ray:ADDRESS"
DEATHS = 3
"""Workers that one task may end; chosen: one that does it again did not do so by
chance."""
WAIT = 60
"""Time in s that a cluster may take to show its first worker; chosen."""
ROOT = Path(__file__).parents[2]
LIBRARIES = ("mujoco", "pin", "numpy", "scipy", "torch")
ONE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
}
"""Environment of a worker: sums depend on the number of threads in their last bits."""

Work = Callable[[Any, Any], Any]
"""Function of a module that works one task: `work(argument, shared)`."""


class Task(NamedTuple):
    """One task: its name, unique in the sweep, and what is sent to the worker."""

    key: str
    argument: Any


class Answer(NamedTuple):
    """What a worker sends back: a result, or why there is none."""

    result: Any
    refusal: str = ""


def run(
    work: Work,
    tasks: Sequence[Task],
    shared: Any = None,
    scheduler: str = "local",
    jobs: int = 2,
) -> Iterator[tuple[str, Any]]:
    """Work tasks and yield their keys and results, in the order in which they end.

    Tasks begin in their order. The scheduler is `local`, `dask:ADDRESS` or
    `ray:ADDRESS`; no jobs means in this process, with its threads, to look into it.

    Raises:
        Unusable: Where there is no such scheduler or cluster.
        BenchError: What the work raises of this kind; the others' results are lost
            where they were not yielded. Also where a task ends worker after worker.
    """
    kind, _, address = scheduler.partition(":")
    if (kind, address) == ("local", ""):
        ended = _local(work, tasks, shared, jobs)
    elif kind in ("dask", "ray") and address:
        spread = _dask if kind == "dask" else _ray
        ended = spread(address, work, tasks, shared) if tasks else iter(())
    else:
        fault = f"there is no such scheduler; expected {SCHEDULERS}."
        raise Unusable(f"--scheduler {scheduler!r}", [fault])
    for key, answer in ended:
        if answer.refusal:
            raise BenchError(answer.refusal)
        yield key, answer.result


def _worked(work: Work, argument: Any, shared: Any, expected: str) -> Answer:
    """Work one task in a worker; errors that are for people come back as text."""
    if os.environ.get("OMP_NUM_THREADS") != "1":
        return Answer(None, _unfit("has more than one thread; set OMP_NUM_THREADS=1"))
    if fingerprint() != expected:
        return Answer(
            None,
            _unfit(
                "has other code, another Python or other libraries than this machine; "
                "install the same commit with the same constraints.txt there"
            ),
        )
    try:
        return Answer(work(argument, shared))
    except BenchError as error:  # some of them do not go through a pipe
        return Answer(None, str(error))


def _unfit(why: str) -> str:
    return f"The worker on {os.uname().nodename} {why}. What is finished was kept."


@lru_cache
def fingerprint() -> str:
    """Return a SHA-256 of our code, the Python version and the numerical libraries."""
    told = sha256(digest_of_code("bench", "stiffness", "scenarios").encode())
    known = [f"{sys.version_info[:2]}", *(f"{n} {version(n)}" for n in LIBRARIES)]
    told.update("\n".join(known).encode())
    return told.hexdigest()


def digest_of_code(*packages: str) -> str:
    """Return the SHA-256 of paths and contents of all Python files of packages."""
    total = sha256()
    for package in packages:
        for file in sorted((ROOT / package).rglob("*.py")):
            total.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return total.hexdigest()


# --- This machine ---------------------------------------------------------------------

Team = process_executor.ProcessPoolExecutor


def _local(
    work: Work, tasks: Sequence[Task], shared: Any, jobs: int
) -> Iterator[tuple[str, Answer]]:
    """Work on processes of this machine; each is a team of one, so that one may die."""
    if not jobs:
        yield from ((t.key, Answer(work(t.argument, shared))) for t in tasks)
        return
    waiting, deaths = deque(tasks), Counter()
    idle = [_team() for _ in range(min(jobs, len(tasks)))]
    running: dict[Future, tuple[Team, Task]] = {}
    try:
        while waiting or running:
            while waiting and idle:
                team, task = idle.pop(), waiting.popleft()
                sent = (work, task.argument, shared, fingerprint())
                running[team.submit(_worked, *sent)] = team, task
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                team, task = running.pop(future)
                try:
                    answer = future.result()
                except BrokenExecutor as death:
                    team.shutdown(wait=False, kill_workers=True)
                    idle.append(_team())
                    waiting.appendleft(task)
                    deaths[task.key] += 1
                    if deaths[task.key] == DEATHS:
                        raise _deadly(task.key) from death
                else:
                    idle.append(team)
                    yield task.key, answer
    finally:
        for team in (*idle, *(team for team, _ in running.values())):
            team.shutdown(wait=True, kill_workers=True)


def _team() -> Team:
    return Team(max_workers=1, env=ONE_THREAD)


def _deadly(key: str) -> BenchError:
    return BenchError(
        f"Task {key} ended {DEATHS} workers. Is there enough memory for each? "
        "What is finished was kept: the same command goes on."
    )


# --- Clusters -------------------------------------------------------------------------


def _itself(shared: Any) -> Any:
    """Return what all tasks share: as a task of its own, it is made again if lost."""
    return shared


def _dask(
    address: str, work: Work, tasks: Sequence[Task], shared: Any
) -> Iterator[tuple[str, Answer]]:
    try:
        from dask.distributed import Client, KilledWorker, as_completed  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise _not_installed("dask") from None
    what = f"--scheduler 'dask:{address}'"
    try:
        client = Client(address, timeout=WAIT, set_as_default=False)
    except (OSError, ValueError) as error:
        fault = f"no scheduler answers there: {error}; start one with dask scheduler."
        raise Unusable(what, [fault]) from None
    try:
        try:
            client.wait_for_workers(1, timeout=WAIT)
        except TimeoutError:
            fault = f"it has no workers after {WAIT} s; start some with dask worker."
            raise Unusable(what, [fault]) from None
        threads: Any = client.nthreads()
        if max(threads.values()) > 1:
            fault = "a worker takes several tasks at once; start it with --nthreads 1."
            raise Unusable(what, [fault])
        sweep = uuid4().hex
        beside = client.submit(_itself, shared, key=f"shared-{sweep}")
        keys = {}
        for task in tasks:
            sent = (work, task.argument, beside, fingerprint())
            future = client.submit(_worked, *sent, key=f"{task.key}-{sweep}")
            keys[future] = task.key
        for future in as_completed(list(keys), loop=client.loop):
            key = keys.pop(future)
            try:
                answer = future.result()
            except KilledWorker as death:
                raise _deadly(key) from death
            future.release()
            yield key, answer
        client.cancel(beside)
    finally:
        client.close()


def _ray(
    address: str, work: Work, tasks: Sequence[Task], shared: Any
) -> Iterator[tuple[str, Answer]]:
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise _not_installed("ray") from None
    try:
        ray.init(address, log_to_driver=False)
    except (OSError, ValueError, RuntimeError) as error:
        fault = f"no cluster answers there: {error}"
        raise Unusable(f"--scheduler 'ray:{address}'", [fault]) from None
    try:
        remote = ray.remote(num_cpus=1, max_retries=DEATHS - 1)(_worked)
        beside = ray.put(shared)
        keys = {
            remote.remote(work, t.argument, beside, fingerprint()): t.key for t in tasks
        }
        while keys:
            (ended, *_), _ = ray.wait(list(keys), num_returns=1)
            key = keys.pop(ended)
            try:
                answer = ray.get(ended)
            except ray.exceptions.WorkerCrashedError as death:
                raise _deadly(key) from death
            yield key, answer
    finally:
        ray.shutdown()


def _not_installed(library: str) -> Unusable:
    fault = f"{library} is not installed; pip install 'stiffness-bench[{library}]'."
    return Unusable(f"--scheduler {library}", [fault])


# --- Kept rows ------------------------------------------------------------------------

KEY, SECONDS = "key", "seconds"


@dataclass(frozen=True)
class Rows:
    """Finished results of a sweep, one line of JSON each, in all files of a folder.

    A row is a mapping with its task's `key`; `seconds`, what it took, may differ from
    machine to machine. Files of other machines are merged by copying them into the
    folder. A line that was cut off when the machine stopped is worked again.
    """

    folder: Path

    def read(self) -> dict[str, dict[str, Any]]:
        """Return all rows, by key.

        Raises:
            Unusable: Where a line is no row, or two of one key differ.
        """
        found: dict[str, tuple[dict[str, Any], str]] = {}
        faults = []
        for file in sorted(self.folder.glob("*.jsonl")):
            lines = file.read_bytes().split(b"\n")[:-1]
            for number, line in enumerate(lines, start=1):
                place = f"{file.name}, line {number}"
                try:
                    row = json.loads(line)
                    first, where = found.setdefault(row[KEY], (row, place))
                except (ValueError, LookupError, TypeError, RecursionError):
                    faults.append(f"{place}: it is no row of a sweep.")
                    continue
                if _timeless(first) != _timeless(row):
                    faults.append(
                        f"{where} and {place}: results of {row[KEY]} differ; they are "
                        "of other versions or processors. Delete one of both."
                    )
        refuse(f"Folder {str(self.folder)!r}", faults)
        return {key: row for key, (row, _) in found.items()}

    def writer(self, keys: Sequence[str]) -> Callable[[Mapping[str, Any]], None]:
        """Return a function that appends a row to the file of these tasks.

        The file is named by the tasks, so that other slices have other files and the
        same slice goes on in its own.
        """
        name = sha256("\n".join(sorted(keys)).encode()).hexdigest()[:12]
        file = self.folder / f"{name}.jsonl"
        self.folder.mkdir(parents=True, exist_ok=True)
        if file.exists():  # without a line that was cut off
            content = file.read_bytes()
            whole = content[: content.rfind(b"\n") + 1]
            if whole != content:
                os.truncate(file, len(whole))

        def append(row: Mapping[str, Any]) -> None:
            with file.open("ab", buffering=0) as out:
                out.write(compact(row).encode() + b"\n")

        return append


def compact(value: Any) -> str:
    """Return JSON in one line, keys sorted: the same text for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


def _timeless(row: Mapping[str, Any]) -> str:
    """Return a row without what it took; as text, for NaN differs from itself."""
    return compact({k: v for k, v in row.items() if k != SECONDS})
